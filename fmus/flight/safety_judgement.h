/* safety_judgement.h - the rules of the safety monitor over the time between two samples: least
 * margin and first violation.
 *
 * The relative motion is a cubic arc in the axes of each rule: Hill, target or servicer. What was
 * in force at the first sample is in force until the second. docs/models.md G.1, G.4 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SAFETY_JUDGEMENT_H
#define SAFETY_JUDGEMENT_H

#include "drift.h"
#include "safety_ports.h"

#define RESTING 1e9 /* margin of a rule that is off */

/* ---- relative states and arcs ---- */
static inline Pair pair(const SafetyInput *u) { return (Pair){{u->T.r, u->T.v}, {u->S.r, u->S.v}}; }

static inline Relative in_hill(const SafetyParameters *p, const SafetyInput *u)
{
    Pair x = pair(u);
    return relative_in_hill(p->mu, &x);
}

/* as seen in a body that turns with omega: v = C drho_N - omega x p */
static inline Relative in_body(const SafetyInput *u, const Body *b)
{
    mat3 C = dcm_of_quat(attitude_in(b->q));
    vec3 p = mul(C, sub(u->S.r, u->T.r));
    return (Relative){p, sub(mul(C, sub(u->S.v, u->T.v)), cross(b->omega, p))};
}

static inline Relative in_axes(const SafetyParameters *p, const SafetyInput *u, double axes)
{
    return axes == TARGET_AXES ? in_body(u, &u->T) : in_hill(p, u);
}

static inline Arc joined(Relative a, Relative b, double h)
{
    return hermite(a.p, a.v, b.p, b.v, h);
}

/* ---- rules in continuous time: least margin on the arc, first violation ---- */
typedef struct { double margin, t; } Finding;

static const Finding resting = {RESTING, NEVER};

typedef struct {
    const SafetyParameters *p;
    const SafetyInput *from, *to; /* what was in force, what is now */
    double t, h;                  /* the arc */
} Interval;

static inline Finding along(const Interval *i, Margin m, Arc arc)
{
    double margin = least_on(&m, &arc);
    return (Finding){margin, margin < 0 ? i->t + i->h * first_below_zero(&m, &arc) : NEVER};
}

static inline Arc arc_in(const Interval *i, double axes)
{
    return joined(in_axes(i->p, i->from, axes), in_axes(i->p, i->to, axes), i->h);
}

static inline Finding keep_out(const Interval *i)
{
    const SafetyParameters *p = i->p;
    Zone zone = {p->keep_out_shape, p->keep_out_half};
    if (zone.shape == NO_ZONE || (p->keep_out_opens && i->from->approaching)) return resting;
    return along(i, (Margin){zone_value, zone_bound, &zone}, arc_in(i, p->keep_out_axes));
}

static inline Finding corridor(const Interval *i)
{
    const SafetyParameters *p = i->p;
    Corridor cone = {p->corridor_apex, p->corridor_axis, p->corridor_half_angle,
                     p->corridor_length};
    if (!p->use_corridor || !i->from->approaching) return resting;
    return along(i, (Margin){corridor_value, corridor_bound, &cone}, arc_in(i, p->corridor_axes));
}

static inline Finding speed(const Interval *i)
{
    SpeedLimit limit = {i->p->speed_at_zero, i->p->speed_slope};
    if (!i->p->use_speed_limit || !i->from->approaching) return resting;
    return along(i, (Margin){speed_value, speed_bound, &limit}, arc_in(i, HILL_AXES));
}

/* thrusters are bolted to the body: the arc in servicer axes */
static inline Finding plume(const Interval *i)
{
    const SafetyParameters *p = i->p;
    double F = norm(i->from->F_cmd_S);
    if (!p->use_plume || F <= p->plume_force_min) return resting;
    Plume cone = {scale(1 / F, i->from->F_cmd_S), p->plume_half_angle, p->plume_range};
    Arc arc = joined(in_body(i->from, &i->from->S), in_body(i->to, &i->to->S), i->h);
    return along(i, (Margin){plume_value, plume_bound, &cone}, arc);
}

/* ---- passive safety ---- */
/* the attitude of the target is not predicted: a zone that turns with it counts as the sphere
 * around it */
static inline Zone passive_zone(const SafetyParameters *p)
{
    vec3 d = p->keep_out_half;
    double around = p->keep_out_shape == BOX ? norm(d) : fmax(d.x, fmax(d.y, d.z));
    if (p->keep_out_axes == TARGET_AXES) return (Zone){ELLIPSOID, vec(around, around, around)};
    return (Zone){p->keep_out_shape, d};
}

static inline Encounter encounter(const SafetyParameters *p, Pair x)
{
    Zone zone = passive_zone(p);
    Drift drift = {
        {.mu = p->mu, .R_E = p->R_E, .J2 = p->J2}, p->use_J2, p->passive_time, p->passive_step};
    return drift_encounter(&drift, &(Margin){zone_value, zone_bound, &zone}, x);
}

static inline PosVel on_the_way(PosVel a, PosVel b, double h, double s)
{
    Arc arc = hermite(a.r, a.v, b.r, b.v, h);
    return (PosVel){arc_position(&arc, s), arc_velocity(&arc, s)};
}

static inline Pair pair_at(const Interval *i, double s)
{
    Pair a = pair(i->from), b = pair(i->to);
    return (Pair){on_the_way(a.T, b.T, i->h, s), on_the_way(a.S, b.S, i->h, s)};
}

/* the instant between the samples from which on the drift is not safe: it was at the first, it is
 * not at the second */
static inline double passive_violation(const Interval *i)
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

/* known: a violation has been found before, its instant is not asked for */
static inline Finding passive(const Interval *i, int known, double *entry)
{
    *entry = NEVER;
    if (i->p->passive_time == 0) return resting;
    Encounter e = encounter(i->p, pair(i->to));
    *entry = e.entry;
    return (Finding){e.margin, e.margin < 0 && !known ? passive_violation(i) : NEVER};
}

#endif
