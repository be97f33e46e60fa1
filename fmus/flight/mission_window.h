/* mission_window.h - time to begin to turn with the target: its grasp axis moves, and the
 * fly-around is short if the servicer begins when this axis is about to pass the servicer.
 *
 *   T_s    = max(spin_time, 1.875 w/spin_accel), w = |w_T|: duration of the change to the rate w_T
 *   a_s    = a turned by w T_s/2 about w_T, the angle by which the servicer lags during this change
 *   off    = angle(a_s, rho)
 *   least  = |angle(w_T, rho) - angle(w_T, a)|: least value of `off` in a turn of the target
 *   open:    off <= least + await_axis, or the servicer has waited for 2 pi/w
 * open: condition under which the servicer may begin; a_s: grasp axis turned by the angle by which
 * the servicer lags; a: grasp axis, rho: position of the servicer from the target; spin_time,
 * spin_accel, await_axis: parameters of the mission. docs/models.md J.14 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef MISSION_WINDOW_H
#define MISSION_WINDOW_H

#include "mission_ports.h"

static inline double spin_up_time(const MissionParameters *p, double tumble)
{
    if (p->spin_accel == 0) return p->spin_time;
    return larger(p->spin_time, 1.875 * tumble / p->spin_accel);
}

/* the vector a rotated about the unit vector u by the angle `by` */
static inline vec3 turned_about(vec3 a, vec3 u, double by)
{
    SineCosine s = sine_and_cosine(by);
    return sum3(scale(s.c, a), scale(s.s, cross(u, a)), scale((1 - s.c) * dot(u, a), u));
}

/* true if turning with the target may begin; axis: a; w_T, a and rho are in any axes, the same for
 * all; since: time that the servicer has waited [s] */
static inline int window_is_open(const MissionParameters *p, vec3 w_T, vec3 axis, vec3 rho,
                                 double since)
{
    double w = norm(w_T);
    if (p->await_axis == 0 || w == 0 || since >= 2 * PI / w) return 1;
    vec3 later = turned_about(axis, scale(1 / w, w_T), w * spin_up_time(p, w) / 2);
    double least = fabs(angle(w_T, rho) - angle(w_T, axis));
    return angle(later, rho) <= least + p->await_axis;
}

#endif
