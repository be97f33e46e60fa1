/* safety_filter.c - the least change of a commanded force that satisfies keep-out sphere,
 * corridor, speed limit, drift, plume and force limits, for any controller.
 *
 * Every rule gives rows n.u >= c for the force u, which is held for one sample period. With a force
 * that satisfies a row, the servicer does not reach the edge of the rule during the hold, and at
 * its end the braking distance fits into the remaining gap.
 *
 *   min |u - F_cmd_S|   subject to   n_i.u >= c_i for all rows i
 *
 * filter 3: the nearest force. Rank of the rules: force limits, keep-out, speed, corridor, plume,
 * drift. Where no force satisfies all rows, the first row that the rows of higher rank exclude is
 * relaxed, as little as these permit. Rows for the drift are added only where the force found would
 * let the servicer drift into the sphere, at most four times.
 * filter 1: F_cmd_S, cut to the force limits, while this force is safe: it satisfies all rows, the
 * servicer can stop after it outside the sphere and inside the corridor, and a drift after it
 * misses the sphere. Else the backup: the servicer brakes (force 0 if only the drift is unsafe),
 * until F_cmd_S has been safe for the time `dwell`. For the stop outside the sphere, only the
 * motion along the line to the target counts.
 * filter 2: as filter 1, but the whole straight way to the stop must be outside the sphere.
 * filter 0: F_cmd_S unchanged; only the barriers are computed.
 *
 * Filter 3 passes a force that violates no row unchanged, to the last bit. Without a valid state
 * F_cmd_S passes at every call, between samples too, and barriers (gaps that remain after braking)
 * retain their values. Rows: filter_rows.h, filter_drift.h. Nearest point: half_spaces.h.
 * Equations, reasons, sources: docs/models.md M. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "filter_drift.h"
#include "earth.h"
#include "time_grid.h"

#define RESTING 1e9   /* barrier of a rule that is off or does not apply */
#define DROPPED -1e30 /* c of a row that was relaxed twice: the row has no effect */

typedef FilterParameters Parameters;
typedef FilterInput Input;

typedef struct {
    /* slope of the faces of a pyramid inscribed in the corridor: tan(half angle) cos(pi/8) */
    double slope;
    /* filters 1 and 2. backup: 1 during the backup; passed: time in the backup for which F_cmd_S
     * has been safe without interruption [s] */
    double backup, passed;
    double least[BARRIERS];
} State;
typedef struct {
    vec3 F_safe_S;
    double mode, active, intervention, feasible, relaxed, barrier[BARRIERS], least[BARRIERS];
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.filter = ASIF,
          .mu = MU_JGM3,
          .mass = 100,
          .mass_error = 0.1,
          .F_max = {2, 1, 1},
          .a_dist = 1e-4,
          .keep_out_radius = 4,
          .brake_keep_out = 4.5e-3,
          .corridor_half_angle = PI / 18,
          .corridor_axis = {1, 0, 0},
          .brake_corridor = 3e-3,
          .alpha_T_max = 2e-5,
          .speed_at_zero = 0.02,
          .speed_slope = 0.0185,
          .speed_max = 1e9,
          .passive_points = 20,
          .passive_margin = 0.15,
          .plume_force = 0.5,
          .recover_speed = 0.02,
          .dwell = 5,
          .sample_period = 0.1},
    .u = {.T = {.r = {7158140, 0, 0}, .v = {0, 7462.286, 0}, .q = {1, 0, 0, 0}},
          .S = {.r = {7158140, 20, 0}, .v = {-0.0208, 7462.286, 0}, .q = {1, 0, 0, 0}},
          .approaching = 1,
          .relative_valid = 1},
};

static const Variable variables[] = {
    FILTER_PARAMETERS,

    FILTER_INPUTS,

    OUTPUT(F_safe_S, "N", "force to be passed on, servicer axes"),
    MODE(mode, "origin of the force",
         "F_cmd_S passes|filtered|backup|a rule relaxed|no valid state"),
    MODE(active, "rule that determines the force",
         "none|keep-out|corridor|speed|drift|plume|force limit"),
    NONNEGATIVE_OUTPUT(intervention, "N", "size of the change of the force"),
    FLAG(feasible, "0: no force satisfies all rules (only with filter = 3)"),
    MODE(relaxed, "first rule that was relaxed, only with filter = 3",
         "none|keep-out|corridor|speed|drift|plume|force limit"),
    OUTPUT(barrier, "1",
           "gap after braking to keep-out and corridor, speed limit - speed [m/s], drift margin, "
           "range - plume_range; 1e9: off"),
    ROW_AS(OUTPUT_ROW, y, "least_barrier", least, 1, "1",
           "per barrier: least value since the start", ANY_VALUE),
};

/* M.3-4 */
static void check(const Parameters *p, Problems *problems) { check_filter(p, problems); }

static int equal(vec3 a, vec3 b) /* equal to the last bit */
{
    return bits_of(a.x) == bits_of(b.x) && bits_of(a.y) == bits_of(b.y) &&
           bits_of(a.z) == bits_of(b.z);
}

/* a row is satisfied if n.u is at least c minus this tolerance [N] */
static double tolerance(const Parameters *p) { return 1e-9 * norm(p->F_max); }

/* ---- filter 3: the nearest force ---- */
/* relaxes row i: reduces its c to the largest n.u that the rows before it permit, less two
 * tolerances; a row that fails a second time is dropped */
/* M.5-3 */
static void relax(const Parameters *p, Rows *rows, int i)
{
    Row *r = &rows->row[i];
    double tol = tolerance(p);
    vec3 far = scale(1e3 * norm(p->F_max), r->n), best = far;
    int possible = !r->failed && nearest_point(rows->row, i, far, tol, &best) == ALL_SATISFIED;
    r->c = possible ? dot(r->n, best) - 2 * tol : DROPPED;
    r->failed = 1;
}

/* a command of more than this many times |F_max| is shortened to it: rounding errors of the nearest
 * force would otherwise violate rows */
#define FAR_COMMAND 1e5
/* M.5-4 */
static vec3 shortened(const Parameters *p, vec3 F)
{
    double most = FAR_COMMAND * norm(p->F_max);
    double largest = larger(fabs(F.x), larger(fabs(F.y), fabs(F.z)));
    return largest > most ? scale(most / largest, F) : F;
}

/* nearest force that satisfies all rows; where none exists, rows are relaxed by rank. *relaxed
 * becomes the rule of the first row that is relaxed, unless a rule is stored there already. */
/* M.5-2 */
static vec3 nearest_by_rank(const Parameters *p, const Input *u, Rows *rows, double *relaxed)
{
    vec3 command = shortened(p, u->F_cmd_S), F = command;
    for (int failure = 0; failure <= 2 * MOST_ROWS; failure++) {
        int i = nearest_point(rows->row, rows->count, command, tolerance(p), &F);
        if (i == ALL_SATISFIED) break;
        if (!*relaxed) *relaxed = rows->row[i].rule;
        relax(p, rows, i);
    }
    return F;
}

/* most times that rows of the drift are added and the force is searched again, because the force
 * found lets the servicer drift into the sphere */
enum { DRIFT_ROUNDS = 4 };
static vec3 with_drift(const Parameters *p, const Input *u, const DriftFan *f, vec3 F, Rows *rows,
                       double *relaxed)
{
    for (int round = 0; round < DRIFT_ROUNDS; round++) {
        Worst w = worst_drift(p, f, F);
        if (w.margin >= 0) break;
        add_drift_rows(p, f, w.chord, rows);
        F = nearest_by_rank(p, u, rows, relaxed);
    }
    return F;
}

static double deciding_rule(const Parameters *p, const Rows *rows, vec3 F)
{
    double near = 10 * tolerance(p);
    for (int i = 0; i < rows->count; i++) {
        const Row *r = &rows->row[i];
        if (r->rule != BOX && dot(r->n, F) <= r->c + near) return r->rule;
    }
    return BOX;
}

/* M.5-1 */
static void filter_least(const Parameters *p, const Input *u, const Geometry *g, Rows *rows,
                         Output *y)
{
    vec3 F = nearest_by_rank(p, u, rows, &y->relaxed);
    if (g->drift) {
        DriftFan f = drift_fan(p, u, g);
        y->barrier[DRIFT - 1] = worst_chord(&f, f.free).margin;
        F = with_drift(p, u, &f, F, rows, &y->relaxed);
    }
    int same = equal(F, u->F_cmd_S);
    y->F_safe_S = F;
    y->feasible = !y->relaxed;
    y->mode = same ? PASSES : y->relaxed ? RELAXED : FILTERED;
    y->active = same ? NO_RULE : deciding_rule(p, rows, F);
}

/* ---- filters 1 and 2: pass or brake ---- */
static vec3 boxed(const Parameters *p, vec3 F)
{
    vec3 most = p->F_max;
    return vec(clamp(F.x, -most.x, most.x), clamp(F.y, -most.y, most.y),
               clamp(F.z, -most.z, most.z));
}

/* (22): state after one hold of a force, relative to the frame in which the servicer would stop: T
 * with a corridor, else N; e: bound of the position error */
typedef struct {
    vec3 x, v;
    double e, brakes; /* brakes: half the time from v to the stop [s] */
} Held;

static Held after_hold(const Parameters *p, const Geometry *g, vec3 F)
{
    double P = g->P, a_b = p->brake_keep_out;
    vec3 a_F = scale(1 / p->mass, tmul(g->C_SN, F)), v = g->corridor ? g->v_T : g->v;
    vec3 a = add(g->corridor ? g->a_T : g->g, a_F);
    double unknown = p->a_dist + g->turn + norm(a_F) * p->mass_error;
    if (g->corridor) a_b = smaller(a_b, p->brake_corridor);
    Held h = {.x = sum3(g->rho, scale(P, v), scale(P * P / 2, a)), .v = add(v, scale(P, a))};
    double s = norm(h.v) + p->velocity_error + P * unknown;
    h.e = p->position_error + P * P / 2 * unknown;
    h.brakes = s / (2 * a_b);
    return h;
}

/* (23), (24) */
static int stops_outside(const Parameters *p, const Held *h)
{
    double clear = p->keep_out_radius + h->e, distance = norm(h->x);
    if (p->filter == SIMPLEX_IMPLICIT)
        return norm(nearest_of_chord(h->x, add(h->x, scale(h->brakes, h->v)))) >= clear;
    double closing = distance > 0 ? smaller(dot(h->x, h->v) / distance, 0) : 0;
    return distance - clear + closing * h->brakes >= 0;
}

static int stops_inside(const Parameters *p, const Geometry *g, double slope, const Held *h)
{
    Face face[FACES];
    int faces = corridor_faces(p, g->C_TN, slope, face), inside = 1;
    vec3 x = from_apex(p, g, h->x);
    for (int j = 0; j < faces; j++) {
        double closing = smaller(dot(face[j].n, h->v) - p->rate_error * g->R, 0);
        double gap = face[j].offset + dot(face[j].n, x) - h->e - p->attitude_error * g->R;
        inside = inside && gap + closing * h->brakes >= 0;
    }
    return inside;
}

/* M.7-2 */
static int can_stop(const Parameters *p, const Geometry *g, double slope, vec3 F)
{
    Held h = after_hold(p, g, F);
    return (!g->sphere || stops_outside(p, &h)) && (!g->corridor || stops_inside(p, g, slope, &h));
}

/* (25): force that stops the servicer within one sample period P, scaled down to F_max */
static vec3 braking(const Parameters *p, const Geometry *g)
{
    vec3 v = g->corridor ? g->v_T : g->v, a = g->corridor ? g->a_T : g->g, most = p->F_max;
    vec3 F = scale(-p->mass, mul(g->C_SN, add(scale(1 / g->P, v), a)));
    double x = fabs(F.x) / most.x, y = fabs(F.y) / most.y, z = fabs(F.z) / most.z;
    return scale(1 / larger(1, larger(x, larger(y, z))), F);
}

static double first_broken(const Parameters *p, const Rows *rows, vec3 F)
{
    for (int i = 0; i < rows->count; i++)
        if (excludes(&rows->row[i], F, tolerance(p))) return rows->row[i].rule;
    return NO_RULE;
}

/* true during the backup: from the first command that fails a test until all commands have passed
 * the tests for the time `dwell` */
/* M.7-1 */
static int stays_in_backup(const Parameters *p, State *x, int passes, double P)
{
    x->passed = passes && x->backup ? x->passed + P : 0;
    x->backup = !passes || (x->backup && !reached(x->passed, p->dwell));
    return x->backup != 0;
}

static void filter_simplex(const Parameters *p, const Input *u, const Geometry *g, Rows *rows,
                           State *x, Output *y)
{
    vec3 F = boxed(p, u->F_cmd_S);
    double broken = first_broken(p, rows, F);
    int stops = !broken && can_stop(p, g, x->slope, F), drifts_clear = 1;
    if (g->drift) {
        DriftFan f = drift_fan(p, u, g);
        y->barrier[DRIFT - 1] = worst_chord(&f, f.free).margin;
        drifts_clear = worst_drift(p, &f, F).margin >= 0;
    }
    if (!stays_in_backup(p, x, stops && drifts_clear, g->P)) {
        y->F_safe_S = F;
        y->mode = equal(F, u->F_cmd_S) ? PASSES : FILTERED;
        y->active = equal(F, u->F_cmd_S) ? NO_RULE : BOX;
        return;
    }
    int only_drift = stops && !drifts_clear;
    y->F_safe_S = only_drift ? vec(0, 0, 0) : braking(p, g);
    y->mode = BACKUP;
    y->active = only_drift ? DRIFT : broken;
}

/* ---- samples ---- */
static void observe(const Parameters *p, const Input *u, const Geometry *g, Output *y)
{
    if (!g->drift) return;
    DriftFan f = drift_fan(p, u, g);
    y->barrier[DRIFT - 1] = worst_chord(&f, f.free).margin;
}

/* M.3-1 */
static void let_pass(const Input *u, State *x, Output *y, double mode)
{
    y->F_safe_S = u->F_cmd_S;
    y->mode = mode;
    x->passed = 0;
}

/* M.3-2 */
static void sample(const Parameters *p, const Input *inputs, State *x, Output *y, double P)
{
    Input bounded = *inputs, *u = &bounded;
    u->T = body_in(u->T);
    u->S = body_in(u->S);
    y->active = y->relaxed = 0;
    y->feasible = 1;
    if (!u->relative_valid || P == 0) {
        let_pass(u, x, y, u->relative_valid ? PASSES : NO_STATE);
    } else {
        for (int rule = 0; rule < BARRIERS; rule++) y->barrier[rule] = RESTING;
        Geometry g = geometry(p, u, P);
        Rows rows = all_rows(p, u, &g, x->slope, y->barrier);
        if (p->filter == ASIF) filter_least(p, u, &g, &rows, y);
        else if (p->filter != NO_FILTER) filter_simplex(p, u, &g, &rows, x, y);
        else let_pass(u, x, y, PASSES), observe(p, u, &g, y);
    }
    y->intervention = norm(bounded3(sub(y->F_safe_S, u->F_cmd_S)));
    for (int rule = 0; rule < BARRIERS; rule++)
        y->least[rule] = x->least[rule] = smaller(x->least[rule], y->barrier[rule]);
}

static State initial_state(const Parameters *p)
{
    SineCosine half = sine_and_cosine(p->corridor_half_angle);
    State x = {.slope = half.s / half.c * (sqrt(2 + sqrt(2.0)) / 2)};
    for (int rule = 0; rule < BARRIERS; rule++) x.least[rule] = RESTING;
    return x;
}

/* While the initial values of a system are computed, inputs may have any value. Therefore sample()
 * changes only the copy `first` of the initial state. With sample_period 0 a hold lasts one step,
 * whose length is not known here: F_cmd_S passes unchanged. */
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    State first = initial_state(p);
    (void)t;
    *x = first;
    for (int rule = 0; rule < BARRIERS; rule++) y->barrier[rule] = RESTING;
    sample(p, u, &first, y, p->sample_period);
}

/* M.3-3 */
static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        sample(p, u, x, y, s.period);
    if (p->filter != NO_FILTER && y->mode != NO_STATE) return;
    y->F_safe_S = u->F_cmd_S;
    y->intervention = 0;
}

FMU_MODEL("safety_filter",
          "Safety filter: the least change of a force for sphere, corridor, speed and drift");
