/* state.h - states of an instance (copies of the memory of the model) and directional derivatives
 * (finite differences between such copies) for all versions of FMI. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef STATE_H
#define STATE_H

#include "instance.h"

size_t snapshot_size(void); /* number of bytes of a state, in memory and serialized */

/* copies the state to *state, and allocates *state if it is NULL; false: out of memory */
bool take_snapshot(const Instance *instance, void **state);
void restore_snapshot(Instance *instance, const void *state);

void write_snapshot(const void *state, void *bytes);

/* replaces *state by the state that write_snapshot() wrote to `bytes`; returns NULL, or the
 * reason why the bytes are rejected (then *state is unchanged) */
const char *read_snapshot(const Instance *instance, const void *bytes, size_t size, void **state);

typedef struct {
    const char *function; /* name of the FMI function, for messages */
    const unsigned *unknown, *known;
    size_t unknowns, knowns;
    const double *seed;
} Direction;

/* computes the directional derivative of each unknown with respect to the knowns along the seed;
 * false after a message that names the reason if the call is rejected or a model fails */
bool derive(const Instance *instance, const Direction *d, double sensitivity[]);

#endif
