/* arm_guidance.c - guidance of an arm that grasps the grapple fixture of a tumbling target: modes
 * STOWED, DEPLOY, ALIGN, CLOSE, REST and FOLD; conditions under which the gripper closes.
 *
 *   e = C_QN (r_E - r_Q),   u = C_QN (v_E - v_T - w_T x (r_E - r_T))
 *   DEPLOY, FOLD   q_ref = q_a + S (goal - q_a)                  S(x) = 10 x^3 - 15 x^4 + 6 x^5
 *   ALIGN, CLOSE   e_r = e_0 + S (goal - e_0),   phi = (1 - S) phi_0
 *                  x_r = r_T + C_TN^T p_QT_T + C_QN^T e_r,   q_r = q_QN q_m rotq(phi)
 *                  xd = C_SN [v_r - v_S + K_E[1] (x_r - r_E); w_r + K_E[2] rotvec(q_r q_EN*)]
 *   REST           the measured joint rates decrease linearly to zero over T_rest
 *
 * E: end effector, Q: grapple fixture on T; tip: origin of E; e, u: position and velocity of the
 * tip as seen in Q, Q axes. S rises from 0 to 1 over the duration of the mode, x is the elapsed
 * share of this duration. In DEPLOY and FOLD the goal is the deployed or stowed arm, q_a are the
 * reference angles at the start of the mode. In ALIGN the goal is the standoff, e_0 is e at the
 * start of the mode; in CLOSE the goal is the seat, e_0 the standoff. q_m: attitude relative to Q
 * in which X_E = -X_Q, with the roll angle of E at the start of ALIGN; phi_0: rotation vector from
 * q_m to the attitude of E at that time, 0 in CLOSE. x_r, q_r: reference of position and attitude
 * of E; v_r, w_r: velocity and rate of this reference, the motion of T at x_r plus the derivatives
 * of e_r and phi; xd: commanded velocity of E relative to S and angular velocity of E relative to
 * N, S axes. Joint rates follow from xd by resolved_rate.h; q_ref is integrated from the previous
 * reference, not from the measured angle. Sampled. Equations: docs/models.md K.3. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "arm_rows.h"
#include "body_rows.h"
#include "resolved_rate.h"
#include "small_rotation.h"
#include "time_grid.h"

enum { STOWED, DEPLOY, ALIGN, CLOSE, REST, FOLD, CHANGES = 13 };

typedef struct {
    Arm arm;
    double mass_0;
    mat3 J_S;
    vec3 p_QT_T;
    quat q_QT;
    double standoff, seat_depth, joint_angle_stowed[ARM_JOINTS];
    double T_deploy, T_align, T_close, T_rest, deploy_from, track_from, gate_distance, gate_angle;
    double K_E[2];
    RateLaw law;
    double grip_distance, grip_angle, grip_speed, grip_rate, grip_dwell, sample_period;
} Parameters;
typedef struct {
    Body T, S;
    double joint_angle[ARM_JOINTS], joint_rate[ARM_JOINTS], arm_mode_cmd, capture_phase;
} Input;
typedef struct {
    double mode, t_mode, grip, in_grip_window, t_grip_window;
    double q_ref[ARM_JOINTS], q_a[ARM_JOINTS], dq_a[ARM_JOINTS];
    vec3 e_0, phi_0;
    quat q_m;
} State;
typedef struct {
    double joint_angle_ref[ARM_JOINTS], joint_rate_ref[ARM_JOINTS], joint_accel_ref[ARM_JOINTS];
    double arm_mode, grip;
    vec3 tip_Q;
    double misalignment, tip_speed, tip_rate, position_error, angle_error;
    double manipulability, damping, limited[ARM_JOINTS], rate_scale;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.arm = ARM_START,
          .mass_0 = 100,
          .J_S = {{{200, 0, 0}, {0, 250, 0}, {0, 0, 150}}},
          .p_QT_T = {0.6, 0, 0},
          .q_QT = {1, 0, 0, 0},
          .standoff = 0.3,
          .seat_depth = 0.05,
          .joint_angle_stowed = ARM_STOWED,
          .T_deploy = 60,
          .T_align = 30,
          .T_close = 30,
          .T_rest = 1,
          .deploy_from = 10,
          .track_from = 90,
          .gate_distance = 0.03,
          .gate_angle = 0.05,
          .K_E = {0.5, 0.5},
          .law = {.ready = {0.15, 0.54, 0.19, -2.15, -0.05, 1.6, -0.16},
                  .angle_min = {-3.1, -3.1, -3.1, -3.1, -3.1, -3.1, -3.1},
                  .angle_max = {3.1, 3.1, 3.1, 3.1, 3.1, 3.1, 3.1},
                  .rate_max = {0.2, 0.2, 0.2, 0.2, 0.2, 0.2, 0.2},
                  .K_posture = 0.02,
                  .K_limit = 1,
                  .damping_max = 0.1,
                  .manipulability_min = 0.05,
                  .base_floats = 1},
          .grip_distance = 0.01,
          .grip_angle = 0.035,
          .grip_speed = 0.005,
          .grip_rate = 0.005,
          .grip_dwell = 0.5},
    .u = {.T = {.r = {7158140, 0, 0}, .v = {0, 7462.286, 0}, .q = {1, 0, 0, 0}},
          .S = {.r = {7158142.6, 0, 0}, .v = {0, 7462.286, 0}, .q = {0, 0, 0, 1}},
          .arm_mode_cmd = -1},
};

static const Variable variables[] = {
    ARM_PARAMETERS,
    POSITIVE(mass_0, "kg", "mass of the base body"),
    MATRIX(J_S, "kg.m2", "inertia of the base body about S, wheels locked, body axes"),
    PARAMETER(p_QT_T, "m", "grapple fixture from the centre of mass of the target, target axes"),
    PARAMETER(q_QT, "1",
              "attitude of the grapple fixture relative to the target, scalar first; its X points "
              "outward"),
    PARAMETER(standoff, "m",
              "distance of the end effector in front of the fixture at the end of ALIGN"),
    PARAMETER(seat_depth, "m", "depth of the end effector inside the fixture at the end of CLOSE"),
    PARAMETER(joint_angle_stowed, "rad", "joint angles of the stowed arm"),
    PARAMETER_AS("joint_angle_ready", law.ready, "rad", "joint angles of the deployed arm"),
    POSITIVE(T_deploy, "s", "duration of DEPLOY and of FOLD"),
    POSITIVE(T_align, "s", "duration of ALIGN"),
    POSITIVE(T_close, "s", "duration of CLOSE"),
    POSITIVE(T_rest, "s", "time in which REST stops the joints"),
    PARAMETER(deploy_from, "s", "with arm_mode_cmd = -1: DEPLOY from this time on"),
    PARAMETER(track_from, "s", "with arm_mode_cmd = -1: ALIGN from this time on"),
    NONNEGATIVE(gate_distance, "m", "ALIGN to CLOSE: largest distance from the standoff"),
    NONNEGATIVE(gate_angle, "rad", "ALIGN to CLOSE: largest misalignment"),
    NONNEGATIVE(K_E, "1/s", "gains on the error of the end effector; elements: position, attitude"),
    NONNEGATIVE_AS("K_posture", law.K_posture, "1/s",
                   "gain of the null-space motion towards joint_angle_ready"),
    NONNEGATIVE_AS("K_limit", law.K_limit, "1/s",
                   "largest rate of a joint towards its angle limit, per rad of its distance "
                   "from the limit"),
    NONNEGATIVE_AS("damping_max", law.damping_max, "1",
                   "damping of the inverse Jacobian at a singularity"),
    NONNEGATIVE_AS("manipulability_min", law.manipulability_min, "1",
                   "manipulability below which the inverse Jacobian is damped"),
    PARAMETER_AS("joint_angle_min", law.angle_min, "rad",
                 "least joint angles, for ALIGN and CLOSE"),
    PARAMETER_AS("joint_angle_max", law.angle_max, "rad",
                 "largest joint angles, for ALIGN and CLOSE"),
    NONNEGATIVE_AS("joint_rate_max", law.rate_max, "rad/s",
                   "largest joint rates, for ALIGN and CLOSE"),
    ROW_AS(PARAMETER_ROW, p, "base_floats", law.base_floats, 1, "1",
           "1: generalized Jacobian of a free-floating base, 0: Jacobian of the arm with the "
           "measured motion of the base",
           SWITCH_VALUE),
    NONNEGATIVE(grip_distance, "m", "gripper closes: largest distance from the seated position"),
    NONNEGATIVE(grip_angle, "rad", "gripper closes: largest misalignment"),
    NONNEGATIVE(grip_speed, "m/s", "gripper closes: largest speed of the tip"),
    NONNEGATIVE(grip_rate, "rad/s", "gripper closes: largest relative angular velocity"),
    NONNEGATIVE(grip_dwell, "s", "gripper closes: all conditions hold for this time"),
    SAMPLE_PERIOD,

    BODY_INPUTS("T", T, "target"),
    BODY_INPUTS("S", S, "servicer"),
    INPUT(joint_angle, "rad", "joint angles"),
    INPUT(joint_rate, "rad/s", "joint rates"),
    OPTIONAL_MODE(arm_mode_cmd, "commanded mode of the arm (-1: by deploy_from and track_from)",
                  "stow|deploy|grasp|rest"),
    OPTIONAL_MODE(capture_phase, "phase of the capture, from the docking mechanism",
                  "free|contact|soft capture|hard capture|released|broken"),

    OUTPUT(joint_angle_ref, "rad", "reference of the joint angles"),
    OUTPUT(joint_rate_ref, "rad/s", "reference of the joint rates"),
    OUTPUT(joint_accel_ref, "rad/s2", "reference of the joint accelerations"),
    MODE(arm_mode, "mode of the arm", "stowed|deploy|align|close|rest|fold"),
    FLAG(grip, "1: command to close the gripper, until DEPLOY or FOLD"),
    OUTPUT(tip_Q, "m", "position of the end effector from the fixture, axes of the fixture"),
    ANGLE_OUTPUT(misalignment, "angle between X of the end effector and -X of the fixture"),
    NONNEGATIVE_OUTPUT(tip_speed, "m/s", "speed of the end effector as seen from the fixture"),
    NONNEGATIVE_OUTPUT(tip_rate, "rad/s",
                       "size of the angular velocity of the end effector relative to the fixture"),
    NONNEGATIVE_OUTPUT(
        position_error, "m",
        "distance of the end effector from its reference position; 0 except in ALIGN and CLOSE"),
    NONNEGATIVE_OUTPUT(
        angle_error, "rad",
        "angle of the end effector from its reference attitude; 0 except in ALIGN and CLOSE"),
    NONNEGATIVE_OUTPUT(manipulability, "1",
                       "sqrt(det(J J^T)) of the Jacobian in use; 0 except in ALIGN and CLOSE"),
    NONNEGATIVE_OUTPUT(damping, "1", "damping of the inverse Jacobian"),
    FLAG(limited, "1: rate limited by K_limit near a limit of the joint angle, per joint"),
    NONNEGATIVE_OUTPUT(rate_scale, "1",
                       "factor on all joint rates, by which none exceeds joint_rate_max; 0 except "
                       "in ALIGN and CLOSE"),
};

/* K.3-7 */
static void check(const Parameters *p, Problems *problems)
{
    int joints = check_arm(problems, &p->arm);
    check_inertia(problems, "J_S", p->J_S);
    check_unit_quaternion(problems, "|q_QT|", p->q_QT);
    for (int i = 0; i < joints; i++)
        if (!(p->law.angle_min[i] < p->law.angle_max[i]))
            reject_row(problems, "joint_angle_max", i, p->law.angle_max[i],
                       "must be above joint_angle_min");
}

/* ---- motion of E relative to Q ---- */
typedef struct {
    Chain arm;
    Tree tree;
    Links links;
    mat3 C_SN, C_QN;
    quat q_QN, q_EN, q_EQ;
    vec3 port, tip, w_T; /* r_Q - r_T, r_E - r_T, angular velocity of T; N axes */
    vec3 e, X;           /* position of E from Q, X axis of E; Q axes */
    double misalignment, speed, rate;
} RelativePose;

static void set_relative_pose(RelativePose *v, const Parameters *p, const Input *u)
{
    quat q_SN = canonical(u->S.q), q_TN = canonical(u->T.q);
    Speeds measured = {.w = u->S.omega};
    memcpy(measured.joint, u->joint_rate, sizeof u->joint_rate);
    set_chain(&v->arm, &p->arm);
    place_links(&v->tree, &v->links, &v->arm, u->joint_angle);
    mat3 C_TN = dcm_of_quat(q_TN);
    Twist motion = tip_twist(&v->tree, &measured);

    v->C_SN = dcm_of_quat(q_SN);
    v->q_QN = product(q_TN, p->q_QT);
    v->C_QN = dcm_of_quat(v->q_QN);
    v->q_EN = product(q_SN, tip_attitude(&p->arm, &v->tree));
    v->q_EQ = canonical(product(conjugate(v->q_QN), v->q_EN));
    v->port = tmul(C_TN, p->p_QT_T);
    v->tip = add(sub(u->S.r, u->T.r), tmul(v->C_SN, v->tree.p_E));
    v->w_T = tmul(C_TN, u->T.omega);
    v->e = mul(v->C_QN, sub(v->tip, v->port));
    v->X = dcm_of_quat(v->q_EQ).row[0];

    vec3 v_E = add(sub(u->S.v, u->T.v), tmul(v->C_SN, velocity_at(motion, v->tree.p_E)));
    v->misalignment = arc_tangent(sqrt(v->X.y * v->X.y + v->X.z * v->X.z), -v->X.x);
    v->speed = norm(sub(v_E, cross(v->w_T, v->tip)));
    v->rate = norm(sub(tmul(v->C_SN, motion.w), v->w_T));
}

/* ---- modes ---- */
static vec3 standoff_tip(const Parameters *p) { return vec(p->standoff, 0, 0); }
static vec3 seated_tip(const Parameters *p) { return vec(-p->seat_depth, 0, 0); }

static int is_captured(const Input *u) { return u->capture_phase == 2 || u->capture_phase == 3; }

static double commanded_mode(const Parameters *p, const Input *u, double t)
{
    if (u->arm_mode_cmd >= 0) return u->arm_mode_cmd;
    return reached(t, p->track_from) ? 2 : reached(t, p->deploy_from);
}

/* true if all conditions for gripping have held for grip_dwell seconds */
/* K.3-2 */
static int may_grip(const Parameters *p, const RelativePose *v, State *x, double t)
{
    int inside = norm(sub(v->e, seated_tip(p))) <= p->grip_distance &&
                 v->misalignment <= p->grip_angle && v->speed <= p->grip_speed &&
                 v->rate <= p->grip_rate;
    if (inside && !x->in_grip_window) x->t_grip_window = t;
    x->in_grip_window = inside;
    return inside && reached(t, x->t_grip_window + p->grip_dwell);
}

static int is_at_standoff(const Parameters *p, const RelativePose *v)
{
    return norm(sub(v->e, standoff_tip(p))) <= p->gate_distance && v->misalignment <= p->gate_angle;
}

/* K.3-1 */
static int next_mode(const Parameters *p, const Input *u, const RelativePose *v, State *x, double t)
{
    int mode = (int)x->mode, captured = is_captured(u);
    int deployed = reached(t, x->t_mode + p->T_deploy),
        aligned = reached(t, x->t_mode + p->T_align);
    int gripped = mode == CLOSE && may_grip(p, v, x, t);
    double cmd = commanded_mode(p, u, t);
    const struct {
        int from, to, when;
    } change[CHANGES] = {
        {STOWED, DEPLOY, cmd == 1 || cmd == 2},
        {DEPLOY, FOLD, cmd == 0},
        {DEPLOY, ALIGN, cmd == 2 && deployed},
        {ALIGN, DEPLOY, cmd == 1},
        {ALIGN, FOLD, cmd == 0},
        {ALIGN, CLOSE, aligned && is_at_standoff(p, v)},
        {CLOSE, DEPLOY, cmd == 1},
        {CLOSE, FOLD, cmd == 0},
        {CLOSE, REST, gripped},
        {REST, DEPLOY, cmd == 1 && !captured},
        {REST, FOLD, cmd == 0 && !captured},
        {FOLD, DEPLOY, cmd >= 1},
        {FOLD, STOWED, deployed},
    };
    if (mode != STOWED && mode != REST && (cmd == 3 || captured)) return REST;
    for (int i = 0; i < CHANGES; i++) {
        if (change[i].from != mode || !change[i].when) continue;
        if (change[i].to == REST) x->grip = 1;
        return change[i].to;
    }
    return mode;
}

/* q_EQ rotated along the shortest arc until X_E = -X_Q; the roll angle about X_E does not change */
static quat aligned_attitude(const RelativePose *v)
{
    double g = sqrt(larger(0, (1 - v->X.x) / 2));
    quat arc = g < 1e-6 ? (quat){0, 0, 0, 1} : (quat){g, 0, -v->X.z / (2 * g), v->X.y / (2 * g)};
    return canonical(product(arc, v->q_EQ));
}

/* K.3-3 */
static void begin_mode(const Parameters *p, const Input *u, const RelativePose *v, State *x,
                       int mode)
{
    const double *from = mode == REST ? u->joint_angle : x->q_ref;
    memcpy(x->q_a, from, sizeof x->q_a);
    memcpy(x->dq_a, u->joint_rate, sizeof x->dq_a);
    if (mode == ALIGN) {
        x->e_0 = v->e;
        x->q_m = aligned_attitude(v);
        x->phi_0 = rotation_vector(product(conjugate(x->q_m), v->q_EQ));
    } else {
        x->e_0 = standoff_tip(p);
        x->phi_0 = vec(0, 0, 0);
    }
    if (mode == DEPLOY || mode == FOLD) x->grip = 0;
    x->in_grip_window = 0;
}

static void change_mode(const Parameters *p, const Input *u, const RelativePose *v, State *x,
                        double t)
{
    int mode = next_mode(p, u, v, x, t);
    if (mode == x->mode) return;
    begin_mode(p, u, v, x, mode);
    x->mode = mode;
    x->t_mode = t;
}

/* ---- references ---- */
typedef struct { double s, d, dd; } Polynomial; /* S(x) and its time derivatives */

static Polynomial rise_at(double elapsed, double T)
{
    double x = clamp(elapsed / T, 0, 1), y = 1 - x;
    return (Polynomial){x * x * x * (10 - x * (15 - 6 * x)), 30 * x * x * y * y / T,
                        60 * x * y * (y - x) / (T * T)};
}

static void set_joint_path(const State *x, const double goal[], Polynomial r, int joints, Output *y)
{
    for (int i = 0; i < joints; i++) {
        double path = goal[i] - x->q_a[i];
        y->joint_angle_ref[i] = x->q_a[i] + r.s * path;
        y->joint_rate_ref[i] = r.d * path;
        y->joint_accel_ref[i] = r.dd * path;
    }
}

static void set_joint_stop(const State *x, double T, double elapsed, int joints, Output *y)
{
    double f = smaller(elapsed / T, 1);
    for (int i = 0; i < joints; i++) {
        y->joint_angle_ref[i] = x->q_a[i] + x->dq_a[i] * T * (f - f * f / 2);
        y->joint_rate_ref[i] = x->dq_a[i] * (1 - f);
        y->joint_accel_ref[i] = f < 1 ? -x->dq_a[i] / T : 0;
    }
}

static void track_fixture(const Parameters *p, const Input *u, RelativePose *v, const State *x,
                          double elapsed, Output *y)
{
    int closing = x->mode == CLOSE;
    Polynomial r = rise_at(elapsed, closing ? p->T_close : p->T_align);
    vec3 path = sub(closing ? seated_tip(p) : standoff_tip(p), x->e_0);
    vec3 from_T = add(v->port, tmul(v->C_QN, add(x->e_0, scale(r.s, path)))); /* x_r - r_T */
    vec3 dphi = scale(-r.d, x->phi_0), rate_of_phi = tmul(v->C_QN, tmul(dcm_of_quat(x->q_m), dphi));
    quat q_r = product(v->q_QN, product(x->q_m, quat_of_rotation_vector(scale(1 - r.s, x->phi_0))));

    vec3 v_r = sum3(u->T.v, cross(v->w_T, from_T), tmul(v->C_QN, scale(r.d, path)));
    vec3 w_r = add(v->w_T, rate_of_phi), position_error = sub(from_T, v->tip);
    vec3 attitude_error = rotation_vector(product(q_r, conjugate(v->q_EN)));
    vec3 linear = add(sub(v_r, u->S.v), scale(p->K_E[0], position_error));
    vec3 angular = add(w_r, scale(p->K_E[1], attitude_error));
    Twist xd = {mul(v->C_SN, linear), mul(v->C_SN, angular)};
    Composite base = body_at_S(p->mass_0, p->J_S);
    set_link_inertias(&v->links, &v->arm);
    set_mass_matrix(&v->tree, &v->links, &base);
    JointRates rates =
        joint_rates(&p->law, &v->tree, u->S.omega, u->joint_angle, u->joint_rate, xd);

    memcpy(y->joint_angle_ref, x->q_ref, sizeof x->q_ref);
    memcpy(y->joint_rate_ref, rates.dq, sizeof rates.dq);
    memcpy(y->limited, rates.limited, sizeof rates.limited);
    y->position_error = norm(position_error);
    y->angle_error = norm(attitude_error);
    y->manipulability = rates.manipulability;
    y->damping = rates.damping;
    y->rate_scale = rates.rate_scale;
}

static void guide(const Parameters *p, const Input *u, State *x, Output *y, double t, double period)
{
    RelativePose v;
    set_relative_pose(&v, p, u);
    int joints = (int)v.tree.joints;
    change_mode(p, u, &v, x, t);
    int mode = (int)x->mode, tracking = mode == ALIGN || mode == CLOSE;
    double elapsed = t - x->t_mode;

    *y = (Output){.arm_mode = mode,
                  .grip = x->grip,
                  .tip_Q = v.e,
                  .misalignment = v.misalignment,
                  .tip_speed = v.speed,
                  .tip_rate = v.rate};
    if (mode == STOWED) memcpy(y->joint_angle_ref, p->joint_angle_stowed, sizeof x->q_ref);
    if (mode == DEPLOY) set_joint_path(x, p->law.ready, rise_at(elapsed, p->T_deploy), joints, y);
    if (mode == FOLD)
        set_joint_path(x, p->joint_angle_stowed, rise_at(elapsed, p->T_deploy), joints, y);
    if (mode == REST) set_joint_stop(x, p->T_rest, elapsed, joints, y);
    if (tracking) track_fixture(p, u, &v, x, elapsed, y);
    for (int i = 0; i < ARM_JOINTS; i++) {
        if (i >= joints) y->joint_angle_ref[i] = 0;
        x->q_ref[i] = y->joint_angle_ref[i] + (tracking ? period * y->joint_rate_ref[i] : 0);
    }
}

/* K.3-6 */
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    *x = (State){.q_m = {1, 0, 0, 0}};
    memcpy(x->q_ref, p->joint_angle_stowed, sizeof x->q_ref);
    State first = *x;
    guide(p, u, &first, y, t, 0);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        guide(p, u, x, y, s.t, s.period);
}

FMU_MODEL("arm_guidance",
          "Guidance of an arm: deploy, align with a grapple fixture, close, grip, rest");
