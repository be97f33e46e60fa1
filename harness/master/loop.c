/* loop.c - the schedule of schedule.py, executed in C over the functions of the loaded FMUs.
 *
 * The same calls in the same order with the same buffers as the Python executor, so the results
 * agree bit for bit. Python lays out the calls (executors.py has the same structs); nothing here
 * allocates or knows Python. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "finite.h"
#include "fmi2FunctionTypes.h"

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
    SET_AFFINE
}; /* integers carry fmi2Boolean as well */
enum { NOT_FINITE = -1 }; /* beside fmi2Status: an output is infinite or NaN */

typedef struct {
    size_t slot, count; /* neighbours on the bus that are neighbours in the buffer too */
} Piece;

typedef struct {
    int kind;
    int every, phase;       /* due in macro step k if k % every == phase */
    int no_rollback;        /* noSetFMUStatePriorToCurrentPoint of a step */
    void (*function)(void); /* fmi2SetReal, fmi2DoStep, ... of the FMU's library */
    fmi2Component component;
    size_t count; /* of values in a SET or GET */
    const fmi2ValueReference *reference;
    const size_t *slot; /* place of each value on the bus */
    const Piece *piece; /* the same places in pieces */
    size_t pieces;
    void *value;                   /* buffer of fmi2Real or fmi2Integer */
    const double *factor, *offset; /* of SET_AFFINE: input = factor * bus + offset */
} Call;

typedef struct {
    double start, step; /* s; macro step k goes from start + k step to start + (k + 1) step */
    double *bus;
    size_t slots;
    double *table; /* recorded rows, row r = bus after r * every macro steps, the last after all */
    long every, steps;
    volatile int64_t *marks; /* macro steps completed, call being made: for who finds us dead */
} Run;

typedef struct {
    long done;   /* macro steps completed */
    size_t call; /* where it stopped, and why */
    int status;
} Stop;

static int set_real(const Call *c, const double *bus)
{
    fmi2Real *value = c->value;
    for (const Piece *p = c->piece, *end = p + c->pieces; p < end; value += p++->count)
        memcpy(value, bus + p->slot, p->count * sizeof *value);
    return (int)((fmi2SetRealTYPE *)c->function)(c->component, c->reference, c->count, c->value);
}

static int set_affine(const Call *c, const double *bus)
{
    fmi2Real *value = c->value;
    for (size_t i = 0; i < c->count; i++) value[i] = c->factor[i] * bus[c->slot[i]] + c->offset[i];
    return (int)((fmi2SetRealTYPE *)c->function)(c->component, c->reference, c->count, value);
}

static int set_integer(const Call *c, const double *bus)
{
    fmi2Integer *value = c->value;
    for (size_t i = 0; i < c->count; i++) value[i] = (fmi2Integer)bus[c->slot[i]];
    return (int)((fmi2SetIntegerTYPE *)c->function)(c->component, c->reference, c->count, value);
}

static int get_real(const Call *c, double *bus)
{
    fmi2Real *value = c->value;
    int status = (int)((fmi2GetRealTYPE *)c->function)(c->component, c->reference, c->count, value);
    if (status > fmi2Warning) return status;
    if (!all_finite(value, c->count)) return NOT_FINITE;
    for (const Piece *p = c->piece, *end = p + c->pieces; p < end; value += p++->count)
        memcpy(bus + p->slot, value, p->count * sizeof *value);
    return status;
}

static int get_integer(const Call *c, double *bus)
{
    fmi2Integer *value = c->value;
    int status =
        (int)((fmi2GetIntegerTYPE *)c->function)(c->component, c->reference, c->count, value);
    for (size_t i = 0; i < c->count; i++) bus[c->slot[i]] = value[i];
    return status;
}

static int perform(const Call *c, const Run *run, long k)
{
    switch (c->kind) {
    case SET_REAL: return set_real(c, run->bus);
    case SET_AFFINE: return set_affine(c, run->bus);
    case SET_INTEGER: return set_integer(c, run->bus);
    case GET_REAL: return get_real(c, run->bus);
    case GET_INTEGER: return get_integer(c, run->bus);
    default:
        return (int)((fmi2DoStepTYPE *)c->function)(
            c->component, run->start + (double)k * run->step, c->every * run->step, c->no_rollback);
    }
}

static int due(const Call *c, long k) /* every step for most: no division then */
{
    return c->every == 1 || k % c->every == c->phase;
}

static void record(const Run *run, long done)
{
    if (done % run->every == 0 || done == run->steps) {
        size_t row = (size_t)((done + run->every - 1) / run->every);
        memcpy(run->table + row * run->slots, run->bus, run->slots * sizeof(double));
    }
    run->marks[0] = done;
}

/* Macro steps first .. last - 1; stops at the first call whose status is neither fmi2OK nor
 * fmi2Warning. */
EXPORT Stop execute(const Call *calls, size_t count, const Run *run, long first, long last)
{
    for (long k = first; k < last; k++) {
        for (size_t i = 0; i < count; i++) {
            if (!due(&calls[i], k)) continue;
            run->marks[1] = (int64_t)i;
            int status = perform(&calls[i], run, k);
            if (status < fmi2OK || status > fmi2Warning) return (Stop){k, i, status};
        }
        record(run, k + 1);
    }
    return (Stop){last, 0, fmi2OK};
}
