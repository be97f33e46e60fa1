/* safety_evaluation.h - evaluation of the rules of the safety monitor between two samples: least
 * margin and first violation.
 *
 * The relative motion is a cubic arc in the axes of each rule: Hill, target or servicer. A rule
 * that applies at the first sample applies until the second. docs/models.md G.1, G.4 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SAFETY_EVALUATION_H
#define SAFETY_EVALUATION_H

#include "drift.h"
#include "safety_ports.h"

#define RESTING 1e9  /* margin of a rule that is off or does not apply */
#define TINY    1e-9 /* m, m/s: lower bound of a range or speed limit, so that no Size is 0 */

/* ---- relative states and arcs ---- */
static inline TwoOrbits two_orbits(const SafetyInput *u)
{
    return (TwoOrbits){{u->T.r, u->T.v}, {u->S.r, u->S.v}};
}

static inline Relative in_hill(const SafetyParameters *p, const SafetyInput *u)
{
    TwoOrbits x = two_orbits(u);
    return relative_in_hill(p->mu, &x);
}

/* position p and velocity v of S relative to T, as seen in body b, which rotates with omega:
 * p = C rho_N, v = C drho_N - omega x p, C: rotation matrix from N to body axes */
static inline Relative in_body(const SafetyInput *u, const Body *b)
{
    mat3 C = dcm_of_quat(attitude_in(b->q));
    vec3 p = mul(C, sub(u->S.r, u->T.r));
    return (Relative){p, sub(mul(C, sub(u->S.v, u->T.v)), cross(b->omega, p))};
}

static inline Arc arc_between(Relative a, Relative b, double h)
{
    return hermite(a.p, a.v, b.p, b.v, h);
}

/* ---- rules in continuous time: least margin on the arc, first violation ---- */
typedef struct { double margin, t; } Finding;

static const Finding resting = {RESTING, NEVER};

typedef struct {
    const SafetyParameters *p;
    const SafetyInput *from, *to; /* inputs of the first and of the second sample */
    double t, h;
    Arc arc[2]; /* arcs in Hill axes and in target axes */
} Interval;

/* true if a rule is evaluated on the arc in these axes; arcs that no rule needs are not computed */
static inline int is_needed(const SafetyParameters *p, double axes)
{
    return (p->keep_out_shape != NO_ZONE && p->keep_out_axes == axes) ||
           (p->use_corridor && p->corridor_axes == axes) ||
           (p->use_speed_limit && axes == HILL_AXES);
}

static inline Interval interval(const SafetyParameters *p, const SafetyInput *from,
                                const SafetyInput *to, double t, double h)
{
    Interval i = {.p = p, .from = from, .to = to, .t = t, .h = h};
    if (is_needed(p, HILL_AXES))
        i.arc[HILL_AXES] = arc_between(in_hill(p, from), in_hill(p, to), h);
    if (is_needed(p, TARGET_AXES))
        i.arc[TARGET_AXES] = arc_between(in_body(from, &from->T), in_body(to, &to->T), h);
    return i;
}

static inline const Arc *arc_in(const Interval *i, double axes)
{
    return &i->arc[axes == TARGET_AXES];
}

/* geometry of one rule in this interval; own: arc in servicer axes, which only the plume uses */
typedef struct {
    union {
        Zone zone;
        Corridor corridor;
        SpeedLimit speed;
        Plume plume;
    } of;
    Arc own;
} Setting;

/* function that sets the geometry of a rule and returns the arc on which the rule is evaluated,
 * NULL if the rule does not apply */
typedef const Arc *InForce(const Interval *i, Setting *s);

static inline const Arc *keep_out(const Interval *i, Setting *s)
{
    const SafetyParameters *p = i->p;
    s->of.zone = (Zone){p->keep_out_shape, p->keep_out_half};
    if (p->keep_out_shape == NO_ZONE || (p->keep_out_opens && i->from->approaching)) return NULL;
    return arc_in(i, p->keep_out_axes);
}

static inline Corridor corridor_of(const SafetyParameters *p)
{
    return (Corridor){p->corridor_apex, p->corridor_axis, p->corridor_half_angle,
                      p->corridor_length};
}

static inline const Arc *corridor(const Interval *i, Setting *s)
{
    const SafetyParameters *p = i->p;
    s->of.corridor = corridor_of(p);
    return p->use_corridor && i->from->approaching ? arc_in(i, p->corridor_axes) : NULL;
}

/* slope of the speed limit over range; with speed_tumble = 1 the tumble rate of the target, up to
 * tumble_max, is added, because the speed of a servicer that rotates with the target contains
 * |w_T| |rho| as seen in H */
static inline double speed_slope_at(const SafetyParameters *p, const SafetyInput *u)
{
    double tumble = smaller(norm(u->T.omega), p->tumble_max);
    return p->speed_tumble ? p->speed_slope + tumble : p->speed_slope;
}

static inline const Arc *speed(const Interval *i, Setting *s)
{
    s->of.speed = (SpeedLimit){i->p->speed_at_zero, speed_slope_at(i->p, i->from)};
    return i->p->use_speed_limit && i->from->approaching ? arc_in(i, HILL_AXES) : NULL;
}

/* the direction of the force is fixed in the servicer, so the arc is in servicer axes */
static inline const Arc *plume(const Interval *i, Setting *s)
{
    const SafetyParameters *p = i->p;
    double F = norm(i->from->F_cmd_S);
    if (!p->use_plume || F <= p->plume_force_min) return NULL;
    s->of.plume = (Plume){scale(1 / F, i->from->F_cmd_S), p->plume_half_angle, p->plume_range};
    s->own = arc_between(in_body(i->from, &i->from->S), in_body(i->to, &i->to->S), i->h);
    return &s->own;
}

/* typical size of a margin at a range [m, m/s]: margins are divided by it to compare different
 * rules */
typedef double Size(const SafetyParameters *p, double range);

static inline double zone_size(const SafetyParameters *p, double range)
{
    (void)range;
    return smallest(p->keep_out_half);
}
static inline double corridor_size(const SafetyParameters *p, double range)
{
    return larger(range, TINY) * sine(p->corridor_half_angle);
}
static inline double speed_size(const SafetyParameters *p, double range)
{
    return larger(p->speed_at_zero + p->speed_slope * range, TINY);
}
static inline double plume_size(const SafetyParameters *p, double range)
{
    (void)range;
    return p->plume_range;
}

/* functions of each rule. PASSIVE has no in_force, because it is evaluated on a predicted drift,
 * not on the arc between two samples. NAVIGATION, whose margin is a time, and ESCAPE, which
 * is a prediction, are not in the table. */
static const struct {
    InForce *in_force;
    MarginValue *value;
    MarginBound *bound;
    Size *size;
} rules[] = {
    [KEEP_OUT] = {keep_out, zone_value, zone_bound, zone_size},
    [CORRIDOR] = {corridor, corridor_value, corridor_bound, corridor_size},
    [SPEED] = {speed, speed_value, speed_bound, speed_size},
    [PASSIVE] = {NULL, zone_value, zone_bound, zone_size},
    [PLUME] = {plume, plume_value, plume_bound, plume_size},
};

static inline Finding evaluate_rule(const Interval *i, int rule)
{
    Setting s;
    memset(&s, 0, sizeof s);
    const Arc *arc = rules[rule].in_force(i, &s);
    if (!arc) return resting;
    const Margin m = {rules[rule].value, rules[rule].bound, &s.of};
    double margin = least_on(&m, arc);
    return (Finding){margin, margin < 0 ? i->t + i->h * first_below_zero(&m, arc) : NEVER};
}

/* ---- passive safety ---- */
/* zone for the predicted drift. The attitude of the target is not predicted: a zone in target
 * axes is replaced by the sphere around it. */
static inline Zone passive_zone(const SafetyParameters *p)
{
    vec3 d = p->keep_out_half;
    double around = p->keep_out_shape == BOX ? norm(d) : larger(d.x, larger(d.y, d.z));
    if (p->keep_out_axes == TARGET_AXES) return (Zone){ELLIPSOID, vec(around, around, around)};
    return (Zone){p->keep_out_shape, d};
}

static inline Encounter encounter(const SafetyParameters *p, TwoOrbits x)
{
    Zone zone = passive_zone(p);
    Drift drift = {
        {.mu = p->mu, .R_E = p->R_E, .J2 = p->J2}, p->use_J2, p->passive_time, p->passive_step};
    return drift_encounter(&drift, &(Margin){rules[PASSIVE].value, rules[PASSIVE].bound, &zone}, x);
}

static inline PosVel interpolated(PosVel a, PosVel b, double h, double s)
{
    Arc arc = hermite(a.r, a.v, b.r, b.v, h);
    return (PosVel){arc_position(&arc, s), arc_velocity(&arc, s)};
}

/* states at the last prediction of the drift (from, at time t) and at the present one (to, at
 * t + h) */
typedef struct {
    TwoOrbits from, to;
    double t, h;
} Course;

static inline TwoOrbits orbits_at(const Course *c, double s)
{
    return (TwoOrbits){interpolated(c->from.T, c->to.T, c->h, s),
                       interpolated(c->from.S, c->to.S, c->h, s)};
}

/* instant from which on the drift is unsafe, found by bisection between the last prediction and the
 * present one, which is unsafe; time of the last prediction if that was unsafe already */
static inline double passive_violation(const SafetyParameters *p, const Course *c)
{
    double safe = 0, unsafe = 1;
    if (c->h == 0 || encounter(p, c->from).margin < 0) return c->t;
    for (int k = 0; k < 30; k++) {
        double s = (safe + unsafe) / 2;
        if (encounter(p, orbits_at(c, s)).margin < 0) unsafe = s;
        else safe = s;
    }
    return c->t + c->h * unsafe;
}

/* margin of the drift that begins at the end of the course c, and instant at which the rule PASSIVE
 * was first violated; *entry: time until the drift enters the zone. With known = 1, if the first
 * violation is stored already, no instant is computed. */
static inline Finding passive_finding(const SafetyParameters *p, const Course *c, int known,
                                      double *entry)
{
    Encounter e = encounter(p, c->to);
    *entry = e.entry;
    return (Finding){e.margin, e.margin < 0 && !known ? passive_violation(p, c) : NEVER};
}

#endif
