/* safety_monitor.c - watches an approach: keep-out zone, corridor, speed, passive safety, plume,
 * and orders the abort.
 *
 *   1 keep-out    ellipsoid or box about the target, Hill or target axes
 *   2 corridor    cone about the direction of approach, Hill or target axes
 *   3 speed       |drho_H| <= v_0 + k |rho|
 *   4 passive     the drift without thrust for the next passive_time keeps out of the zone
 *   5 plume       the exhaust of F_cmd_S does not meet the target
 *   6 navigation  no longer than lost_time without a valid relative state
 *
 * Rules 1, 2, 3 and 5 are judged in continuous time: between two samples the servicer moves on the
 * cubic arc through both states, and what was in force at the first (approaching, F_cmd_S) is in
 * force until the second. Published margins are the least since the last sample, never above the
 * true least of the arc and below it by no more than 1e-7; a rule that is off or rests has margin
 * 1e9. Rule 4 is judged at the samples; if it fails, the instant is found by halving the arc. The
 * first violation of each rule is kept with its time; `abort` is latched.
 *
 * Abort manoeuvre (act = 1): after the abort F_safe_S is no longer F_cmd_S but abort_force along a
 * velocity increment, until that is spent: abort_dv_H or, if that is zero, abort_speed outwards
 * along the corridor, both as they point in the last valid state. Without one (target lost) nothing
 * is judged, margins keep their values, and the next valid state begins a new arc. At zero
 * range the zone is violated, corridor and plume are on their edge. Inputs that are not numbers are
 * refused by the interface. Equations: docs/models.md G. */
#include "drift.h"
#include "safety_rules.h"
#include "tracking.h"

enum { KEEP_OUT, CORRIDOR, SPEED, PASSIVE, PLUME, NAVIGATION, RULES };
enum { HILL_AXES, TARGET_AXES };
#define RESTING    1e9  /* margin of a rule that is off */
#define NOT_YET    (-1) /* time of what has not happened */
#define TINY_RANGE 1e-9 /* m */

typedef struct {
    double mu, R_E, J2, use_J2;
    double keep_out_shape, keep_out_axes, keep_out_opens;
    vec3 keep_out_half;
    double use_corridor, corridor_axes, corridor_half_angle, corridor_length;
    vec3 corridor_axis, corridor_apex;
    double use_speed_limit, speed_at_zero, speed_slope;
    double passive_time, passive_step;
    double use_plume, plume_half_angle, plume_range, plume_force_min;
    double lost_time;
    double abort_on[RULES];
    double act, mass, abort_force, abort_speed;
    vec3 abort_dv_H;
    double sample_period;
} Parameters;
typedef struct {
    Body T, S;
    vec3 F_cmd_S;
    double approaching, relative_valid;
} Input;
typedef struct {
    double begun, seen, t, t_valid; /* t: of the last sample, t_valid: of the last valid state */
    Input last;                     /* valid one; seen: it was that of the last sample */
    double margin[RULES], least[RULES], t_first[RULES];
    double abort;
    vec3 dv_N;
} State;
typedef struct {
    double keep_out_margin, corridor_margin, speed_margin, passive_margin, plume_margin,
        navigation_margin;
    double least_margin[RULES], nearest, passive_entry;
    double abort, violated[RULES], t_first[RULES], t_violation, rule_violated;
    vec3 F_safe_S, dv_left_N;
} Output;
typedef struct {
    Parameters p;
    Input u;
    State x;
    Output y;
} Model;

static const Model start = {
    .p = {.mu = 3.986004415e14,
          .R_E = 6378136.3,
          .J2 = 1.0826360229829945e-3,
          .use_J2 = 1,
          .keep_out_shape = ELLIPSOID,
          .keep_out_half = {2, 2, 2},
          .corridor_axis = {0, 1, 0},
          .corridor_half_angle = 0.3490658503988659,
          .speed_at_zero = 0.1,
          .speed_slope = 0.01,
          .passive_step = 60,
          .plume_half_angle = 0.3490658503988659,
          .plume_range = 20,
          .plume_force_min = 1e-3,
          .lost_time = 30,
          .abort_on = {1, 1, 1, 1, 1, 1},
          .mass = 100,
          .abort_force = 20,
          .abort_speed = 0.1},
    .u = {.T = {.r = {7158140, 0, 0}, .v = {0, 7462.286, 0}, .q = {1, 0, 0, 0}},
          .S = {.r = {7158140, 20, 0}, .v = {-0.0208, 7462.286, 0}, .q = {1, 0, 0, 0}},
          .approaching = 1,
          .relative_valid = 1},
};

#define SWITCH_INPUT(member, text) ROW_AS(INPUT_ROW, u, #member, member, 1, "1", text, SWITCH_VALUE)

static const Variable variables[] = {
    NONNEGATIVE(mu, "m3/s2", "gravitational parameter of the planet; 0 = deep space"),
    NONNEGATIVE(R_E, "m", "equatorial radius of the planet"),
    NONNEGATIVE(J2, "1", "second zonal harmonic of the planet"),
    SWITCH(use_J2, "1: the drift without thrust feels the oblateness"),
    PARAMETER(keep_out_shape, "1", "keep-out zone: 0 = none, 1 = ellipsoid, 2 = box"),
    SWITCH(keep_out_axes, "axes of the keep-out zone: 0 = Hill, 1 = target"),
    SWITCH(keep_out_opens, "1: the keep-out zone rests while approaching (berthing)"),
    POSITIVE(keep_out_half, "m", "half axes of the keep-out zone; three equal ones: sphere"),
    SWITCH(use_corridor, "1: approach corridor, while approaching"),
    SWITCH(corridor_axes, "axes of the corridor: 0 = Hill, 1 = target"),
    POSITIVE(corridor_half_angle, "rad", "half angle of the cone, below pi/2"),
    NONNEGATIVE(corridor_length, "m", "the corridor ends there, along its axis; 0 = never"),
    PARAMETER(corridor_axis, "1", "unit vector from the apex outwards"),
    PARAMETER(corridor_apex, "m", "apex of the cone, from the target's centre of mass"),
    SWITCH(use_speed_limit, "1: speed limit, while approaching"),
    NONNEGATIVE(speed_at_zero, "m/s", "speed limit at range 0, as seen in the Hill frame"),
    NONNEGATIVE(speed_slope, "1/s", "rise of the speed limit with the range"),
    NONNEGATIVE(passive_time, "s",
                "the drift without thrust must keep out of the zone that long; 0 = rule off"),
    POSITIVE(passive_step, "s", "integration step of the drift"),
    SWITCH(use_plume, "1: the exhaust must not meet the target"),
    POSITIVE(plume_half_angle, "rad", "half angle of the exhaust, below pi/2"),
    POSITIVE(plume_range, "m", "the exhaust does no harm beyond this distance"),
    NONNEGATIVE(plume_force_min, "N", "smaller forces make no plume"),
    NONNEGATIVE(lost_time, "s", "longest time without a valid relative state; 0 = rule off"),
    SWITCH(abort_on, "1: a violation of this rule aborts; order of the rules: keep-out, corridor, "
                     "speed, passive, plume, navigation"),
    SWITCH(act, "1: after the abort F_safe_S is the abort manoeuvre, 0: it stays F_cmd_S"),
    POSITIVE(mass, "kg", "mass of the servicer as assumed for the abort manoeuvre"),
    NONNEGATIVE(abort_force, "N", "force of the abort manoeuvre; 0: free drift"),
    NONNEGATIVE(abort_speed, "m/s", "velocity increment outwards along the corridor"),
    PARAMETER(abort_dv_H, "m/s", "velocity increment in Hill axes; zero: along the corridor"),
    NONNEGATIVE(sample_period, "s", "sample period of the software; 0 = at every call"),

    BODY_INPUTS("T", T, "target"),
    BODY_INPUTS("S", S, "servicer"),
    INPUT(F_cmd_S, "N", "commanded force, servicer axes"),
    SWITCH_INPUT(approaching, "1: corridor and speed limit apply (0: after the approach was "
                              "given up)"),
    SWITCH_INPUT(relative_valid, "1: the states of target and servicer can be relied on"),

    OUTPUT(keep_out_margin, "m", "least margin of the keep-out zone since the last sample"),
    OUTPUT(corridor_margin, "m", "least margin of the corridor since the last sample"),
    OUTPUT(speed_margin, "m/s", "least margin of the speed limit since the last sample"),
    OUTPUT(passive_margin, "m", "least margin of the keep-out zone during the drift from here"),
    OUTPUT(plume_margin, "m", "least margin of the plume since the last sample"),
    OUTPUT(navigation_margin, "s", "time left until the target counts as lost"),
    OUTPUT(least_margin, "1", "least margin of this rule since the start, in its unit"),
    OUTPUT(nearest, "1",
           "rule with the least margin over its own size: 1 keep-out, 2 corridor, 3 speed, 4 "
           "passive, 5 plume; 0: none applies"),
    OUTPUT(passive_entry, "s", "time of drift until the zone is entered; -1: it is not"),
    ALARM(abort, "1: a rule that aborts has been violated; stays"),
    FLAG(violated, "1: this rule has been violated; stays"),
    OUTPUT(t_first, "s", "first violation of this rule; -1: none"),
    OUTPUT(t_violation, "s", "first violation of any rule; -1: none"),
    OUTPUT(rule_violated, "1", "rule violated first, 1 to 6; 0: none"),
    OUTPUT(F_safe_S, "N", "force to be passed on, servicer axes: F_cmd_S, or the abort manoeuvre"),
    OUTPUT(dv_left_N, "m/s", "what is left of the abort manoeuvre, N axes"),
};

static void check_acute(Problems *problems, const char *name, double angle)
{
    if (angle >= 1.5707963267948966) refuse(problems, name, angle, "must be below pi/2");
}

static void check(const Parameters *p, Problems *problems)
{
    double shape = p->keep_out_shape, axis = norm(p->corridor_axis);
    if (shape != NO_ZONE && shape != ELLIPSOID && shape != BOX)
        refuse(problems, "keep_out_shape", shape, "must be 0, 1 or 2");
    if (fabs(axis - 1) > 1e-9) refuse(problems, "corridor_axis", axis, "must be a unit vector");
    if (p->passive_time > 0 && shape == NO_ZONE)
        refuse(problems, "passive_time", p->passive_time, "needs a keep-out zone");
    if (p->passive_time > 1e5 * p->passive_step)
        refuse(problems, "passive_step", p->passive_step, "must not be below passive_time / 1e5");
    check_acute(problems, "corridor_half_angle", p->corridor_half_angle);
    check_acute(problems, "plume_half_angle", p->plume_half_angle);
}

/* ---- relative states and arcs ---- */
static Pair pair(const Input *u) { return (Pair){{u->T.r, u->T.v}, {u->S.r, u->S.v}}; }

static Relative in_hill(const Parameters *p, const Input *u)
{
    Pair x = pair(u);
    return relative_in_hill(p->mu, &x);
}

/* as seen in a body that turns with omega: v = C drho_N - omega x p */
static Relative in_body(const Input *u, const Body *b)
{
    mat3 C = dcm_of_quat(attitude_in(b->q));
    vec3 p = mul(C, sub(u->S.r, u->T.r));
    return (Relative){p, sub(mul(C, sub(u->S.v, u->T.v)), cross(b->omega, p))};
}

static Relative in_axes(const Parameters *p, const Input *u, double axes)
{
    return axes == TARGET_AXES ? in_body(u, &u->T) : in_hill(p, u);
}

static Arc joined(Relative a, Relative b, double h) { return hermite(a.p, a.v, b.p, b.v, h); }

/* ---- rules in continuous time: least margin on the arc, first violation ---- */
typedef struct { double margin, t; } Finding;

static const Finding resting = {RESTING, NEVER};

typedef struct {
    const Parameters *p;
    const Input *from, *to; /* what was in force, what is now */
    double t, h;            /* the arc */
} Interval;

static Finding along(const Interval *i, Margin m, Arc arc)
{
    double margin = least_on(&m, &arc);
    return (Finding){margin, margin < 0 ? i->t + i->h * first_below_zero(&m, &arc) : NEVER};
}

static Arc arc_in(const Interval *i, double axes)
{
    return joined(in_axes(i->p, i->from, axes), in_axes(i->p, i->to, axes), i->h);
}

static Finding keep_out(const Interval *i)
{
    const Parameters *p = i->p;
    Zone zone = {p->keep_out_shape, p->keep_out_half};
    if (zone.shape == NO_ZONE || (p->keep_out_opens && i->from->approaching)) return resting;
    return along(i, (Margin){zone_value, zone_bound, &zone}, arc_in(i, p->keep_out_axes));
}

static Finding corridor(const Interval *i)
{
    const Parameters *p = i->p;
    Corridor cone = {p->corridor_apex, p->corridor_axis, p->corridor_half_angle,
                     p->corridor_length};
    if (!p->use_corridor || !i->from->approaching) return resting;
    return along(i, (Margin){corridor_value, corridor_bound, &cone}, arc_in(i, p->corridor_axes));
}

static Finding speed(const Interval *i)
{
    SpeedLimit limit = {i->p->speed_at_zero, i->p->speed_slope};
    if (!i->p->use_speed_limit || !i->from->approaching) return resting;
    return along(i, (Margin){speed_value, speed_bound, &limit}, arc_in(i, HILL_AXES));
}

/* thrusters are bolted to the body: the arc in servicer axes */
static Finding plume(const Interval *i)
{
    const Parameters *p = i->p;
    double F = norm(i->from->F_cmd_S);
    if (!p->use_plume || F <= p->plume_force_min) return resting;
    Plume cone = {scale(1 / F, i->from->F_cmd_S), p->plume_half_angle, p->plume_range};
    Arc arc = joined(in_body(i->from, &i->from->S), in_body(i->to, &i->to->S), i->h);
    return along(i, (Margin){plume_value, plume_bound, &cone}, arc);
}

/* ---- passive safety ---- */
/* the attitude of the target is not predicted: a zone that turns with it counts as the sphere
 * around it */
static Zone passive_zone(const Parameters *p)
{
    vec3 d = p->keep_out_half;
    double around = p->keep_out_shape == BOX ? norm(d) : fmax(d.x, fmax(d.y, d.z));
    if (p->keep_out_axes == TARGET_AXES) return (Zone){ELLIPSOID, vec(around, around, around)};
    return (Zone){p->keep_out_shape, d};
}

static Encounter encounter(const Parameters *p, Pair x)
{
    Zone zone = passive_zone(p);
    Drift drift = {
        {.mu = p->mu, .R_E = p->R_E, .J2 = p->J2}, p->use_J2, p->passive_time, p->passive_step};
    return drift_encounter(&drift, &(Margin){zone_value, zone_bound, &zone}, x);
}

static PosVel on_the_way(PosVel a, PosVel b, double h, double s)
{
    Arc arc = hermite(a.r, a.v, b.r, b.v, h);
    return (PosVel){arc_position(&arc, s), arc_velocity(&arc, s)};
}

static Pair pair_at(const Interval *i, double s)
{
    Pair a = pair(i->from), b = pair(i->to);
    return (Pair){on_the_way(a.T, b.T, i->h, s), on_the_way(a.S, b.S, i->h, s)};
}

/* the instant between the samples from which on the drift is not safe: it was at the first, it is
 * not at the second */
static double passive_violation(const Interval *i)
{
    double safe = 0, unsafe = 1;
    if (i->h == 0 || encounter(i->p, pair_at(i, 0)).margin < 0) return i->t;
    for (int k = 0; k < 30; k++) {
        double s = (safe + unsafe) / 2;
        if (encounter(i->p, pair_at(i, s)).margin < 0) unsafe = s;
        else safe = s;
    }
    return i->t + i->h * unsafe;
}

static Finding passive(const Interval *i, const State *x, Output *y)
{
    y->passive_entry = NOT_YET;
    if (i->p->passive_time == 0) return resting;
    Encounter e = encounter(i->p, pair(i->to));
    if (e.entry != NEVER) y->passive_entry = e.entry;
    int first = e.margin < 0 && x->t_first[PASSIVE] == NOT_YET;
    return (Finding){e.margin, first ? passive_violation(i) : NEVER};
}

/* ---- what has been found ---- */
static void keep_first(State *x, int rule, Finding f)
{
    x->margin[rule] = f.margin;
    x->least[rule] = fmin(x->least[rule], f.margin);
    if (f.t != NEVER && x->t_first[rule] == NOT_YET) x->t_first[rule] = f.t;
}

static void judge(const Interval *i, State *x, Output *y)
{
    keep_first(x, KEEP_OUT, keep_out(i));
    keep_first(x, CORRIDOR, corridor(i));
    keep_first(x, SPEED, speed(i));
    keep_first(x, PASSIVE, passive(i, x, y));
    keep_first(x, PLUME, plume(i));
}

static void judge_navigation(const Parameters *p, const Input *u, State *x, double t)
{
    if (u->relative_valid) x->t_valid = t;
    if (p->lost_time == 0) return;
    double left = x->t_valid + p->lost_time - t;
    keep_first(x, NAVIGATION, (Finding){left, left < 0 ? x->t_valid + p->lost_time : NEVER});
}

/* the size by which the margin of a rule is compared with those of others */
static double size_of(const Parameters *p, const Input *u, int rule)
{
    double range = norm(sub(u->S.r, u->T.r));
    switch (rule) {
    case CORRIDOR: return fmax(range, TINY_RANGE) * sin(p->corridor_half_angle);
    case SPEED: return fmax(p->speed_at_zero + p->speed_slope * range, TINY_RANGE);
    case PLUME: return p->plume_range;
    default: return smallest(p->keep_out_half);
    }
}

static double nearest(const Parameters *p, const Input *u, const State *x)
{
    double least = INFINITY, which = 0;
    for (int rule = 0; rule < NAVIGATION; rule++) {
        double share = x->margin[rule] / size_of(p, u, rule);
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
    double F = fmin(p->abort_force, most);
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
    const double *m = x->margin;
    y->keep_out_margin = m[KEEP_OUT];
    y->corridor_margin = m[CORRIDOR];
    y->speed_margin = m[SPEED];
    y->passive_margin = m[PASSIVE];
    y->plume_margin = m[PLUME];
    y->navigation_margin = m[NAVIGATION];
    y->abort = x->abort;
    y->dv_left_N = x->dv_N;
    publish_first(x, y);
}

static State begun(double t)
{
    State x = {.begun = 1, .t = t, .t_valid = t};
    for (int rule = 0; rule < RULES; rule++)
        x.margin[rule] = x.least[rule] = RESTING, x.t_first[rule] = NOT_YET;
    return x;
}

static void watch(const Parameters *p, const Input *u, State *x, Output *y, double t, double period)
{
    if (!x->begun) *x = begun(t);
    if (u->relative_valid) {
        Interval i = {p, x->seen ? &x->last : u, u, x->seen ? x->t : t, x->seen ? t - x->t : 0};
        judge(&i, x, y);
        y->nearest = nearest(p, u, x);
        x->last = *u;
    }
    x->seen = u->relative_valid;
    x->t = t;
    judge_navigation(p, u, x, t);
    decide(p, x);
    y->F_safe_S = p->act && x->abort ? abort_force_S(p, u, x, period) : u->F_cmd_S;
    publish(x, y);
}

/* While start values travel through a system the inputs may be anything: margins are shown, nothing
 * is kept before the first step. */
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    State first = {0}, none = {0}, nothing = begun(t);
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
}

FMU_MODEL("safety_monitor",
          "Safety monitor of an approach: keep-out zone, corridor, speed, passive safety, plume");
