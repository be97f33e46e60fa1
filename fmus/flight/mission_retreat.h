/* mission_retreat.h - retreat: velocity outwards and along the track, so that the servicer drifts
 * away and does not return.
 *
 *   v = v_retreat rho/|rho| +- v_drift y_H
 *
 * The sign with the larger least distance of the drift from the target is chosen, by the
 * equations of Clohessy and Wiltshire (hill_drift.h), n = |w_H|. The retreat is planned from the
 * last valid state. If the parameter abort_relative is 1, this state is first propagated to the
 * present time, and near the target the direction outwards is the grasp axis.
 *
 * With a purely outward velocity the servicer returns after an orbit. A component along the track
 * causes a permanent drift of 3 |v_y| per unit of time. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef MISSION_RETREAT_H
#define MISSION_RETREAT_H

#include "hill_drift.h"
#include "mission_ports.h"

#define ROUNDED_DOWN 1e-12 /* largest relative rounding error of drift_time / drift_step */
#define SPENT        1e-12 /* m/s: a smaller remaining increment counts as 0 */

/* least distance from the target during the drift, at the times drift_step, 2 drift_step, .. up to
 * drift_time, or the present distance if drift_time < drift_step; v: velocity at the start */
static inline double least_distance(const MissionParameters *p, const RelativeState *from, vec3 v)
{
    double steps = floor_of(p->drift_time / p->drift_step * (1 + ROUNDED_DOWN)),
           n = norm(from->w_H);
    double least = steps > 0 ? INFINITE : norm(from->rho_H);
    for (double k = 0; k < steps; k++) {
        double t = (k + 1) * p->drift_step;
        Transition f = transition(n, t, sine_and_cosine(n * t));
        least = smaller(least, norm(drift_position(&f, from->rho_H, v)));
    }
    return least;
}

typedef struct {
    vec3 dv_N;
    double clearance;
} Escape;

/* velocity increment of the retreat, and least distance from the target during the drift after it;
 * axis_H: axis along which the servicer leaves near the target, 0: none */
/* J.3-1 */
static inline Escape plan_escape(const MissionParameters *p, const RelativeState *from, vec3 axis_H)
{
    vec3 out = outward_velocity(p->v_retreat, from->rho_H, axis_H, p->axis_radius);
    vec3 ahead = add(out, vec(0, p->v_drift, 0)), behind = sub(out, vec(0, p->v_drift, 0));
    double clear_ahead = least_distance(p, from, ahead),
           clear_behind = least_distance(p, from, behind);
    vec3 v = clear_ahead >= clear_behind ? ahead : behind;
    return (Escape){tmul(from->C_HN, sub(v, from->drho_H)), larger(clear_ahead, clear_behind)};
}

/* force over one sample of the burn; subtracts the velocity change of this sample from dv_N */
/* J.3-2 */
static inline vec3 burn(const MissionParameters *p, double mass, double period, vec3 *dv_N)
{
    double left = norm(*dv_N), most = period > 0 ? mass * left / period : 0;
    vec3 F_N = left > 0 ? scale(smaller(p->F_retreat, most) / left, *dv_N) : vec(0, 0, 0);
    *dv_N = sub(*dv_N, scale(period / mass, F_N));
    if (norm(*dv_N) < SPENT) *dv_N = vec(0, 0, 0);
    return F_N;
}

#endif
