/* disturbance.h - disturbance acceleration on an orbiting body, given in N axes or in the Hill
 * frame of its own orbit. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef DISTURBANCE_H
#define DISTURBANCE_H

#include "orbit.h"
#include "sinusoid.h"

/* disturbance acceleration at time t, N axes; step_start: start time of the internal step that
 * contains t, from which sinusoid() decides whether the disturbance has begun */
static inline vec3 disturbance_N(const Sinusoid *d, double in_hill_axes, double mu, const vec3 *r,
                                 const vec3 *v, double step_start, double t)
{
    vec3 a = sinusoid(d, step_start, t);
    return in_hill_axes ? tmul(hill_frame(mu, *r, *v).C_HN, a) : a;
}

#endif
