/* hill_drift.h - relative state in Hill axes, its drift without thrust, and the velocity with which
 * an abort leaves the target.
 *
 * Equations of Clohessy and Wiltshire for a circular orbit, s = sin(n t), c = cos(n t):
 *
 *   x(t) = (4 - 3c) x + s/n x' + 2 (1 - c)/n y'
 *   y(t) = 6 (s - n t) x + y - 2 (1 - c)/n x' + (4 s - 3 n t)/n y'
 *   z(t) = c z + s/n z'
 *
 * n = 0 (deep space): straight lines. docs/models.md G.10, J.3 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef HILL_DRIFT_H
#define HILL_DRIFT_H

#include "orbit.h"

typedef struct {
    mat3 C_HN;
    vec3 w_H, rho_H, drho_H;
} RelativeState; /* drho as seen in H */

static inline RelativeState relative_state(double mu, PosVel T, PosVel S)
{
    HillFrame H = hill_frame(mu, T.r, T.v);
    vec3 rho = mul(H.C_HN, sub(S.r, T.r)), v = mul(H.C_HN, sub(S.v, T.v));
    return (RelativeState){H.C_HN, H.w_H, rho, rate_in_frame(&H, rho, v)};
}

/* elements of the transition matrix that are neither 0 nor 1: Phi_rr = [xx 0 0; yx 1 0; 0 0 zz],
 * Phi_rv = [vx swing 0; -swing vy 0; 0 0 vx] */
typedef struct { double xx, yx, zz, vx, swing, vy; } Transition;

static inline Transition transition(double n, double t, SineCosine nt)
{
    double s = nt.s, c = nt.c, vx = t, swing = 0, vy = t;
    if (n > 0) vx = s / n, swing = 2 * (1 - c) / n, vy = 4 * vx - 3 * t;
    return (Transition){4 - 3 * c, 6 * (s - n * t), c, vx, swing, vy};
}

static inline vec3 drift_position(const Transition *f, vec3 r, vec3 v)
{
    return vec(f->xx * r.x + f->vx * v.x + f->swing * v.y,
               f->yx * r.x + r.y - f->swing * v.x + f->vy * v.y, f->zz * r.z + f->vx * v.z);
}

/* Phi_rr^T a */
static inline vec3 position_part(const Transition *f, vec3 a)
{
    return vec(f->xx * a.x + f->yx * a.y, a.y, f->zz * a.z);
}
/* Phi_rv^T a */
static inline vec3 velocity_part(const Transition *f, vec3 a)
{
    return vec(f->vx * a.x - f->swing * a.y, f->swing * a.x + f->vy * a.y, f->vx * a.z);
}

static inline vec3 drift_velocity(double n, SineCosine nt, vec3 r, vec3 v)
{
    double s = nt.s, c = nt.c;
    return vec(3 * n * s * r.x + c * v.x + 2 * s * v.y,
               -6 * n * (1 - c) * r.x - 2 * s * v.x + (4 * c - 3) * v.y, -n * s * r.z + c * v.z);
}

/* relative state after a drift of t seconds, in the Hill axes of that time */
static inline RelativeState drifted(const RelativeState *from, double t)
{
    double n = norm(from->w_H);
    SineCosine nt = sine_and_cosine(n * t);
    Transition f = transition(n, t, nt);
    vec3 x = from->C_HN.row[0], y = from->C_HN.row[1];
    return (RelativeState){rows(add(scale(nt.c, x), scale(nt.s, y)),
                                sub(scale(nt.c, y), scale(nt.s, x)), from->C_HN.row[2]),
                           from->w_H, drift_position(&f, from->rho_H, from->drho_H),
                           drift_velocity(n, nt, from->rho_H, from->drho_H)};
}

/* velocity of an abort relative to the target: away from the target or, at a range of at most
 * axis_radius, along the axis (0: no axis), so that the servicer does not retreat through the
 * structure of the target; 0 at zero range without an axis */
static inline vec3 outward_velocity(double speed, vec3 rho, vec3 axis, double axis_radius)
{
    double R = norm(rho);
    if (norm(axis) > 0 && R <= axis_radius) return scale(speed, axis);
    return R > 0 ? scale(speed / R, rho) : scale(speed, axis);
}

#endif
