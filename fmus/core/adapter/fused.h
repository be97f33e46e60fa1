/* fused.h - a system of models as one model: what the system.c that core/build/fuse.py writes is made
 * of.
 *
 * Memory, in doubles: the macro step and the heads of all parts (parameters, inputs); then what the
 * adapter takes for states and outputs: the start time, the macro steps done, whether the initial
 * values have not settled, a time per slow part, outputs that are published late, and the tails of all parts (states, outputs). After it is room for
 * one part in one piece. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef FUSED_H
#define FUSED_H

#include "finite.h"
#include "interface.h"

enum { MACRO_STEP = 0, MOST_ROUNDS = 200 };

typedef struct {
    size_t from, to, count; /* doubles */
    double factor, offset;  /* of a signal that is changed on the way: to = factor from + offset */
    bool plain;             /* it is not */
} Copy;

typedef struct {
    const Copy *copy;
    size_t count;
} Copies;

typedef struct {
    const char *prefix; /* "component." */
    const ModelInterface *model;
    size_t head, tail; /* where they begin */
    Copies driven;     /* inputs, from outputs as they are published */
    Copies late;       /* outputs to where they are published, if not where they are */
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

/* whether a bit has changed */
static inline bool replaced(double *to, const double *from, size_t count)
{
    if (memcmp(to, from, count * sizeof *to) == 0) return false;
    memcpy(to, from, count * sizeof *to);
    return true;
}

static inline bool drive(const Part *part, double m[])
{
    bool changed = false;
    const Copies all = part->driven;
    for (const Copy *c = all.copy; c < all.copy + all.count; c++)
        for (size_t i = 0; i < c->count; i++) {
            const double x = m[c->from + i], y = c->plain ? x : c->factor * x + c->offset;
            changed |= replaced(m + c->to + i, &y, 1);
        }
    return changed;
}

/* the part in one piece, with states and outputs as at the start */
static inline void assemble(const Part *part, const double m[], double work[])
{
    memcpy(work, part->model->start, part->model->size);
    memcpy(work, m + part->head, part->model->state_offset);
}

static inline void check_part(const Part *part, const double m[], double work[], Problems *problems)
{
    assemble(part, m, work);
    problems->part = part->prefix;
    part->model->check(work, problems);
    problems->part = "";
}

/* ---- initialization ----
 * Outputs of all parts, then inputs of all parts, until no output changes: the rounds of
 * harness/master/simulation.py. A part is evaluated again if one of its inputs has changed,
 * from its start values as the adapter does it. */

/* whether an output of a part differs from what it was */
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

/* whether an output has changed */
static inline bool evaluate(const Part *part, double m[], double work[], double t)
{
    assemble(part, m, work);
    part->model->initialize(work, t);
    const bool changed = outputs_differ(part->model, work, m + part->tail);
    memcpy(m + part->tail, work + head_count(part->model), tail_count(part->model) * sizeof *m);
    copy_all(part->late, m);
    return changed;
}

/* what the adapter of the part alone would let pass */
static inline bool keeps_rules(const Part *part, const double m[])
{
    const ModelInterface *model = part->model;
    if (!all_finite(m + part->tail, tail_count(model))) return false;
    for (const Variable *v = model->variables; v < model->variables + model->variable_count; v++) {
        const size_t first = v->offset / sizeof *m;
        const double *value = v->causality == OUTPUT_ROW
                                  ? m + part->tail + (first - head_count(model))
                                  : m + part->head + first;
        if (v->causality != PARAMETER_ROW && !keep_rule(v->rule, value, v->size)) return false;
    }
    return true;
}

/* driven inputs as at the start, a bus of zeros */
static inline void begin_part(const Part *part, double m[])
{
    const double *start = part->model->start;
    const Copies all = part->driven;
    for (const Copy *c = all.copy; c < all.copy + all.count; c++)
        memcpy(m + c->to, start + (c->to - part->head), c->count * sizeof *m);
    memset(m + part->tail, 0, tail_count(part->model) * sizeof *m);
}

/* whether the outputs have settled; work: room for the largest part with its scratch; stale: one per
 * part */
static inline bool initialize_parts(const Part *parts, size_t count, bool stale[], double m[],
                                    double work[], double t)
{
    const Part *const end = parts + count;
    for (const Part *p = parts; p < end; p++) {
        begin_part(p, m);
        stale[p - parts] = true;
    }
    bool changed = true;
    for (int round = 0; changed && round < MOST_ROUNDS; round++) {
        changed = false;
        for (const Part *p = parts; p < end; p++) {
            if (!stale[p - parts]) continue;
            changed |= evaluate(p, m, work, t);
            if (!keeps_rules(p, m)) return true; /* the adapter refuses what stands there */
        }
        for (const Part *p = parts; p < end; p++) stale[p - parts] = drive(p, m);
    }
    for (const Part *p = parts; p < end; p++)
        if (stale[p - parts]) evaluate(p, m, work, t);
    return !changed;
}

#endif
