/* drift.h - least margin of a safety rule while target and servicer drift without thrust.
 *
 *   dr/dt = v,   dv/dt = -mu r/r^3 (+ J2)   of target and servicer, classical Runge-Kutta
 * The relative path in Hill axes during an integration step is a cubic arc, on which the least
 * margin is computed in continuous time. Equations: docs/models.md G.4 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef DRIFT_H
#define DRIFT_H

#include "arc.h"
#include "orbit.h"
#include "rk4.h"

typedef struct { PosVel T, S; } TwoOrbits; /* N axes */

typedef struct {
    Orbit planet; /* mu, R_E, J2 */
    double use_J2, duration, max_step;
} Drift;

typedef struct {
    vec3 p, v;
} Relative; /* servicer relative to the target, as seen in the Hill frame */

static inline Relative relative_in_hill(double mu, const TwoOrbits *x)
{
    HillFrame H = hill_frame(mu, x->T.r, x->T.v);
    vec3 p = mul(H.C_HN, sub(x->S.r, x->T.r));
    return (Relative){p, rate_in_frame(&H, p, mul(H.C_HN, sub(x->S.v, x->T.v)))};
}

static inline void drift_derivative(const Drift *d, double t, const TwoOrbits *x, TwoOrbits *dx)
{
    (void)t;
    *dx = (TwoOrbits){{x->T.v, gravity(&d->planet, d->use_J2, x->T.r)},
                      {x->S.v, gravity(&d->planet, d->use_J2, x->S.r)}};
}

RK4(integrate_drift, drift_derivative, Drift, TwoOrbits)

/* least margin of the rule over the duration, and time from the start of the drift at which the
 * margin first falls below zero [s], NEVER if it does not */
typedef struct { double margin, entry; } Encounter;

static inline Encounter drift_encounter(const Drift *d, const Margin *m, TwoOrbits x)
{
    double steps = ceiling_of(d->duration / d->max_step), h = d->duration / steps;
    Encounter result = {INFINITY, NEVER};
    Relative before = relative_in_hill(d->planet.mu, &x);
    for (double k = 0; k < steps; k++) {
        integrate_drift(d, k * h, h, &x);
        Relative after = relative_in_hill(d->planet.mu, &x);
        Arc arc = hermite(before.p, before.v, after.p, after.v, h);
        result.margin = smaller(result.margin, least_on(m, &arc));
        if (result.margin < 0 && result.entry == NEVER)
            result.entry = (k + first_below_zero(m, &arc)) * h;
        before = after;
    }
    return result;
}

#endif
