/* sinusoid.h - sinusoidal disturbance: bias + amplitude sin(frequency t + phase) per axis from its
 * start time on, 0 before. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SINUSOID_H
#define SINUSOID_H

#include "time_grid.h"
#include "vec3.h"

typedef struct {
    vec3 bias, amplitude, frequency, phase;
    double start;
} Sinusoid;

#define SINUSOID_ROWS_AS(name, member, unit, text)                                             \
    PARAMETER_AS(name ".bias", member.bias, unit, text ": constant part, per axis"),           \
        PARAMETER_AS(name ".amplitude", member.amplitude, unit, text ": amplitude, per axis"), \
        PARAMETER_AS(name ".frequency", member.frequency, "rad/s",                             \
                     text ": angular frequency, per axis"),                                    \
        PARAMETER_AS(name ".phase", member.phase, "rad",                                       \
                     text ": phase of the sine at t = 0, per axis"),                           \
        PARAMETER_AS(name ".start", member.start, "s", text ": zero before this time")
#define SINUSOID_ROWS(member, unit, text) SINUSOID_ROWS_AS(#member, member, unit, text)

/* disturbance on one axis; amplitude 0, the most frequent case, skips the sine */
static inline double wave(double bias, double amplitude, double frequency, double phase, double t)
{
    return amplitude == 0 ? bias : bias + amplitude * sine(frequency * t + phase);
}

/* disturbance at time t; step_start: start of the internal step that contains t. The disturbance
 * acts from the first internal step that begins at or after its start time. */
static inline vec3 sinusoid(const Sinusoid *d, double step_start, double t)
{
    if (!reached(step_start, d->start)) return vec(0, 0, 0);
    return vec(wave(d->bias.x, d->amplitude.x, d->frequency.x, d->phase.x, t),
               wave(d->bias.y, d->amplitude.y, d->frequency.y, d->phase.y, t),
               wave(d->bias.z, d->amplitude.z, d->frequency.z, d->phase.z, t));
}

#endif
