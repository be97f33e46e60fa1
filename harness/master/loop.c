/* loop.c - macro steps of a run: the calls of FMI functions that schedule.py lists, made in C.
 *
 * This executor makes the same calls in the same order with the same buffers as the Python
 * executor, so the results agree bit for bit. Python prepares the calls (executors.py and
 * transfer.py have the same structs); the code here neither allocates memory nor uses Python. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "finite.h"
#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"

#if defined _WIN32
#define EXPORT __declspec(dllexport)
#elif defined __GNUC__
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

enum {
    SET_REAL,
    SET_INTEGER,
    STEP,
    GET_REAL,
    GET_INTEGER,
    SET_AFFINE,
    SET_FLOAT64, /* this and all following kinds are calls of FMI 3.0 */
    GET_FLOAT64,
    SET_OTHER,
    GET_OTHER,
    STEP_3,
    SET_AFFINE_3
}; /* SET_INTEGER, GET_INTEGER: for fmi2Integer and fmi2Boolean, which are both int */

/* Statuses that FMI does not define: an output is infinite or NaN; an output is a whole number
 * that a double cannot represent; a step requests termination; a step has returned early. */
enum { NOT_FINITE = -1, TOO_WIDE = -2, TERMINATION = -3, EARLY_RETURN = -4 };

typedef struct {
    size_t slot, count, at; /* `count` values from bus[slot] on, and from buffer[at] on */
} Piece;

typedef struct {
    int kind, every, phase;              /* due in macro step k if k % every == phase */
    int no_rollback;                     /* noSetFMUStatePriorToCurrentPoint of a step */
    int type;                            /* FMI 3.0: index of the values' type in `conversion` */
    int finite;                          /* 1: outputs are finite (FMU of the project): no check */
    size_t count, pieces, wires, values; /* lengths of reference, piece, slot (and at), value */
    void (*function)(void);              /* fmi2SetReal, fmi2DoStep, ... of the FMU's library */
    void *component;
    const unsigned *reference;
    const size_t *slot, *at;       /* index of each signal on the bus and in the buffer */
    const Piece *piece;            /* the same indices, consecutive ones joined */
    void *value;                   /* buffer: values in the type that `function` takes */
    const double *factor, *offset; /* SET_AFFINE: input = factor * bus + offset */
} Call;

typedef struct {
    double start, step; /* s; macro step k goes from start + k step to start + (k + 1) step */
    size_t slots;
    long every, steps;
    double *bus;
    double *table; /* recorded rows: row r after r * every macro steps, the last row at the end */
    /* completed macro steps, index of present call; read by the parent process, if there is one */
    volatile int64_t *progress;
} Run;

typedef struct {
    long done;   /* macro steps completed */
    size_t call; /* index of the failed call, or of the call before which the run pauses */
    int status;
} Stop;

typedef struct {
    double *bus;
    double t, step; /* s; begin and length of the present macro step */
} Moment;

static inline void gather(const Call *c, const double *bus)
{
    double *value = c->value;
    for (const Piece *p = c->piece, *end = p + c->pieces; p < end; p++)
        memcpy(value + p->at, bus + p->slot, p->count * sizeof *value);
}

static inline int scatter(const Call *c, double *bus, int status)
{
    const double *value = c->value;
    if (status > fmi2Warning) return status;
    if (!c->finite && !all_finite(value, c->values)) return NOT_FINITE;
    for (const Piece *p = c->piece, *end = p + c->pieces; p < end; p++)
        memcpy(bus + p->slot, value + p->at, p->count * sizeof *value);
    return status;
}

static void gather_affine(const Call *c, const double *bus)
{
    double *value = c->value;
    for (size_t i = 0; i < c->wires; i++)
        value[c->at[i]] = c->factor[i] * bus[c->slot[i]] + c->offset[i];
}

/* ---- FMI 2.0 ---- */
static int set_real(const Call *c, const Moment *now)
{
    gather(c, now->bus);
    return (int)((fmi2SetRealTYPE *)c->function)(c->component, c->reference, c->count, c->value);
}

static int set_affine(const Call *c, const Moment *now)
{
    gather_affine(c, now->bus);
    return (int)((fmi2SetRealTYPE *)c->function)(c->component, c->reference, c->count, c->value);
}

static int set_integer(const Call *c, const Moment *now)
{
    fmi2Integer *value = c->value;
    for (size_t i = 0; i < c->count; i++) value[i] = (fmi2Integer)now->bus[c->slot[i]];
    return (int)((fmi2SetIntegerTYPE *)c->function)(c->component, c->reference, c->count, value);
}

static int get_real(const Call *c, const Moment *now)
{
    fmi2GetRealTYPE *get = (fmi2GetRealTYPE *)c->function;
    return scatter(c, now->bus, (int)get(c->component, c->reference, c->count, c->value));
}

static int get_integer(const Call *c, const Moment *now)
{
    fmi2Integer *value = c->value;
    int status =
        (int)((fmi2GetIntegerTYPE *)c->function)(c->component, c->reference, c->count, value);
    for (size_t i = 0; i < c->count; i++) now->bus[c->slot[i]] = value[i];
    return status;
}

static int step_2(const Call *c, const Moment *now)
{
    fmi2DoStepTYPE *step = (fmi2DoStepTYPE *)c->function;
    return (int)step(c->component, now->t, c->every * now->step, c->no_rollback);
}

/* ---- FMI 3.0 ---- */
static int call_3(const Call *c) /* fmi3GetX or fmi3SetX: equal but for the type of buffer */
{
    return (int)((fmi3GetFloat64TYPE *)c->function)(c->component, c->reference, c->count, c->value,
                                                    c->values);
}

static int set_float64(const Call *c, const Moment *now)
{
    gather(c, now->bus);
    return call_3(c);
}

static int get_float64(const Call *c, const Moment *now) { return scatter(c, now->bus, call_3(c)); }

static int set_affine_3(const Call *c, const Moment *now)
{
    gather_affine(c, now->bus);
    return call_3(c);
}

#define CONVERSION(Type)                                     \
    static void put_##Type(void *buffer, size_t i, double x) \
    {                                                        \
        ((fmi3##Type *)buffer)[i] = (fmi3##Type)x;           \
    }                                                        \
    static double take_##Type(const void *buffer, size_t i)  \
    {                                                        \
        return (double)((const fmi3##Type *)buffer)[i];      \
    }
CONVERSION(Float64)
CONVERSION(Float32)
CONVERSION(Int8)
CONVERSION(Int16)
CONVERSION(Int32)
CONVERSION(Int64)
CONVERSION(UInt8)
CONVERSION(UInt16)
CONVERSION(UInt32)
CONVERSION(UInt64)
CONVERSION(Boolean)

typedef struct {
    void (*put)(void *buffer, size_t i, double x);
    double (*take)(const void *buffer, size_t i);
} Conversion;

#define BOTH(Type) {put_##Type, take_##Type}
static const Conversion conversion[] = {BOTH(Float64), BOTH(Float32), BOTH(Int8),   BOTH(Int16),
                                        BOTH(Int32),   BOTH(Int64),   BOTH(UInt8),  BOTH(UInt16),
                                        BOTH(UInt32),  BOTH(UInt64),  BOTH(Boolean)};
enum { INT64 = 5, UINT64 = 9 };

/* Returns 1 if element i of the buffer, a whole number, differs from x, its value as a double. */
static int is_wide(const Call *c, size_t i, double x)
{
    if (!(x >= 9007199254740992.0 || x <= -9007199254740992.0)) return 0;
    if (c->type == INT64)
        return x >= 9223372036854775808.0 || (int64_t)x != ((const int64_t *)c->value)[i];
    if (c->type != UINT64) return 0;
    return x >= 18446744073709551616.0 || (uint64_t)x != ((const uint64_t *)c->value)[i];
}

static int set_other(const Call *c, const Moment *now)
{
    for (size_t i = 0; i < c->wires; i++)
        conversion[c->type].put(c->value, c->at[i], now->bus[c->slot[i]]);
    return call_3(c);
}

static int get_other(const Call *c, const Moment *now)
{
    int status = call_3(c);
    for (size_t i = 0; i < c->wires && status <= fmi3Warning; i++) {
        const double x = conversion[c->type].take(c->value, c->at[i]);
        if (!c->finite && !isfinite(x)) return NOT_FINITE;
        if (is_wide(c, c->at[i], x)) return TOO_WIDE;
        now->bus[c->slot[i]] = x;
    }
    return status;
}

static int step_3(const Call *c, const Moment *now)
{
    fmi3Boolean event, terminate = fmi3False, early = fmi3False;
    fmi3Float64 last;
    int status = (int)((fmi3DoStepTYPE *)c->function)(c->component, now->t, c->every * now->step,
                                                      c->no_rollback != 0, &event, &terminate,
                                                      &early, &last);
    if (status > fmi3Warning) return status;
    return terminate ? TERMINATION : early ? EARLY_RETURN : status;
}

/* Functions by kind of call, for both versions of FMI. */
static int (*const perform[])(const Call *c, const Moment *now) = {
    [SET_REAL] = set_real,       [SET_INTEGER] = set_integer, [STEP] = step_2,
    [GET_REAL] = get_real,       [GET_INTEGER] = get_integer, [SET_AFFINE] = set_affine,
    [SET_FLOAT64] = set_float64, [GET_FLOAT64] = get_float64, [SET_OTHER] = set_other,
    [GET_OTHER] = get_other,     [STEP_3] = step_3,           [SET_AFFINE_3] = set_affine_3};

static int due(const Call *c, long k) /* every == 1 is the usual case and needs no division */
{
    return c->every == 1 || k % c->every == c->phase;
}

static void record(const Run *run, long done)
{
    if (done % run->every == 0 || done == run->steps) {
        size_t row = (size_t)((done + run->every - 1) / run->every);
        memcpy(run->table + row * run->slots, run->bus, run->slots * sizeof(double));
    }
    run->progress[0] = done;
}

/* Makes calls i .. end - 1 of macro step k; stops at the first call whose status is neither fmi2OK
 * nor fmi2Warning. */
static Stop part(const Call *calls, size_t i, size_t end, const Run *run, long k)
{
    const Moment now = {run->bus, run->start + (double)k * run->step, run->step};
    for (; i < end; i++) {
        if (!due(&calls[i], k)) continue;
        run->progress[1] = (int64_t)i;
        int status = perform[calls[i].kind](&calls[i], &now);
        if (status < fmi2OK || status > fmi2Warning) return (Stop){k, i, status};
    }
    return (Stop){k, end, fmi2OK};
}

/* Performs macro steps first .. last - 1, then, if the run goes on, the calls of macro step `last`
 * before call `pause`. There the run pauses, so that the user can set the outputs of an open
 * component. ready: 1 if the run already pauses before call `pause` of macro step `first`, 0 if
 * this step has not begun. */
EXPORT Stop execute(const Call *calls, size_t count, const Run *run, long first, long last,
                    size_t pause, int ready)
{
    Stop stop = {first, pause, fmi2OK};
    if (!ready) stop = part(calls, 0, pause, run, first);
    for (long k = first; k < last && stop.call == pause; k++) {
        stop = part(calls, pause, count, run, k);
        if (stop.call < count) break;
        record(run, k + 1);
        stop = (Stop){k + 1, pause, fmi2OK};
        if (k + 1 < run->steps) stop = part(calls, 0, pause, run, k + 1);
    }
    return stop;
}

typedef struct {
    const Call *calls;
    size_t count;
    const Run *run;
    long first, last;
    size_t pause;
    Stop stop;
} Stretch;

/* Performs stretches (consecutive macro steps) of several simulations, one after the other. */
EXPORT void execute_all(Stretch *stretches, size_t count)
{
    for (Stretch *s = stretches; s < stretches + count; s++)
        s->stop = execute(s->calls, s->count, s->run, s->first, s->last, s->pause, 1);
}

/* Replacements of fmi2GetX and fmi3GetX for an open component: nothing is read, because the buffer
 * already contains the values that the user has set. */
EXPORT fmi2Status held_2(fmi2Component component, const fmi2ValueReference reference[],
                         size_t count, fmi2Real value[])
{
    (void)component, (void)reference, (void)count, (void)value;
    return fmi2OK;
}

EXPORT fmi3Status held_3(fmi3Instance component, const fmi3ValueReference reference[], size_t count,
                         fmi3Float64 value[], size_t values)
{
    (void)component, (void)reference, (void)count, (void)value, (void)values;
    return fmi3OK;
}
