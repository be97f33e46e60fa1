/* thruster_allocation.c - throttles of up to 16 thrusters for a commanded force and torque.
 *
 *   min |A x - w|^2 + eps sum (|a_i| x_i)^2,   0 <= x_i <= 1,     w = W [F; M],
 *           a_i = W [P R; (L - D_cm) x P R]
 *
 * x_i: throttle of thruster i, P: its nominal thrust, R: direction, L: position; D_cm: centre of
 * mass; A: matrix of the columns a_i; F, M: commanded force and torque; W: weights weight_F and
 * weight_M. The second term chooses among the many x that give the same wrench. With it the
 * solution is unique and continuous in the command, and no thrusters work against each other,
 * because less thrust of both would give the same wrench. The weight |a_i| makes the choice
 * independent of the strength of a thruster. With eps = 1e-10 the wrench is wrong by about
 * eps/sigma^2 < 1e-6 of its length; sigma: smallest singular value of the columns a_i/|a_i|.
 * Active-set solver after Stark & Parker 1995 (BVLS); it releases at most 100 throttles from their
 * bounds.
 *
 * With keep_direction = 1 a command out of reach is scaled to s w with the largest attainable s,
 * which is found by decreasing s from 1. The attainable wrenches are a convex set that contains 0.
 * If s w is outside, the residual r = s w - A x is normal to a plane that separates s w from the
 * set, and s becomes r.(A x) / r.w, which is never too small. The sequence ends on the facet
 * through which w leaves the set.
 *
 * Pulses: once per period the on-time of each thruster is x_i times the period plus the remainder
 * of the period before, in whole samples; an on-time below min_on_time is added to the next period.
 * So at any time the on-time lags the demand by less than min_on_time, rounded up to whole samples
 * (at least one). Thrusters that are known to have failed are not used from lost_from on. Own
 * design; the wrench of a thruster as in docs/models.md B.6. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "thrusters.h"
#include "time_grid.h"

enum { EXCHANGES = 100, CUTS = 100, LENGTH = 6 + THRUSTERS };
#define DAMPING  1e-5 /* sqrt(eps) */
#define IN_REACH 1e-6 /* a command w is attainable if |residual| <= IN_REACH |w| */

typedef struct {
    Thrusters thrusters;
    vec3 weight_F, weight_M;
    double keep_direction, pulsed, pulse_period, min_on_time, sample_period;
    double lost[THRUSTERS], lost_from;
} Parameters;
typedef struct { vec3 F_cmd_S, M_cmd_S; } Input;
typedef struct {
    double on[THRUSTERS], carry[THRUSTERS];
} State; /* on: on-time in this period; carry: on-time added to the next period; in samples */
typedef struct {
    double throttle[THRUSTERS], infeasible, scale;
    vec3 F_alloc_S, M_alloc_S;
    double demand[THRUSTERS], unspent[THRUSTERS];
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.thrusters = PAPER_THRUSTERS,
          .weight_F = {1, 1, 1},
          .weight_M = {1, 1, 1},
          .keep_direction = 1,
          .pulse_period = 1,
          .min_on_time = 0.2,
          .sample_period = 0.1},
};

static const Variable variables[] = {
    THRUSTER_ROWS(thrusters),
    NONNEGATIVE(weight_F, "1/N",
                "weight of the force error, per body axis; 0 = the error of this axis is ignored"),
    NONNEGATIVE(weight_M, "1/(N.m)",
                "weight of the torque error, per body axis; 0 = the error of this axis is ignored"),
    SWITCH(keep_direction,
           "command out of reach: 1 = scaled, 0 = nearest wrench by weight_F and weight_M"),
    SWITCH(pulsed, "0: continuous throttles, 1: pulse-width modulation"),
    POSITIVE(pulse_period, "s", "period of the pulses, a multiple of sample_period"),
    NONNEGATIVE(min_on_time, "s", "shortest pulse"),
    SAMPLE_PERIOD_AS(sample_period, "at every communication step (if pulsed = 0)"),
    SWITCH(lost, "1: known to have failed, not used from lost_from on; per thruster"),
    PARAMETER(lost_from, "s", "thrusters with lost = 1 are not used from this time on"),

    INPUT(F_cmd_S, "N", "commanded force, body axes"),
    INPUT(M_cmd_S, "N.m", "commanded torque about the centre of mass, body axes"),

    NONNEGATIVE_OUTPUT(throttle, "1",
                       "commanded part of the nominal thrust, per thruster; 0 or 1 with pulses"),
    FLAG(infeasible, "1: the command is out of reach"),
    NONNEGATIVE_OUTPUT(scale, "1",
                       "part of the command that is allocated; always 1 if keep_direction = 0"),
    OUTPUT(F_alloc_S, "N", "allocated force, body axes"),
    OUTPUT(M_alloc_S, "N.m", "allocated torque about the centre of mass, body axes"),
    NONNEGATIVE_OUTPUT(demand, "1", "throttle before the pulse modulation, per thruster"),
    NONNEGATIVE_OUTPUT(unspent, "s", "on-time carried over to later pulses, per thruster"),
};

static int is_multiple(double a, double b)
{
    return fabs(a / b - nearest_whole(a / b)) <= ROUNDED_OFF * larger(1, a / b);
}

/* B.7-6 */
static void check(const Parameters *p, Problems *problems)
{
    check_thrusters(problems, &p->thrusters);
    if (!p->pulsed) return;
    if (p->sample_period == 0)
        reject(problems, "sample_period", 0, "must be > 0 with pulses (pulsed = 1)");
    else if (!is_multiple(p->pulse_period, p->sample_period))
        reject(problems, "pulse_period", p->pulse_period, "must be a multiple of sample_period");
    if (p->min_on_time > p->pulse_period)
        reject(problems, "min_on_time", p->min_on_time, "must not be above pulse_period");
}

/* ---- columns of A: six weighted wrench components, then one damping row per thruster ---- */
typedef struct { double v[LENGTH]; } Column;
typedef struct {
    Column a[THRUSTERS]; /* a[i]: row 6 + i is the only damping row that is not 0 */
    double length[THRUSTERS];
} Matrix;

static double product_of(const Column *a, const Column *b, int length)
{
    double sum = 0;
    for (int i = 0; i < length; i++) sum += a->v[i] * b->v[i];
    return sum;
}

static void add_to(Column *a, double k, const Column *b, int length) /* a += k b */
{
    for (int i = 0; i < length; i++) a->v[i] += k * b->v[i];
}

static void divide(Column *a, double by, int length)
{
    for (int i = 0; i < length; i++) a->v[i] /= by;
}

static Column weighted(const Parameters *p, vec3 F, vec3 M)
{
    vec3 f = times(p->weight_F, F), m = times(p->weight_M, M);
    return (Column){{f.x, f.y, f.z, m.x, m.y, m.z}};
}

/* B.7-3 */
static double thrust_at(const Parameters *p, int i, double t)
{
    return p->lost[i] && reached(t, p->lost_from) ? 0 : p->thrusters.nominal[i];
}

static Matrix columns_of(const Parameters *p, double t)
{
    Matrix A;
    for (int i = 0; i < THRUSTERS; i++) {
        Wrench w = thruster_wrench(&p->thrusters, i, thrust_at(p, i, t));
        A.a[i] = weighted(p, w.F, w.M);
        A.a[i].v[6 + i] = DAMPING * sqrt(product_of(&A.a[i], &A.a[i], 6));
        A.length[i] = sqrt(product_of(&A.a[i], &A.a[i], LENGTH));
    }
    return A;
}

/* residual b - A x; the damping rows of b are 0 */
static Column residual(const Matrix *A, Column b, const double *x)
{
    for (int i = 0; i < THRUSTERS; i++) {
        add_to(&b, -x[i], &A->a[i], 6);
        b.v[6 + i] = -x[i] * A->a[i].v[6 + i];
    }
    return b;
}

/* ---- bounded least squares ---- */
typedef enum { AT_ZERO, FREE, AT_ONE } Side;
typedef struct {
    double x[THRUSTERS];
    Side side[THRUSTERS];
} Iterate;

/* decomposition Q R of the columns of the free thrusters; who: number of the thruster of each
 * column, n: number of columns that are valid; c: see free_step(). Column k of Q has its damping
 * value in row 6 + k, not 6 + who[k], and is 0 below this row. */
typedef struct {
    Column Q[THRUSTERS];
    double R[THRUSTERS][THRUSTERS], c[THRUSTERS];
    int who[THRUSTERS], n;
} Factors;

/* appends the column of thruster i as column n of Q and R, by modified Gram-Schmidt */
static void orthogonalize(const Matrix *A, Factors *f, int n, int i)
{
    Column *q = &f->Q[n];
    *q = A->a[i];
    q->v[6 + i] = 0;
    q->v[6 + n] = A->a[i].v[6 + i];
    for (int k = 0; k < n; k++) {
        f->R[k][n] = product_of(&f->Q[k], q, 7 + k);
        add_to(q, -f->R[k][n], &f->Q[k], 7 + k);
    }
    f->R[n][n] = sqrt(product_of(q, q, 7 + n));
    divide(q, f->R[n][n], 7 + n);
    f->who[n] = i;
    f->n = n + 1;
}

/* step d of the free variables to the minimum while the others are fixed: d = R^-1 c, c = Q^T r.
 * The first columns of Q and R are reused as long as their thrusters are the same as in the last
 * step. */
static void free_step(const Matrix *A, const Iterate *it, Column r, Factors *f, double *d)
{
    int n = 0;
    for (int i = 0; i < THRUSTERS; i++) {
        d[i] = 0;
        if (it->side[i] != FREE) continue;
        if (n >= f->n || f->who[n] != i) orthogonalize(A, f, n, i);
        r.v[6 + n] = r.v[6 + i];
        f->c[n] = product_of(&f->Q[n], &r, 7 + n);
        add_to(&r, -f->c[n], &f->Q[n], 7 + n);
        n++;
    }
    for (int i = n - 1; i >= 0; i--) {
        double step = f->c[i] / f->R[i][i];
        d[f->who[i]] = step;
        for (int k = 0; k < i; k++) f->c[k] -= f->R[k][i] * step;
    }
}

/* index of the variable at a bound whose release lowers the sum of squares fastest; -1 if none
 * lowers it: x is the minimum */
static int variable_to_release(const Matrix *A, const Iterate *it, const Column *b)
{
    Column r = residual(A, *b, it->x);
    double best = 0, size = sqrt(product_of(b, b, 6));
    int found = -1;
    for (int i = 0; i < THRUSTERS; i++) {
        if (it->side[i] == FREE || A->length[i] == 0) continue;
        double slope = (product_of(&A->a[i], &r, 6) + A->a[i].v[6 + i] * r.v[6 + i]) /
                       A->length[i] * (it->side[i] == AT_ZERO ? 1 : -1);
        if (slope > 1e-14 * size && slope > best) best = slope, found = i;
    }
    return found;
}

/* moves the free variables towards their minimum, as far as the first bound; returns 1 if the
 * minimum was reached */
/* B.7-5 */
static int move(const Matrix *A, Iterate *it, const Column *b, Factors *f)
{
    double d[THRUSTERS], part = 1, step_to_bound[THRUSTERS];
    free_step(A, it, residual(A, *b, it->x), f, d);
    for (int i = 0; i < THRUSTERS; i++) {
        step_to_bound[i] = d[i] > 0 ? (1 - it->x[i]) / d[i] : d[i] < 0 ? -it->x[i] / d[i] : 2;
        part = smaller(part, step_to_bound[i]);
    }
    for (int i = 0; i < THRUSTERS; i++) {
        if (it->side[i] != FREE) continue;
        int stopped = step_to_bound[i] <= part && part < 1;
        it->x[i] = stopped ? d[i] > 0 : clamp(it->x[i] + part * d[i], 0, 1);
        if (stopped) it->side[i] = d[i] > 0 ? AT_ONE : AT_ZERO;
    }
    return part == 1;
}

/* B.7-1 */
static Iterate bounded_least_squares(const Matrix *A, const Column *b, Factors *f)
{
    Iterate it = {{0}, {AT_ZERO}};
    for (int exchange = 0, i; exchange < EXCHANGES && (i = variable_to_release(A, &it, b)) >= 0;
         exchange++) {
        it.side[i] = FREE;
        for (int bound = 0; bound <= THRUSTERS && !move(A, &it, b, f); bound++) {}
    }
    return it;
}

/* ---- the command ---- */
/* B.7-2 */
static void allocate_wrench(const Parameters *p, const Input *u, Output *y, double t)
{
    Matrix A = columns_of(p, t);
    Column w = weighted(p, u->F_cmd_S, u->M_cmd_S);
    Factors f = {.n = 0};
    Iterate it;
    y->scale = 1;
    for (int cut = 0;; cut++) {
        Column target = {{0}};
        add_to(&target, y->scale, &w, 6);
        it = bounded_least_squares(&A, &target, &f);
        Column r = residual(&A, target, it.x), met = target;
        add_to(&met, -1, &r, 6);
        int in_reach = product_of(&r, &r, 6) <= IN_REACH * IN_REACH * product_of(&w, &w, 6);
        if (in_reach || !p->keep_direction || cut == CUTS - 1) break;
        y->scale = larger(0, product_of(&r, &met, 6) / product_of(&r, &w, 6));
    }
    memcpy(y->demand, it.x, sizeof it.x);
}

static void publish_wrench(const Parameters *p, const Input *u, Output *y)
{
    y->F_alloc_S = y->M_alloc_S = vec(0, 0, 0);
    for (int i = 0; i < THRUSTERS; i++) {
        Wrench w = thruster_wrench(&p->thrusters, i, p->thrusters.nominal[i] * y->demand[i]);
        y->F_alloc_S = add(y->F_alloc_S, w.F);
        y->M_alloc_S = add(y->M_alloc_S, w.M);
    }
    Column w = weighted(p, u->F_cmd_S, u->M_cmd_S), met = weighted(p, y->F_alloc_S, y->M_alloc_S);
    Column missing = w;
    add_to(&missing, -1, &met, 6);
    y->infeasible = product_of(&missing, &missing, 6) > IN_REACH * IN_REACH * product_of(&w, &w, 6);
}

/* ---- pulses, counted in samples ---- */
/* B.7-4 */
static void plan_pulse(double demand, double period, double shortest, double *on, double *carry)
{
    double due = demand * period + *carry;
    /* 1e-5 samples cover the error of the allocation: a demand of n samples gives n, not n - 1 */
    *on = smaller(floor_of(due + 1e-5), period);
    if (*on < shortest) *on = 0;
    *carry = larger(0, due - *on);
}

static void modulate(const Parameters *p, State *x, Output *y, double index)
{
    double period = nearest_whole(p->pulse_period / p->sample_period);
    double shortest = ceiling_of(p->min_on_time / p->sample_period - ROUNDED_OFF);
    double phase = index - period * floor_of(index / period);
    for (int i = 0; i < THRUSTERS; i++) {
        if (phase == 0) plan_pulse(y->demand[i], period, shortest, &x->on[i], &x->carry[i]);
        y->throttle[i] = phase < x->on[i];
        y->unspent[i] = x->carry[i] * p->sample_period;
    }
}

static void allocate(const Parameters *p, const Input *u, State *x, Output *y, double t,
                     double index)
{
    allocate_wrench(p, u, y, t);
    publish_wrench(p, u, y);
    if (p->pulsed) modulate(p, x, y, index);
    else memcpy(y->throttle, y->demand, sizeof y->demand);
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    State first = {.on = {0}};
    *x = first;
    allocate(p, u, &first, y, t, p->sample_period > 0 ? sample_index(t, p->sample_period) : 0);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        allocate(p, u, x, y, s.t, s.index);
}

FMU_MODEL("thruster_allocation",
          "Thruster allocation by bounded least squares, continuous or pulse-width modulated");
