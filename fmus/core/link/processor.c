/* processor.c - an emulated processor, started for one link or shared by several, and never left
 * behind.
 *
 * A private folder holds three named pipes: `to_board` and `from_board` carry the frames, `life`
 * ends it. A keeper, forked here, starts the emulator and reads `life`: links join (j) and leave
 * (q) by a byte, and if the whole program is killed, the pipe ends by itself. Then the keeper ends
 * the emulator and removes the folder. In the keeper only functions run that are safe after a fork
 * of a program with threads. */
/* SPDX-License-Identifier: BSD-2-Clause */
#define _GNU_SOURCE
#include "stream.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#ifdef __linux__
#include <sys/prctl.h>
#endif

enum { LONG_PATH = PATH_SIZE + 40, ARGUMENT_SIZE = 2 * PATH_SIZE + 200, MOST_FILES = 4096 };

typedef struct {
    char to_board[LONG_PATH], from_board[LONG_PATH], life[LONG_PATH], log[LONG_PATH],
        lock[LONG_PATH];
} Paths;

typedef struct {
    char text[MOST_ARGUMENTS][ARGUMENT_SIZE];
    char *list[MOST_ARGUMENTS + 1];
} Command;

static void name_paths(Paths *p, const Stream *s)
{
    snprintf(p->to_board, LONG_PATH, "%s/to_board", s->folder);
    snprintf(p->from_board, LONG_PATH, "%s/from_board", s->folder);
    snprintf(p->life, LONG_PATH, "%s/life", s->folder);
    snprintf(p->log, LONG_PATH, "%s/log", s->folder);
    snprintf(p->lock, LONG_PATH, "%s/lock", s->folder);
}

/* what is left of the folder when nobody uses it any more; not 0 if that fails */
static int remove_folder(const Paths *p, const char *folder)
{
    unlink(p->to_board), unlink(p->from_board), unlink(p->life), unlink(p->log), unlink(p->lock);
    return rmdir(folder);
}

static bool gave_up(Stream *s, const char *doing)
{
    int reason = errno;
    snprintf(s->reason, sizeof s->reason, "the emulator cannot be started: %.1200s (%.200s)", doing,
             strerror(reason));
    return false;
}

/* ---- the command: @ is the folder of the resources, % that of the pipes */
static void spell(char *text, const char *argument, const Config *c, const Stream *s)
{
    char *end = text + ARGUMENT_SIZE - 1;
    for (; *argument && text < end; argument++) {
        const char *part = *argument == '@' ? c->resources : *argument == '%' ? s->folder : NULL;
        if (!part) *text++ = *argument;
        for (; part && *part && text < end; part++) *text++ = *part;
    }
    *text = 0;
}

static void spell_command(Command *command, const Config *c, const Stream *s)
{
    for (size_t i = 0; i < c->arguments; i++) {
        spell(command->text[i], c->argument[i], c, s);
        command->list[i] = command->text[i];
    }
    command->list[c->arguments] = NULL;
}

static bool on_path(const char *name)
{
    const char *path = getenv("PATH");
    char file[LONG_PATH];
    while (path && *path) {
        size_t length = strcspn(path, ":");
        snprintf(file, sizeof file, "%.*s/%s", (int)length, path, name);
        if (access(file, X_OK) == 0) return true;
        path += length + (path[length] == ':');
    }
    return strchr(name, '/') && access(name, X_OK) == 0;
}

/* ---- the keeper */
static void default_signals(void)
{
    sigset_t none;
    const int numbers[] = {SIGINT, SIGTERM, SIGHUP, SIGPIPE, SIGQUIT, SIGCHLD};
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) signal(numbers[i], SIG_DFL);
    sigemptyset(&none);
    sigprocmask(SIG_SETMASK, &none, NULL);
}

/* standard streams go nowhere, and nothing that the program has open is kept open here */
static void keep_only(int kept)
{
    int nothing = open("/dev/null", O_RDWR);
    for (int file = 0; file < 3; file++) dup2(nothing, file);
    for (int file = 3; file < MOST_FILES; file++)
        if (file != kept) close(file);
}

static void become_emulator(char *const command[], int log)
{
#ifdef __linux__
    prctl(PR_SET_PDEATHSIG, SIGKILL);
#endif
    dup2(log, 1), dup2(log, 2);
    execvp(command[0], command);
    _exit(127);
}

/* until every link has left, or the program with them has ended; the pipe of the emulator ends
 * with it, and with its pipes gone nobody waits for it any more */
static void wait_for_the_end(int life, int alive, const Paths *p)
{
    struct pollfd watched[] = {{life, POLLIN, 0}, {alive, POLLIN, 0}};
    for (long members = 0;;) {
        char word;
        if (poll(watched, 2, -1) < 0 && errno != EINTR) return;
        if (watched[1].revents) unlink(p->to_board), watched[1].fd = -1;
        if (!watched[0].revents) continue;
        if (read(life, &word, 1) != 1) return;
        members += word == 'j' ? 1 : -1;
        if (members <= 0) return;
    }
}

static void keep(const Paths *p, const char *folder, char *const command[])
{
    int alive[2], log;
    setsid();
    default_signals();
    int own = fcntl(open(p->life, O_RDONLY), F_DUPFD, 3);
    keep_only(own);
    log = open(p->log, O_WRONLY | O_CREAT, 0600);
    if (pipe(alive) < 0) _exit(1);
    pid_t emulator = fork();
    if (emulator == 0) close(own), close(alive[0]), become_emulator(command, log);
    close(alive[1]);
    wait_for_the_end(own, alive[0], p);
    if (emulator > 0) kill(emulator, SIGKILL), waitpid(emulator, NULL, 0);
    _exit(remove_folder(p, folder));
}

/* ---- the folder */
static bool make_folder(Stream *s, const Config *c, bool *first)
{
    const char *place = getenv("TMPDIR");
    struct stat about;
    if (!place || !*place) place = "/tmp";
    *first = true;
    if (!*c->group) {
        snprintf(s->folder, sizeof s->folder, "%s/slnk-XXXXXX", place);
        return mkdtemp(s->folder) != NULL;
    }
    snprintf(s->folder, sizeof s->folder, "%s/slnk-%ld-%s", place, (long)getpid(), c->group);
    if (mkdir(s->folder, 0700) == 0) return true;
    *first = false;
    return lstat(s->folder, &about) == 0 && S_ISDIR(about.st_mode) && about.st_uid == geteuid() &&
           (about.st_mode & 077) == 0;
}

/* ---- a link joins */
static bool wait_for_keeper(Stream *s, const Paths *p, double until)
{
    while ((s->life = open(p->life, O_WRONLY | O_NONBLOCK | O_CLOEXEC)) < 0) {
        if (now_s() > until) return gave_up(s, p->life);
        nanosleep(&(struct timespec){0, 1000000}, NULL);
    }
    return true;
}

static bool begin(Stream *s, const Paths *p, const Config *c)
{
    Command *command = calloc(1, sizeof *command);
    if (!command || c->arguments == 0) return free(command), gave_up(s, "no command");
    spell_command(command, c, s);
    if (!on_path(command->list[0]))
        return errno = ENOENT, gave_up(s, command->list[0]), free(command), false;
    if (mkfifo(p->to_board, 0600) < 0 || mkfifo(p->from_board, 0600) < 0 ||
        mkfifo(p->life, 0600) < 0)
        return free(command), gave_up(s, s->folder);
    int life = open(p->life, O_RDWR | O_NONBLOCK | O_CLOEXEC); /* so that the keeper's own opens */
    s->keeper = fork();
    if (s->keeper == 0) keep(p, s->folder, command->list);
    free(command);
    bool fine = s->keeper > 0 ? wait_for_keeper(s, p, now_s() + c->timeout) : gave_up(s, "fork");
    close(life);
    return fine;
}

/* the emulator has opened its ends when ours can be written to */
static bool open_pipes(Stream *s, const Paths *p, double until)
{
    char words[REASON_SIZE / 2] = "";
    s->in = open(p->from_board, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    while (s->in >= 0 && (s->out = open(p->to_board, O_WRONLY | O_NONBLOCK | O_CLOEXEC)) < 0) {
        if (errno != ENXIO || now_s() > until) break;
        nanosleep(&(struct timespec){0, 1000000}, NULL);
    }
    if (s->out >= 0) return true;
    last_words(s, words, sizeof words);
    return gave_up(s, *words ? words : "it does not open its pipes");
}

bool start_processor(Stream *s, const Config *c)
{
    Paths p;
    bool first;
    if (!make_folder(s, c, &first)) return gave_up(s, s->folder);
    name_paths(&p, s);
    if (first ? !begin(s, &p, c) : !wait_for_keeper(s, &p, now_s() + c->timeout)) {
        if (first && s->keeper <= 0) remove_folder(&p, s->folder); /* nobody else does */
        return false;
    }
    if (write(s->life, "j", 1) != 1 || !open_pipes(s, &p, now_s() + c->timeout)) return false;
    if (*c->group) s->lock = open(p.lock, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    return true;
}

/* ---- and leaves */
enum { PATIENCE_MS = 2000 };

static void wait_for_keeper_to_end(const Stream *s, bool alone)
{
    for (int i = 0; i < (alone ? PATIENCE_MS : 20); i++) {
        if (waitpid(s->keeper, NULL, WNOHANG) != 0) return;
        nanosleep(&(struct timespec){0, 1000000}, NULL);
    }
    if (alone) kill(s->keeper, SIGKILL), waitpid(s->keeper, NULL, 0);
}

void leave_processor(Stream *s)
{
    if (s->lock >= 0) close(s->lock);
    if (s->life >= 0) {
        ssize_t said = write(s->life, "q", 1);
        close(s->life);
        if (said == 1 && s->keeper > 0) wait_for_keeper_to_end(s, s->lock < 0);
    }
    s->life = s->lock = -1;
    s->keeper = 0;
}

void last_words(const Stream *s, char *text, size_t size)
{
    char path[LONG_PATH], line[REASON_SIZE];
    text[0] = 0;
    if (!*s->folder) return;
    snprintf(path, sizeof path, "%s/log", s->folder);
    FILE *log = fopen(path, "r");
    while (log && fgets(line, sizeof line, log)) {
        line[strcspn(line, "\n")] = 0;
        if (*line) snprintf(text, size, "%s", line);
    }
    if (log) fclose(log);
}
