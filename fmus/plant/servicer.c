/* servicer.c - servicer spacecraft: orbit, attitude, three momentum wheels, propellant.
 *
 *   dr/dt     = v
 *   dv/dt     = -mu r/r^3 + a_J2 + a_dist + C_SN^T F_S / m,        dm/dt = -mdot
 *   dsigma/dt = 1/4 G(sigma) omega
 *   J_S domega/dt = -omega x (J_S omega + A_w Omega) - A_w dOmega/dt + M_S + M_gg + M_dist
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
#include "disturbance.h"
#include "orbit_rows.h"
#include "rigid_body.h"
#include "rk4.h"

typedef struct {
    Orbit orbit;
    vec3 r_0_N, v_0_N, rho_0_H, drho_0_H;
    double mass_0;
    mat3 J_S, A_w;
    vec3 sigma_SN_0, omega_SN_S_0, wheel_speed_0;
    double t_att, use_J2, use_gravity_gradient, wheel_accel_max, wheel_speed_max;
    Sinusoid M_dist_S, a_dist;
    double a_dist_axes, velocity_follows_attitude, max_step;
} Parameters;
typedef struct {
    vec3 F_S, M_S;
    double mdot;
    vec3 wheel_accel_cmd;
} Input;
typedef struct {
    vec3 r, v, sigma, omega, wheel_speed;
    double mass;
} State;
typedef struct {
    vec3 r_SN_N, v_SN_N;
    quat q_SN;
    vec3 omega_SN_S, sigma_SN, wheel_speed;
    double mass;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.orbit = {EARTH, .a = 7158140, .e = 0.01, .inc = 0.5235987755982988,
                    .argp = 1.0471975511965976, .raan = 2.0943951023931953,
                    .nu = 0.5235987755982988},
          .rho_0_H = {0, 20, 0},
          .mass_0 = 100,
          .J_S = {{{200, 0, 0}, {0, 250, 0}, {0, 0, 150}}},
          .A_w = {{{12, 0, 0}, {0, 15, 0}, {0, 0, 10}}},
          .use_J2 = 1,
          .max_step = 0.1},
};

static const Variable variables[] = {
    ORBIT_ROWS,
    PARAMETER(r_0_N, "m", "start position in N axes, used when a = 0"),
    PARAMETER(v_0_N, "m/s", "start velocity in N axes, used when a = 0"),
    PARAMETER(rho_0_H, "m", "start position relative to the target, Hill axes, used when a > 0"),
    PARAMETER(drho_0_H, "m/s",
              "start velocity relative to the target as seen in the Hill frame, used when a > 0"),
    POSITIVE(mass_0, "kg", "start mass"),
    MATRIX(J_S, "kg.m2",
           "inertia of the whole servicer about its centre of mass, wheels locked, body axes"),
    MATRIX(A_w, "kg.m2", "wheel inertia matrix: wheel speeds to wheel momentum in body axes"),
    PARAMETER(sigma_SN_0, "1", "start attitude relative to N, modified Rodrigues parameters"),
    PARAMETER(omega_SN_S_0, "rad/s",
              "angular velocity relative to N when the attitude is released, body axes"),
    PARAMETER(wheel_speed_0, "rad/s",
              "wheel speeds relative to the body when the attitude is released"),
    PARAMETER(t_att, "s", "the attitude is frozen before this time"),
    SWITCH(use_J2, "1: oblateness of the planet acts on the orbit"),
    SWITCH(use_gravity_gradient, "1: gravity gradient acts on the attitude"),
    NONNEGATIVE(wheel_accel_max, "rad/s2", "largest wheel acceleration, per wheel; 0 = no limit"),
    NONNEGATIVE(wheel_speed_max, "rad/s", "largest wheel speed, per wheel; 0 = no limit"),
    SINUSOID_ROWS(M_dist_S, "N.m", "disturbance torque, body axes"),
    SINUSOID_ROWS(a_dist, "m/s2", "disturbance acceleration, axes by a_dist_axes"),
    SWITCH(a_dist_axes, "axes of a_dist: 0 = N, 1 = Hill frame of the own orbit"),
    SWITCH(velocity_follows_attitude,
           "1: the velocity turns with the body; unphysical, only to reproduce Kozlova & Fomichev"),
    POSITIVE(max_step, "s", "internal integration step"),

    INPUT(F_S, "N", "force of the actuators, body axes"),
    INPUT(M_S, "N.m", "torque of the actuators about the centre of mass, body axes"),
    NONNEGATIVE_INPUT(mdot, "kg/s", "propellant consumption"),
    INPUT(wheel_accel_cmd, "rad/s2", "commanded wheel acceleration relative to the body"),

    OUTPUT(r_SN_N, "m", "position of the servicer, N axes"),
    OUTPUT(v_SN_N, "m/s", "velocity of the servicer, N axes"),
    OUTPUT(q_SN, "1", "attitude of the servicer relative to N, scalar first"),
    OUTPUT(omega_SN_S, "rad/s", "angular velocity of the servicer relative to N, body axes"),
    OUTPUT(sigma_SN, "1",
           "attitude of the servicer relative to N, modified Rodrigues parameters inside the unit "
           "sphere"),
    OUTPUT(wheel_speed, "rad/s", "wheel speeds relative to the body"),
    NONNEGATIVE_OUTPUT(mass, "kg", "mass with the propellant left"),
};

static void check(const Parameters *p, Problems *problems)
{
    check_orbit(problems, &p->orbit, p->r_0_N);
    check_inertia(problems, "J_S", p->J_S);
    check_positive_definite(problems, "A_w", p->A_w);
    mat3 A = p->A_w, J = p->J_S; /* the body without the wheels must have inertia of its own */
    check_positive_definite(
        problems, "J_S - A_w",
        rows(sub(J.row[0], A.row[0]), sub(J.row[1], A.row[1]), sub(J.row[2], A.row[2])));
}

typedef struct {
    const Parameters *p;
    const Input *u;
    vec3 wheel_accel;
    double since; /* start of the internal step */
    int released;
} Context;

/* velocity_follows_attitude: what keeps C_SN v constant while the body turns */
static vec3 velocity_turning_N(const Context *c, const State *x)
{
    if (!c->p->velocity_follows_attitude || !c->released) return vec(0, 0, 0);
    return cross(tmul(dcm_of_mrp(x->sigma), x->omega), x->v);
}

/* (15), (17) */
static void attitude_derivative(const Context *c, double t, const State *x, State *dx)
{
    const Parameters *p = c->p;
    vec3 momentum = add(mul(p->J_S, x->omega), mul(p->A_w, x->wheel_speed));
    vec3 torque = add(c->u->M_S, sinusoid(&p->M_dist_S, c->since, t));
    if (p->use_gravity_gradient)
        torque =
            add(torque, gravity_gradient(p->orbit.mu, mul(dcm_of_mrp(x->sigma), x->r), p->J_S));

    dx->sigma = mrp_rate(x->sigma, x->omega);
    dx->omega =
        solve(p->J_S, sub(sub(torque, cross(x->omega, momentum)), mul(p->A_w, c->wheel_accel)));
    dx->wheel_speed = c->wheel_accel;
}

static void derivative(const Context *c, double t, const State *x, State *dx)
{
    const Parameters *p = c->p;
    vec3 thrust = scale(1 / x->mass, tmul(dcm_of_mrp(x->sigma), c->u->F_S));
    vec3 free_fall =
        add(gravity(&p->orbit, p->use_J2, x->r),
            disturbance_N(&p->a_dist, p->a_dist_axes, p->orbit.mu, &x->r, &x->v, c->since, t));
    *dx = (State){
        .r = x->v, .v = sum3(free_fall, thrust, velocity_turning_N(c, x)), .mass = -c->u->mdot};
    if (c->released) attitude_derivative(c, t, x, dx);
}

RK4(integrate, derivative, Context, State)

/* acceleration of one wheel over an internal step, within the limits of acceleration and speed */
static double wheel_accel(const Parameters *p, double command, double speed, double h)
{
    double accel = limited(command, p->wheel_accel_max), top = p->wheel_speed_max;
    return top > 0 ? clamp(accel, smaller(0, (-top - speed) / h), larger(0, (top - speed) / h))
                   : accel;
}

static vec3 wheel_accels(const Parameters *p, vec3 command, vec3 speed, double h)
{
    return vec(wheel_accel(p, command.x, speed.x, h), wheel_accel(p, command.y, speed.y, h),
               wheel_accel(p, command.z, speed.z, h));
}

static void publish(const Parameters *p, const State *x, Output *y, double t)
{
    int released = reached(t, p->t_att);
    y->r_SN_N = x->r;
    y->v_SN_N = x->v;
    y->q_SN = quat_of_mrp(x->sigma);
    y->omega_SN_S = released ? x->omega : vec(0, 0, 0);
    y->sigma_SN = x->sigma;
    y->wheel_speed = released ? x->wheel_speed : vec(0, 0, 0);
    y->mass = x->mass;
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    PosVel s = p->orbit.a > 0 ? posvel_beside(&p->orbit, p->rho_0_H, p->drho_0_H)
                              : (PosVel){p->r_0_N, p->v_0_N};
    (void)u;
    *x = (State){s.r, s.v, mrp_inside(p->sigma_SN_0), p->omega_SN_S_0, p->wheel_speed_0, p->mass_0};
    publish(p, x, y, t);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Substep s = first_substep(t, h, p->max_step); s.h > 0; s = next_substep(s)) {
        const Context context = {p, u, wheel_accels(p, u->wheel_accel_cmd, x->wheel_speed, s.h),
                                 s.t, reached(s.t, p->t_att)};
        integrate(&context, s.t, s.h, x);
        x->sigma = mrp_inside(x->sigma);
    }
    publish(p, x, y, t + h);
}

FMU_MODEL(
    "servicer",
    "Servicer spacecraft: orbit with J2, attitude with momentum wheels, propellant consumption");
