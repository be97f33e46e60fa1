/* mission_retreat.h - retreat: a velocity outwards, and along the track for a drift that does not
 * return.
 *
 *   v = v_retreat rho/|rho| +- v_drift y_H
 *
 * with the sign whose drift has the larger least distance by the equations of Clohessy and
 * Wiltshire for a circular orbit, n = |w_H|, s = sin(n t), c = cos(n t):
 *
 *   x(t) = (4 - 3c) x + s/n x' + 2 (1 - c)/n y'
 *   y(t) = 6 (s - n t) x + y - 2 (1 - c)/n x' + (4 s - 3 n t)/n y'
 *   z(t) = c z + s/n z'
 *
 * A purely outward velocity returns after an orbit. A component along the track causes a permanent
 * drift of 3 |v_y| per unit of time. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef MISSION_RETREAT_H
#define MISSION_RETREAT_H

#include "mission_ports.h"

#define ROUNDED_DOWN 1e-12 /* relative rounding error of the number of steps */
#define SPENT        1e-12 /* m/s: a smaller rest of an increment counts as 0 */

typedef struct {
    mat3 C_HN;
    vec3 w_H, rho_H, drho_H;
} RelativeState; /* of the last valid sample; drho as seen in H */

static inline vec3 drift_position(double n, vec3 r, vec3 v, double t)
{
    if (n == 0) return add(r, scale(t, v));
    SineCosine nt = sine_and_cosine(n * t);
    double s = nt.s, c = nt.c, swing = 2 * (1 - c) / n;
    return vec((4 - 3 * c) * r.x + s / n * v.x + swing * v.y,
               6 * (s - n * t) * r.x + r.y - swing * v.x + (4 * s / n - 3 * t) * v.y,
               c * r.z + s / n * v.z);
}

/* least distance at the instants k drift_step, k = 1, 2, ...; without an instant the present one */
static inline double least_distance(const MissionParameters *p, const RelativeState *from, vec3 v)
{
    double steps = floor_of(p->drift_time / p->drift_step * (1 + ROUNDED_DOWN)),
           n = norm(from->w_H);
    double least = steps > 0 ? INFINITY : norm(from->rho_H);
    for (double k = 0; k < steps; k++)
        least = smaller(least, norm(drift_position(n, from->rho_H, v, (k + 1) * p->drift_step)));
    return least;
}

typedef struct {
    vec3 dv_N;
    double clearance;
} Escape;

static inline Escape plan_escape(const MissionParameters *p, const RelativeState *from)
{
    double R = norm(from->rho_H);
    vec3 out = R > 0 ? scale(p->v_retreat / R, from->rho_H) : vec(0, 0, 0);
    vec3 ahead = add(out, vec(0, p->v_drift, 0)), behind = sub(out, vec(0, p->v_drift, 0));
    double clear_ahead = least_distance(p, from, ahead),
           clear_behind = least_distance(p, from, behind);
    vec3 v = clear_ahead >= clear_behind ? ahead : behind;
    return (Escape){tmul(from->C_HN, sub(v, from->drho_H)), larger(clear_ahead, clear_behind)};
}

/* force over one sample of the burn; reduces the remaining increment dv_N accordingly */
static inline vec3 burn(const MissionParameters *p, double mass, double period, vec3 *dv_N)
{
    double left = norm(*dv_N), most = period > 0 ? mass * left / period : 0;
    vec3 F_N = left > 0 ? scale(smaller(p->F_retreat, most) / left, *dv_N) : vec(0, 0, 0);
    *dv_N = sub(*dv_N, scale(period / mass, F_N));
    if (norm(*dv_N) < SPENT) *dv_N = vec(0, 0, 0);
    return F_N;
}

#endif
