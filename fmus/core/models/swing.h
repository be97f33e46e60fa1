/* swing.h - prescribed swing of the arm (module about its hinge): angle, rate and acceleration
 * over time.
 *
 * u = (t - start)/duration, limited to 0 .. 1, angle = angle_f f(u):
 *   smooth:  f = 10 u^3 - 15 u^4 + 6 u^5
 *   else:    f = 2 u^2, from the middle on 1 - 2 (1-u)^2, constant acceleration, then the
 *            opposite */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SWING_H
#define SWING_H

#include "vec3.h"

typedef struct { double angle, start, duration, smooth; } Swing;
typedef struct { double angle, rate, accel; } Arm; /* rad, rad/s, rad/s2 */

#define SWING_START {.angle = PI / 2, .start = 600, .duration = 3000, .smooth = 1}

#define SWING_ROWS(member)                                                                \
    PARAMETER_AS("swing_angle", member.angle, "rad",                                      \
                 "angle of the arm (module about its hinge) after the swing; before: 0"), \
        PARAMETER_AS("swing_start", member.start, "s", "start of the swing"),             \
        POSITIVE_AS("swing_duration", member.duration, "s", "duration of the swing"),     \
        ROW_AS(PARAMETER_ROW, p, "swing_smooth", member.smooth, 1, "1",                   \
               "1: quintic swing; 0: constant acceleration, then as much deceleration",   \
               SWITCH_VALUE)

/* swing at time t. t_inside: an instant inside the integration step; where the acceleration or
 * its derivative jumps, t_inside selects the side of the jump */
static inline Arm arm_in_step(const Swing *s, double t, double t_inside)
{
    double u = clamp((t - s->start) / s->duration, 0, 1), v = 1 - u;
    double u_inside = (t_inside - s->start) / s->duration, f, df, ddf;
    if (u_inside < 0) return (Arm){0, 0, 0};
    if (u_inside > 1) return (Arm){s->angle, 0, 0};
    if (s->smooth != 0) {
        f = u * u * u * (10 - 15 * u + 6 * u * u);
        df = 30 * u * u * v * v;
        ddf = 60 * u * v * (v - u);
    } else {
        int first = u_inside <= 0.5;
        f = first ? 2 * u * u : 1 - 2 * v * v;
        df = first ? 4 * u : 4 * v;
        ddf = first ? 4 : -4;
    }
    double rate = s->angle / s->duration;
    return (Arm){s->angle * f, rate * df, rate / s->duration * ddf};
}
static inline Arm arm_at(const Swing *s, double t) { return arm_in_step(s, t, t); }

#endif
