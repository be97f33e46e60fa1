/* known_calls.h - cache of calls: the value references of a call are not resolved again if one of
 * the last calls had the same.
 *
 * A master reads and writes the same variables at every step. The references of its last calls are
 * stored with the runs of consecutive doubles that they name. A call is known if it has the same
 * references in the same order as a stored call; the address of the array does not matter. An
 * unknown call is resolved reference by reference. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef KNOWN_CALLS_H
#define KNOWN_CALLS_H

#include "interface.h"

#ifndef LONGEST_CALL /* largest number of references of a stored call, smaller in firmware */
#define LONGEST_CALL 1024
#endif
enum { KNOWN_CALLS = 2, MOST_RUNS = LONGEST_CALL < 256 ? 16 : 64 };

typedef struct {
    size_t first, count; /* neighbouring doubles of the model: index of the first, number */
    Rule rule;
} Run;

typedef struct {
    size_t count, values, runs; /* numbers of references (0: no call stored), elements and runs */
    unsigned reference[LONGEST_CALL];
    Run run[MOST_RUNS];
} KnownCall;

typedef struct {
    KnownCall call[KNOWN_CALLS];
    size_t oldest;
} KnownCalls;

static inline const KnownCall *find_known_call(const KnownCalls *known, const unsigned vr[],
                                               size_t count)
{
    for (const KnownCall *c = known->call; c < known->call + KNOWN_CALLS; c++)
        if (count && c->count == count && memcmp(c->reference, vr, count * sizeof *vr) == 0)
            return c;
    return NULL;
}

/* elements of one value reference: one element in FMI 2.0, a whole row in FMI 3.0 */
typedef struct {
    Scalar first; /* row NULL: the variable does not exist */
    size_t size;
} Part;

static inline Part part_of(const ModelInterface *m, unsigned vr, bool rows)
{
    Scalar s = scalar_of(m, vr);
    if (!s.row || (rows && s.element)) return (Part){{NULL, 0}, 0};
    return (Part){s, rows ? s.row->size : 1};
}

/* Adds the elements of p to run[0 .. *runs-1]. A Run is a group of neighbouring elements with
 * the same rule: p extends the last Run if p begins at its end and has its rule; otherwise p
 * becomes a new Run, for which the array must have space. */
static inline void add_to_runs(Run run[], size_t *runs, Part p, Rule rule)
{
    size_t at = p.first.row->offset / sizeof(double) + p.first.element;
    Run *last = run + *runs - (*runs > 0);
    if (*runs && last->first + last->count == at && last->rule == rule) last->count += p.size;
    else run[(*runs)++] = (Run){at, p.size, rule};
}

/* stores a call in place of the oldest stored one; a call with too many references or Runs is
 * not stored */
static inline void store_known_call(KnownCalls *known, const ModelInterface *m, const unsigned vr[],
                                    size_t count, bool rows)
{
    KnownCall *c = &known->call[known->oldest];
    if (count == 0 || count > LONGEST_CALL) return;
    c->count = c->values = c->runs = 0;
    for (size_t i = 0; i < count; i++) {
        Part p = part_of(m, vr[i], rows);
        if (c->runs == MOST_RUNS) return;
        add_to_runs(c->run, &c->runs, p, rule_when_set(p.first));
        c->values += p.size;
    }
    memcpy(c->reference, vr, count * sizeof *vr);
    c->count = count;
    known->oldest = (known->oldest + 1) % KNOWN_CALLS;
}

static inline bool satisfy_rules(const KnownCall *c,
                                 const double value[]) /* value: finite numbers */
{
    for (const Run *r = c->run, *end = r + c->runs; r < end; value += r++->count)
        if (!satisfy_rule(r->rule, value, r->count)) return false;
    return true;
}

static inline void write_runs(const KnownCall *c, double model[], const double value[])
{
    for (const Run *r = c->run, *end = r + c->runs; r < end; value += r++->count)
        memcpy(model + r->first, value, r->count * sizeof *value);
}

static inline void read_runs(const KnownCall *c, const double model[], double value[])
{
    for (const Run *r = c->run, *end = r + c->runs; r < end; value += r++->count)
        memcpy(value, model + r->first, r->count * sizeof *value);
}

#endif
