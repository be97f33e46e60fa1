/* safety_monitor.c - monitoring of an approach: keep-out zone, corridor, speed, passive safety,
 * plume, navigation, escape; commands the abort.
 *
 *   1 keep-out    ellipsoid or box about the target, Hill or target axes
 *   2 corridor    cone about the direction of approach, Hill or target axes
 *   3 speed       |drho_H| <= v_0 + k |rho|;  with speed_tumble k + min(|w_T|, tumble_max)
 *                 replaces k
 *   4 passive     the drift without thrust for the next passive_time stays outside the zone
 *   5 plume       the exhaust of F_cmd_S does not meet the target
 *   6 navigation  no longer than lost_time without a valid relative state; with use_range a state
 *                 that disagrees with an independent range is invalid; with range_alone the
 *                 absence of states alone does not violate the rule, only such disagreement does
 *   7 escape      after an abort ordered now, the drift stays outside escape_radius for
 *                 escape_time, for all errors of the state within the bounds e_r, e_v and of the
 *                 burn within the bounds k_p, k_n
 *
 * Rules 1, 2, 3 and 5 are evaluated in continuous time: between two samples the servicer moves on
 * the cubic arc through both states, and the inputs approaching, F_cmd_S and omega_TN_T (rule 3)
 * of the first sample hold until the second. Published margins are the least since the last
 * sample, never above the true least of the arc and below it by no more than 1e-7; a rule that is
 * off or does not apply has margin 1e9. Rule 4 is evaluated at samples that are passive_period or
 * more apart; if it fails, the instant of the violation is found by bisection of the arc. With
 * passive_opens = 1 it applies only while `approaching` is 0. Rule 7 is evaluated until the abort,
 * at samples that are escape_period or more apart. It is violated as soon as its margin is below
 * escape_reserve, while the escape is still certain.
 * The first violation of each rule is stored with its time; `abort` is latched.
 *
 * F_safe_S is F_cmd_S at every call, between samples too; after the abort, with act = 1, it is the
 * abort manoeuvre: abort_force along a velocity increment, until the increment is spent. The
 * increment is abort_dv_H if that is not zero. Else, with abort_relative = 1, it changes the
 * velocity as seen in H to abort_speed away from the target; the last valid state, propagated
 * without thrust until now, gives the velocity before the burn. With abort_relative = 0 it is
 * abort_speed along the corridor axis as directed at the last valid state. While there is no valid
 * state, and before t_armed (filters settle), rules 1 to 5 and 7 are not evaluated, margins retain
 * their values, and the next valid state begins a new arc. Rule 6 also begins at t_armed. At zero
 * range the zone is violated, and the margins of plume and corridor (with apex 0) are zero. The
 * adapter rejects inputs that are not finite. Equations: docs/models.md G. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "earth.h"
#include "safety_escape.h"
#include "safety_range.h"

typedef SafetyParameters Parameters;
typedef SafetyInput Input;

typedef struct {
    double begun, seen, t, t_valid; /* t, t_valid: times of last sample, last valid state */
    Input last;                     /* last valid inputs; seen: 1 if they are of the last sample */
    double foreseen, t_foreseen;    /* 1: the drift has been predicted; time of the prediction */
    TwoOrbits from;                 /* state from which the drift was predicted */
    double margin[RULES], least[RULES], t_first[RULES];
    double abort;
    vec3 dv_N;
    RangeCheck range;
    Known known;
    double looked_ahead, t_escape; /* 1: rule escape was evaluated; time of the evaluation */
} State;
typedef struct {
    double margin[RULES], least_margin[RULES], nearest, passive_entry, passive_age;
    double escape_time_least, escape_dv;
    double abort, violated[RULES], t_first[RULES], t_violation, rule_violated;
    vec3 F_safe_S, dv_left_N;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {EARTH,
          .use_J2 = 1,
          .keep_out_shape = ELLIPSOID,
          .keep_out_half = {2, 2, 2},
          .corridor_axis = {0, 1, 0},
          .corridor_half_angle = PI / 9,
          .speed_at_zero = 0.1,
          .speed_slope = 0.01,
          .tumble_max = 0.04,
          .passive_step = 60,
          .plume_half_angle = PI / 9,
          .plume_range = 20,
          .plume_force_min = 1e-3,
          .lost_time = 20,
          RANGE_CHECK,
          .abort_on = {1, 1, 1, 1, 1, 1, 1},
          .mass = 100,
          .abort_force = 20,
          .abort_speed = 0.1,
          .abort_relative = 1,
          .abort_time = 1e30,
          .axis_radius = 3,
          .escape_reserve = {1, 0},
          .e_r = 0.05,
          .e_v = 5e-3,
          .k_p = 0.05,
          .k_n = 0.01,
          .r_max = 80,
          .e_model = 1e-8},
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

    MARGIN(KEEP_OUT, "keep_out", "m",
           "least margin of the keep-out zone since the last sample; all margins: below 0 "
           "violated, 1e9 not in force"),
    MARGIN(CORRIDOR, "corridor", "m", "least margin of the corridor since the last sample"),
    MARGIN(SPEED, "speed", "m/s", "least margin of the speed limit since the last sample"),
    MARGIN(PASSIVE, "passive", "m",
           "least margin of the keep-out zone during the drift, as predicted last"),
    MARGIN(PLUME, "plume", "m", "least margin of the plume since the last sample"),
    MARGIN(NAVIGATION, "navigation", "s", "time left until navigation is declared lost"),
    MARGIN(
        ESCAPE, "escape", "m",
        "least range after an abort ordered now, minus escape_radius, for all errors within e_r, "
        "e_v, k_p, k_n; holds for a short burn on an orbit of eccentricity <= 0.01"),
    OUTPUT(least_margin, "1", "per rule: least margin since the start, in the unit of its margin"),
    MODE(nearest, "rule whose margin, divided by a typical size, is smallest",
         "none|keep-out|corridor|speed|passive|plume"),
    OUTPUT(passive_entry, "s",
           "time until a drift without thrust enters the zone; -1: it does not"),
    NONNEGATIVE_OUTPUT(passive_age, "s", "time since the drift of passive_margin was predicted"),
    OUTPUT(escape_time_least, "s",
           "time after the abort at which escape_margin is reached; -1: rule does not apply"),
    NONNEGATIVE_OUTPUT(escape_dv, "m/s", "velocity increment of an abort ordered now"),
    ALARM(abort, "1: a rule with abort_on was violated, or abort_time reached; stays 1"),
    FLAG(violated, "per rule, 1: it has been violated; stays 1"),
    OUTPUT(t_first, "s", "per rule: time of the first violation; -1: none"),
    OUTPUT(t_violation, "s", "time of the first violation of any rule; -1: none"),
    MODE(rule_violated, "rule violated first",
         "none|keep-out|corridor|speed|passive|plume|navigation|escape"),
    OUTPUT(F_safe_S, "N", "force to be passed on, servicer axes: F_cmd_S, or the abort manoeuvre"),
    OUTPUT(dv_left_N, "m/s", "velocity increment of the abort manoeuvre that remains, N axes"),
};

/* G.2-7 */
static void check(const Parameters *p, Problems *problems) { check_safety(p, problems); }

/* ---- findings ---- */
/* G.2-1 */
static void record(State *x, int rule, Finding f)
{
    x->margin[rule] = f.margin;
    x->least[rule] = smaller(x->least[rule], f.margin);
    if (f.t != NEVER && x->t_first[rule] == NOT_YET) x->t_first[rule] = f.t;
}

/* G.2-2 */
static void evaluate(const Interval *i, State *x)
{
    for (int rule = 0; rule < NAVIGATION; rule++)
        if (rules[rule].in_force) record(x, rule, evaluate_rule(i, rule));
}

static int passive_is_off(const Parameters *p, const Input *u)
{
    return p->passive_opens && u->approaching;
}

/* G.2-3 */
static void predict_drift(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    if (passive_is_off(p, u)) {
        x->margin[PASSIVE] = RESTING;
        y->passive_entry = NOT_YET;
        return;
    }
    int due = !x->foreseen || reached(t, x->t_foreseen + p->passive_period);
    if (p->passive_time == 0 || !due) return;
    double t0 = x->foreseen ? x->t_foreseen : t, entry;
    Course c = {x->foreseen ? x->from : two_orbits(u), two_orbits(u), t0, t - t0};
    record(x, PASSIVE, passive_finding(p, &c, x->t_first[PASSIVE] != NOT_YET, &entry));
    y->passive_entry = entry == NEVER ? NOT_YET : entry;
    x->from = c.to;
    x->t_foreseen = t;
}

/* age of the last prediction of the drift [s]; 0 before the first one and while the rule is off */
static double predicted_age(const State *x, double t)
{
    return x->margin[PASSIVE] == RESTING ? 0 : larger(0, t - x->t_foreseen);
}

/* G.2-5 */
static int is_armed(const Parameters *p, double t)
{
    return p->t_armed == 0 || reached(t, p->t_armed);
}

/* true if relative_valid declares the states valid and, with use_range, the independent range does
 * not disagree */
/* G.2-4 */
static int has_valid_states(const Parameters *p, const Input *u, State *x, double t)
{
    if (!p->use_range || !is_armed(p, t)) return u->relative_valid != 0;
    x->range = updated_check(p, u, x->range, t);
    return u->relative_valid && !x->range.distrusted;
}

/* evaluates rule navigation: time left until the relative state counts as lost. With range_alone, a
 * state that its source declares invalid does not count as lost. */
/* G.5-2 */
static void evaluate_navigation(const Parameters *p, const Input *u, State *x, int is_valid,
                                double t)
{
    if (is_valid || (p->range_alone && !u->relative_valid)) x->t_valid = t;
    if (p->lost_time == 0 || !is_armed(p, t)) return;
    double since = p->t_armed > 0 ? larger(x->t_valid, p->t_armed) : x->t_valid;
    double left = since + p->lost_time - t;
    record(x, NAVIGATION, (Finding){left, left < 0 ? since + p->lost_time : NEVER});
}

/* ---- increment of the abort ---- */
static int is_relative(const Parameters *p)
{
    return p->abort_relative && norm(p->abort_dv_H) == 0;
}

/* increment, in N axes, of an abort with abort_relative = 0 or a given abort_dv_H, which does not
 * depend on the velocity of the servicer; u: inputs at the last valid state. Before the
 * first valid state the increment is 0, and the servicer drifts. */
static vec3 fixed_increment_N(const Parameters *p, const Input *u)
{
    if (!u->relative_valid) return vec(0, 0, 0);
    mat3 C_HN = hill_frame(p->mu, u->T.r, u->T.v).C_HN, C_TN = dcm_of_quat(attitude_in(u->T.q));
    if (norm(p->abort_dv_H) > 0) return tmul(C_HN, p->abort_dv_H);
    vec3 out = scale(p->abort_speed, p->corridor_axis);
    return tmul(p->corridor_axes == TARGET_AXES ? C_TN : C_HN, out);
}

/* G.10-1 */
static vec3 abort_increment_N(const Parameters *p, const State *x, double t)
{
    if (!is_relative(p)) return fixed_increment_N(p, &x->last);
    if (!x->known.is_known) return vec(0, 0, 0);
    RelativeState now = drifted(&x->known.state, t - x->known.t);
    return tmul(now.C_HN, relative_increment(p, &now, x->known.axis_H));
}

/* ---- rule escape ---- */
/* velocity increment in Hill axes for an abort that is ordered at the last valid state */
static vec3 increment_in_hill(const Parameters *p, const Input *u, const Known *known)
{
    if (is_relative(p)) return relative_increment(p, &known->state, known->axis_H);
    return mul(known->state.C_HN, fixed_increment_N(p, u));
}

/* escape radius in force; 0: rule escape does not apply, for example within axis_radius while
 * approaching, because contact is intended there */
/* G.11-3 */
static double radius_in_force(const Parameters *p, const Input *u, const State *x)
{
    int approaching = u->approaching != 0;
    if (p->escape_time == 0 || x->abort || !x->known.is_known) return 0;
    if (approaching && norm(sub(u->S.r, u->T.r)) <= p->axis_radius) return 0;
    return p->escape_radius[approaching];
}

static void rest_escape(State *x, Output *y)
{
    x->looked_ahead = 0;
    x->margin[ESCAPE] = RESTING;
    y->escape_time_least = NOT_YET;
    y->escape_dv = 0;
}

/* G.11-1 */
static void foresee_abort(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    double radius = radius_in_force(p, u, x), reserve = p->escape_reserve[u->approaching != 0];
    if (radius == 0) {
        rest_escape(x, y);
        return;
    }
    if (x->looked_ahead && !reached(t, x->t_escape + p->escape_period)) return;
    EscapeBound found = escape_bound(p, u, &x->known, increment_in_hill(p, u, &x->known));
    double margin = found.margin - radius;
    record(x, ESCAPE, (Finding){margin, margin < reserve ? t : NEVER});
    y->escape_time_least = found.t;
    y->escape_dv = found.dv;
    x->looked_ahead = 1;
    x->t_escape = t;
}

/* number of the rule whose margin, divided by its typical size (safety_evaluation.h), is smallest
 * (1: keep-out, ...); 0: no rule applies */
/* G.2-6 */
static double nearest_rule(const Parameters *p, const Input *u, const State *x)
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
/* G.5-1 */
static void latch_abort(const Parameters *p, State *x, double t)
{
    int due = reached(t, p->abort_time);
    for (int rule = 0; rule < RULES; rule++)
        due |= p->abort_on[rule] != 0 && x->t_first[rule] != NOT_YET;
    if (due && !x->abort) x->dv_N = abort_increment_N(p, x, t);
    x->abort = x->abort || due;
}

/* abort_force along the remaining increment; smaller in the last sample, so that the increment
 * is exactly spent */
/* G.5-3 */
static vec3 abort_force_S(const Parameters *p, const Input *u, State *x, double period)
{
    double left = norm(x->dv_N), most = period > 0 ? p->mass * left / period : 0;
    double F = smaller(p->abort_force, most);
    vec3 F_N = left > 0 ? scale(F / left, x->dv_N) : x->dv_N;
    x->dv_N = sub(x->dv_N, scale(period / p->mass, F_N));
    return mul(dcm_of_quat(attitude_in(u->S.q)), F_N);
}

/* ---- outputs ---- */
static void publish_violations(const State *x, Output *y)
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
    publish_violations(x, y);
}

static State initial_state(double t)
{
    State x = {.begun = 1, .t = t, .t_valid = t, .range = unchecked};
    for (int rule = 0; rule < RULES; rule++)
        x.margin[rule] = x.least[rule] = RESTING, x.t_first[rule] = NOT_YET;
    return x;
}

static void monitor(const Parameters *p, const Input *u, State *x, Output *y, double t,
                    double period)
{
    if (!x->begun) *x = initial_state(t);
    int is_valid = has_valid_states(p, u, x, t), active = is_valid && is_armed(p, t);
    if (active) {
        double t0 = x->seen ? x->t : t;
        Interval i = interval(p, x->seen ? &x->last : u, u, t0, t - t0);
        evaluate(&i, x);
        predict_drift(p, u, x, y, t);
        x->known = known_state(p, u, x->known, t);
        foresee_abort(p, u, x, y, t);
        y->nearest = nearest_rule(p, u, x);
        x->last = *u;
    }
    x->seen = active;
    x->foreseen = active && !passive_is_off(p, u);
    x->t = t;
    evaluate_navigation(p, u, x, is_valid, t);
    latch_abort(p, x, t);
    if (p->act && x->abort) y->F_safe_S = abort_force_S(p, u, x, period);
    y->passive_age = predicted_age(x, t);
    publish(x, y);
}

/* While the initial values of a system are computed, inputs may have any value: margins are
 * published, but no violation is stored before the first step. */
/* G.5-5 */
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    State first = {0}, none = {0}, nothing = initial_state(t);
    y->passive_entry = y->escape_time_least = NOT_YET;
    monitor(p, u, &first, y, t, 0);
    memcpy(nothing.margin, first.margin, sizeof first.margin);
    memcpy(nothing.least, first.least, sizeof first.least);
    publish(&nothing, y);
    y->F_safe_S = u->F_cmd_S;
    *x = none;
}

/* G.5-4 */
static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        monitor(p, u, x, y, s.t, s.period);
    if (!(p->act && x->abort)) y->F_safe_S = u->F_cmd_S;
}

FMU_MODEL(
    "safety_monitor",
    "Safety monitor of an approach: keep-out, corridor, speed, passive, plume, navigation, escape");
