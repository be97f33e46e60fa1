/* limited_roll.h - a reference attitude D, whose axis i is given and which rolls about this axis
 * within limits of rate and acceleration.
 *
 *   i, k, j = k x i: axes of D,   w = i x i' + r i,   |r| <= rate_max,   |dr/dt| <= acceleration_max
 *
 * w: angular velocity of D, r: its roll rate. D follows a rule: an attitude with the same axis i
 * that may roll at any rate, or jump. As long as the rule satisfies the limits, D is equal to the
 * rule. If the rule violates the limits, or the caller sets `held`, D moves on its own: k follows i
 * on the shortest arc and rolls at the rate r, which is controlled towards r_d: the roll rate r* of
 * the rule plus a rate v that removes the roll angle psi from D to the rule,
 *
 *   r_d = r* + v(psi),   v = psi/tau,  beyond |psi| = a tau^2:  +-sqrt(2 a (|psi| - a tau^2/2)),
 *
 * a = acceleration_max/2, tau = ten samples; with `held`, r_d = 0. D follows the rule again
 * when both agree. Derivation: docs/models.md A.4.6. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef LIMITED_ROLL_H
#define LIMITED_ROLL_H

#include "attitude.h"
#include "motion.h"
#include "portable_math.h"

#define ROLL_SAMPLES 10   /* tau */
#define AGREED       1e-6 /* rad, rad/s: D and rule agree if they differ by less */
#define NEARLY_BACK  3.0  /* rad: beyond this angle from the rule, D retains its sense of roll */

typedef enum { ROLL_NONE, ROLL_BY_RULE, ROLL_FREE } RollMode;
typedef struct { double rate_max, acceleration_max; } RollLimits;
typedef struct {
    vec3 i, k;                 /* axes i and k of D, in components along N */
    double rate, acceleration; /* roll about i */
} Roll;
typedef struct {
    double mode, t; /* mode: a RollMode; t: time of the last sample */
    Roll D;
} RollState;

/* k, normal to the unit vector a, rotated by the shortest rotation that takes a to b */
static inline vec3 rotated_with_axis(vec3 k, vec3 a, vec3 b)
{
    return sub(k, scale(dot(k, b) / (1 + dot(a, b)), add(a, b)));
}

/* D after the time h: i as given, k carried along by the shortest rotation and rolled with the rate
 * and acceleration of D; the roll rate includes this acceleration, the new acceleration is 0 */
static inline Roll propagated_roll(Roll D, vec3 i, double h)
{
    vec3 k = rotated_with_axis(D.k, D.i, i);
    SineCosine turn = sine_and_cosine((D.rate + 0.5 * D.acceleration * h) * h);
    k = add(scale(turn.c, k), scale(turn.s, cross(i, k)));
    return (Roll){i, unit(sub(k, scale(dot(k, i), i))), D.rate + D.acceleration * h, 0};
}

/* roll angle from D to the rule; near half a turn, its sign is the sense in which D already
 * turns */
static inline double missing_roll(Roll D, Roll rule)
{
    double psi = arc_tangent(dot(cross(D.k, rule.k), D.i), dot(D.k, rule.k));
    double lead = D.rate - rule.rate;
    if (fabs(psi) > NEARLY_BACK && psi * lead < 0) psi += lead > 0 ? 2 * PI : -2 * PI;
    return psi;
}

/* roll rate with which the roll angle psi decreases to 0 with at most the acceleration a */
static inline double closing_rate(double psi, double a, double tau)
{
    double linear = a * tau * tau;
    if (fabs(psi) <= linear) return psi / tau;
    double rate = sqrt(2 * a * (fabs(psi) - 0.5 * linear));
    return psi > 0 ? rate : -rate;
}

static inline int satisfies(RollLimits limits, Roll rule, double h)
{
    return fabs(rule.rate + rule.acceleration * h) <= limits.rate_max &&
           fabs(rule.acceleration) <= limits.acceleration_max;
}

/* roll acceleration of D until the next sample */
static inline double roll_acceleration(RollLimits limits, Roll D, Roll rule, int held, double h)
{
    if (h == 0) return 0;
    double a = 0.5 * limits.acceleration_max, wanted = 0;
    if (!held)
        wanted = rule.rate + rule.acceleration * h +
                 closing_rate(missing_roll(D, rule), a, ROLL_SAMPLES * h);
    wanted = clamp(wanted, -limits.rate_max, limits.rate_max);
    return clamp((wanted - D.rate) / h, -limits.acceleration_max, limits.acceleration_max);
}

/* D at the sample at time t: equal to the rule, or moving towards it within the limits; held: 1
 * while D stops its roll in place of following the rule; h: time to the next sample */
static inline Roll limited_roll(RollLimits limits, RollState *x, Roll rule, int held, double t,
                                double h)
{
    Roll D = x->mode == ROLL_NONE ? rule : propagated_roll(x->D, rule.i, t - x->t);
    int may = !held && satisfies(limits, rule, h), agreed = x->mode != ROLL_FREE;
    if (!agreed) agreed = fabs(missing_roll(D, rule)) < AGREED && fabs(D.rate - rule.rate) < AGREED;
    if (may && agreed) {
        *x = (RollState){ROLL_BY_RULE, t, rule};
        return rule;
    }
    D.rate = clamp(D.rate, -limits.rate_max, limits.rate_max);
    D.acceleration = roll_acceleration(limits, D, rule, held, h);
    *x = (RollState){ROLL_FREE, t, D};
    return D;
}

#endif
