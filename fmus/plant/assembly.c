/* assembly.c - large docked assembly whose module swings: attitude on a circular orbit under
 * gravity gradient, drag and the torque of control moment gyros.
 *
 *   J_A omega_0' = tau_gg + tau_aero - J_A' omega_0 - h_m' - h_cmg' - omega_0 x H
 *   H = J_A omega_0 + h_m + h_cmg
 *   q_So' = q_So (x) [0, omega_0 - C_So omega_orb]/2
 *
 * Model, axes, attitude zero and J_A, h_m, tau: assembly.h; omega_0: angular velocity of the base,
 * omega_orb: of the orbital frame; h_cmg: momentum of the gyros; (x): product of quaternions. The
 * gyros are either an ideal device, h_cmg' = hdot_cmd_S in body axes, or the cluster of
 * cmg_cluster.h with gimbal rates gimbal_rate_cmd within their limit. Saturation: an internal step
 * of length dt brings the momentum h of the ideal device to h + h' dt, or to the nearest point of
 * the sphere |h| = H_sat; the torque on the structure follows from the momentum that the device has
 * absorbed, so that the total momentum is conserved. The cluster cannot leave its envelope.
 * Classical Runge-Kutta on the grid k * max_step. Source: docs/models.md E. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "assembly_rows.h"
#include "cmg_cluster.h"
#include "rk4.h"
#include "time_grid.h"

typedef struct {
    Assembly assembly;
    Swing swing;
    vec3 eps_0, omega_SH_S_0, h_0_S;
    double use_cluster, H_sat, h_w, gimbal_angle_0[GYROS], gimbal_rate_max;
    double use_gravity_gradient, use_aero, max_step;
} Parameters;
typedef struct {
    vec3 hdot_cmd_S;
    double gimbal_rate_cmd[GYROS];
} Input;
typedef struct {
    quat q; /* q_So */
    vec3 omega, h;
    double gimbal_angle[GYROS];
} State;
typedef struct {
    quat q_SH;
    vec3 omega_SN_S, omega_SH_S;
    quat q_SN;
    vec3 eps;
    double rotation;
    vec3 h_cmg_S;
    double h_cmg, momentum_share, saturated, gimbal_angle[GYROS], gimbal_rate[GYROS], singularity;
    Arm arm;
    vec3 M_gravity_S, M_aero_S, h_total_N;
    mat3 J_A;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.assembly = ASSEMBLY_START,
          .swing = SWING_START,
          .H_sat = 1500,
          .h_w = 350,
          .gimbal_angle_0 = GIMBALS_AT_START,
          .gimbal_rate_max = 0.1,
          .use_gravity_gradient = 1,
          .use_aero = 1,
          .max_step = 0.5},
};

static const Variable variables[] = {
    ASSEMBLY_ROWS(assembly),
    SWING_ROWS(swing),
    PARAMETER(
        eps_0, "1",
        "attitude at the start relative to the flight attitude (see q_SH), vector part of the "
        "quaternion"),
    PARAMETER(omega_SH_S_0, "rad/s", "angular velocity relative to H at the start, body axes"),
    PARAMETER(h_0_S, "N.m.s", "momentum of the ideal device at the start, body axes"),
    SWITCH(use_cluster, "1: cluster of six gyros, driven by gimbal_rate_cmd; 0: ideal device, "
                        "driven by hdot_cmd_S"),
    POSITIVE(H_sat, "N.m.s", "largest momentum of the ideal device"),
    POSITIVE(h_w, "N.m.s", "momentum of the wheel of one gyro"),
    PARAMETER(gimbal_angle_0, "rad",
              "gimbal angles at the start; gimbal axes: z, then five at atan(2) from z, azimuths "
              "0, 72 .. 288 deg"),
    POSITIVE(gimbal_rate_max, "rad/s", "largest gimbal rate"),
    SWITCH(use_gravity_gradient, "1: gravity gradient acts"),
    SWITCH(use_aero, "1: drag acts on the surfaces"),
    GRID(max_step, "internal integration step"),

    INPUT(hdot_cmd_S, "N.m",
          "commanded rate of change of h_cmg_S, body axes; used if use_cluster = 0"),
    INPUT(gimbal_rate_cmd, "rad/s", "commanded gimbal rates; used if use_cluster = 1"),

    OUTPUT(q_SH, "1",
           "attitude of the base relative to H, scalar first; (1,-1,-1,1)/2 is the flight "
           "attitude"),
    OUTPUT(omega_SN_S, "rad/s", "angular velocity of the base relative to N, body axes"),
    OUTPUT(omega_SH_S, "rad/s", "angular velocity of the base relative to H, body axes"),
    OUTPUT(q_SN, "1", "attitude of the base relative to N, which is H at t = 0, scalar first"),
    OUTPUT(eps, "1", "attitude relative to the flight attitude, vector part of the quaternion"),
    ANGLE_OUTPUT(rotation,
                 "angle between the attitude of the base and the flight attitude, see q_SH"),
    OUTPUT(h_cmg_S, "N.m.s", "momentum of the gyros, body axes"),
    NONNEGATIVE_OUTPUT(h_cmg, "N.m.s", "magnitude of the momentum of the gyros"),
    NONNEGATIVE_OUTPUT(
        momentum_share, "1",
        "momentum of the gyros divided by the largest possible one in its direction"),
    ALARM(saturated,
          "1: gyros saturated: commanded momentum beyond H_sat, or cluster above 0.98 of its "
          "envelope"),
    OUTPUT(gimbal_angle, "rad",
           "gimbal angles; spin axes at angle 0: x, then in the xy plane at the azimuth of the "
           "gimbal axis + 90 deg"),
    OUTPUT(gimbal_rate, "rad/s", "gimbal rates"),
    NONNEGATIVE_OUTPUT(singularity, "1",
                       "sqrt(det A A^T), A: torque axes of the six gyros; 0 = singular"),
    ROW_AS(OUTPUT_ROW, y, "arm_angle", arm.angle, 1, "rad",
           "angle of the arm (module about its hinge), positive about +z", ANY_VALUE),
    ROW_AS(OUTPUT_ROW, y, "arm_rate", arm.rate, 1, "rad/s", "derivative of arm_angle", ANY_VALUE),
    ROW_AS(OUTPUT_ROW, y, "arm_accel", arm.accel, 1, "rad/s2", "derivative of arm_rate", ANY_VALUE),
    OUTPUT(M_gravity_S, "N.m", "gravity-gradient torque, body axes"),
    OUTPUT(M_aero_S, "N.m",
           "aerodynamic torque about the centre of mass of the assembly, body axes"),
    OUTPUT(h_total_N, "N.m.s", "total momentum about the centre of mass of the assembly, N axes"),
    ROW_AS(OUTPUT_ROW, y, "J_A", J_A, 3, "kg.m2",
           "inertia of the assembly about its centre of mass, base axes", ANY_VALUE),
};

static void check(const Parameters *p, Problems *problems)
{
    check_assembly(problems, &p->assembly);
    if (norm(p->eps_0) > 1) reject(problems, "eps_0", norm(p->eps_0), "must not be longer than 1");
    if (norm(p->h_0_S) > p->H_sat)
        reject(problems, "h_0_S", norm(p->h_0_S), "must not be larger than H_sat");
}

/* ---- torques ---- */
typedef struct { vec3 gravity, aero; } Torques;

static Torques torques(const Parameters *p, const Configuration *c, mat3 C_So)
{
    return (Torques){scale(p->use_gravity_gradient, gravity_torque(&p->assembly, c, C_So)),
                     scale(p->use_aero, aero_torque(&p->assembly, c, C_So))};
}

static vec3 rate_relative_to_H(const Parameters *p, mat3 C_So, vec3 omega)
{
    return sub(omega, mul(C_So, orbital_rate_o(&p->assembly)));
}

/* ---- the gyros over one internal step ---- */
typedef struct {
    double use_cluster, h_w;
    vec3 h, dh; /* momentum of the ideal device: h + dh tau at the time tau in the step */
    double saturated, angle[GYROS], rate[GYROS];
} GyroMotion;

typedef struct { vec3 h, dh; } Momentum;

static Momentum momentum_at(const GyroMotion *d, double tau)
{
    double angle[GYROS];
    if (d->use_cluster == 0) return (Momentum){add(d->h, scale(tau, d->dh)), d->dh};
    for (int i = 0; i < GYROS; i++) angle[i] = d->angle[i] + tau * d->rate[i];
    return (Momentum){cluster_momentum(d->h_w, angle), cluster_rate(d->h_w, angle, d->rate)};
}

static double gimbal_rate(const Parameters *p, const Input *u, int i)
{
    return p->use_cluster != 0 ? limited(u->gimbal_rate_cmd[i], p->gimbal_rate_max) : 0;
}

static GyroMotion gyro_motion(const Parameters *p, const Input *u, const State *x, double h)
{
    GyroMotion d = {.use_cluster = p->use_cluster, .h_w = p->h_w, .h = x->h, .dh = u->hdot_cmd_S};
    vec3 h_cmd = add(x->h, scale(h, u->hdot_cmd_S));
    double size = norm(h_cmd);
    d.saturated = p->use_cluster == 0 && size > p->H_sat;
    if (d.saturated != 0) d.dh = scale(1 / h, sub(scale(p->H_sat / size, h_cmd), x->h));
    for (int i = 0; i < GYROS; i++) {
        d.angle[i] = x->gimbal_angle[i];
        d.rate[i] = gimbal_rate(p, u, i);
    }
    return d;
}

static void advance_gyros(const GyroMotion *d, double h, State *x)
{
    x->h = momentum_at(d, h).h;
    for (int i = 0; i < GYROS; i++) x->gimbal_angle[i] += h * d->rate[i];
}

/* ---- motion ---- */
typedef struct {
    const Parameters *p;
    const GyroMotion *gyros;
    double t_0, t_inside; /* start of the internal step; instant inside it: see arm_in_step() */
} Context;

typedef struct {
    quat q;
    vec3 omega;
} Motion7;

static void derivative(const Context *c, double t, const Motion7 *x, Motion7 *dx)
{
    Configuration now = configuration(&c->p->assembly, arm_in_step(&c->p->swing, t, c->t_inside));
    Momentum cmg = momentum_at(c->gyros, t - c->t_0);
    mat3 C_So = dcm_of_quat(x->q);
    Torques environment = torques(c->p, &now, C_So);

    vec3 w = rate_relative_to_H(c->p, C_So, x->omega);
    quat dq = product(x->q, (quat){0, w.x, w.y, w.z});
    dx->q = (quat){dq.w / 2, dq.x / 2, dq.y / 2, dq.z / 2};
    dx->omega =
        acceleration(&now, x->omega, cmg.h, cmg.dh, add(environment.gravity, environment.aero));
}

RK4(integrate, derivative, Context, Motion7)

/* ---- outputs ---- */
static double largest_momentum(const Parameters *p, vec3 h)
{
    if (p->use_cluster == 0) return p->H_sat;
    return envelope(p->h_w, norm(h) > 0 ? unit(h) : vec(0, 0, 1));
}

enum {
    NEARLY_ALL_PERCENT = 98
}; /* share of the envelope above which the cluster is reported as saturated */

static void publish_gyros(const Parameters *p, const Input *u, const State *x, double saturated,
                          Output *y)
{
    y->h_cmg_S = x->h;
    y->h_cmg = norm(x->h);
    y->momentum_share = y->h_cmg / largest_momentum(p, x->h);
    y->saturated = p->use_cluster != 0 ? y->momentum_share > NEARLY_ALL_PERCENT / 100.0 : saturated;
    for (int i = 0; i < GYROS; i++) {
        y->gimbal_angle[i] = x->gimbal_angle[i];
        y->gimbal_rate[i] = gimbal_rate(p, u, i);
    }
    y->singularity = singularity_measure(x->gimbal_angle);
}

static void publish(const Parameters *p, const State *x, double t, double t_inside, Output *y)
{
    mat3 C_So = dcm_of_quat(x->q);
    y->arm = arm_in_step(&p->swing, t, t_inside);
    Configuration now = configuration(&p->assembly, y->arm);
    Torques environment = torques(p, &now, C_So);

    y->q_SH = q_SH_of_q_So(x->q);
    y->q_SN = canonical(product(q_HN(&p->assembly, t), y->q_SH));
    y->omega_SN_S = x->omega;
    y->omega_SH_S = rate_relative_to_H(p, C_So, x->omega);
    y->eps = vector_part(x->q);
    y->rotation = 2 * arc_tangent(norm(y->eps), x->q.w);
    y->M_gravity_S = environment.gravity;
    y->M_aero_S = environment.aero;
    y->h_total_N = tmul(dcm_of_quat(y->q_SN), add(momentum_without_gyros(&now, x->omega), x->h));
    y->J_A = now.J;
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    const Assembly *a = &p->assembly;
    double e = dot(p->eps_0, p->eps_0);
    x->q = canonical((quat){sqrt(larger(0, 1 - e)), p->eps_0.x, p->eps_0.y, p->eps_0.z});
    x->omega = add(mul(dcm_of_quat(x->q), orbital_rate_o(a)), p->omega_SH_S_0);
    for (int i = 0; i < GYROS; i++) x->gimbal_angle[i] = p->gimbal_angle_0[i];
    x->h = p->use_cluster != 0 ? cluster_momentum(p->h_w, x->gimbal_angle) : p->h_0_S;
    publish_gyros(p, u, x, 0, y);
    publish(p, x, t, t, y);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    double saturated = 0, t_inside = t, end = t + h;
    for (Substep s = first_substep(t, h, p->max_step); s.h > 0; s = next_substep(s)) {
        GyroMotion gyros = gyro_motion(p, u, x, s.h);
        Motion7 motion = {x->q, x->omega};
        t_inside = s.t + s.h / 2;
        const Context context = {p, &gyros, s.t, t_inside};
        integrate(&context, s.t, s.h, &motion);
        x->q = canonical(motion.q);
        x->omega = motion.omega;
        advance_gyros(&gyros, s.h, x);
        saturated = gyros.saturated;
        end = s.end.t;
    }
    publish_gyros(p, u, x, saturated, y);
    publish(p, x, end, t_inside, y);
}

FMU_MODEL("assembly", "Large docked assembly with a swinging module and control moment gyros");
