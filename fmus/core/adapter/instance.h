/* instance.h - one instance of an FMU: the model, its last good state, progress, callbacks, log.
 *
 * It knows no version of FMI: each has its files (fmi2*.c, fmi3*.c) over this one, life.h,
 * values.h and state.h.
 *
 * States and outputs are kept before a step and put back if one of its results is refused, so an
 * error leaves the last good state in place; parameters and inputs are constant in a step. There
 * are no globals: instances do not know of each other. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef INSTANCE_H
#define INSTANCE_H

#include "known_calls.h"

#include <stdbool.h>
#include <stdlib.h>

typedef enum {
    INSTANTIATED = 1,
    INITIALIZING = 2,
    STEPPING = 4,
    TERMINATED = 8,
    FAILED = 16
} Phase; /* bits of masks */
enum { ANY_PHASE = INSTANTIATED | INITIALIZING | STEPPING | TERMINATED | FAILED };
enum { LOG_ERRORS = 1, LOG_WARNINGS = 2, LOG_EVENTS = 4 };
typedef enum { STATUS_OK, STATUS_WARNING, STATUS_DISCARD, STATUS_ERROR } Status; /* FMI's numbers */

typedef struct {
    Phase phase;
    int stale; /* outputs not yet evaluated for the values set in initialization mode */
    double start, time, stop,
        step;    /* s; stop: infinite if undefined; step: the last one, 0 before the first */
    double grid; /* s; internal steps and samples are no closer than this, 0 if there are none */
} Progress;

typedef struct Instance Instance;

/* what the environment offers; hand_over: how a version of FMI brings a finished line to its logger */
typedef struct {
    void (*hand_over)(const Instance *instance, Status status, const char *category, char *line);
    void (*logger)(void); /* in the type of that version; NULL: nobody listens */
    void *environment;
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory); /* both or none: calloc and free then */
} Callbacks;

struct Instance {
    Callbacks call;
    char *name;
    unsigned categories; /* log categories switched on */
    Progress now;
    void *model;                       /* memory_of(&fmu_model) bytes */
    void *good;                        /* states and outputs before the step: tail_size() bytes */
    Run *guarded;                      /* outputs with a rule beyond being finite */
    size_t guarded_count, alarm_count; /* alarms are the first of them */
    KnownCalls written, read;
};

/* with text buffers that are to be no part of the stack of a step that goes well */
#if defined __GNUC__
#define RARE __attribute__((noinline))
#else
#define RARE
#endif

extern const char *const log_categories[3];

void log_message(const Instance *instance, Status status, unsigned category, const char *text);
bool refuse_call(const Instance *instance, const char *function,
                 const char *text);                                /* logs, returns false */
bool refuse_phase(const Instance *instance, const char *function); /* logs, returns false */
void *allocate(const Instance *instance, size_t bytes);
void release(const Instance *instance, void *memory);

/* check and initialize a model, or step it; false and a message if it or its result is refused:
 * states and outputs are then of no use */
bool initialize_checked(const Instance *instance, const char *function, void *model);
bool step_checked(const Instance *instance, const char *function, void *model, double t, double h);

/* fill in the outputs with a rule, at most variable_count + judged_count runs of fmu_model */
void list_guarded(Instance *instance);

/* warn of every alarm that has risen since the last good state */
void report_alarms(const Instance *instance, double t);

static inline bool allowed(const Instance *instance, const char *function, unsigned phases)
{
    if (instance && (unsigned)instance->now.phase & phases) return true;
    return refuse_phase(instance, function);
}

/* states and outputs: from state_offset to the end of the model */
static inline size_t tail_size(void) { return fmu_model.size - fmu_model.state_offset; }
static inline void *tail(void *model) { return (char *)model + fmu_model.state_offset; }
static inline const void *tail_const(const void *model)
{
    return (const char *)model + fmu_model.state_offset;
}
static inline void keep_good(Instance *instance)
{
    memcpy(instance->good, tail(instance->model), tail_size());
}
static inline void put_back(Instance *instance)
{
    memcpy(tail(instance->model), instance->good, tail_size());
}

/* a step of so many internal ones is taken for a mistake in a parameter, not for patience */
static inline bool too_many_substeps(const Progress *now, double h)
{
    return now->grid > 0 && h / now->grid > 1e7;
}

#endif
