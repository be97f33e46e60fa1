/* arm_controller.c - computed torque for an arm on a free base, between the controller of the base
 * and its actuators: feed-forward that compensates the reaction of the arm on the base, and joint
 * brakes after the capture.
 *
 *   v = ddq_ref + 2 zeta o (dq_ref - dq) + o^2 (q_ref - q),   o = omega_joint or omega_rest (REST)
 *   [F_r; M_r] = H_0m ddq_ref + b_0(w, dq) - b_0(w, 0)         minus the reaction of the arm at S
 *   F_ff = F_r,   M_ff = M_r + c x (F_cmd + F_ff - F_r)     0 in REST and without compensation
 *   F_sum = F_cmd + F_ff,   M_sum = M_cmd,   wheel_accel_sum = wheel_accel_cmd - A_w^-1 M_ff
 *   Q_0 = [F_sum; M_sum - A_w wheel_accel_sum - w x A_w Omega],   du_0 = H_00^-1 (Q_0 - b_0 - H_0m v)
 *   tau = H_0m^T du_0 + H_mm v + b_m + damping dq_ref + friction dq_ref/sqrt(dq_ref^2 + r^2)
 *
 * q: joint angles; tau: joint torques; du_0: acceleration of the base; H_00, H_0m, H_mm and b_0,
 * b_m: blocks of the mass matrix and of the velocity-dependent loads, 0 for the base, m for the
 * joints; w: rate of the base; c: position of C, the centre of mass of base and arm, from S; r:
 * friction_rate; Q_0: load of the commands on the base; Omega: wheel speeds; zeta, A_w: parameters.
 * Without wheels M_sum = M_cmd + M_ff, wheel_accel_sum = wheel_accel_cmd. Every joint error obeys
 * e'' + 2 zeta o e' + o^2 e = 0 for any command of the base, and the planned motion does not turn
 * the base: the term with c balances the torque about C of forces that act at S. The feed-forward
 * contains ddq_ref, not v with its feedback, so that a joint held by friction does not turn the
 * base. Sampled. Equations: docs/models.md K.4. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "arm_dynamics.h"
#include "arm_rows.h"
#include "mat3.h"
#include "time_grid.h"

enum { STOWED = 0, REST = 4 }; /* modes of arm_guidance that close the brakes */

typedef struct {
    Arm arm;
    double mass_0;
    mat3 J_S, A_w;
    Joints joint;
    double omega_joint, omega_rest, zeta, T_lock, lock_rate, compensate_torque, compensate_force;
    vec3 M_ff_max;
    double use_wheels, base_rest, sample_period;
} Parameters;
typedef struct {
    vec3 omega_SN_S, wheel_speed;
    double joint_angle[ARM_JOINTS], joint_rate[ARM_JOINTS];
    double joint_angle_ref[ARM_JOINTS], joint_rate_ref[ARM_JOINTS], joint_accel_ref[ARM_JOINTS];
    double arm_mode;
    vec3 F_cmd_S, M_cmd_S, wheel_accel_cmd;
} Input;
typedef struct { double resting, t_rest, locked; } State;
typedef struct {
    double joint_torque[ARM_JOINTS], joint_lock[ARM_JOINTS];
    vec3 F_sum_S, M_sum_S, wheel_accel_sum, F_ff_S, M_ff_S;
    double saturated[ARM_JOINTS], joint_error;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.arm = ARM_START,
          .mass_0 = 100,
          .J_S = {{{200, 0, 0}, {0, 250, 0}, {0, 0, 150}}},
          .A_w = {{{12, 0, 0}, {0, 15, 0}, {0, 0, 10}}},
          .joint = {.friction_rate = 0.005},
          .omega_joint = 5,
          .omega_rest = 1.5,
          .zeta = 1,
          .T_lock = 2,
          .lock_rate = 0.02,
          .compensate_torque = 1,
          .use_wheels = 1,
          .base_rest = 1},
};

static const Variable variables[] = {
    ARM_PARAMETERS,
    POSITIVE(mass_0, "kg", "mass of the base body"),
    MATRIX(J_S, "kg.m2", "inertia of the base body about S, wheels locked, body axes"),
    MATRIX(A_w, "kg.m2", "wheel inertia matrix: wheel speeds to wheel momentum in body axes"),
    JOINTS_PARAMETERS,
    NONNEGATIVE(omega_joint, "rad/s", "bandwidth of the joints"),
    NONNEGATIVE(omega_rest, "rad/s", "bandwidth of the joints in REST"),
    NONNEGATIVE(zeta, "1", "damping ratio of the joints"),
    NONNEGATIVE(T_lock, "s", "REST: least time from its start until the brakes close"),
    NONNEGATIVE(lock_rate, "rad/s", "REST: largest joint rate at which the brakes close"),
    SWITCH(compensate_torque, "1: feed-forward torque of the base against the arm's motion"),
    SWITCH(compensate_force, "1: feed-forward force of the base against the arm's motion"),
    NONNEGATIVE(M_ff_max, "N.m", "largest feed-forward torque, per axis; 0 = no limit"),
    SWITCH(use_wheels, "1: feed-forward torque by wheels, 0: by thrusters"),
    SWITCH(base_rest, "1: the commands of the base are 0 in REST; 0: they pass unchanged (for "
                      "systems in which a command_selector sets them)"),
    SAMPLE_PERIOD,

    INPUT(omega_SN_S, "rad/s", "angular velocity of the servicer relative to N, body axes"),
    INPUT(wheel_speed, "rad/s", "wheel speeds relative to the body"),
    INPUT(joint_angle, "rad", "joint angles"),
    INPUT(joint_rate, "rad/s", "joint rates"),
    INPUT(joint_angle_ref, "rad", "reference of the joint angles"),
    INPUT(joint_rate_ref, "rad/s", "reference of the joint rates"),
    INPUT(joint_accel_ref, "rad/s2", "reference of the joint accelerations"),
    MODE_INPUT(arm_mode, "mode of the arm", "stowed|deploy|align|close|rest|fold"),
    INPUT(F_cmd_S, "N", "force commanded by the controller of the base, body axes"),
    INPUT(M_cmd_S, "N.m", "torque commanded by the controller of the base, body axes"),
    INPUT(wheel_accel_cmd, "rad/s2", "wheel acceleration commanded by the controller of the base"),

    OUTPUT(joint_torque, "N.m", "torque at the joints"),
    FLAG(joint_lock, "1: the brakes are closed, equal for all joints"),
    OUTPUT(F_sum_S, "N", "force command with the feed-forward, body axes"),
    OUTPUT(M_sum_S, "N.m", "torque command, with the feed-forward if use_wheels = 0, body axes"),
    OUTPUT(wheel_accel_sum, "rad/s2",
           "commanded wheel acceleration, with the feed-forward if use_wheels = 1"),
    OUTPUT(F_ff_S, "N", "feed-forward force"),
    OUTPUT(M_ff_S, "N.m", "feed-forward torque about S, within M_ff_max"),
    FLAG(saturated, "1: the torque is at its limit, per joint"),
    NONNEGATIVE_OUTPUT(joint_error, "rad",
                       "largest error of a joint angle; 0 while the brakes are closed"),
};

static void check(const Parameters *p, Problems *problems)
{
    check_joints(problems, &p->joint, check_arm(problems, &p->arm));
    check_inertia(problems, "J_S", p->J_S);
    check_positive_definite(problems, "A_w", p->A_w);
    check_positive_definite(problems, "J_S - A_w", minus(p->J_S, p->A_w));
}

/* ---- force, torque and wheel acceleration of the base ---- */
static void copy_base_command(const Parameters *p, const Input *u, Output *y)
{
    int resting = u->arm_mode == REST && p->base_rest;
    vec3 none = vec(0, 0, 0);
    *y = (Output){.F_sum_S = resting ? none : u->F_cmd_S,
                  .M_sum_S = resting ? none : u->M_cmd_S,
                  .wheel_accel_sum = resting ? none : u->wheel_accel_cmd};
}

/* force and torque at S that the arm needs for its planned motion, opposite to its reaction on the
 * base, evaluated at the measured w and dq */
/* K.4-1 */
static Wrench reaction_of_arm(const Input *u, const Tree *t, const Forces *b)
{
    Speeds planned = {.w = {0, 0, 0}};
    memcpy(planned.joint, u->joint_accel_ref, sizeof u->joint_accel_ref);
    Wrench r = plus_wrench(base_rows(t, &planned), 1, b->base);
    return plus_wrench(r, -1, gyroscopic_wrench(&t->whole, u->omega_SN_S));
}

/* K.4-2 */
static void feed_forward(const Parameters *p, Wrench reaction, vec3 c, Output *y)
{
    vec3 none = vec(0, 0, 0), F_cmd = y->F_sum_S;
    y->F_ff_S = p->compensate_force ? reaction.F : none;
    y->F_sum_S = add(F_cmd, y->F_ff_S);
    if (!p->compensate_torque) return;
    vec3 balance = cross(c, sub(y->F_sum_S, reaction.F));
    y->M_ff_S = limited3(add(reaction.M, balance), p->M_ff_max);
    if (p->use_wheels) y->wheel_accel_sum = sub(y->wheel_accel_sum, solve(p->A_w, y->M_ff_S));
    else y->M_sum_S = add(y->M_sum_S, y->M_ff_S);
}

/* ---- joint torques ---- */
static Speeds commanded_accelerations(const Parameters *p, const Input *u, int joints)
{
    Speeds v = {.w = {0, 0, 0}};
    double o = u->arm_mode == REST ? p->omega_rest : p->omega_joint;
    for (int i = 0; i < joints; i++)
        v.joint[i] = u->joint_accel_ref[i] +
                     2 * p->zeta * o * (u->joint_rate_ref[i] - u->joint_rate[i]) +
                     o * o * (u->joint_angle_ref[i] - u->joint_angle[i]);
    return v;
}

/* du = [du_0; v]: acceleration of the base under its commands while the joints accelerate with v */
static Speeds predicted_acceleration(const Parameters *p, const Input *u, const Tree *t,
                                     const Forces *b, const Output *y)
{
    Mobility base = mobility_of(&t->whole, 1);
    vec3 w = u->omega_SN_S;
    vec3 wheels = add(mul(p->A_w, y->wheel_accel_sum), cross(w, mul(p->A_w, u->wheel_speed)));
    Speeds du = commanded_accelerations(p, u, (int)t->joints);
    Wrench Q_0 = {y->F_sum_S, sub(y->M_sum_S, wheels)};

    Twist du_0 =
        base_response(&base, plus_wrench(Q_0, -1, plus_wrench(base_rows(t, &du), 1, b->base)));
    du.v = du_0.v;
    du.w = du_0.w;
    return du;
}

/* K.4-4 */
static void set_joint_torques(const Parameters *p, const Input *u, const Tree *t, const Forces *b,
                              Output *y)
{
    Speeds du = predicted_acceleration(p, u, t, b, y);
    int joints = (int)t->joints;
    double row[COLUMNS];
    set_joint_rows(row, t, &du);
    for (int i = 0; i < joints; i++) {
        double torque = row[i] + b->joint[i] + friction_torque(&p->joint, i, u->joint_rate_ref[i]);
        y->joint_torque[i] = limited(torque, p->joint.torque_max[i]);
        y->saturated[i] = y->joint_torque[i] != torque;
        y->joint_error = larger(y->joint_error, fabs(u->joint_angle_ref[i] - u->joint_angle[i]));
    }
}

/* ---- joint brakes ---- */
/* K.4-3 */
static void update_brakes(const Parameters *p, const Input *u, State *x, double t)
{
    int resting = u->arm_mode == REST;
    double fastest = 0;
    int joints = (int)p->arm.joints;
    for (int i = 0; i < joints; i++) fastest = larger(fastest, fabs(u->joint_rate[i]));
    if (resting && !x->resting) x->t_rest = t;
    x->resting = resting;
    x->locked =
        resting && (x->locked || (reached(t, x->t_rest + p->T_lock) && fastest <= p->lock_rate));
}

static void control(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    update_brakes(p, u, x, t);
    copy_base_command(p, u, y);
    int locked = u->arm_mode == STOWED || x->locked;
    for (int i = 0; i < ARM_JOINTS; i++) y->joint_lock[i] = locked;
    if (locked) return;

    Chain arm;
    Tree tree;
    Links links;
    Speeds measured = {.w = u->omega_SN_S};
    Composite base = body_at_S(p->mass_0, p->J_S);
    const TidalField none = {.at_S = {0, 0, 0}};
    memcpy(measured.joint, u->joint_rate, sizeof u->joint_rate);
    set_chain(&arm, &p->arm);
    place_links(&tree, &links, &arm, u->joint_angle);
    set_link_inertias(&links, &arm);
    set_mass_matrix(&tree, &links, &base);
    Forces b = velocity_forces(&tree, &links, &base, &measured, &none);
    if (u->arm_mode != REST)
        feed_forward(p, reaction_of_arm(u, &tree, &b), centre_of(&tree.whole), y);
    set_joint_torques(p, u, &tree, &b, y);
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    *x = (State){0, 0, 0};
    control(p, u, x, y, t);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        control(p, u, x, y, s.t);
}

FMU_MODEL("arm_controller",
          "Computed torque of an arm on a free base, feed-forward to the base, brakes");
