/* target.c - tumbling, non-cooperative target: orbit and attitude of one rigid body.
 *
 *   dr/dt     = v
 *   dv/dt     = -mu r/r^3 + a_J2 + a_dist + a_manoeuvre + C_TN^T F_T / mass
 *   dsigma/dt = 1/4 G(sigma) omega
 *   J_T domega/dt = -omega x (J_T omega) + M_gg + M_dist + M_T,    M_gg = 3 mu/r^3 rb x (J_T rb)
 *
 * rb: unit vector from the planet, body axes. Source: Zhu & Yang 2009, equations (2) and (4), with
 * J2. Classical Runge-Kutta on the grid k * max_step; after each internal step sigma (modified
 * Rodrigues parameters) is replaced by its shadow set where |sigma| > 1. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "disturbance.h"
#include "orbit_rows.h"
#include "rigid_body.h"
#include "rk4.h"

typedef struct {
    Orbit orbit;
    vec3 r_0_N, v_0_N;
    double mass;
    mat3 J_T;
    vec3 sigma_TN_0, omega_TN_T_0;
    double use_J2, use_gravity_gradient;
    Sinusoid M_dist_T, a_dist, a_manoeuvre_N;
    double a_dist_axes, max_step;
} Parameters;
typedef struct { vec3 F_T, M_T; } Input;
typedef struct { vec3 r, v, sigma, omega; } State;
typedef struct {
    vec3 r_TN_N, v_TN_N;
    quat q_TN;
    vec3 omega_TN_T, sigma_TN, M_gg_T;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.orbit = START_ORBIT,
          .mass = 100,
          .J_T = {{{100, 0, 0}, {0, 150, 0}, {0, 0, 90}}},
          .sigma_TN_0 = {-0.02, 0.015, -0.25},
          .omega_TN_T_0 = {0.002, 0.01, 0},
          .use_J2 = 1,
          .use_gravity_gradient = 1,
          .max_step = 0.1},
};

static const Variable variables[] = {
    ORBIT_ROWS(orbit),
    PARAMETER(r_0_N, "m", "start position, N axes; used if parameter a = 0"),
    PARAMETER(v_0_N, "m/s", "start velocity, N axes; used if parameter a = 0"),
    POSITIVE(mass, "kg", "mass, needed for contact forces only"),
    MATRIX(J_T, "kg.m2", "inertia about the centre of mass, body axes"),
    PARAMETER(sigma_TN_0, "1", "start attitude relative to N, modified Rodrigues parameters"),
    PARAMETER(omega_TN_T_0, "rad/s", "start angular velocity relative to N, body axes"),
    SWITCH(use_J2, "1: oblateness of the planet acts on the orbit"),
    SWITCH(use_gravity_gradient, "1: gravity gradient acts on the attitude"),
    SINUSOID_ROWS(M_dist_T, "N.m", "disturbance torque, body axes"),
    SINUSOID_ROWS(a_dist, "m/s2", "disturbance acceleration in the axes given by a_dist_axes"),
    SINUSOID_ROWS(a_manoeuvre_N, "m/s2",
                  "acceleration of a manoeuvre unknown to the servicer, N axes"),
    SWITCH(a_dist_axes, "axes of a_dist: 0 = N, 1 = Hill frame of the target's orbit"),
    GRID(max_step, "internal integration step"),

    INPUT(F_T, "N", "contact or servicing force, body axes"),
    INPUT(M_T, "N.m", "contact or servicing torque about the centre of mass, body axes"),

    OUTPUT(r_TN_N, "m", "position of the target, N axes"),
    OUTPUT(v_TN_N, "m/s", "velocity of the target, N axes"),
    OUTPUT(q_TN, "1", "attitude of the target relative to N, scalar first"),
    OUTPUT(omega_TN_T, "rad/s", "angular velocity of the target relative to N, body axes"),
    OUTPUT(sigma_TN, "1",
           "attitude of the target relative to N, modified Rodrigues parameters inside the unit "
           "sphere"),
    OUTPUT(M_gg_T, "N.m", "gravity-gradient torque, body axes"),
};

static void check(const Parameters *p, Problems *problems)
{
    check_orbit(problems, &p->orbit, p->r_0_N);
    check_inertia(problems, "J_T", p->J_T);
}

static vec3 gravity_gradient_T(const Parameters *p, mat3 C_TN, vec3 r)
{
    return p->use_gravity_gradient ? gravity_gradient(p->orbit.mu, mul(C_TN, r), p->J_T)
                                   : vec(0, 0, 0);
}

typedef struct {
    const Parameters *p;
    const Input *u;
    double step_start; /* start time of the internal step [s] */
} Context;

/* (2), (4) */
static void derivative(const Context *c, double t, const State *x, State *dx)
{
    const Parameters *p = c->p;
    mat3 C_TN = dcm_of_mrp(x->sigma);
    vec3 contact = scale(1 / p->mass, tmul(C_TN, c->u->F_T));
    vec3 torque = sum3(gravity_gradient_T(p, C_TN, x->r), sinusoid(&p->M_dist_T, c->step_start, t),
                       c->u->M_T);

    dx->r = x->v;
    dx->v =
        sum4(gravity(&p->orbit, p->use_J2, x->r),
             disturbance_N(&p->a_dist, p->a_dist_axes, p->orbit.mu, &x->r, &x->v, c->step_start, t),
             sinusoid(&p->a_manoeuvre_N, c->step_start, t), contact);
    dx->sigma = mrp_rate(x->sigma, x->omega);
    dx->omega = solve(p->J_T, sub(torque, cross(x->omega, mul(p->J_T, x->omega))));
}

RK4(integrate, derivative, Context, State)

static void publish(const Parameters *p, const State *x, Output *y)
{
    y->r_TN_N = x->r;
    y->v_TN_N = x->v;
    y->q_TN = quat_of_mrp(x->sigma);
    y->omega_TN_T = x->omega;
    y->sigma_TN = x->sigma;
    y->M_gg_T = gravity_gradient_T(p, dcm_of_mrp(x->sigma), x->r);
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    PosVel s = p->orbit.a > 0 ? posvel_of_elements(&p->orbit) : (PosVel){p->r_0_N, p->v_0_N};
    (void)u, (void)t;
    *x = (State){s.r, s.v, mrp_inside(p->sigma_TN_0), p->omega_TN_T_0};
    publish(p, x, y);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Substep s = first_substep(t, h, p->max_step); s.h > 0; s = next_substep(s)) {
        const Context context = {p, u, s.t};
        integrate(&context, s.t, s.h, x);
        x->sigma = mrp_inside(x->sigma);
    }
    publish(p, x, y);
}

FMU_MODEL("target", "Tumbling non-cooperative target: orbit with J2, attitude with gravity "
                    "gradient and disturbances");
