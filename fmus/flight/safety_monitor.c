/* safety_monitor.c - watches an approach: keep-out zone, corridor, speed, passive safety, plume,
 * and orders the abort.
 *
 *   1 keep-out    ellipsoid or box about the target, Hill or target axes
 *   2 corridor    cone about the direction of approach, Hill or target axes
 *   3 speed       |drho_H| <= v_0 + k |rho|
 *   4 passive     the drift without thrust for the next passive_time keeps out of the zone
 *   5 plume       the exhaust of F_cmd_S does not meet the target
 *   6 navigation  no longer than lost_time without a valid relative state; with use_range one that
 *                 disagrees with an independent range is not valid (range_alone: nothing else counts)
 *
 * Rules 1, 2, 3 and 5 are judged in continuous time: between two samples the servicer moves on the
 * cubic arc through both states, and what was in force at the first (approaching, F_cmd_S) is in
 * force until the second. Published margins are the least since the last sample, never above the
 * true least of the arc and below it by no more than 1e-7; a rule that is off or rests has margin
 * 1e9. Rule 4 is judged at samples, passive_period apart or more (with passive_opens not while
 * approaching); if it fails, the instant is found by halving the arc. The first violation of each rule is kept with its time; `abort` is latched.
 *
 * F_safe_S is F_cmd_S at every call, between samples too. Abort manoeuvre (act = 1): after the abort
 * it is abort_force along a velocity increment, until that is spent: abort_dv_H or, if that is zero,
 * abort_speed outwards along the corridor, both as they point in the last valid state. Without one
 * (target lost) and before t_armed (filters settle) nothing is judged, margins keep their values,
 * and the next valid state begins a new arc. At zero range the zone is violated, corridor and plume
 * are on their edge. Inputs that are not numbers are refused by the interface. Equations: docs/models.md G. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "earth.h"
#include "safety_judgement.h"
#include "safety_range.h"

typedef SafetyParameters Parameters;
typedef SafetyInput Input;

typedef struct {
    double begun, seen, t, t_valid; /* t: of the last sample, t_valid: of the last valid state */
    Input last;                     /* valid one; seen: it was that of the last sample */
    double foreseen, t_foreseen;    /* the drift has been predicted since the target was lost */
    Pair from;                      /* its state */
    double margin[RULES], least[RULES], t_first[RULES];
    double abort;
    vec3 dv_N;
    RangeCheck range;
} State;
typedef struct {
    double margin[RULES], least_margin[RULES], nearest, passive_entry;
    double abort, violated[RULES], t_first[RULES], t_violation, rule_violated;
    vec3 F_safe_S, dv_left_N;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {EARTH, .use_J2 = 1, .keep_out_shape = ELLIPSOID, .keep_out_half = {2, 2, 2},
          .corridor_axis = {0, 1, 0}, .corridor_half_angle = PI / 9, .speed_at_zero = 0.1,
          .speed_slope = 0.01, .passive_step = 60, .plume_half_angle = PI / 9, .plume_range = 20,
          .plume_force_min = 1e-3, .lost_time = 20, RANGE_CHECK, .abort_on = {1, 1, 1, 1, 1, 1},
          .mass = 100, .abort_force = 20, .abort_speed = 0.1},
    .u = {.T = {.r = {7158140, 0, 0}, .v = {0, 7462.286, 0}, .q = {1, 0, 0, 0}},
          .S = {.r = {7158140, 20, 0}, .v = {-0.0208, 7462.286, 0}, .q = {1, 0, 0, 0}},
          .approaching = 1,
          .relative_valid = 1,
          .range_time = NOT_YET},
};

#define MARGIN(rule, name, unit, text) \
    ROW_AS(OUTPUT_ROW, y, name "_margin", margin[rule], 1, unit, text, ANY_VALUE)

static const Variable variables[] = {
    SAFETY_PARAMETERS,

    SAFETY_INPUTS,

    MARGIN(KEEP_OUT, "keep_out", "m", "least margin of the keep-out zone since the last sample"),
    MARGIN(CORRIDOR, "corridor", "m", "least margin of the corridor since the last sample"),
    MARGIN(SPEED, "speed", "m/s", "least margin of the speed limit since the last sample"),
    MARGIN(PASSIVE, "passive", "m",
           "least margin of the keep-out zone during the drift, as predicted last"),
    MARGIN(PLUME, "plume", "m", "least margin of the plume since the last sample"),
    MARGIN(NAVIGATION, "navigation", "s", "time left until navigation is declared lost"),
    OUTPUT(least_margin, "1", "least margin of this rule since the start, in its unit"),
    OUTPUT(nearest, "1",
           "rule with the least margin over its own size: 1 keep-out, 2 corridor, 3 speed, 4 "
           "passive, 5 plume; 0: none applies"),
    OUTPUT(passive_entry, "s",
           "time until a drift without thrust enters the zone; -1: it does not"),
    ALARM(abort, "1: a rule that aborts has been violated; stays"),
    FLAG(violated, "1: this rule has been violated; stays"),
    OUTPUT(t_first, "s", "first violation of this rule; -1: none"),
    OUTPUT(t_violation, "s", "first violation of any rule; -1: none"),
    OUTPUT(rule_violated, "1", "rule violated first, 1 to 6; 0: none"),
    OUTPUT(F_safe_S, "N", "force to be passed on, servicer axes: F_cmd_S, or the abort manoeuvre"),
    OUTPUT(dv_left_N, "m/s", "increment of velocity left of the abort manoeuvre, N axes"),
};

static void check(const Parameters *p, Problems *problems) { check_safety(p, problems); }

/* ---- what has been found ---- */
static void keep_first(State *x, int rule, Finding f)
{
    x->margin[rule] = f.margin;
    x->least[rule] = smaller(x->least[rule], f.margin);
    if (f.t != NEVER && x->t_first[rule] == NOT_YET) x->t_first[rule] = f.t;
}

static void judge(const Interval *i, State *x)
{
    for (int rule = 0; rule < NAVIGATION; rule++)
        if (rules[rule].in_force) keep_first(x, rule, found(i, rule));
}

static int passive_rests(const Parameters *p, const Input *u)
{
    return p->passive_opens && u->approaching;
}

static void predict(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    if (passive_rests(p, u)) {
        x->margin[PASSIVE] = RESTING;
        y->passive_entry = NOT_YET;
        return;
    }
    int due = !x->foreseen || reached(t, x->t_foreseen + p->passive_period);
    if (p->passive_time == 0 || !due) return;
    double t0 = x->foreseen ? x->t_foreseen : t, entry;
    Course c = {x->foreseen ? x->from : pair(u), pair(u), t0, t - t0};
    keep_first(x, PASSIVE, passive(p, &c, x->t_first[PASSIVE] != NOT_YET, &entry));
    y->passive_entry = entry == NEVER ? NOT_YET : entry;
    x->from = c.to;
    x->t_foreseen = t;
}

static int armed(const Parameters *p, double t)
{
    return p->t_armed == 0 || reached(t, p->t_armed);
}

/* the states can be relied on: their source says so, and the independent range */
static int valid(const Parameters *p, const Input *u, State *x, double t)
{
    if (!p->use_range || !armed(p, t)) return u->relative_valid != 0;
    x->range = checked(p, u, x->range, t);
    return u->relative_valid && !x->range.distrusted;
}

/* with range_alone a state that its source calls invalid is the business of the source */
static void judge_navigation(const Parameters *p, const Input *u, State *x, int is_valid, double t)
{
    if (is_valid || (p->range_alone && !u->relative_valid)) x->t_valid = t;
    if (p->lost_time == 0 || !armed(p, t)) return;
    double since = p->t_armed > 0 ? larger(x->t_valid, p->t_armed) : x->t_valid;
    double left = since + p->lost_time - t;
    keep_first(x, NAVIGATION, (Finding){left, left < 0 ? since + p->lost_time : NEVER});
}

/* the rule with the least margin over its size, 1 keep-out ...; 0: none applies */
static double nearest(const Parameters *p, const Input *u, const State *x)
{
    double least = INFINITY, which = 0, range = norm(sub(u->S.r, u->T.r));
    for (int rule = 0; rule < NAVIGATION; rule++) {
        double share = x->margin[rule] / rules[rule].size(p, range);
        if (x->margin[rule] == RESTING || share >= least) continue;
        least = share;
        which = rule + 1;
    }
    return which;
}

/* ---- abort ---- */
/* u: the last valid state; if there never was one, the servicer drifts */
static vec3 abort_increment_N(const Parameters *p, const Input *u)
{
    if (!u->relative_valid) return vec(0, 0, 0);
    mat3 C_HN = hill_frame(p->mu, u->T.r, u->T.v).C_HN, C_TN = dcm_of_quat(attitude_in(u->T.q));
    if (norm(p->abort_dv_H) > 0) return tmul(C_HN, p->abort_dv_H);
    vec3 out = scale(p->abort_speed, p->corridor_axis);
    return tmul(p->corridor_axes == TARGET_AXES ? C_TN : C_HN, out);
}

static void decide(const Parameters *p, State *x)
{
    int due = 0;
    for (int rule = 0; rule < RULES; rule++)
        due |= p->abort_on[rule] != 0 && x->t_first[rule] != NOT_YET;
    if (due && !x->abort) x->dv_N = abort_increment_N(p, &x->last);
    x->abort = x->abort || due;
}

/* the increment with abort_force, the last sample with what is left of it */
static vec3 abort_force_S(const Parameters *p, const Input *u, State *x, double period)
{
    double left = norm(x->dv_N), most = period > 0 ? p->mass * left / period : 0;
    double F = smaller(p->abort_force, most);
    vec3 F_N = left > 0 ? scale(F / left, x->dv_N) : x->dv_N;
    x->dv_N = sub(x->dv_N, scale(period / p->mass, F_N));
    return mul(dcm_of_quat(attitude_in(u->S.q)), F_N);
}

/* ---- outputs ---- */
static void publish_first(const State *x, Output *y)
{
    y->t_violation = NOT_YET;
    y->rule_violated = 0;
    for (int rule = 0; rule < RULES; rule++) {
        double t = y->t_first[rule] = x->t_first[rule];
        y->least_margin[rule] = x->least[rule];
        y->violated[rule] = t != NOT_YET;
        if (t == NOT_YET || (y->rule_violated && t >= y->t_violation)) continue;
        y->t_violation = t;
        y->rule_violated = rule + 1;
    }
}

static void publish(const State *x, Output *y)
{
    memcpy(y->margin, x->margin, sizeof y->margin);
    y->abort = x->abort;
    y->dv_left_N = x->dv_N;
    publish_first(x, y);
}

static State begun(double t)
{
    State x = {.begun = 1, .t = t, .t_valid = t, .range = unchecked};
    for (int rule = 0; rule < RULES; rule++)
        x.margin[rule] = x.least[rule] = RESTING, x.t_first[rule] = NOT_YET;
    return x;
}

static void watch(const Parameters *p, const Input *u, State *x, Output *y, double t, double period)
{
    if (!x->begun) *x = begun(t);
    int is_valid = valid(p, u, x, t), judged = is_valid && armed(p, t);
    if (judged) {
        double t0 = x->seen ? x->t : t;
        Interval i = interval(p, x->seen ? &x->last : u, u, t0, t - t0);
        judge(&i, x);
        predict(p, u, x, y, t);
        y->nearest = nearest(p, u, x);
        x->last = *u;
    }
    x->seen = judged;
    x->foreseen = judged && !passive_rests(p, u);
    x->t = t;
    judge_navigation(p, u, x, is_valid, t);
    decide(p, x);
    if (p->act && x->abort) y->F_safe_S = abort_force_S(p, u, x, period);
    publish(x, y);
}

/* While start values travel through a system the inputs may be anything: margins are shown, nothing
 * is kept before the first step. */
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    State first = {0}, none = {0}, nothing = begun(t);
    y->passive_entry = NOT_YET;
    watch(p, u, &first, y, t, 0);
    memcpy(nothing.margin, first.margin, sizeof first.margin);
    memcpy(nothing.least, first.least, sizeof first.least);
    publish(&nothing, y);
    y->F_safe_S = u->F_cmd_S;
    *x = none;
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        watch(p, u, x, y, s.t, s.period);
    if (!(p->act && x->abort)) y->F_safe_S = u->F_cmd_S;
}

FMU_MODEL("safety_monitor",
          "Safety monitor of an approach: keep-out zone, corridor, speed, passive safety, plume");
