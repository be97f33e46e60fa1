/* fused.h - a system of models as one model: types and functions for the system.c written by
 * core/build/fuse.py.
 *
 * A part is a component of the system. The memory is an array of doubles, in this order: the macro
 * step; the heads of all parts (parameters, inputs); start time; number of completed macro steps; a
 * flag that is 1 if the initial values have not converged; the time of each part that does not step
 * at every macro step; for each part, copies of its outputs if they are published later than they
 * are computed, and its tail (states, outputs). In the workspace behind the memory, one part at a
 * time is assembled, with its tail directly behind its head. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef FUSED_H
#define FUSED_H

#include "interface.h"

enum { MACRO_STEP = 0, MOST_ROUNDS = 200 };

typedef struct {
    size_t from, to, count; /* indices in the memory, number of doubles */
    double factor, offset;  /* unit conversion: m[to] = factor m[from] + offset */
    bool plain;             /* no conversion */
} Copy;

typedef struct {
    const Copy *copy;
    size_t count;
} Copies;

typedef struct {
    const char *prefix; /* "component." */
    const ModelInterface *model;
    size_t head;   /* index in the memory of the first parameter of the part; inputs follow */
    size_t tail;   /* index in the memory of the first state of the part; outputs follow */
    Copies driven; /* published outputs of other parts -> inputs of this part */
    Copies late;   /* outputs that are published late: from this part to copies that others read */
} Part;

static inline size_t head_count(const ModelInterface *m)
{
    return m->state_offset / sizeof(double);
}
static inline size_t tail_count(const ModelInterface *m)
{
    return (m->size - m->state_offset) / sizeof(double);
}

static inline void copy_all(Copies all, double m[])
{
    for (const Copy *c = all.copy; c < all.copy + all.count; c++)
        memcpy(m + c->to, m + c->from, c->count * sizeof *m);
}

/* copies `count` doubles; returns true if a bit of the destination has changed */
static inline bool copy_if_different(double *to, const double *from, size_t count)
{
    if (memcmp(to, from, count * sizeof *to) == 0) return false;
    memcpy(to, from, count * sizeof *to);
    return true;
}

static inline bool set_driven_inputs(const Part *part, double m[])
{
    bool changed = false;
    const Copies all = part->driven;
    for (const Copy *c = all.copy; c < all.copy + all.count; c++)
        for (size_t i = 0; i < c->count; i++) {
            const double x = m[c->from + i], y = c->plain ? x : c->factor * x + c->offset;
            changed |= copy_if_different(m + c->to + i, &y, 1);
        }
    return changed;
}

/* writes a whole part to work[]: parameters and inputs from the memory m, start values of states
 * and outputs */
static inline void assemble_part(const Part *part, const double m[], double work[])
{
    memcpy(work, part->model->start, part->model->size);
    memcpy(work, m + part->head, part->model->state_offset);
}

static inline void check_part(const Part *part, const double m[], double work[], Problems *problems)
{
    assemble_part(part, m, work);
    problems->part = part->prefix;
    part->model->check(work, problems);
    problems->part = "";
}

/* ---- initialization ----
 * Each round evaluates the outputs of all parts and then sets the inputs of all parts, until no
 * output changes, as harness/master/simulation.py does. A part is evaluated again, from its start
 * values, if one of its inputs has changed. */

/* true if an output of a part has other bits in `whole` (head and tail with the new values) than in
 * `tail` (tail with the previous values) */
static inline bool outputs_differ(const ModelInterface *model, const double whole[],
                                  const double tail[])
{
    for (const Variable *v = model->variables; v < model->variables + model->variable_count; v++) {
        const size_t first = v->offset / sizeof *whole;
        if (v->causality == OUTPUT_ROW &&
            memcmp(whole + first, tail + first - head_count(model), v->size * sizeof *whole) != 0)
            return true;
    }
    return false;
}

/* evaluates the initial states and outputs of a part at time t and stores them in the memory m;
 * returns true if an output has changed */
static inline bool evaluate_outputs(const Part *part, double m[], double work[], double t)
{
    assemble_part(part, m, work);
    part->model->initialize(work, t);
    const bool changed = outputs_differ(part->model, work, m + part->tail);
    memcpy(m + part->tail, work + head_count(part->model), tail_count(part->model) * sizeof *m);
    copy_all(part->late, m);
    return changed;
}

/* true if states and outputs of the part are finite, and inputs and outputs satisfy their rules:
 * the adapter of a single FMU makes the same checks */
static inline bool satisfies_rules(const Part *part, const double m[])
{
    const ModelInterface *model = part->model;
    if (!all_finite(m + part->tail, tail_count(model))) return false;
    return satisfy_rows(model, INPUT_ROW, m + part->head, 0) &&
           satisfy_rows(model, OUTPUT_ROW, m + part->tail, head_count(model));
}

/* sets the driven inputs of a part to their start values, its states and outputs to zero */
static inline void reset_part(const Part *part, double m[])
{
    const double *start = part->model->start;
    const Copies all = part->driven;
    for (const Copy *c = all.copy; c < all.copy + all.count; c++)
        memcpy(m + c->to, start + (c->to - part->head), c->count * sizeof *m);
    memset(m + part->tail, 0, tail_count(part->model) * sizeof *m);
}

/* initializes all parts at time t; returns false if the outputs have not converged. If a value
 * violates its rule, the function returns true at once: the adapter then rejects this value. work:
 * space for the largest part with its workspace; stale: one element per part, true if the part must
 * be evaluated again */
static inline bool initialize_parts(const Part *parts, size_t count, bool stale[], double m[],
                                    double work[], double t)
{
    const Part *const end = parts + count;
    for (const Part *p = parts; p < end; p++) {
        reset_part(p, m);
        stale[p - parts] = true;
    }
    bool changed = true;
    for (int round = 0; changed && round < MOST_ROUNDS; round++) {
        changed = false;
        for (const Part *p = parts; p < end; p++) {
            if (!stale[p - parts]) continue;
            changed |= evaluate_outputs(p, m, work, t);
            if (!satisfies_rules(p, m)) return true; /* the adapter rejects the value */
        }
        for (const Part *p = parts; p < end; p++) stale[p - parts] = set_driven_inputs(p, m);
    }
    for (const Part *p = parts; p < end; p++)
        if (stale[p - parts]) evaluate_outputs(p, m, work, t);
    return !changed;
}

#endif
