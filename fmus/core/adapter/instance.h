/* instance.h - instance of an FMU: model, last valid state, progress, callbacks, log.
 *
 * It is independent of the version of FMI: each version has files of its own (fmi2*.c, fmi3*.c),
 * which use this one, life.h, values.h and state.h.
 *
 * States and outputs are stored before a step and restored if a result of the step is
 * rejected, so that after an error the instance has its last valid state; parameters and inputs are
 * constant in a step. There are no global variables, so that instances are independent. */
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
} Phase; /* bits, combined in masks of allowed phases */
enum { ANY_PHASE = INSTANTIATED | INITIALIZING | STEPPING | TERMINATED | FAILED };
enum { LOG_ERRORS = 1, LOG_WARNINGS = 2, LOG_EVENTS = 4 };
typedef enum { STATUS_OK, STATUS_WARNING, STATUS_DISCARD, STATUS_ERROR } Status; /* FMI's numbers */

typedef struct {
    Phase phase;
    int stale; /* 1: outputs at the start are outdated: values have been set since */
    double start, time, stop,
        step; /* s; stop: infinite if undefined; step: size of the last step, 0 before the first */
    double grid; /* s; shortest internal step or sample period, 0 if there is none */
} Progress;

typedef struct Instance Instance;

/* callbacks of the importer; write_line calls `logger` with the arguments of one version of FMI */
typedef struct {
    void (*write_line)(const Instance *instance, Status status, const char *category, char *line);
    void (*logger)(void); /* NULL: no logger */
    void *environment;
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory); /* calloc and free if one of allocate, release is NULL */
} Callbacks;

struct Instance {
    Callbacks call;
    char *name;
    unsigned categories; /* bits of the log categories switched on */
    Progress now;
    void *model;                     /* memory_of(&fmu_model) bytes */
    void *last_good;                 /* states and outputs before the step: tail_size() bytes */
    Run *ruled;                      /* groups of outputs whose rule rejects some finite values */
    size_t ruled_count, alarm_count; /* `ruled` begins with the alarms */
    KnownCalls written, read;
};

/* for functions with text buffers: they are not inlined, so that a step without an error needs
 * no stack for the buffers */
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

/* initialize_checked() checks and initializes a model, step_checked() steps it; false, after a
 * message, if the model or its result is rejected: its states and outputs are then invalid */
bool initialize_checked(const Instance *instance, const char *function, void *model);
bool step_checked(const Instance *instance, const char *function, void *model, double t, double h);

/* fills `ruled` with one entry for each group of neighbouring outputs that have the same rule;
 * `ruled` needs memory for as many entries as the tables `variables` and `checked` of the model
 * have rows */
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

/* true if a step of length h has so many internal steps that a parameter is probably wrong */
static inline bool too_many_substeps(const Progress *now, double h)
{
    return now->grid > 0 && h / now->grid > 1e7;
}

#endif
