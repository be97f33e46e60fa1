/* safety_range.h - comparison of the estimate with an independent range, which detects a bias that
 * no rule on the estimate can detect.
 *
 *   R = |rho|,   R' = rho . v / R                       of the estimate
 *   off   = range_meas - (R - R' (t - t_m))             error of position, at the time t_m
 *   drift = range_meas - (D - R' (t - t_m))             error of velocity, by dead reckoning D
 *   D' = R',   D <- D + min(1, (t_m - t_p)/range_tau) drift,    |drift| limited to most
 *   most = range_at_zero + range_slope range_meas
 *
 * t_m, t_p: times of this and of the previous measurement. The first range sets D; single outliers
 * hardly change it. An error b of the velocity along the line of sight shows in off or in drift: if
 * the estimated position is integrated from the velocity, off grows with b t; if it is not, drift
 * tends to b range_tau. The estimate is distrusted when |off| or |drift| (before it is limited) has
 * been above the limit `most` at every measurement for the time range_patience, and trusted again
 * when one measurement agrees. Without a new measurement only D changes. docs/models.md G.8 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SAFETY_RANGE_H
#define SAFETY_RANGE_H

#include "safety_ports.h"

#define NOT_YET (-1) /* time of an event that has not happened */

/* start values of the parameters of the range check. The allowed disagreement is ten times the
 * noise of a range_sensor with its own start values. */
#define RANGE_CHECK .range_at_zero = 1, .range_slope = 0.01, .range_patience = 5, .range_tau = 10

typedef struct {
    /* begun: 1 if D is set; t, rate, reckoned: time, R' and D of the last sample */
    double begun, t, rate, reckoned;
    double stamp,
        since; /* times of the last range and of the first of consecutive ranges that disagree */
    double distrusted;
} RangeCheck;

static const RangeCheck unchecked = {.stamp = NOT_YET, .since = NOT_YET};

static inline void compare_range(const SafetyParameters *p, const SafetyInput *u, RangeCheck *c,
                                 double R, double back)
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

/* compares the estimate with a new range. An estimate that its source declares invalid is not
 * compared; dead reckoning then starts again. */
/* G.8-1, G.8-2 */
static inline RangeCheck updated_check(const SafetyParameters *p, const SafetyInput *u,
                                       RangeCheck c, double t)
{
    vec3 rho = sub(u->S.r, u->T.r);
    double R = norm(rho), rate = dot(unit_or_zero(rho), sub(u->S.v, u->T.v));
    if (!u->relative_valid) c.begun = 0;
    if (c.begun) c.reckoned += (t - c.t) * (c.rate + rate) / 2;
    c.t = t;
    c.rate = rate;
    if (u->relative_valid && u->range_valid && u->range_time > c.stamp)
        compare_range(p, u, &c, R, rate * (t - u->range_time));
    return c;
}

#endif
