/* optimal_forecast.h - parameters, inputs and state of optimal_controller, and the motion that its
 * present plan will cause until the next plan is in force.
 *
 *   (21) rho += v s + f s^2/2,  v += f s,  f = F/m + d_hat + tide      over each second s
 *
 * rho, v: position and velocity of the servicer from the target; s: one second; F: force of the
 * plan (mode 0), the last feasible plan (1) or braking (2), and 0 before the first plan (3); m:
 * mass; d_hat: estimated acceleration that is not modelled; tide: gravity at the servicer minus
 * gravity at the target, to first order. Equations: docs/models.md N. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef OPTIMAL_FORECAST_H
#define OPTIMAL_FORECAST_H

#include "adaptive_attitude.h"
#include "body_rows.h"
#include "optimal_motion.h"
#include "time_grid.h"

/* samples in a second; longest time to compute the first plan to a goal [s] */
enum { SAMPLES = 10, MOST_SECONDS = 20 };
/* longest duration of a path [s]: 60 nodes of 20 s, for which four steps of the tumble suffice, as
 * the parameter tumble_step is at least 5 s */
#define LONGEST_DURATION 1200.0

enum { INACTIVE, TO_POINT, TO_AXIS, ALONG_AXIS, GOALS };
enum { PLAN, LAST_PLAN, BRAKE, FIRST_PLAN };

typedef struct {
    double mu;
    vec3 p_T;
    mat3 J_T;
    vec3 F_max;
    double duration[GOALS - 1], L_end[GOALS - 1];
    vec3 line;
    double keep_out[2], cone, cone_hold, hold_lead, slab[2], T_min;
    double speed_limit, v_0, v_slope;
    double iterations, iterations_first, kappa, k_d, tol[2], bad_max, age_max, K_b, P_b;
    double tumble_step, turn[GOALS - 1], omega_rest, relax_time, arrive_radius;
    double use_attitude, use_wheels, t_att;
    vec3 K_att, P_att;
    Eta eta_hat_0;
    double sample_period;
} OptimalParameters;
typedef struct {
    Body T, S;
    vec3 wheel_speed;
    Reference ref;
    double mass, goal, L_goal, T_goal;
} OptimalInput;
typedef struct {
    Grid grid;
    vec3 u[NODES];
} Plan; /* u: accelerations [m/s2] */
typedef struct {
    /* d_hat: estimated acceleration that is not modelled; rho, v: state at the start of this
     * second; F_sum: sum of the forces commanded at the samples since then; N axes */
    vec3 d_hat, rho, v, F_sum;
    double known; /* 1: rho, v and F_sum are set */
} Disturbance;
typedef struct {
    vec3 rho; /* place where braking began, axes of T if in_target, else H */
    double in_target;
} Hold;
typedef struct {
    Gains gains;
    double goal, L_goal, t_goal, sample, seconds, has_iterates, bad, has_plan, mode;
    Problem problem;
    Iterates it;
    Grid grid; /* time grid of the path that the iterations improve */
    Progress progress;
    double range; /* range at the start of the path that the solve computes [m] */
    Plan plan;
    Hold hold;
    Disturbance d;
} OptimalState;

/* range_of: range at which the goal (1, 2 or 3) is reached: the input L_goal if it is > 0, else the
 * parameter L_end; at least keep_out for goals 1 and 2. duration_of: time from the start of the
 * goal until it is reached: the input T_goal, up to LONGEST_DURATION, if it is > 0, else the
 * parameter duration. */
static inline double range_of(const OptimalParameters *p, const OptimalInput *u, int goal)
{
    double L = u->L_goal > 0 ? u->L_goal : p->L_end[goal - 1];
    return goal == ALONG_AXIS ? L : larger(L, p->keep_out[goal - 1]);
}
static inline double duration_of(const OptimalParameters *p, const OptimalInput *u, int goal)
{
    return u->T_goal > 0 ? smaller(u->T_goal, LONGEST_DURATION) : p->duration[goal - 1];
}

static inline double second_of(const OptimalParameters *p) { return SAMPLES * p->sample_period; }

/* ---- states predicted over the coming seconds, (21) ---- */
typedef struct {
    vec3 rho, v;
    Tumble tumble;
    double t, after; /* t: time; after: seconds since the sample of the inputs */
} Carried;

static inline Carried carried_now(const OptimalInput *u, double t)
{
    return (Carried){
        sub(u->S.r, u->T.r), sub(u->S.v, u->T.v), {canonical(u->T.q), u->T.omega}, t, 0};
}

static inline OrbitNow orbit_of(const OptimalParameters *p, const OptimalInput *u)
{
    return orbit_now(p->mu, u->T.r, u->T.v);
}
static inline Inertia inertia_of(const OptimalParameters *p)
{
    return (Inertia){p->J_T, inverted(p->J_T)};
}

static inline mat3 hold_axes(const Hold *hold, const OrbitNow *o, const Carried *s)
{
    return hold->in_target ? dcm_of_quat(s->tumble.q) : hill_axes(o, s->after);
}

/* mode 2: acceleration, N axes, that brings the servicer to rest in axes of T or H, at the place
 * where braking began */
static inline vec3 braking(const OptimalParameters *p, const OptimalState *x, const OrbitNow *o,
                           const Carried *s)
{
    mat3 C = hold_axes(&x->hold, o, s);
    vec3 w = scale(o->rate, o->e_n), dw = vec(0, 0, 0), place = tmul(C, x->hold.rho);
    if (x->hold.in_target) {
        Inertia i = inertia_of(p);
        w = tmul(C, s->tumble.w);
        dw = tmul(C, free_rate_change(&i, s->tumble.w));
    }
    vec3 turned = add(cross(dw, place), cross(w, cross(w, place)));
    vec3 known = add(tide(o, s->after, s->rho), x->d.d_hat);
    vec3 error = scale(p->K_b, sub(s->rho, place));
    return sub(turned, sum3(known, error, scale(p->P_b, sub(s->v, cross(w, place)))));
}

/* acceleration by the force of the present mode, N axes, not yet limited to F_max */
static inline vec3 acceleration(const OptimalParameters *p, const OptimalState *x,
                                const OrbitNow *o, const Carried *s)
{
    if (x->mode == FIRST_PLAN) return vec(0, 0, 0);
    if (x->mode == BRAKE) return braking(p, x, o, s);
    double nodes = (s->t - x->plan.grid.t) / x->plan.grid.dt + 1e-9;
    return x->plan.u[index_within(nodes, NODES - 1)];
}

/* (21): propagates position, velocity and tumble of `s` over the seconds until the next plan
 * begins */
static inline void carry(const OptimalParameters *p, const OptimalState *x, const OrbitNow *o,
                         int seconds, Carried *s)
{
    Inertia i = inertia_of(p);
    double h = second_of(p);
    for (int j = 0; j < MOST_SECONDS; j++) {
        if (j == seconds) break;
        vec3 f = sum3(acceleration(p, x, o, s), x->d.d_hat, tide(o, s->after, s->rho));
        s->rho = sum3(s->rho, scale(h, s->v), scale(h * h / 2, f));
        s->v = add(s->v, scale(h, f));
        tumble_on(&i, h, &s->tumble);
        s->t += h;
        s->after += h;
    }
}

#endif
