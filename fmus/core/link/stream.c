/* stream.c - opening, reading and writing the byte stream to a board. */
/* SPDX-License-Identifier: BSD-2-Clause */
#define _GNU_SOURCE
#include "stream.h"

#include <errno.h>
#include <fcntl.h>
#include <netdb.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

double now_s(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static bool fail_open(Stream *s, const char *action)
{
    snprintf(s->reason, sizeof s->reason, "%s (%s)", action, strerror(errno));
    return false;
}

static bool set_nonblocking(int file)
{
    int flags = fcntl(file, F_GETFL);
    return fcntl(file, F_SETFD, FD_CLOEXEC) == 0 && flags >= 0 &&
           fcntl(file, F_SETFL, flags | O_NONBLOCK) == 0;
}

/* ---- waiting */
static bool is_ready(int file, short events, double until)
{
    struct pollfd watched = {file, events, 0};
    for (;;) {
        double left = until - now_s();
        int count = poll(&watched, 1, left > 0 ? (int)(1000 * left) + 1 : 0);
        if (count >= 0 || errno != EINTR) return count > 0;
    }
}

/* ---- sockets */
static bool connect_within(int file, const struct sockaddr *address, socklen_t size, double until)
{
    int error = 0;
    socklen_t size_of_error = sizeof error;
    if (!set_nonblocking(file)) return false;
    if (connect(file, address, size) == 0) return true;
    if (errno != EINPROGRESS) return false;
    if (!is_ready(file, POLLOUT, until)) return errno = ETIMEDOUT, false;
    getsockopt(file, SOL_SOCKET, SO_ERROR, &error, &size_of_error);
    errno = error;
    return error == 0;
}

static int connect_any(const struct addrinfo *list, double until)
{
    for (const struct addrinfo *a = list; a; a = a->ai_next) {
        int file = socket(a->ai_family, a->ai_socktype, a->ai_protocol);
        if (file < 0) continue;
        if (connect_within(file, a->ai_addr, a->ai_addrlen, until)) return file;
        int saved_errno = errno;
        close(file);
        errno = saved_errno;
    }
    return -1;
}

static bool open_tcp(Stream *s, const Config *c)
{
    struct addrinfo hints = {.ai_socktype = SOCK_STREAM}, *list = NULL;
    int on = 1, error = getaddrinfo(c->host, c->port, &hints, &list);
    if (error) return snprintf(s->reason, sizeof s->reason, "%s", gai_strerror(error)), false;
    s->in = s->out = connect_any(list, now_s() + c->timeout);
    int saved_errno = errno;
    freeaddrinfo(list);
    errno = saved_errno;
    if (s->in < 0) return fail_open(s, "the connection failed");
    setsockopt(s->in, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
    return true;
}

static bool open_unix(Stream *s, const Config *c)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    if (strlen(c->path) >= sizeof address.sun_path)
        return errno = ENAMETOOLONG, fail_open(s, "the path of the socket is too long");
    strcpy(address.sun_path, c->path);
    s->in = s->out = socket(AF_UNIX, SOCK_STREAM, 0);
    if (s->in < 0 ||
        !connect_within(s->in, (struct sockaddr *)&address, sizeof address, now_s() + c->timeout))
        return fail_open(s, "the connection failed");
    return true;
}

/* ---- serial line: 8N1, raw bytes */
static speed_t speed_of(long baud)
{
    static const struct {
        long baud;
        speed_t speed;
    } known[] = {
        {9600, B9600},     {19200, B19200},   {38400, B38400},     {57600, B57600},
        {115200, B115200}, {230400, B230400},
#ifdef B460800
        {460800, B460800}, {921600, B921600}, {1000000, B1000000}, {2000000, B2000000},
#endif
    };
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        if (known[i].baud == baud) return known[i].speed;
    return B0;
}

static bool open_serial(Stream *s, const Config *c)
{
    struct termios line;
    speed_t speed = speed_of(c->baud);
    s->in = s->out = open(c->path, O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (s->in < 0) return fail_open(s, "cannot be opened");
    if (tcgetattr(s->in, &line) < 0) return fail_open(s, "is not a serial line");
    if (speed == B0) return errno = EINVAL, fail_open(s, "the baud rate is not supported");
    line.c_iflag = line.c_oflag = line.c_lflag = 0;
    line.c_cflag = CS8 | CREAD | CLOCAL;
    line.c_cc[VMIN] = 1, line.c_cc[VTIME] = 0;
    cfsetispeed(&line, speed), cfsetospeed(&line, speed);
    if (tcsetattr(s->in, TCSANOW, &line) < 0) return fail_open(s, "cannot be configured");
    tcflush(s->in, TCIOFLUSH);
    return true;
}

/* ---- opening and closing */
bool open_stream(Stream *s, const Config *c)
{
    *s = (Stream){.in = -1, .out = -1, .life = -1, .lock = -1};
    if (strcmp(c->via, "emulator") == 0) return start_processor(s, c);
    if (strcmp(c->via, "tcp") == 0) return open_tcp(s, c);
    if (strcmp(c->via, "unix") == 0) return open_unix(s, c);
    if (strcmp(c->via, "serial") == 0) return open_serial(s, c);
    snprintf(s->reason, sizeof s->reason,
             "link.txt: unknown connection type '%.40s', expected emulator, tcp, unix or serial",
             c->via);
    return false;
}

void close_stream(Stream *s)
{
    if (s->in >= 0) close(s->in);
    if (s->out >= 0 && s->out != s->in) close(s->out);
    s->in = s->out = -1;
    leave_processor(s);
}

void lock_stream(const Stream *s)
{
    while (s->lock >= 0 && flock(s->lock, LOCK_EX) < 0 && errno == EINTR) continue;
}
void unlock_stream(const Stream *s)
{
    if (s->lock >= 0) flock(s->lock, LOCK_UN);
}

/* ---- bytes */
static StreamState report_end(Stream *s)
{
    char log_line[REASON_SIZE / 2] = "";
    last_log_line(s, log_line, sizeof log_line);
    snprintf(s->reason, sizeof s->reason, "the connection has ended%s%s", *log_line ? ": " : "",
             log_line);
    return STREAM_ENDED;
}

/* writes bytes; writing to a closed pipe returns an error and raises no SIGPIPE */
static ssize_t write_quietly(int file, const void *bytes, size_t count)
{
    sigset_t pipe_only, before, waiting;
    int caught;
    sigemptyset(&pipe_only);
    sigaddset(&pipe_only, SIGPIPE);
    sigpending(&waiting);
    if (sigismember(&waiting, SIGPIPE)) return write(file, bytes, count);
    pthread_sigmask(SIG_BLOCK, &pipe_only, &before);
    ssize_t done = write(file, bytes, count);
    int saved_errno = errno;
    if (done < 0 && saved_errno == EPIPE && sigpending(&waiting) == 0 &&
        sigismember(&waiting, SIGPIPE))
        sigwait(&pipe_only, &caught);
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    errno = saved_errno;
    return done;
}

static bool is_retryable(void) { return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR; }

StreamState write_stream(Stream *s, const void *bytes, size_t count, double until)
{
    const char *from = bytes;
    while (count > 0) {
        ssize_t done = write_quietly(s->out, from, count);
        if (done < 0 && !is_retryable()) return report_end(s);
        if (done > 0) from += done, count -= (size_t)done;
        if (count > 0 && (!is_ready(s->out, POLLOUT, until) || now_s() > until)) return STREAM_LATE;
    }
    return STREAM_OK;
}

StreamState read_stream(Stream *s, void *bytes, size_t most, size_t *got, double until)
{
    *got = 0;
    for (;;) {
        if (!is_ready(s->in, POLLIN, until)) return STREAM_LATE;
        ssize_t count = read(s->in, bytes, most);
        if (count > 0) return *got = (size_t)count, STREAM_OK;
        if (count == 0 || !is_retryable()) return report_end(s);
    }
}
