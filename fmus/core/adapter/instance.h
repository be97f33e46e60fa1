/* instance.h - instance of an FMU: model, last valid state, progress, callbacks, log.
 *
 * It is independent of the version of FMI: each version has files of its own (fmi2*.c, fmi3*.c),
 * which use this one, life.h, values.h and state.h.
 *
 * States and outputs are stored before a step and restored if one of its results is rejected, so
 * that after an error the instance has its last valid state; parameters and inputs are constant in
 * a step. There are no global variables, so that instances are independent. */
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
    int stale; /* 1: outputs are not yet evaluated for the values set in initialization mode */
    double start, time, stop,
        step; /* s; stop: infinite if undefined; step: size of the last step, 0 before the first */
    double grid; /* s; shortest internal step or sample period, 0 if there is none */
} Progress;

typedef struct Instance Instance;

/* callbacks of the environment; write_line: calls the logger as a version of FMI defines it */
typedef struct {
    void (*write_line)(const Instance *instance, Status status, const char *category, char *line);
    void (*logger)(void); /* NULL: no logger */
    void *environment;
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory); /* if one of allocate and release is NULL: calloc and free */
} Callbacks;

struct Instance {
    Callbacks call;
    char *name;
    unsigned categories; /* log categories switched on */
    Progress now;
    void *model;                     /* memory_of(&fmu_model) bytes */
    void *last_good;                 /* states and outputs before the step: tail_size() bytes */
    Run *ruled;                      /* outputs with a rule besides being finite */
    size_t ruled_count, alarm_count; /* alarms come first among these outputs */
    KnownCalls written, read;
};

/* functions with text buffers, not inlined, so that a successful step needs no stack for the
 * buffers */
#if defined __GNUC__
#define RARE __attribute__((noinline))
#else
#define RARE
#endif

extern const char *const log_categories[3];

void log_message(const Instance *instance, Status status, unsigned category, const char *text);
bool reject_call(const Instance *instance, const char *function,
                 const char *text);                                /* logs and returns false */
bool reject_phase(const Instance *instance, const char *function); /* logs and returns false */
void *allocate(const Instance *instance, size_t bytes);
void release(const Instance *instance, void *memory);

/* check and initialize a model, or step it; false with a message if the model or its result is
 * rejected, which leaves invalid states and outputs */
bool initialize_checked(const Instance *instance, const char *function, void *model);
bool step_checked(const Instance *instance, const char *function, void *model, double t, double h);

/* fills `ruled`, one entry per run of neighbouring outputs with the same rule; `ruled` needs memory
 * for variable_count + checked_count entries */
void list_ruled_outputs(Instance *instance);

/* logs a warning for every alarm that has changed to 1 since the last valid state */
void report_alarms(const Instance *instance, double t);

static inline bool allowed(const Instance *instance, const char *function, unsigned phases)
{
    if (instance && (unsigned)instance->now.phase & phases) return true;
    return reject_phase(instance, function);
}

/* states and outputs: from state_offset to the end of the model */
static inline size_t tail_size(void) { return fmu_model.size - fmu_model.state_offset; }
static inline void *tail(void *model) { return (char *)model + fmu_model.state_offset; }
static inline const void *tail_const(const void *model)
{
    return (const char *)model + fmu_model.state_offset;
}
static inline void store_good_state(Instance *instance)
{
    memcpy(instance->last_good, tail(instance->model), tail_size());
}
static inline void restore_good_state(Instance *instance)
{
    memcpy(tail(instance->model), instance->last_good, tail_size());
}

/* such a number of internal steps in a step is considered a mistake in a parameter */
static inline bool too_many_substeps(const Progress *now, double h)
{
    return now->grid > 0 && h / now->grid > 1e7;
}

#endif
