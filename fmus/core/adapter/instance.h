/* instance.h - one instance of an FMU: two copies of the model, progress, callbacks, log.
 *
 * A step works on the spare copy and becomes current only if every number is finite, so an error
 * leaves the last good state in place. There are no globals: instances do not know of each
 * other. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include "fmi2Functions.h"
#include "interface.h"

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

typedef struct {
    Phase phase;
    fmi2Boolean stale; /* outputs not yet evaluated for the values set in initialization mode */
    double start, time, stop,
        step;    /* s; stop: infinite if undefined; step: the last one, 0 before the first */
    double grid; /* s; internal steps and samples are no closer than this, 0 if there are none */
} Progress;

typedef struct {
    fmi2CallbackFunctions call;
    char *name;
    unsigned categories; /* log categories switched on */
    Progress now;
    void *model, *spare; /* both of fmu_model.size bytes */
} Instance;

extern const char *const log_categories[3];

void log_message(const Instance *instance, fmi2Status status, unsigned category, const char *text);
fmi2Status failure(const Instance *instance, const char *function,
                   const char *text); /* logs, returns fmi2Error */
bool allowed(const Instance *instance, const char *function, unsigned phases); /* logs if not */
void *allocate(const Instance *instance, size_t bytes);
void release(const Instance *instance, void *memory);

/* evaluate check + initialize, or one step, from `from` into `into`; false and a message if refused
 * or not finite */
bool initialize_into(const Instance *instance, const char *function, const void *from, void *into);
bool step_into(const Instance *instance, const char *function, const void *from, void *into,
               double t, double h);

/* warn of every alarm that has risen from `before` to `after` */
void report_alarms(const Instance *instance, const void *before, const void *after, double t);

/* a step of so many internal ones is taken for a mistake in a parameter, not for patience */
static inline bool takes_ages(const Progress *now, double h)
{
    return now->grid > 0 && h / now->grid > 1e7;
}

static inline void swap_models(Instance *instance)
{
    void *model = instance->model;
    instance->model = instance->spare;
    instance->spare = model;
}

#endif
