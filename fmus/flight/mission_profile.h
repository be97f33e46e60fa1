/* mission_profile.h - distance on the grasp axis over time: final approach, mating, backing off.
 *
 *   s(x) = 10 x^3 - 15 x^4 + 6 x^5 in 0..1: fifth-order step, at rest at both ends
 *   FLYAROUND        L = R_2 + (R_f - R_2) s(tau/T), R_f: range of the fly-around
 *   FINAL            L = a + (L_3 - a) s(tau/T),  T = 1.875 |a - L_3|/v: peak speed v
 *   BACKOFF          the same as FINAL, to L_3 or to R_f, but T is at least 1 s
 *   MATING           dL = -v s(tau/T), then -v, until L_end; with by_arm: at rest at L_3
 * R_2, L_3, L_end: parameters; L: reference distance from the target; tau: time since the start of
 * the phase; a: distance along the grasp axis at this start; T in FLYAROUND: as in FINAL; T in
 * MATING: ramp_mate. v: v_back in FLYAROUND and on the way back to L_3, v_final in FINAL and on the
 * way back to R_f, v_mate in MATING. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef MISSION_PROFILE_H
#define MISSION_PROFILE_H

#include "mission_ports.h"

typedef struct {
    double phase, t, from, to;
} Profile; /* phase; t: its start time; from, to: distance L at start and end of the profile */
typedef struct { double L, d, dd; } Distance;

static inline Distance constant_distance(double L) { return (Distance){L, 0, 0}; }

static inline double profile_duration(const MissionParameters *p, const Profile *a)
{
    double way = 1.875 * fabs(a->from - a->to);
    if (a->phase == FINAL) return way / p->v_final;
    /* v_back, not v_final: if an abort interrupts the change of range, the servicer must be able
     * to stop outside the keep-out zone */
    if (a->phase == FLYAROUND) return way / p->v_back;
    if (a->phase != BACKOFF) return 0;
    return larger(way / (a->to == p->L_3 ? p->v_back : p->v_final), 1);
}

static inline Distance fifth_order_step(double from, double to, double T, double tau)
{
    double x = tau / T, y = 1 - x, way = to - from;
    return (Distance){from + way * x * x * x * (10 - 15 * x + 6 * x * x),
                      way * 30 * x * x * y * y / T, way * 60 * x * y * (y - x) / (T * T)};
}

static inline Distance mating_distance(const MissionParameters *p, double tau)
{
    double T = p->ramp_mate, v = p->v_mate, x = tau / T, y = 1 - x;
    Distance steady = {p->L_3 - v * (tau - T / 2), -v, 0};
    if (tau >= T) return steady;
    return (Distance){p->L_3 - v * T * x * x * x * x * (2.5 - 3 * x + x * x),
                      -v * x * x * x * (10 - 15 * x + 6 * x * x), -30 * v * x * x * y * y / T};
}

static inline Distance profile_at(const MissionParameters *p, const Profile *a, double t)
{
    double tau = t - a->t, T = profile_duration(p, a);
    if (a->phase == FAR) return constant_distance(p->R_2);
    if (a->phase == MATING && !p->by_arm) {
        Distance now = mating_distance(p, tau);
        return now.L <= p->L_end ? constant_distance(p->L_end) : now;
    }
    return tau < T ? fifth_order_step(a->from, a->to, T, tau) : constant_distance(a->to);
}

#endif
