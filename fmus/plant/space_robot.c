/* space_robot.c - free-floating robot of a base and two links in orbit: three-dimensional motion
 * under gravity gradient.
 *
 *   u = [omega_0; dq_1; dq_2],   H du/dt + b = Q_gg + Q_ext + [0; tau_1; tau_2]
 *   H    = sum_k Jw_k^T I_k Jw_k + m_k Jv_k^T Jv_k
 *   b    = sum_k Jw_k^T (I_k alpha'_k + omega_k x I_k omega_k) + m_k Jv_k^T a'_k
 *   Q_gg = sum_k Jw_k^T M_k + Jv_k^T f_k,   M_k = 3 g a x I_k a,
 *           f_k = g m_k (3 a (a.rho_k) - rho_k),   g = mu/r^3
 *
 * omega_0: angular velocity of the base; dq: joint rates; tau: joint torques; Q_ext: force and
 * torque on the base; m_k, I_k, omega_k: mass, inertia and angular velocity of body k (0: base, 1,
 * 2: links); Jw_k, Jv_k: derivatives of the angular velocity and the velocity of body k by u;
 * alpha'_k, a'_k: angular acceleration and acceleration of body k for du/dt = 0; M_k, f_k: torque
 * and force of the gravity gradient on body k; rho_k: centre of mass of body k from the centre of
 * mass of the robot; a, r: unit vector and distance from the centre of the planet to the centre of
 * mass of the robot; all in base axes. Both joint axes are parallel to the z axis of the base;
 * joint 1 lies on the x axis of the base. Locked joints do not move; the momentum of a joint that
 * is locked while it moves is transferred to the robot as one body. Without a force on the base,
 * the centre of mass follows a Kepler orbit that the attitude does not influence. Source: Guo, Li,
 * Fan, Meng 2014, with the corrections of docs/models.md D.6. Integrated by the classical
 * Runge-Kutta method on the grid k * max_step. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "orbit_rows.h"
#include "portable_math.h"
#include "rigid_body.h"
#include "rk4.h"
#include "time_grid.h"
#include "two_links.h"

typedef struct {
    Orbit orbit;
    Links links;
    double euler_0[3], deuler_0[3], joint_angle_0[JOINTS], joint_rate_0[JOINTS];
    double use_gravity_gradient, max_step;
} Parameters;
typedef struct {
    vec3 F_S, M_S;
    double joint_torque[JOINTS], joint_lock;
} Input;
typedef struct {
    vec3 r, v; /* position, velocity of the centre of mass of the robot, N axes */
    quat q;
    vec3 omega;
    double joint_angle[JOINTS], joint_rate[JOINTS], nu, pitch;
} State;
typedef struct {
    vec3 r_SN_N, v_SN_N;
    quat q_SN;
    vec3 omega_SN_S;
    double joint_angle[JOINTS], joint_rate[JOINTS], joint_accel[JOINTS];
    double euler[3], deuler[3], pitch, pitch_rate, true_anomaly;
    vec3 h_N;
    double kinetic_energy, potential_energy, lock_torque[JOINTS];
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.orbit = {.mu = MU_WGS84, .a = 7.0e6},
          .links = {.mass = {5799.28, 68.68, 68.68},
                    .Ixx = {4124.83, 0.38, 0.38},
                    .Iyy = {4124.83, 22.84, 22.84},
                    .Izz = {4124.83, 22.84, 22.84},
                    .l = {1, 1, 1},
                    .r = {1, 1, 1}},
          .joint_angle_0 = {0.5235987755982988, 0.3490658503988659},
          .use_gravity_gradient = 1,
          .max_step = 1},
};

static const Variable variables[] = {
    POSITIVE_AS("a", orbit.a, "m", "semi-major axis of the orbit of the centre of mass"),
    ELLIPSE_ROWS(orbit),
    POSITIVE_AS("mass", links.mass, "kg", "mass of base, link 1, link 2"),
    POSITIVE_AS(
        "Ixx", links.Ixx, "kg.m2",
        "moment of inertia about the centre of mass, axis along the link (base: x), per body"),
    POSITIVE_AS("Iyy", links.Iyy, "kg.m2",
                "moment of inertia, axis across link and joint axes (base: y), per body"),
    POSITIVE_AS("Izz", links.Izz, "kg.m2",
                "moment of inertia about the joint axes (base: z), per body"),
    NONNEGATIVE_AS(
        "l", links.l, "m",
        "distance from inboard joint to centre of mass, per body; not used for the base"),
    NONNEGATIVE_AS("r", links.r, "m",
                   "distance from centre of mass to outboard joint (base: along x), per body; not "
                   "used for link 2"),
    PARAMETER(euler_0, "rad",
              "start attitude relative to the Hill frame of the own orbit: angles about x, y, z; "
              "turned about x, then z (pitch), then y"),
    PARAMETER(deuler_0, "rad/s", "rates of the angles euler at the start, about x, y, z"),
    PARAMETER(joint_angle_0, "rad",
              "joint angles at the start: link 1 from x of the base, link 2 from link 1"),
    PARAMETER(joint_rate_0, "rad/s", "joint rates at the start"),
    SWITCH(use_gravity_gradient, "1: gravity gradient acts on all bodies"),
    GRID(max_step, "internal integration step; recommended: at most 0.1 s with joint torques, 10 s "
                   "in free drift"),

    INPUT(F_S, "N", "force at the centre of mass of the base, base axes"),
    INPUT(M_S, "N.m", "torque on the base, base axes"),
    INPUT(joint_torque, "N.m",
          "torque at the joints, on the outboard body about +z; no effect while locked"),
    ROW_AS(INPUT_ROW, u, "joint_lock", joint_lock, 1, "1", "1: both joints are locked",
           SWITCH_VALUE),

    OUTPUT(r_SN_N, "m", "position of the centre of mass of the base, N axes"),
    OUTPUT(v_SN_N, "m/s", "velocity of the centre of mass of the base, N axes"),
    OUTPUT(q_SN, "1", "attitude of the base relative to N, scalar first"),
    OUTPUT(omega_SN_S, "rad/s", "angular velocity of the base relative to N, base axes"),
    OUTPUT(joint_angle, "rad", "joint angles"),
    OUTPUT(joint_rate, "rad/s", "joint rates"),
    OUTPUT(joint_accel, "rad/s2", "joint accelerations"),
    OUTPUT(euler, "rad",
           "attitude relative to the Hill frame of the own orbit: angles about x, y, z; turned "
           "about x, then z, then y"),
    OUTPUT(deuler, "rad/s", "rates of the angles euler"),
    OUTPUT(
        pitch, "rad",
        "in planar motion: angle about z from radial direction to x of the base, with full turns"),
    OUTPUT(pitch_rate, "rad/s",
           "angular velocity about z of the base minus the rate of the true anomaly"),
    OUTPUT(true_anomaly, "rad", "true anomaly, counted through full turns"),
    OUTPUT(h_N, "N.m.s", "angular momentum about the centre of mass of the robot, N axes"),
    OUTPUT(kinetic_energy, "J", "kinetic energy of the motion about the centre of mass"),
    OUTPUT(potential_energy, "J", "potential energy of the gravity gradient"),
    OUTPUT(lock_torque, "N.m", "torque of the lock on the outboard body about +z; 0 when free"),
};

static void check(const Parameters *p, Problems *problems)
{
    const Links *links = &p->links;
    char name[16];
    check_ellipse(problems, &p->orbit);
    for (int k = 0; k < BODIES; k++) {
        snprintf(name, sizeof name, "Izz[%d]", k + 1);
        if (!satisfies_triangle_inequality(diagonal(links->Ixx[k], links->Iyy[k], links->Izz[k])))
            reject(problems, name, links->Izz[k],
                   "Ixx, Iyy, Izz must satisfy the triangle inequality (none above the sum of the "
                   "others)");
    }
}

/* ---- motion ---- */
static double gradient_factor(const Parameters *p, const State *x) /* g = mu/r^3 [1/s2] */
{
    double r = norm(x->r);
    return p->use_gravity_gradient * p->orbit.mu / (r * r * r);
}

static vec3 radial_S(const State *x) { return mul(dcm_of_quat(x->q), unit(x->r)); }

typedef struct {
    Column speeds_rate; /* du/dt */
    double lock_torque[JOINTS];
} Acceleration;

static Acceleration accelerations(const Parameters *p, const Input *u, const State *x)
{
    Robot robot = robot_at(&p->links, x->joint_angle, x->joint_rate);
    Matrix H = mass_matrix(&robot);
    Column b = inertial_loads(&robot, x->omega, x->joint_rate);
    Column loads = gravity_gradient_loads(&robot, gradient_factor(p, x), radial_S(x));
    int locked = u->joint_lock != 0;

    add_generalised_force(&loads, &robot.part[0], u->M_S, u->F_S);
    for (int j = 0; j < JOINTS && !locked; j++) loads.at[3 + j] += u->joint_torque[j];
    for (int i = 0; i < SPEEDS; i++) loads.at[i] -= b.at[i];

    Acceleration found = {.speeds_rate = solution(H, loads, locked ? 3 : SPEEDS)};
    for (int j = 0; j < JOINTS && locked; j++) {
        found.lock_torque[j] = -loads.at[3 + j];
        for (int i = 0; i < 3; i++)
            found.lock_torque[j] += H.at[3 + j][i] * found.speeds_rate.at[i];
    }
    return found;
}

typedef struct {
    const Parameters *p;
    const Input *u;
} Context;

static double anomaly_rate(const State *x) { return norm(cross(x->r, x->v)) / dot(x->r, x->r); }

static void derivative(const Context *c, double t, const State *x, State *dx)
{
    const Parameters *p = c->p;
    (void)t;

    const double *m = p->links.mass;
    quat dq = product(x->q, (quat){0, x->omega.x, x->omega.y, x->omega.z});
    const Acceleration found = accelerations(p, c->u, x);
    const double *du = found.speeds_rate.at;
    *dx = (State){.r = x->v,
                  .v = add(gravity(&p->orbit, 0, x->r),
                           scale(1 / (m[0] + m[1] + m[2]), tmul(dcm_of_quat(x->q), c->u->F_S))),
                  .q = {dq.w / 2, dq.x / 2, dq.y / 2, dq.z / 2},
                  .omega = vec(du[0], du[1], du[2]),
                  .joint_angle = {x->joint_rate[0], x->joint_rate[1]},
                  .joint_rate = {du[3], du[4]},
                  .nu = anomaly_rate(x)};
}

RK4(integrate, derivative, Context, State)

/* stops the joints and conserves the angular momentum: omega becomes H_bb^-1 (H_bb omega +
 * H_bm dq); H_bb, H_bm: columns of omega and of the joint rates dq in the rows of H for omega */
static void stop_joints(const Parameters *p, State *x)
{
    Robot robot = robot_at(&p->links, x->joint_angle, x->joint_rate);
    Matrix H = mass_matrix(&robot);
    double speeds[SPEEDS] = {x->omega.x, x->omega.y, x->omega.z, x->joint_rate[0],
                             x->joint_rate[1]};
    Column momentum = {{0}};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < SPEEDS; j++) momentum.at[i] += H.at[i][j] * speeds[j];
    Column after = solution(H, momentum, 3);
    x->omega = vec(after.at[0], after.at[1], after.at[2]);
    for (int j = 0; j < JOINTS; j++) x->joint_rate[j] = 0;
}

static void apply_lock(const Parameters *p, const Input *u, State *x)
{
    if (u->joint_lock != 0 && (x->joint_rate[0] != 0 || x->joint_rate[1] != 0)) stop_joints(p, x);
}

/* ---- attitude relative to the orbital frame: x outward, y along track, z orbit normal ---- */
static mat3 orbital_frame(const Parameters *p, vec3 r, vec3 v)
{
    SineCosine i = sine_and_cosine(p->orbit.inc), O = sine_and_cosine(p->orbit.raan);
    vec3 of_elements = vec(i.s * O.s, -i.s * O.c, i.c);
    vec3 x = unit(r), z = p->orbit.mu > 0 ? unit(cross(r, v)) : of_elements;
    return rows(x, cross(z, x), z);
}

/* C_b,or = Ry(psi) Rz(theta) Rx(vartheta), orbital frame to base; angles: vartheta about x, psi
 * about y, theta about z, in this order */
static mat3 dcm_of_euler(const double angles[3])
{
    SineCosine x = sine_and_cosine(angles[0]), y = sine_and_cosine(angles[1]),
               z = sine_and_cosine(angles[2]);
    mat3 Rx = rows(vec(1, 0, 0), vec(0, x.c, x.s), vec(0, -x.s, x.c));
    mat3 Rz = rows(vec(z.c, z.s, 0), vec(-z.s, z.c, 0), vec(0, 0, 1));
    mat3 Ry = rows(vec(y.c, 0, -y.s), vec(0, 1, 0), vec(y.s, 0, y.c));
    return matmul(Ry, matmul(Rz, Rx));
}

#define UPRIGHT 1e-9 /* least divisor cos(theta) in euler_of_dcm() */

/* sets the angles of a rotation matrix C_b,or (indices from 0): theta = asin(-C10), vartheta =
 * atan2(C12, C11), psi = atan2(C20, C00); and their rates. w: angular velocity of the base relative
 * to the orbital frame, base axes, w = T_Y [dvartheta; dpsi; dtheta]; T_Y is singular at theta =
 * +-90 deg. */
static void euler_of_dcm(mat3 C, vec3 w, double angles[3], double rates[3])
{
    double cz = sqrt(C.row[1].y * C.row[1].y + C.row[1].z * C.row[1].z), sz = -C.row[1].x;
    angles[0] = arc_tangent(C.row[1].z, C.row[1].y);
    angles[1] = arc_tangent(C.row[2].x, C.row[0].x);
    angles[2] = arc_tangent(sz, cz);
    SineCosine y = sine_and_cosine(angles[1]);
    rates[0] = (y.c * w.x + y.s * w.z) / larger(cz, UPRIGHT);
    rates[1] = w.y + sz * rates[0];
    rates[2] = y.c * w.z - y.s * w.x;
}

static vec3 rate_of_euler(const double angles[3], const double rates[3]) /* T_Y rates */
{
    SineCosine y = sine_and_cosine(angles[1]), z = sine_and_cosine(angles[2]);
    return vec(y.c * z.c * rates[0] - y.s * rates[2], rates[1] - z.s * rates[0],
               y.s * z.c * rates[0] + y.c * rates[2]);
}

/* returns the angle plus the number of full turns that brings it nearest to the earlier angle */
static double unwrapped(double earlier, double angle)
{
    return angle + 2 * PI * nearest_whole((earlier - angle) / (2 * PI));
}

static double pitch_of(const State *x)
{
    vec3 a = radial_S(x);
    return arc_tangent(-a.y, a.x);
}

/* ---- outputs ---- */
static void publish_energies(const Parameters *p, const State *x, Output *y)
{
    Robot robot = robot_at(&p->links, x->joint_angle, x->joint_rate);
    double g = gradient_factor(p, x);
    vec3 a = radial_S(x), h_S = vec(0, 0, 0);
    y->kinetic_energy = y->potential_energy = 0;
    for (int k = 0; k < BODIES; k++) {
        const Part *b = &robot.part[k];
        vec3 w = add(x->omega, vec(0, 0, b->sigma));
        vec3 relative = add(scale(x->joint_rate[0], b->D[0]), scale(x->joint_rate[1], b->D[1]));
        vec3 v = add(cross(x->omega, b->rho), relative);
        double trace = b->inertia.row[0].x + b->inertia.row[1].y + b->inertia.row[2].z,
               radial = dot(a, b->rho);
        h_S = sum3(h_S, mul(b->inertia, w), scale(b->mass, cross(b->rho, v)));
        y->kinetic_energy += (dot(w, mul(b->inertia, w)) + b->mass * dot(v, v)) / 2;
        y->potential_energy += g * (1.5 * dot(a, mul(b->inertia, a)) - trace / 2) +
                               g * b->mass * (dot(b->rho, b->rho) - 3 * radial * radial) / 2;
    }
    y->h_N = tmul(dcm_of_quat(x->q), h_S);
}

static void publish(const Parameters *p, const Input *u, const State *x, Output *y)
{
    mat3 C_SN = dcm_of_quat(x->q), C_ON = orbital_frame(p, x->r, x->v);
    Robot robot = robot_at(&p->links, x->joint_angle, x->joint_rate);
    const Part *base = &robot.part[0];
    vec3 relative = add(scale(x->joint_rate[0], base->D[0]), scale(x->joint_rate[1], base->D[1]));
    Acceleration now = accelerations(p, u, x);

    y->r_SN_N = add(x->r, tmul(C_SN, base->rho));
    y->v_SN_N = add(x->v, tmul(C_SN, add(cross(x->omega, base->rho), relative)));
    y->q_SN = x->q;
    y->omega_SN_S = x->omega;
    for (int j = 0; j < JOINTS; j++) {
        y->joint_angle[j] = x->joint_angle[j];
        y->joint_rate[j] = x->joint_rate[j];
        y->joint_accel[j] = now.speeds_rate.at[3 + j];
        y->lock_torque[j] = now.lock_torque[j];
    }
    vec3 orbital = scale(anomaly_rate(x), mul(C_SN, C_ON.row[2]));
    euler_of_dcm(matmul_t(C_SN, C_ON), sub(x->omega, orbital), y->euler, y->deuler);
    y->pitch = x->pitch;
    y->pitch_rate = x->omega.z - anomaly_rate(x);
    y->true_anomaly = x->nu;
    publish_energies(p, x, y);
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    (void)t;
    PosVel s = posvel_of_elements(&p->orbit);
    mat3 C_ON = orbital_frame(p, s.r, s.v), C_SO = dcm_of_euler(p->euler_0);
    *x = (State){.r = s.r,
                 .v = s.v,
                 .q = quat_of_dcm(matmul(C_SO, C_ON)),
                 .joint_angle = {p->joint_angle_0[0], p->joint_angle_0[1]},
                 .joint_rate = {p->joint_rate_0[0], p->joint_rate_0[1]},
                 .nu = p->orbit.nu};
    x->omega = add(rate_of_euler(p->euler_0, p->deuler_0), mul(C_SO, vec(0, 0, anomaly_rate(x))));
    x->pitch = unwrapped(p->euler_0[2], pitch_of(x));
    apply_lock(p, u, x);
    publish(p, u, x, y);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    const Context context = {p, u};
    apply_lock(p, u, x);
    for (Substep s = first_substep(t, h, p->max_step); s.h > 0; s = next_substep(s)) {
        integrate(&context, s.t, s.h, x);
        x->q = canonical(x->q);
        x->pitch = unwrapped(x->pitch, pitch_of(x));
    }
    publish(p, u, x, y);
}

FMU_MODEL("space_robot",
          "Free-floating space robot of a base and two links under gravity gradient");
