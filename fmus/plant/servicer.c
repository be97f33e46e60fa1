/* servicer.c - servicer spacecraft: orbit, attitude, three momentum wheels, propellant.
 *
 *   dr/dt     = v
 *   dv/dt     = -mu r/r^3 + a_J2 + a_dist + C_SN^T (F_S + F_contact_S) / m,   dm/dt = -mdot
 *   dsigma/dt = 1/4 G(sigma) omega
 *   J_S domega/dt = -omega x (J_S omega + A_w Omega) - A_w dOmega/dt + M_S + M_contact_S + M_gg
 *                   + M_dist
 *   dOmega/dt = commanded wheel acceleration, within the limits
 *
 * J_S: whole servicer with wheels locked; Omega: wheel speeds relative to the body; the momentum is
 * J_S omega + A_w Omega. The force stays in body axes: thrusters turn with the body. Before t_att
 * the attitude is frozen: sigma holds its start value, the published rate is zero, wheels stand
 * still. With velocity_follows_attitude the velocity turns with the body for free (no force does
 * that): dv/dt += omega x v, so that d(C_SN v)/dt = F_S / m, the kinematics of Kozlova & Fomichev
 * 2023 (docs/models.md B.2).
 * Source: Zhu & Yang 2009, equations (9), (15), (17). Classical Runge-Kutta on the grid k *
 * max_step. */
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

static void check(const Parameters *p, Problems *problems) { check_base(problems, &p->base); }

typedef struct {
    const BaseParameters *p;
    const BaseInput *u;
    vec3 wheel_accel;
    double since; /* start of the internal step */
    int released;
} Context;

/* (15), (17) */
static void attitude_derivative(const Context *c, double t, const BaseState *x, BaseState *dx)
{
    const BaseParameters *p = c->p;
    vec3 momentum = add(mul(p->J_S, x->omega), mul(p->A_w, x->wheel_speed));
    vec3 torque = add(torque_S(c->u), sinusoid(&p->M_dist_S, c->since, t));
    if (p->use_gravity_gradient)
        torque =
            add(torque, gravity_gradient(p->orbit.mu, mul(dcm_of_mrp(x->sigma), x->r), p->J_S));

    dx->sigma = mrp_rate(x->sigma, x->omega);
    dx->omega =
        solve(p->J_S, sub(sub(torque, cross(x->omega, momentum)), mul(p->A_w, c->wheel_accel)));
    dx->wheel_speed = c->wheel_accel;
}

static void derivative(const Context *c, double t, const State *state, State *rate)
{
    const BaseState *x = &state->base;
    vec3 thrust = scale(1 / x->mass, tmul(dcm_of_mrp(x->sigma), force_S(c->u)));
    vec3 free_fall = free_fall_N(c->p, &x->r, &x->v, c->since, t);
    vec3 turning = velocity_turning_N(c->p, c->released, x, x->v);
    *rate = (State){{.r = x->v, .v = sum3(free_fall, thrust, turning), .mass = -c->u->mdot}};
    if (c->released) attitude_derivative(c, t, x, &rate->base);
}

RK4(integrate, derivative, Context, State)

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
        vec3 wheels = wheel_accels(base, u->base.wheel_accel_cmd, x->base.wheel_speed, s.h);
        const Context context = {base, &u->base, wheels, s.t, reached(s.t, base->t_att)};
        integrate(&context, s.t, s.h, x);
        x->base.sigma = mrp_inside(x->base.sigma);
    }
    publish_base(base, &x->base, &y->base, t + h);
}

FMU_MODEL(
    "servicer",
    "Servicer spacecraft: orbit with J2, attitude with momentum wheels, propellant consumption");
