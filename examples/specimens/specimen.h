/* specimen.h - what all specimens share: life cycle, access to variables by a table, states.
 *
 * A specimen is one C file. It includes "types.h" and defines
 *
 *   Model      struct with all variables and states, plain data
 *   start      its start values
 *   variables  table of value references, types, places and sizes in Model
 *   TOKEN      instantiation token of the model description
 *   step       advance from t by at most h; return the time reached
 *   evaluate   outputs in Initialization Mode and Event Mode, before they are read
 *   update     what fmi3UpdateDiscreteStates does
 *
 * and includes "specimen.h" behind `variables`, and before `step`. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef enum { STARTED, INITIALIZING, EVENT, STEP, ENDED } Mode;

typedef struct {
    Model m;
    Mode mode;
    double time;
    bool events; /* Event Mode is used, and a step may return early */
    bool event;  /* a step has ended at an event that has not been handled */
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} Instance;

static double step(Instance *c, double t, double h);
static void evaluate(Instance *c);
static void update(Instance *c);

/* ---- messages */

static fmi3Status failure(const Instance *c, const char *function, const char *rule)
{
    char text[200];
    snprintf(text, sizeof text, "%s: %s", function, rule);
    if (c->log) c->log(c->environment, fmi3Error, "logStatusError", text);
    return fmi3Error;
}

static bool in(const Instance *c, Mode mode, const char *function, const char *name)
{
    if (c->mode == mode) return true;
    char rule[80];
    snprintf(rule, sizeof rule, "only in %s", name);
    failure(c, function, rule);
    return false;
}

/* ---- variables */

static const Variable *find(fmi3ValueReference reference, Type type)
{
    for (size_t k = 0; k < sizeof variables / sizeof *variables; k++)
        if (variables[k].reference == reference && variables[k].type == type) return variables + k;
    return NULL;
}

/* copy `count` variables between the model and `value`; size: bytes of an element; values: elements
 * of `value`, for all variables together */
static fmi3Status copied(Instance *c, const fmi3ValueReference references[], size_t count,
                         Type type, char *value, size_t size, size_t values, bool set)
{
    size_t done = 0;
    if (!set && (c->mode == INITIALIZING || c->mode == EVENT)) evaluate(c);
    for (size_t k = 0; k < count; k++) {
        const Variable *v = find(references[k], type);
        if (!v || done + v->size > values)
            return failure(c, set ? "fmi3Set" : "fmi3Get", "no such variable, or too few values");
        if (set && v->causality == AN_OUTPUT)
            return failure(c, "fmi3Set", "an output cannot be set");
        if (set && v->causality == A_PARAMETER && c->mode > INITIALIZING)
            return failure(c, "fmi3Set", "a parameter is fixed after initialization");
        char *place = (char *)&c->m + v->place, *other = value + done * size;
        memcpy(set ? place : other, set ? other : place, v->size * size);
        done += v->size;
    }
    return done == values ? fmi3OK : failure(c, set ? "fmi3Set" : "fmi3Get", "too many values");
}

#define ACCESS(Kind, TYPE)                                                                \
    fmi3Status fmi3Get##Kind(fmi3Instance c, const fmi3ValueReference r[], size_t n,      \
                             fmi3##Kind value[], size_t values)                           \
    {                                                                                     \
        return copied(c, r, n, TYPE, (char *)value, sizeof *value, values, false);        \
    }                                                                                     \
    fmi3Status fmi3Set##Kind(fmi3Instance c, const fmi3ValueReference r[], size_t n,      \
                             const fmi3##Kind value[], size_t values)                     \
    {                                                                                     \
        return copied(c, r, n, TYPE, (char *)(size_t)value, sizeof *value, values, true); \
    }

ACCESS(Float64, FLOAT64)
ACCESS(Int32, INT32)

fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Clock value[])
{
    if (!in(c, EVENT, "fmi3GetClock", "Event Mode")) return fmi3Error;
    return copied(c, r, n, CLOCK, (char *)value, sizeof *value, n, false);
}

fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference r[], size_t n,
                        const fmi3Clock value[])
{
    if (!in(c, EVENT, "fmi3SetClock", "Event Mode")) return fmi3Error;
    return copied(c, r, n, CLOCK, (char *)(size_t)value, sizeof *value, n, true);
}

/* ---- life cycle */

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                         fmi3Boolean visible, fmi3Boolean logging,
                                         fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference required[], size_t count,
                                         fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback intermediate)
{
    (void)name, (void)resources, (void)visible, (void)logging;
    (void)required, (void)count, (void)intermediate;
    Instance *c = strcmp(token, TOKEN) ? NULL : calloc(1, sizeof *c);
    if (!c) return NULL;
    *c = (Instance){.m = start, .environment = environment, .log = log};
    c->events = events && early;
    return c;
}

void fmi3FreeInstance(fmi3Instance c) { free(c); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean has_tolerance,
                                       fmi3Float64 tolerance, fmi3Float64 time,
                                       fmi3Boolean has_stop, fmi3Float64 stop)
{
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    Instance *c = instance;
    if (!in(c, STARTED, "fmi3EnterInitializationMode", "the state after instantiation"))
        return fmi3Error;
    c->time = time;
    c->mode = INITIALIZING;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    Instance *c = instance;
    if (!in(c, INITIALIZING, "fmi3ExitInitializationMode", "Initialization Mode")) return fmi3Error;
    evaluate(c);
    c->mode = c->events ? EVENT : STEP;
    return fmi3OK;
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    Instance *c = instance;
    if (!in(c, STEP, "fmi3EnterEventMode", "Step Mode")) return fmi3Error;
    c->mode = EVENT;
    return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *again, fmi3Boolean *end,
                                    fmi3Boolean *nominals, fmi3Boolean *values,
                                    fmi3Boolean *has_next, fmi3Float64 *next)
{
    Instance *c = instance;
    *again = *end = *nominals = *has_next = fmi3False;
    *values = c->event;
    *next = 0;
    if (!in(c, EVENT, "fmi3UpdateDiscreteStates", "Event Mode")) return fmi3Error;
    evaluate(c);
    update(c);
    c->event = false;
    return fmi3OK;
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
    Instance *c = instance;
    if (!in(c, EVENT, "fmi3EnterStepMode", "Event Mode")) return fmi3Error;
    if (c->event) return failure(c, "fmi3EnterStepMode", "call fmi3UpdateDiscreteStates first");
    c->mode = STEP;
    return fmi3OK;
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no_return,
                      fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *last)
{
    Instance *c = instance;
    (void)no_return;
    *event = *end = *early = fmi3False;
    *last = c->time;
    if (!in(c, STEP, "fmi3DoStep", "Step Mode")) return fmi3Error;
    if (c->event) return failure(c, "fmi3DoStep", "the last step ended at an event: handle it");
    if (!(h > 0)) return failure(c, "fmi3DoStep", "the step must be > 0");
    double off = t - c->time;
    if (!(off <= 1e-9 && off >= -1e-9))
        return failure(c, "fmi3DoStep", "a step begins at the last successful time");
    c->time = step(c, c->time, h);
    *event = c->event;
    *early = c->time < t + h && c->event;
    *last = c->time;
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    Instance *c = instance;
    c->mode = ENDED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    Instance *c = instance;
    c->m = start;
    c->mode = STARTED;
    c->event = false;
    return fmi3OK;
}

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String names[])
{
    (void)c, (void)on, (void)n, (void)names;
    return fmi3OK;
}

/* ---- states */

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)
{
    if (!*state) *state = malloc(sizeof(Instance));
    if (!*state) return failure(c, "fmi3GetFMUState", "no memory");
    memcpy(*state, c, sizeof(Instance));
    return fmi3OK;
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
    memcpy(c, state, sizeof(Instance));
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    (void)c;
    free(*state);
    *state = NULL;
    return fmi3OK;
}

#include "unused.h"
