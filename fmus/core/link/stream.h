/* stream.h - bytes to and from a board with time limits: an emulator that is started here, TCP, a
 * Unix socket, a serial line. POSIX. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef STREAM_H
#define STREAM_H

#include "config.h"

#include <sys/types.h>

enum { REASON_SIZE = 1600 };

typedef struct {
    int in, out;              /* the same for sockets and serial lines */
    int life, lock;           /* of an emulator: see processor.c; -1: none */
    pid_t keeper;             /* that ends the emulator; 0: not ours */
    char folder[PATH_SIZE];   /* of its pipes */
    char reason[REASON_SIZE]; /* why something has failed */
} Stream;

double now_s(void); /* monotonic */

bool open_stream(Stream *s, const Config *c);
void close_stream(Stream *s);

typedef enum { STREAM_FINE, STREAM_LATE, STREAM_ENDED } StreamState;

/* until everything is written, or at least a byte is read; `until`: now_s() at which to give up */
StreamState write_stream(Stream *s, const void *bytes, size_t count, double until);
StreamState read_stream(Stream *s, void *bytes, size_t most, size_t *got, double until);

/* nobody else uses a shared emulator between these two */
void lock_stream(const Stream *s);
void unlock_stream(const Stream *s);

/* processor.c */
bool start_processor(Stream *s, const Config *c);
void leave_processor(Stream *s);
void last_words(const Stream *s, char *text, size_t size); /* of an emulator that has ended */

#endif
