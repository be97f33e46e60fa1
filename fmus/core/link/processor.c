/* processor.c - emulated processor, started for one link or shared by several, and always ended
 * with them.
 *
 * A private folder contains three named pipes: `to_board` and `from_board` carry the frames, `life`
 * controls the lifetime of the emulator. A supervisor process, forked here, starts the emulator and
 * reads `life`: a link writes the byte j when it joins and q when it leaves, and the pipe is closed
 * if the whole program is killed. When all links have left or the pipe is closed, the supervisor
 * ends the emulator and removes the folder. The supervisor calls only functions that are safe after
 * a fork of a program with threads. */
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

/* removes the folder with its files; returns 0 if all are removed */
static int remove_folder(const Paths *p, const char *folder)
{
    unlink(p->to_board), unlink(p->from_board), unlink(p->life), unlink(p->log), unlink(p->lock);
    return rmdir(folder);
}

static bool fail_start(Stream *s, const char *doing)
{
    int error = errno;
    snprintf(s->reason, sizeof s->reason, "the emulator cannot be started: %.1200s (%.200s)", doing,
             strerror(error));
    return false;
}

/* ---- the command; in its arguments @ is the folder of the resources, % the folder of the pipes */
static void expand_argument(char *text, const char *argument, const Config *c, const Stream *s)
{
    char *end = text + ARGUMENT_SIZE - 1;
    for (; *argument && text < end; argument++) {
        const char *part = *argument == '@' ? c->resources : *argument == '%' ? s->folder : NULL;
        if (!part) *text++ = *argument;
        for (; part && *part && text < end; part++) *text++ = *part;
    }
    *text = 0;
}

static void build_command(Command *command, const Config *c, const Stream *s)
{
    for (size_t i = 0; i < c->arguments; i++) {
        expand_argument(command->text[i], c->argument[i], c, s);
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

/* ---- the supervisor */
static void default_signals(void)
{
    sigset_t none;
    const int numbers[] = {SIGINT, SIGTERM, SIGHUP, SIGPIPE, SIGQUIT, SIGCHLD};
    for (size_t i = 0; i < sizeof numbers / sizeof numbers[0]; i++) signal(numbers[i], SIG_DFL);
    sigemptyset(&none);
    sigprocmask(SIG_SETMASK, &none, NULL);
}

/* redirects the standard streams to /dev/null and closes the files of the parent program with
 * numbers below MOST_FILES except `needed` */
static void close_other_files(int needed)
{
    int nothing = open("/dev/null", O_RDWR);
    for (int file = 0; file < 3; file++) dup2(nothing, file);
    for (int file = 3; file < MOST_FILES; file++)
        if (file != needed) close(file);
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

/* returns when every link has left or the program that contains the links has ended. If the
 * emulator ends earlier, the pipe `to_board` is removed, so that no link waits for an emulator. */
static void wait_for_links(int life, int alive, const Paths *p)
{
    struct pollfd watched[] = {{life, POLLIN, 0}, {alive, POLLIN, 0}};
    for (long members = 0;;) {
        char byte;
        if (poll(watched, 2, -1) < 0 && errno != EINTR) return;
        if (watched[1].revents) unlink(p->to_board), watched[1].fd = -1;
        if (!watched[0].revents) continue;
        if (read(life, &byte, 1) != 1) return;
        members += byte == 'j' ? 1 : -1;
        if (members <= 0) return;
    }
}

static void run_supervisor(const Paths *p, const char *folder, char *const command[])
{
    int alive[2], log;
    setsid();
    default_signals();
    int life = fcntl(open(p->life, O_RDONLY), F_DUPFD, 3);
    close_other_files(life);
    log = open(p->log, O_WRONLY | O_CREAT, 0600);
    if (pipe(alive) < 0) _exit(1);
    pid_t emulator = fork();
    if (emulator == 0) close(life), close(alive[0]), become_emulator(command, log);
    close(alive[1]);
    wait_for_links(life, alive[0], p);
    if (emulator > 0) kill(emulator, SIGKILL), waitpid(emulator, NULL, 0);
    _exit(remove_folder(p, folder));
}

/* ---- the folder */
static bool make_folder(Stream *s, const Config *c, bool *first)
{
    const char *parent = getenv("TMPDIR");
    struct stat status;
    if (!parent || !*parent) parent = "/tmp";
    *first = true;
    if (!*c->group) {
        snprintf(s->folder, sizeof s->folder, "%s/slnk-XXXXXX", parent);
        return mkdtemp(s->folder) != NULL;
    }
    snprintf(s->folder, sizeof s->folder, "%s/slnk-%ld-%s", parent, (long)getpid(), c->group);
    if (mkdir(s->folder, 0700) == 0) return true;
    *first = false;
    return lstat(s->folder, &status) == 0 && S_ISDIR(status.st_mode) &&
           status.st_uid == geteuid() && (status.st_mode & 077) == 0;
}

/* ---- joining of a link */
static bool open_life_pipe(Stream *s, const Paths *p, double until)
{
    while ((s->life = open(p->life, O_WRONLY | O_NONBLOCK | O_CLOEXEC)) < 0) {
        if (now_s() > until) return fail_start(s, p->life);
        nanosleep(&(struct timespec){0, 1000000}, NULL);
    }
    return true;
}

static bool start_supervisor(Stream *s, const Paths *p, const Config *c)
{
    Command *command = calloc(1, sizeof *command);
    if (!command || c->arguments == 0)
        return free(command),
               fail_start(s, "link.txt has no line 'argument=', or the memory is full");
    build_command(command, c, s);
    if (!on_path(command->list[0]))
        return errno = ENOENT, fail_start(s, command->list[0]), free(command), false;
    if (mkfifo(p->to_board, 0600) < 0 || mkfifo(p->from_board, 0600) < 0 ||
        mkfifo(p->life, 0600) < 0)
        return free(command), fail_start(s, s->folder);
    /* opened for reading and writing, so that open() in the supervisor does not block */
    int life = open(p->life, O_RDWR | O_NONBLOCK | O_CLOEXEC);
    s->supervisor = fork();
    if (s->supervisor == 0) run_supervisor(p, s->folder, command->list);
    free(command);
    bool started =
        s->supervisor > 0 ? open_life_pipe(s, p, now_s() + c->timeout) : fail_start(s, "fork");
    close(life);
    return started;
}

/* opens the pipes that carry the frames. Opening for writing succeeds once the emulator has opened
 * its end; it is tried until the time `until`. */
static bool open_pipes(Stream *s, const Paths *p, double until)
{
    char log_line[REASON_SIZE / 2] = "";
    s->in = open(p->from_board, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    while (s->in >= 0 && (s->out = open(p->to_board, O_WRONLY | O_NONBLOCK | O_CLOEXEC)) < 0) {
        if (errno != ENXIO || now_s() > until) break;
        nanosleep(&(struct timespec){0, 1000000}, NULL);
    }
    if (s->out >= 0) return true;
    last_log_line(s, log_line, sizeof log_line);
    return fail_start(s, *log_line ? log_line : "the emulator does not answer");
}

bool start_processor(Stream *s, const Config *c)
{
    Paths p;
    bool first;
    if (!make_folder(s, c, &first)) return fail_start(s, s->folder);
    name_paths(&p, s);
    if (first ? !start_supervisor(s, &p, c) : !open_life_pipe(s, &p, now_s() + c->timeout)) {
        if (first && s->supervisor <= 0)
            remove_folder(&p, s->folder); /* no supervisor exists to remove the folder */
        return false;
    }
    if (write(s->life, "j", 1) != 1 || !open_pipes(s, &p, now_s() + c->timeout)) return false;
    if (*c->group) s->lock = open(p.lock, O_RDWR | O_CREAT | O_CLOEXEC, 0600);
    return true;
}

/* ---- leaving of a link */
enum { PATIENCE_MS = 2000 };

static void wait_for_supervisor(const Stream *s, bool alone)
{
    for (int i = 0; i < (alone ? PATIENCE_MS : 20); i++) {
        if (waitpid(s->supervisor, NULL, WNOHANG) != 0) return;
        nanosleep(&(struct timespec){0, 1000000}, NULL);
    }
    if (alone) kill(s->supervisor, SIGKILL), waitpid(s->supervisor, NULL, 0);
}

void leave_processor(Stream *s)
{
    if (s->lock >= 0) close(s->lock);
    if (s->life >= 0) {
        ssize_t written = write(s->life, "q", 1);
        close(s->life);
        if (written == 1 && s->supervisor > 0) wait_for_supervisor(s, s->lock < 0);
    }
    s->life = s->lock = -1;
    s->supervisor = 0;
}

void last_log_line(const Stream *s, char *text, size_t size)
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
