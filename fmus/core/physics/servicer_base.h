/* servicer_base.h - base body of every plant of the servicer: parameters, ports, state, gravity and
 * disturbances, wheels within their limits, attitude frozen before t_att.
 *
 * Sensors, thrusters and wheels are fixed to the base body, so these parameters and ports have the
 * same meaning in every plant. Equations: docs/models.md A.3. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SERVICER_BASE_H
#define SERVICER_BASE_H

#include "disturbance.h"
#include "orbit_rows.h"
#include "rigid_body.h"
#include "time_grid.h"

typedef struct {
    Orbit orbit;
    vec3 r_0_N, v_0_N, rho_0_H, drho_0_H;
    double mass_0;
    mat3 J_S, A_w;
    vec3 sigma_SN_0, omega_SN_S_0, wheel_speed_0;
    double t_att, use_J2, use_gravity_gradient, wheel_accel_max, wheel_speed_max;
    Sinusoid M_dist_S, a_dist;
    double a_dist_axes, velocity_follows_attitude, max_step;
} BaseParameters;
typedef struct {
    vec3 F_S, M_S;
    double mdot;
    vec3 wheel_accel_cmd, F_contact_S, M_contact_S;
} BaseInput;
typedef struct {
    vec3 r, v, sigma, omega, wheel_speed;
    double mass;
} BaseState;
typedef struct {
    vec3 r_SN_N, v_SN_N;
    quat q_SN;
    vec3 omega_SN_S, sigma_SN, wheel_speed;
    double mass, rate_margin;
} BaseOutput;

/* ---- rows of the interface; every servicer plant has these structs as members `base` ---- */
#define BASE_START                                     \
    {.orbit = START_ORBIT,                             \
     .rho_0_H = {0, 20, 0},                            \
     .mass_0 = 100,                                    \
     .J_S = {{{200, 0, 0}, {0, 250, 0}, {0, 0, 150}}}, \
     .A_w = {{{12, 0, 0}, {0, 15, 0}, {0, 0, 10}}},    \
     .use_J2 = 1,                                      \
     .max_step = 0.1}

#define BASE_SWITCH(member, text) \
    ROW_AS(PARAMETER_ROW, p, #member, base.member, 1, "1", text, SWITCH_VALUE)
#define BASE_MATRIX(member, text) \
    ROW_AS(PARAMETER_ROW, p, #member, base.member, 3, "kg.m2", text, ANY_VALUE)
#define BASE_PARAMETERS                                                                            \
    ORBIT_ROWS(base.orbit),                                                                        \
        PARAMETER_AS("r_0_N", base.r_0_N, "m", "start position, N axes; used if parameter a = 0"), \
        PARAMETER_AS("v_0_N", base.v_0_N, "m/s",                                                   \
                     "start velocity, N axes; used if parameter a = 0"),                           \
        PARAMETER_AS("rho_0_H", base.rho_0_H, "m",                                                 \
                     "start position relative to the target, Hill axes; used if parameter a > 0"), \
        PARAMETER_AS("drho_0_H", base.drho_0_H, "m/s",                                             \
                     "start velocity relative to the target as seen in the Hill frame; used if "   \
                     "parameter a > 0"),                                                           \
        POSITIVE_AS("mass_0", base.mass_0, "kg",                                                   \
                    "start mass, including propellant and panels, without an arm"),                \
        BASE_MATRIX(J_S, "inertia of the servicer without an arm about S, undeformed, wheels "     \
                         "locked, body axes"),                                                     \
        BASE_MATRIX(A_w, "matrix from wheel speeds to wheel momentum in body axes"),               \
        PARAMETER_AS("sigma_SN_0", base.sigma_SN_0, "1",                                           \
                     "start attitude relative to N, modified Rodrigues parameters"),               \
        PARAMETER_AS("omega_SN_S_0", base.omega_SN_S_0, "rad/s",                                   \
                     "start angular velocity relative to N (at t_att), body axes"),                \
        PARAMETER_AS("wheel_speed_0", base.wheel_speed_0, "rad/s",                                 \
                     "start wheel speeds relative to the body (at t_att)"),                        \
        PARAMETER_AS("t_att", base.t_att, "s",                                                     \
                     "the attitude relative to N is frozen before this time"),                     \
        BASE_SWITCH(use_J2, "1: oblateness of the planet acts on the orbit"),                      \
        BASE_SWITCH(use_gravity_gradient, "1: gravity gradient acts on the attitude"),             \
        NONNEGATIVE_AS("wheel_accel_max", base.wheel_accel_max, "rad/s2",                          \
                       "largest wheel acceleration, per wheel; 0 = no limit"),                     \
        NONNEGATIVE_AS("wheel_speed_max", base.wheel_speed_max, "rad/s",                           \
                       "largest wheel speed, per wheel; 0 = no limit"),                            \
        SINUSOID_ROWS_AS("M_dist_S", base.M_dist_S, "N.m", "disturbance torque, body axes"),       \
        SINUSOID_ROWS_AS("a_dist", base.a_dist, "m/s2",                                            \
                         "disturbance acceleration in the axes given by a_dist_axes"),             \
        BASE_SWITCH(a_dist_axes, "axes of a_dist: 0 = N, 1 = Hill frame of the own orbit"),        \
        BASE_SWITCH(velocity_follows_attitude,                                                     \
                    "1: the velocity turns with the body; unphysical, only to reproduce Kozlova "  \
                    "& Fomichev"),                                                                 \
        GRID_AS("max_step", base.max_step, "internal integration step")

#define BASE_INPUT(member, unit, text, rule) \
    ROW_AS(INPUT_ROW, u, #member, base.member, 1, unit, text, rule)
#define BASE_INPUTS                                                                                \
    BASE_INPUT(F_S, "N", "force of the actuators at S, body axes", ANY_VALUE),                     \
        BASE_INPUT(M_S, "N.m", "torque of the actuators about S, body axes", ANY_VALUE),           \
        BASE_INPUT(mdot, "kg/s", "propellant consumption", NONNEGATIVE_VALUE),                     \
        BASE_INPUT(wheel_accel_cmd, "rad/s2", "commanded wheel acceleration relative to the body", \
                   ANY_VALUE),                                                                     \
        OPTIONAL_INPUT_AS("F_contact_S", base.F_contact_S, "N",                                    \
                          "force of contact or docking at S, body axes"),                          \
        OPTIONAL_INPUT_AS("M_contact_S", base.M_contact_S, "N.m",                                  \
                          "torque of contact or docking about S, body axes")

#define BASE_OUTPUT(member, unit, text, rule) \
    ROW_AS(OUTPUT_ROW, y, #member, base.member, 1, unit, text, rule)
#define BASE_OUTPUTS                                                                               \
    BASE_OUTPUT(                                                                                   \
        r_SN_N, "m",                                                                               \
        "position of the servicer, N axes; S: its centre of mass without an arm, undeformed",      \
        ANY_VALUE),                                                                                \
        BASE_OUTPUT(v_SN_N, "m/s", "velocity of the servicer, N axes", ANY_VALUE),                 \
        BASE_OUTPUT(q_SN, "1", "attitude of the servicer relative to N, scalar first", ANY_VALUE), \
        BASE_OUTPUT(omega_SN_S, "rad/s",                                                           \
                    "angular velocity of the servicer relative to N, body axes", ANY_VALUE),       \
        BASE_OUTPUT(sigma_SN, "1",                                                                 \
                    "attitude of the servicer relative to N, modified Rodrigues parameters "       \
                    "inside the unit sphere",                                                      \
                    ANY_VALUE),                                                                    \
        BASE_OUTPUT(wheel_speed, "rad/s", "wheel speeds relative to the body", ANY_VALUE),         \
        BASE_OUTPUT(mass, "kg", "total mass, including the remaining propellant",                  \
                    NONNEGATIVE_VALUE),                                                            \
        BASE_OUTPUT(rate_margin, "rad/s",                                                          \
                    "pi/max_step minus the angular rate of the body; below 0 the step fails: "     \
                    "the attitude is lost, max_step is too long",                                  \
                    NONNEGATIVE_VALUE)

static inline void check_base_body(Problems *problems, const BaseParameters *p)
{
    check_orbit(problems, &p->orbit, p->r_0_N);
    check_inertia(problems, "J_S", p->J_S);
    check_positive_definite(problems, "A_w", p->A_w);
}

/* checks the inertia of a servicer that is one rigid body: without the wheels it must be
 * positive definite */
static inline void check_rigid_base(Problems *problems, const BaseParameters *p)
{
    check_base_body(problems, p);
    check_positive_definite(problems, "J_S - A_w", minus(p->J_S, p->A_w));
}

/* ---- motion ---- */
/* force and torque of actuators and contact together, body axes; the torque is about S: the centre
 * of mass of a rigid servicer, of the base body (with an arm), of the undeformed servicer (with
 * flexible parts) */
static inline vec3 force_S(const BaseInput *u) { return add(u->F_S, u->F_contact_S); }
static inline vec3 torque_S(const BaseInput *u) { return add(u->M_S, u->M_contact_S); }

static inline BaseState base_at_start(const BaseParameters *p)
{
    PosVel s = p->orbit.a > 0 ? posvel_beside(&p->orbit, p->rho_0_H, p->drho_0_H)
                              : (PosVel){p->r_0_N, p->v_0_N};
    return (BaseState){s.r,      s.v, mrp_inside(p->sigma_SN_0), p->omega_SN_S_0, p->wheel_speed_0,
                       p->mass_0};
}

/* quantities that are constant over an internal step */
typedef struct {
    const BaseParameters *p;
    const BaseInput *u;
    vec3 wheel_accel;
    double step_start; /* start time of the internal step [s] */
    int released;
} Interval;

/* acceleration of a centre of mass by gravity and disturbance, N axes */
static inline vec3 free_fall_N(const BaseParameters *p, const vec3 *r, const vec3 *v,
                               double step_start, double t)
{
    return add(gravity(&p->orbit, p->use_J2, *r),
               disturbance_N(&p->a_dist, p->a_dist_axes, p->orbit.mu, r, v, step_start, t));
}

/* additional acceleration omega x v with velocity_follows_attitude, N axes: it turns the velocity v
 * of the centre of mass with the body, so that v in body axes stays constant */
static inline vec3 velocity_turning_N(const BaseParameters *p, int released, const BaseState *x,
                                      vec3 v)
{
    if (!p->velocity_follows_attitude || !released) return vec(0, 0, 0);
    return cross(tmul(dcm_of_mrp(x->sigma), x->omega), v);
}

/* acceleration of one wheel over an internal step of length h, within the limits of acceleration
 * and speed */
static inline double wheel_accel(const BaseParameters *p, double command, double speed, double h)
{
    double accel = limited(command, p->wheel_accel_max), limit = p->wheel_speed_max;
    return limit > 0
               ? clamp(accel, smaller(0, (-limit - speed) / h), larger(0, (limit - speed) / h))
               : accel;
}

static inline vec3 wheel_accels(const BaseParameters *p, vec3 command, vec3 speed, double h)
{
    return vec(wheel_accel(p, command.x, speed.x, h), wheel_accel(p, command.y, speed.y, h),
               wheel_accel(p, command.z, speed.z, h));
}

static inline Interval interval(const BaseParameters *p, const BaseInput *u, const BaseState *x,
                                const Substep *s)
{
    return (Interval){p, u, wheel_accels(p, u->wheel_accel_cmd, x->wheel_speed, s->h), s->t,
                      reached(s->t, p->t_att)};
}

/* ---- one rigid body with centre of mass S: (15), (17) of docs/models.md A.3 ---- */
static inline void attitude_rates(const Interval *c, double t, const BaseState *x, BaseState *dx)
{
    const BaseParameters *p = c->p;
    vec3 momentum = add(mul(p->J_S, x->omega), mul(p->A_w, x->wheel_speed));
    vec3 torque = add(torque_S(c->u), sinusoid(&p->M_dist_S, c->step_start, t));
    if (p->use_gravity_gradient)
        torque =
            add(torque, gravity_gradient(p->orbit.mu, mul(dcm_of_mrp(x->sigma), x->r), p->J_S));

    dx->sigma = mrp_rate(x->sigma, x->omega);
    dx->omega =
        solve(p->J_S, sub(sub(torque, cross(x->omega, momentum)), mul(p->A_w, c->wheel_accel)));
    dx->wheel_speed = c->wheel_accel;
}

static inline BaseState rigid_rates(const Interval *c, double t, const BaseState *x)
{
    vec3 thrust = scale(1 / x->mass, tmul(dcm_of_mrp(x->sigma), force_S(c->u)));
    vec3 free_fall = free_fall_N(c->p, &x->r, &x->v, c->step_start, t);
    vec3 turning = velocity_turning_N(c->p, c->released, x, x->v);
    BaseState dx = {.r = x->v, .v = sum3(free_fall, thrust, turning), .mass = -c->u->mdot};
    if (c->released) attitude_rates(c, t, x, &dx);
    return dx;
}

/* half a turn per max_step minus the rate of the body [rad/s]. Half a turn in an internal step
 * is beyond the stability limit of the integrator (2.8 rad): the attitude is lost, and the
 * states would become NaN. */
static inline double rate_margin(const BaseParameters *p, const BaseState *x, double t)
{
    return PI / p->max_step - (reached(t, p->t_att) ? norm(x->omega) : 0);
}

static inline void publish_base(const BaseParameters *p, const BaseState *x, BaseOutput *y,
                                double t)
{
    int released = reached(t, p->t_att);
    y->r_SN_N = x->r;
    y->v_SN_N = x->v;
    y->q_SN = quat_of_mrp(x->sigma);
    y->omega_SN_S = released ? x->omega : vec(0, 0, 0);
    y->sigma_SN = x->sigma;
    y->wheel_speed = released ? x->wheel_speed : vec(0, 0, 0);
    y->mass = x->mass;
    y->rate_margin = rate_margin(p, x, t);
}

#endif
