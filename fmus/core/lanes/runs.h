/* runs.h - macro steps of several runs of a fused system at once: checks, recorded rows.
 *
 * The memory of the system (fused.h) has a vector in the place of every double. Every macro step is
 * checked in every lane as fmi2DoStep of the FMU checks it. A run that fails a check is lost: its
 * lane is no longer computed, and the caller repeats the run alone. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef RUNS_H
#define RUNS_H

#define EXPORT extern "C" __attribute__((visibility("default")))

#define STRETCH 64 /* most macro steps between two saves of the memory, see performed() */

using lanes::Mask;
using lanes::Vector;

/* output whose value must be within low .. high, or 0 or 1 if `flag` is set */
typedef struct {
    const Vector *x;
    double low, high;
    bool flag;
} Ruled;

struct Work {
    Vector memory[scalar::SIZE];
    Vector saved[scalar::SIZE]; /* memory before the macro steps that may be repeated */
    int64_t saved_done, saved_lost;
    double saved_now;
    Ruled ruled[2 * scalar::SIZE];
    size_t ruled_count;
    const Vector **columns; /* vectors of the recorded outputs */
};

typedef struct {
    double start, step;              /* s; macro step k ends at start + k step + step */
    int64_t every, steps;            /* a row after each `every`-th step and after the last */
    int64_t count;                   /* runs, at most WIDTH */
    size_t columns;                  /* recorded outputs */
    const unsigned *reference;       /* value references of the recorded outputs */
    scalar::Snapshot *const *states; /* state of each run: loaded by begin(), stored by end() */
    double *const *tables;           /* table of the recorded rows of each run */
    int64_t done, lost;              /* macro steps completed; bit i is 1 if run i is lost */
    double now;                      /* s; time of all runs */
    Work *work;
} Runs;

/* ---- checks ---- */
static Mask satisfying(const Ruled *r)
{
    const Vector x = *r->x;
    return r->flag ? x == 0 || x == 1 : x >= r->low && x <= r->high;
}

/* bits of the runs in which an output violates its rule, or a state or output is not finite */
static int rejected(const Runs *r)
{
    Mask valid(true);
    for (size_t i = 0; i < r->work->ruled_count; i++)
        valid = valid && satisfying(&r->work->ruled[i]);
    return (!valid).bits() | lanes::not_finite;
}

/* ---- rows ---- */
static void record(const Runs *r)
{
    if (r->done % r->every != 0 && r->done != r->steps) return;
    const size_t row = (size_t)((r->done + r->every - 1) / r->every) * r->columns;
    for (size_t c = 0; c < r->columns; c++)
        for (int i = 0; i < r->count; i++) r->tables[i][row + c] = r->work->columns[c]->v[i];
}

static const Vector *place_of(const Vector *m, const scalar::Variable *v, size_t element)
{
    return m + v->offset / sizeof(double) + element;
}

static void list_ruled(Work *w, const scalar::Variable *rows, size_t count)
{
    for (const scalar::Variable *v = rows; v < rows + count; v++)
        for (size_t k = 0; k < v->size; k++)
            if (v->causality == scalar::OUTPUT_ROW && v->rule != scalar::ANY_VALUE)
                w->ruled[w->ruled_count++] = {
                    place_of(w->memory, v, k),
                    v->rule == scalar::POSITIVE_VALUE ? DBL_TRUE_MIN : scalar::lowest(v->rule),
                    scalar::highest(v->rule), (bool)scalar::is_flag(v->rule)};
}

/* ---- exported functions ---- */
EXPORT const int width = WIDTH;

/* allocates the memory and loads the states of the runs, which all have completed the same number
 * of macro steps; false: out of memory */
EXPORT bool begin(Runs *r)
{
    Work *w = r->work = (Work *)aligned_alloc(alignof(Work), sizeof(Work));
    const Vector **columns = (const Vector **)calloc(r->columns + 1, sizeof *columns);
    if (!w || !columns) return free(columns), free(w), false;
    memset((void *)w, 0, sizeof *w);
    w->columns = columns;
    const double last = fabs(r->start) + (double)r->steps * r->step;
    r->now = r->states[0]->now.time;
    for (int i = 0; i < r->count; i++) {
        const scalar::Snapshot *s = r->states[i];
        for (size_t k = 0; k < scalar::SIZE; k++) w->memory[k].v[i] = s->data[k];
        if (s->now.grid > 0 && last / s->now.grid > scalar::most_grid_steps) r->lost |= 1 << i;
    }
    list_ruled(w, scalar::variables, COUNT(scalar::variables));
#ifdef CHECKED_ROWS
    list_ruled(w, scalar::checked, COUNT(scalar::checked));
#endif
    for (size_t c = 0; c < r->columns; c++) {
        const unsigned row = r->reference[c] / scalar::VR_STRIDE;
        const size_t element = r->reference[c] % scalar::VR_STRIDE;
        w->columns[c] = place_of(w->memory, &scalar::variables[row], element);
    }
    return true;
}

static void activate(const Runs *r) { lanes::active = ((1 << r->count) - 1) & ~(int)r->lost; }

static void save(const Runs *r)
{
    Work *w = r->work;
    memcpy((void *)w->saved, w->memory, sizeof w->saved);
    w->saved_done = r->done;
    w->saved_lost = r->lost;
    w->saved_now = r->now;
}

static void restore(Runs *r)
{
    Work *w = r->work;
    memcpy((void *)w->memory, w->saved, sizeof w->saved);
    r->done = w->saved_done;
    r->lost = w->saved_lost;
    r->now = w->saved_now;
    lanes::present = NULL;
    activate(r);
}

static void perform(Runs *r, int64_t last)
{
    while (r->done < last && lanes::active) {
        const double t = r->start + (double)r->done * r->step;
        lanes::not_finite = 0;
        step_system(r->work->memory, r->now, r->step);
        r->lost |= rejected(r);
        activate(r);
        r->now = t + r->step;
        r->done++;
        record(r);
    }
}

/* performs macro steps up to `last`; false: the lanes differ in a decision of a component for the
 * first time (lanes.h), so that the caller has to restore the saved memory and repeat the steps */
__attribute__((OPAQUE)) static bool performed(Runs *r, int64_t last)
{
    if (setjmp(lanes::again)) return false;
    perform(r, last);
    return true;
}

/* performs macro steps until `last` of them are completed, or until all runs are lost */
EXPORT void advance(Runs *r, int64_t last)
{
    activate(r);
    while (r->done < last && lanes::active) {
        const int64_t end = last - r->done > STRETCH ? r->done + STRETCH : last;
        save(r);
        while (!performed(r, end)) restore(r);
    }
}

/* stores the states of the runs and releases the memory */
EXPORT void end(Runs *r)
{
    for (int i = 0; i < r->count; i++) {
        for (size_t k = 0; k < scalar::SIZE; k++) r->states[i]->data[k] = r->work->memory[k].v[i];
        r->states[i]->now.time = r->now;
        r->states[i]->now.step = r->step;
    }
    free(r->work->columns);
    free(r->work);
}

#endif
