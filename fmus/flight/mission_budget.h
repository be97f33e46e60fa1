/* mission_budget.h - force, momentum and propellant that turning with the target needs, as known at
 * the second hold, and the verdict whether the target can be captured.
 *
 *   w = |w_T| as estimated,  a = budget F_axis/mass
 *   R_f     = clip(a/(w + w_steer)^2, R_around, R_2)                   range of the fly-around
 *   steer   = clip(sqrt(a/R) - w, 0, w_steer)                     steering rate that a permits at R
 *   w_m     = (w_T.h_T)/(h_T.h_T) h_T,  h_T = J_T w_T:  mean rate, constant in N despite nutation
 *   beta    = (w_m.J_S w_m)/(2 w_m.w_m),   h = beta w_m, wheels at most bias_max wheel_speed_max
 *   momentum = |J_T w_T| + w (max J_S + mass mass_T/(mass + mass_T) L_3^2)   of the pair at L_3
 *   dv      = w^2 (R_f pi/steer + L_3 T_3 + (R_f + L_3)/2 T_5)      for turning with the target
 *   wheels  = clip(A_w^-1 (h - J_S w_S), +-bias_max wheel_speed_max),  w_S: rate of the servicer
 * steering: motion about the target relative to its axes, on top of turning with it; h_T, J_T: its
 * angular momentum and inertia; J_S, A_w: inertias of servicer and wheels; names that are not
 * explained are parameters. Pair: servicer and target; max J_S: largest diagonal element; T_3:
 * dwell of FINAL and HOLD_3 and duration of the mating; T_5: duration of the final approach. h is
 * the momentum of body and wheels together from the closing to the fly-around. As h is parallel to
 * w_m, it is constant in body axes while the servicer turns with w_m. The wheels have h before the
 * servicer turns and h - J_S w_m afterwards; along w_m, the first is half of J_S w_m, the second
 * is minus this half. docs/models.md J.13 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef MISSION_BUDGET_H
#define MISSION_BUDGET_H

#include "mission_profile.h"

#define STANDARD_GRAVITY 9.80665

enum { CAN_CAPTURE, NO_FORCE, TOO_MUCH_MOMENTUM, NO_PROPELLANT, ONLY_BY_ARM };

/* R: range R_f of the fly-around; steer: steering rate that the force permits there; dv: velocity
 * increment for turning with the target, mating included; verdict: the first of NO_FORCE, ..
 * ONLY_BY_ARM that applies, or CAN_CAPTURE; bias: wheel speeds before the fly-around */
typedef struct {
    double R, steer, dv, verdict;
    vec3 bias;
} Budget;

/* acceleration per axis that the budget permits for turning with the target */
static inline double allotted_acceleration(const MissionParameters *p, double mass)
{
    return mass > 0 ? p->budget * p->F_axis / mass : 0;
}

static inline double steering_left(const MissionParameters *p, double mass, double tumble, double R)
{
    if (p->budget == 0) return p->w_steer;
    return clamp(sqrt(allotted_acceleration(p, mass) / R) - tumble, 0, p->w_steer);
}

static inline double range_around(const MissionParameters *p, double mass, double tumble)
{
    double W = tumble + p->w_steer;
    if (p->budget == 0 || W == 0) return p->R_2;
    return clamp(allotted_acceleration(p, mass) / (W * W), p->R_around, p->R_2);
}

/* wheel speeds before the fly-around, at which the wheels have the momentum h, all reduced by one
 * factor if one exceeds its limit; w_S: mean rate w_m of the target in servicer axes */
static inline vec3 wheel_bias(const MissionParameters *p, vec3 w_S)
{
    double square = dot(w_S, w_S), share = 1;
    if (p->budget == 0 || square == 0) return vec(0, 0, 0);
    vec3 h = scale(dot(w_S, mul(p->J_S, w_S)) / (2 * square), w_S);
    vec3 bias = solve(p->A_w, h);
    double most = p->bias_max * p->wheel_speed_max, size = largest_size(bias);
    if (size > most) share = most / size;
    return scale(share, bias);
}

/* wheel speeds with which body and wheels, at the servicer rate w_S, have the angular momentum that
 * they have with the speeds `bias` and the body at rest; each speed is limited to
 * bias_max * wheel_speed_max */
static inline vec3 wheels_with(const MissionParameters *p, vec3 bias, vec3 w_S)
{
    vec3 rest = sub(bias, solve(p->A_w, mul(p->J_S, w_S)));
    double most = p->bias_max * p->wheel_speed_max;
    return vec(clamp(rest.x, -most, most), clamp(rest.y, -most, most), clamp(rest.z, -most, most));
}

static inline double momentum_at_grasp(const MissionParameters *p, double mass, vec3 w_T_T)
{
    double reduced = mass > 0 ? mass * p->mass_T / (mass + p->mass_T) : 0;
    double J = larger(p->J_S.row[0].x, larger(p->J_S.row[1].y, p->J_S.row[2].z));
    return norm(mul(p->J_T, w_T_T)) + norm(w_T_T) * (J + reduced * p->L_3 * p->L_3);
}

/* velocity increment needed for turning with the target [m/s]: half a turn with steering at
 * range R, the final approach at its mean range, third hold and mating at L_3 */
static inline double increment_ahead(const MissionParameters *p, double tumble, double R,
                                     double steer)
{
    double final = 1.875 * (R - p->L_3) / p->v_final;
    double there = p->dwell[FINAL] + p->dwell[HOLD_3] + (p->L_3 - p->L_end) / p->v_mate;
    return tumble * tumble * (R * PI / steer + (R + p->L_3) / 2 * final + p->L_3 * there);
}

/* lower bound of the velocity increment that the remaining propellant gives [m/s]: the rocket
 * equation with log(1 + x), 1 + x = mass/(mass_dry + reserve), replaced by its lower bound
 * x/(1 + x) */
static inline double increment_left(const MissionParameters *p, double mass)
{
    return mass > 0 ? p->Isp * STANDARD_GRAVITY * (1 - (p->mass_dry + p->reserve) / mass) : 0;
}

static inline double verdict_on(const MissionParameters *p, const MissionInput *u, double tumble,
                                const Budget *b)
{
    double momentum = momentum_at_grasp(p, u->mass, u->T.omega);
    if (p->budget == 0) return CAN_CAPTURE;
    if (b->steer < p->steer_least) return NO_FORCE;
    if (p->momentum_max > 0 && momentum > p->momentum_max) return TOO_MUCH_MOMENTUM;
    if (b->dv > increment_left(p, u->mass)) return NO_PROPELLANT;
    return p->rate_probe > 0 && !p->by_arm && tumble > p->rate_probe ? ONLY_BY_ARM : CAN_CAPTURE;
}

static inline Budget budget_for(const MissionParameters *p, const MissionInput *u,
                                const Geometry *g)
{
    Budget b = {.R = range_around(p, u->mass, g->tumble)};
    b.steer = steering_left(p, u->mass, g->tumble, b.R);
    b.dv = b.steer > 0 ? increment_ahead(p, g->tumble, b.R, b.steer) : 0;
    b.bias = wheel_bias(p, g->w_mean_S);
    b.verdict = verdict_on(p, u, g->tumble, &b);
    return b;
}

#endif
