/* unloading.h - unloading of wheel momentum by thrusters, switched by the wheel speed with a
 * hysteresis, with a torque proportional to the momentum up to a limit.
 *
 *   X = max_i |Omega_i - ref_i| / speed_max:   on from X >= `on` to X <= `off`
 *   M = -k A_w (Omega - ref), each axis at most `most`
 *
 * Omega: wheel speeds, ref: their reference, A_w: wheel inertia matrix, k: rate [1/s]. M is the
 * torque of the thrusters, which starts at X >= `on` and ends at X <= `off`. The wheels produce the
 * opposite torque, A_w dOmega = M, so that no torque acts on the body: (Omega - ref) decreases with
 * exp(-k t), or more slowly where an axis is limited to `most`. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef UNLOADING_H
#define UNLOADING_H

#include "exact.h"
#include "fmu.h"
#include "mat3.h"

typedef struct {
    double on, off, k, most, speed_max;
    vec3 ref;
} Unloading;

static inline void check_unloading(const Unloading *p, Problems *problems)
{
    if (p->off > p->on) reject(problems, "unload_off", p->off, "must not be above unload_on");
}

/* 1 if the wheels are to be unloaded now, else 0; before: result of the previous sample */
static inline double unloading_is_on(const Unloading *p, vec3 wheel_speed, double before)
{
    double full = largest_size(sub(wheel_speed, p->ref)) / p->speed_max;
    return full >= p->on ? 1 : full <= p->off ? 0 : before;
}

static inline vec3 unloading_torque(const Unloading *p, double on, mat3 A_w, vec3 wheel_speed)
{
    if (!on) return vec(0, 0, 0);
    vec3 M = scale(-p->k, mul(A_w, sub(wheel_speed, p->ref)));
    double most = p->most;
    return vec(clamp(M.x, -most, most), clamp(M.y, -most, most), clamp(M.z, -most, most));
}

#endif
