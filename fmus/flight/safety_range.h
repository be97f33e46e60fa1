/* safety_range.h - the estimate against an independent range: a bias that no rule on the estimate
 * can see.
 *
 *   R = |rho|,   R' = rho . v / R                       of the estimate
 *   off   = range_meas - (R - R' (t - t_m))             position: at the time of the measurement
 *   drift = range_meas - (D - R' (t - t_m))             velocity: against dead reckoning
 *   D' = R',   D <- D + min(1, (t_m - t_m-1)/range_tau) drift,    |drift| limited to most
 *   most = range_at_zero + range_slope range_meas
 *
 * The first range sets D; single outliers hardly move it. Where the velocity is in error by b along
 * the line of sight, off grows with b t if the position follows from it, and drift tends to
 * b range_tau if it does not. The estimate is distrusted when every range of the last range_patience
 * has off or drift above most, until one agrees; without a new range the verdict stays.
 * docs/models.md G.8 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SAFETY_RANGE_H
#define SAFETY_RANGE_H

#include "safety_ports.h"

#define NOT_YET (-1) /* time of what has not happened */

/* start values: ten times the noise of range_sensor, as it starts */
#define RANGE_CHECK .range_at_zero = 1, .range_slope = 0.01, .range_patience = 5, .range_tau = 10

typedef struct {
    double begun, t, rate, reckoned; /* D at the last sample, and R' there */
    double stamp, since;             /* of the last range; of the first in a row that disagrees */
    double distrusted;
} RangeCheck;

static const RangeCheck unchecked = {.stamp = NOT_YET, .since = NOT_YET};

static inline void compare(const SafetyParameters *p, const SafetyInput *u, RangeCheck *c, double R,
                           double back)
{
    double range = u->range_meas, most = p->range_at_zero + p->range_slope * range;
    if (!c->begun) c->reckoned = range + back;
    double off = range - (R - back), drift = range - (c->reckoned - back);
    double share = smaller(1, (u->range_time - c->stamp) / p->range_tau);
    c->reckoned += share * larger(-most, smaller(most, drift));
    c->begun = 1;
    c->stamp = u->range_time;
    if (fabs(off) <= most && fabs(drift) <= most) c->since = NOT_YET;
    else if (c->since == NOT_YET) c->since = c->stamp;
    c->distrusted = c->since != NOT_YET && reached(c->stamp, c->since + p->range_patience);
}

/* an estimate that its source calls invalid is not compared; dead reckoning begins anew after it */
static inline RangeCheck checked(const SafetyParameters *p, const SafetyInput *u, RangeCheck c,
                                 double t)
{
    vec3 rho = sub(u->S.r, u->T.r);
    double R = norm(rho), rate = dot(unit_or_zero(rho), sub(u->S.v, u->T.v));
    if (!u->relative_valid) c.begun = 0;
    if (c.begun) c.reckoned += (t - c.t) * (c.rate + rate) / 2;
    c.t = t;
    c.rate = rate;
    if (u->relative_valid && u->range_valid && u->range_time > c.stamp)
        compare(p, u, &c, R, rate * (t - u->range_time));
    return c;
}

#endif
