/* stream.h - byte stream to a board with time limits: an emulator as child process, TCP, a Unix
 * socket, a serial line. POSIX. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef STREAM_H
#define STREAM_H

#include "config.h"

#include <sys/types.h>

enum { REASON_SIZE = 1600 };

typedef struct {
    int in, out;            /* file descriptors; equal for sockets and serial lines */
    int life, lock;         /* of an emulator: pipe `life`, lock file, see processor.c; -1: none */
    pid_t supervisor;       /* process that ends the emulator; 0: another link started it */
    char folder[PATH_SIZE]; /* folder of the pipes to an emulator */
    char reason[REASON_SIZE]; /* reason of the last failure */
} Stream;

double now_s(void); /* monotonic time [s] */

bool open_stream(Stream *s, const Config *c);
void close_stream(Stream *s);

typedef enum { STREAM_OK, STREAM_LATE, STREAM_ENDED } StreamState;

/* write_stream() returns when all bytes are written, read_stream() when at least one byte is
 * read; both return STREAM_LATE when now_s() reaches `until`, and STREAM_ENDED if the connection
 * ends */
StreamState write_stream(Stream *s, const void *bytes, size_t count, double until);
StreamState read_stream(Stream *s, void *bytes, size_t most, size_t *got, double until);

/* between lock_stream() and unlock_stream() this link alone uses a shared emulator */
void lock_stream(const Stream *s);
void unlock_stream(const Stream *s);

/* processor.c */
bool start_processor(Stream *s, const Config *c);
void leave_processor(Stream *s);
void last_log_line(const Stream *s, char *text,
                   size_t size); /* last line in the log of an emulator */

#endif
