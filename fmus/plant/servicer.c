/* servicer.c - servicer spacecraft: orbit, attitude, three momentum wheels, propellant.
 *
 *   dr/dt     = v
 *   dv/dt     = -mu r/r^3 + a_J2 + a_dist + C_SN^T (F_S + F_contact_S) / m,   dm/dt = -mdot
 *   dsigma/dt = 1/4 G(sigma) omega
 *   J_S domega/dt = -omega x (J_S omega + A_w Omega) - A_w dOmega/dt + M_S + M_contact_S + M_gg
 *                   + M_dist
 *   dOmega/dt = commanded wheel acceleration, within the limits
 *
 * sigma: modified Rodrigues parameters of the attitude; F_S, M_S: force and torque of the
 * actuators; J_S: inertia of the whole servicer with wheels locked; A_w: inertia matrix of the
 * wheels; Omega: wheel speeds relative to the body; the angular momentum is J_S omega + A_w Omega;
 * M_gg, M_dist: torques of gravity gradient and disturbance; a_dist: disturbance acceleration.
 * The force is constant in body axes: thrusters turn with the body. Before the time t_att the
 * attitude is frozen: sigma has its start value, the published rate is zero, the wheels do not
 * accelerate. With the switch velocity_follows_attitude the velocity turns with the body although
 * no force acts: dv/dt += omega x v, so that d(C_SN v)/dt = F_S / m, the kinematics of Kozlova &
 * Fomichev 2023 (docs/models.md B.2). Source: Zhu & Yang 2009, equations (9), (15), (17). Classical
 * Runge-Kutta on the grid k * max_step. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "rk4.h"
#include "servicer_base.h"

typedef struct { BaseParameters base; } Parameters;
typedef struct { BaseInput base; } Input;
typedef struct { BaseState base; } State;
typedef struct { BaseOutput base; } Output;
MODEL_STRUCT;

static const Model start = {.p = {.base = BASE_START}};

static const Variable variables[] = {
    BASE_PARAMETERS,
    BASE_INPUTS,
    BASE_OUTPUTS,
};

static void check(const Parameters *p, Problems *problems) { check_rigid_base(problems, &p->base); }

static void derivative(const Interval *c, double t, const State *x, State *dx)
{
    dx->base = rigid_rates(c, t, &x->base);
}

RK4(integrate, derivative, Interval, State)

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    (void)u;
    x->base = base_at_start(&p->base);
    publish_base(&p->base, &x->base, &y->base, t);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    const BaseParameters *base = &p->base;
    for (Substep s = first_substep(t, h, base->max_step); s.h > 0; s = next_substep(s)) {
        const Interval constant = interval(base, &u->base, &x->base, &s);
        integrate(&constant, s.t, s.h, x);
        x->base.sigma = mrp_inside(x->base.sigma);
        /* ends the step, which fails: the FMI adapter rejects a negative output rate_margin */
        if (rate_margin(base, &x->base, s.t + s.h) < 0) break;
    }
    publish_base(base, &x->base, &y->base, t + h);
}

FMU_MODEL(
    "servicer",
    "Servicer spacecraft: orbit with J2, attitude with momentum wheels, propellant consumption");
