/* sync_guidance.c - synchronised approach: reference position on the grasp axis of a tumbling
 * target, reference attitude with axis X along it, towards the target.
 *
 *   rho* = L(t) C_HT p_T,     L = rho_M - (rho_M - rho_0) exp(-beta t)
 *   D:  i = -C_HT p_T,   u = i x z_H,   k = u/|u|,   j = k x i
 *
 * p_T: grasp axis in T; i, j, k: axes of D; z_H: orbit normal. rho* and the attitude of D are
 * published with two derivatives as seen in N. With range_input = 1, L and its derivatives are
 * inputs; with frame = 1, D is the carried frame of carried_frame.h, which begins at the direction
 * of the servicer and is steered to the grasp axis. A sample with active = 0 resets the state: the
 * next active sample is a first sample. While the grasp axis is within guard_angle of the orbit
 * normal, k is the k of the last sample outside this guard, constant in H and made perpendicular to
 * i; when the axis leaves the guard, k jumps. With roll_rate_max and roll_accel_max above 0, D does
 * not jump and turns about i within these limits (limited_roll.h). The software knows the model of
 * the target (inertia, gravity gradient, Keplerian orbit rate), but its disturbances only with
 * know_M_dist = 1 and frame = 0. Source: Zhu & Yang 2009, equations (5) to (7) and (10);
 * derivatives: docs/models.md A.4. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "body_rows.h"
#include "carried_frame.h"
#include "directions.h"
#include "earth.h"
#include "limited_roll.h"
#include "orbit.h"
#include "reference_rows.h"
#include "rigid_body.h"
#include "sinusoid.h"

#define RATIOS 5

typedef struct {
    double mu;
    mat3 J_T;
    vec3 p_T;
    double rho_M, rho_0, beta, know_M_dist, use_gravity_gradient, guard_angle, sample_period;
    double range_input, frame, steer_input, spin_input, use_inertia_hat;
    RollLimits roll;
    Steering steering;
    Sinusoid M_dist_T;
} Parameters;
typedef struct {
    Body T, S;
    double active, L_ref, dL_ref, ddL_ref, steer_max, spin;
    double inertia_hat[RATIOS];
} Input;
typedef struct {
    vec3 k_H; /* k in H, from the last sample outside the guard */
    CarriedFrame D;
    RollState roll;
} State;
typedef struct {
    Reference ref;
    vec3 rho_H, drho_H, rho_ref_H;
    double range, beta_t, beta_p, attitude_guard, normal_angle, roll_limited;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.mu = MU_JGM3,
          .J_T = {{{100, 0, 0}, {0, 150, 0}, {0, 0, 90}}},
          .p_T = {1, 0, 0},
          .rho_M = 4,
          .rho_0 = 20,
          .beta = 1.0 / 120,
          .use_gravity_gradient = 1,
          .guard_angle = PI / 36,
          .steering = {.spin_time = 60, .k_steer = 0.02, .w_steer = 0.005}},
    .u = {.T = {.r = {7158140, 0, 0}, .v = {0, 7462.286, 0}, .q = {1, 0, 0, 0}},
          .S = {.r = {7158140, 20, 0}, .v = {-0.0208, 7462.286, 0}, .q = {1, 0, 0, 0}},
          .active = 1,
          .L_ref = 4,
          .inertia_hat = {1.5, 0.9}},
};

static const Variable variables[] = {
    NONNEGATIVE(mu, "m3/s2", "gravitational parameter of the planet; 0 = deep space"),
    MATRIX(J_T, "kg.m2", "inertia of the target as known to the software, body axes"),
    PARAMETER(p_T, "1", "unit vector from the target to the grasp point, target axes"),
    POSITIVE(rho_M, "m", "final distance between the centres of mass, on the grasp axis"),
    POSITIVE(rho_0, "m", "distance between the centres of mass at t = 0, on the grasp axis"),
    NONNEGATIVE(beta, "1/s", "rate of the exponential approach"),
    SWITCH(know_M_dist,
           "1: the disturbance torque M_dist_T on the target is known; no effect with frame = 1"),
    SWITCH(use_gravity_gradient, "1: the software models the gravity gradient on the target"),
    POSITIVE(
        guard_angle, "rad",
        "angle from grasp axis to orbit normal below which the roll reference is held constant"),
    NONNEGATIVE_AS("roll_rate_max", roll.rate_max, "rad/s",
                   "frame = 0: largest roll rate of the reference attitude; 0 = no limit, roll "
                   "jumps at guard_angle"),
    NONNEGATIVE_AS("roll_accel_max", roll.acceleration_max, "rad/s2",
                   "frame = 0: largest roll acceleration of the reference attitude, used if "
                   "roll_rate_max > 0"),
    SAMPLE_PERIOD,
    SWITCH(range_input,
           "1: the distance on the grasp axis is L_ref, 0: it follows from rho_0, rho_M and beta"),
    SWITCH(
        frame,
        "0: X of D is on the grasp axis, to the target; 1: carried frame: X starts on the line of "
        "sight and is steered there (needs range_input = 1)"),
    POSITIVE_AS(
        "spin_time", steering.spin_time, "s",
        "carried frame: duration of the change from turning with H to turning with the target"),
    NONNEGATIVE_AS("k_steer", steering.k_steer, "1/s",
                   "carried frame: steering rate per sine of the angle off the grasp axis"),
    NONNEGATIVE_AS(
        "w_steer", steering.w_steer, "rad/s",
        "carried frame: limit of the steering rate by k_steer, and of that by k_integral"),
    NONNEGATIVE_AS(
        "k_integral", steering.k_integral, "1/s2",
        "carried frame: integral gain of the steering rate, per sine of the angle off the grasp "
        "axis"),
    NONNEGATIVE_AS(
        "spin_accel", steering.spin_accel, "rad/s2",
        "carried frame: largest spin-up acceleration, lengthens spin_time; 0 = no limit"),
    SWITCH(steer_input, "1: the steering rate is also limited to steer_max (needs frame = 1)"),
    SWITCH(spin_input, "1: the carried frame turns with H until spin is 1 (needs frame = 1)"),
    SWITCH(use_inertia_hat, "1: the inertia of the target is inertia_hat, 0: J_T"),
    SINUSOID_ROWS(M_dist_T, "N.m", "disturbance torque on the target, used if know_M_dist = 1"),

    BODY_INPUTS("T", T, "target"),
    BODY_INPUTS("S", S, "servicer"),
    OPTIONAL_SWITCH(active, ACTIVE_TEXT),
    OPTIONAL_INPUT(L_ref, "m", "distance between the centres of mass, used if range_input = 1"),
    OPTIONAL_INPUT(dL_ref, "m/s", "rate of L_ref, used if range_input = 1"),
    OPTIONAL_INPUT(ddL_ref, "m/s2", "acceleration of L_ref, used if range_input = 1"),
    OPTIONAL_NONNEGATIVE(steer_max, "rad/s", "largest steering rate, used if steer_input = 1"),
    OPTIONAL_SWITCH(
        spin, "1: the carried frame begins to turn with the target, until active is 0; used if "
              "spin_input = 1"),
    OPTIONAL_INPUT(inertia_hat, "1",
                   "J22, J33, J12, J13, J23 of the target over J11, used if use_inertia_hat = 1"),

    REFERENCE_ROWS(OUTPUT_ROW, y, ref),
    OUTPUT(rho_H, "m", "position of the servicer relative to the target, Hill axes"),
    OUTPUT(drho_H, "m/s", "derivative of rho_H as seen in the Hill frame"),
    OUTPUT(rho_ref_H, "m", "reference position, Hill axes"),
    NONNEGATIVE_OUTPUT(range, "m", "distance between the centres of mass"),
    ANGLE_OUTPUT(beta_t, "angle between the relative position and the grasp axis of the target"),
    ANGLE_OUTPUT(beta_p,
                 "angle between the arm axis (+X of the servicer) and the direction to the target"),
    FLAG(attitude_guard,
         "1: grasp axis within guard_angle of the orbit normal, roll reference held constant; 0 if "
         "frame = 1"),
    ANGLE_OUTPUT(normal_angle, "angle between the grasp axis and the line of the orbit normal"),
    FLAG(roll_limited, "1: the roll of the reference attitude is limited and differs from the "
                       "unlimited roll; 0 if "
                       "frame = 1"),
};

/* A.4-7 */
static void check(const Parameters *p, Problems *problems)
{
    check_inertia(problems, "J_T", p->J_T);
    check_unit_vector(problems, "p_T", p->p_T);
    if (p->guard_angle >= 1.5)
        reject(problems, "guard_angle", p->guard_angle, "must be below 1.5 rad");
    if ((p->roll.rate_max > 0) != (p->roll.acceleration_max > 0))
        reject(problems, "roll_accel_max", p->roll.acceleration_max,
               "must be above 0 if roll_rate_max is above 0, else 0");
    if (p->frame == 1 && p->range_input != 1)
        reject(problems, "frame", p->frame, "needs range_input = 1");
    if (p->steer_input == 1 && p->frame != 1)
        reject(problems, "steer_input", p->steer_input, "needs frame = 1");
    if (p->spin_input == 1 && p->frame != 1)
        reject(problems, "spin_input", p->spin_input, "needs frame = 1");
    if (p->know_M_dist == 1 && p->use_inertia_hat == 1)
        reject(problems, "know_M_dist", p->know_M_dist,
               "needs use_inertia_hat = 0: inertia_hat has no unit, the torque has N m");
}

/* inertia of the target as the software knows it: J_T or, with use_inertia_hat, the inertia divided
 * by J11, a scale without effect on free motion and gravity gradient */
static mat3 known_inertia(const Parameters *p, const Input *u)
{
    const double *k = u->inertia_hat;
    if (!p->use_inertia_hat) return p->J_T;
    return rows(vec(1, k[2], k[3]), vec(k[2], k[0], k[4]), vec(k[3], k[4], k[1]));
}

/* docs/models.md A.4.3: dw_T, angular acceleration of the target by the model of the software, T
 * axes */
static vec3 acceleration_of_target(const Parameters *p, const Input *u, mat3 C_TN, vec3 torque)
{
    const Body *T = &u->T;
    mat3 J = known_inertia(p, u);
    if (p->use_gravity_gradient) torque = add(torque, gravity_gradient(p->mu, mul(C_TN, T->r), J));
    return solve(J, sub(torque, cross(T->omega, mul(J, T->omega))));
}

/* docs/models.md A.4.3: grasp axis in H from the model of the target, with derivatives as seen in
 * H */
static Motion grasp_axis(const Parameters *p, const Input *u, const HillFrame *H, double t)
{
    const Body *T = &u->T;
    mat3 C_TN = dcm_of_quat(canonical(T->q)), C_TH = matmul_t(C_TN, H->C_HN);
    vec3 torque = p->know_M_dist ? sinusoid(&p->M_dist_T, t, t) : vec(0, 0, 0);
    vec3 domega = acceleration_of_target(p, u, C_TN, torque);

    vec3 wH_T = mul(C_TH, H->w_H);
    vec3 w = sub(T->omega, wH_T); /* angular velocity of T relative to H, T axes */
    vec3 dw = add(sub(domega, mul(C_TH, H->dw_H)), cross(w, wH_T));
    vec3 dp = cross(w, p->p_T);
    return (Motion){tmul(C_TH, p->p_T), tmul(C_TH, dp),
                    tmul(C_TH, add(cross(dw, p->p_T), cross(w, dp)))};
}

/* L(t) by (10) of the paper and its derivatives; with range_input = 1 the inputs L_ref, dL_ref,
 * ddL_ref */
/* A.4-5 */
static Radius reference_radius(const Parameters *p, const Input *u, double t)
{
    if (p->range_input) return (Radius){u->L_ref, u->dL_ref, u->ddL_ref};
    double decay = (p->rho_M - p->rho_0) * exponential(-p->beta * t), L1 = p->beta * decay;
    return (Radius){p->rho_M - decay, L1, -p->beta * L1};
}

/* reference position by (10) of the paper and its derivatives as seen in H */
static Motion reference_position(Radius r, Motion axis)
{
    return (Motion){scale(r.L, axis.x), add(scale(r.d, axis.x), scale(r.L, axis.d)),
                    sum3(scale(r.dd, axis.x), scale(2 * r.d, axis.d), scale(r.L, axis.dd))};
}

/* (6) of the paper: u = i x z_H */
static Motion roll_vector(Motion i)
{
    vec3 z = vec(0, 0, 1);
    return (Motion){cross(i.x, z), cross(i.d, z), cross(i.dd, z)};
}

/* docs/models.md A.4.5: attitude, rate and acceleration of D relative to N, from its axes
 * i, j, k in H */
static void publish_attitude(const HillFrame *H, Motion i, Motion j, Motion k, Reference *ref)
{
    mat3 C_DH = rows(i.x, j.x, k.x);
    vec3 w_DH = frame_rate(i, j, k), wH_D = mul(C_DH, H->w_H);

    ref->q = quat_of_dcm(matmul(C_DH, H->C_HN));
    ref->omega = add(w_DH, wH_D);
    ref->alpha = sub(add(frame_acceleration(i, j, k), mul(C_DH, H->dw_H)), cross(w_DH, wH_D));
}

/* docs/models.md A.4.5: within guard_angle of the orbit normal u = k_held - (k_held.i) i, with
 * k_held (`held`) constant in H */
/* A.4-2 */
static void reference_attitude(const Parameters *p, const HillFrame *H, Motion axis, vec3 *held,
                               Output *y)
{
    Motion i = neg_motion(axis), u = roll_vector(i);
    y->attitude_guard = norm(u.x) < sine(p->guard_angle);
    if (y->attitude_guard) u = perpendicular_part(*held, i);
    Motion k = normalised(u);
    publish_attitude(H, i, cross_motion(k, i), k, &y->ref);
    if (!y->attitude_guard) *held = k.x;
}

/* converts a vector in H axes with derivatives as seen in H to N axes, with derivatives as seen in
 * N */
static Motion in_N(const HillFrame *H, Motion a)
{
    return (Motion){tmul(H->C_HN, a.x), tmul(H->C_HN, rate_in_N(H, a.x, a.d)),
                    tmul(H->C_HN, add(a.dd, transport(H, a.x, a.d)))};
}

/* docs/models.md A.4.6: with a limited roll the reference attitude is the frame D of
 * limited_roll.h. Its angular velocity is w = i x i' + r i, in D axes, with the roll rate r about
 * i. */
/* A.4-3 */
static void limit_roll(const Parameters *p, const HillFrame *H, Motion axis, RollState *x,
                       Output *y, double t, double period)
{
    Motion i = in_N(H, neg_motion(axis));
    Roll rule = {i.x, dcm_of_quat(y->ref.q).row[2], y->ref.omega.x, y->ref.alpha.x};
    Roll D = limited_roll(p->roll, x, rule, y->attitude_guard == 1, t, period);
    y->roll_limited = x->mode == ROLL_FREE;
    if (!y->roll_limited) return;

    vec3 j = cross(D.k, D.i);
    y->ref.q = quat_of_dcm(rows(D.i, j, D.k));
    y->ref.omega = vec(D.rate, -dot(i.d, D.k), dot(i.d, j));
    y->ref.alpha = vec(D.acceleration, D.rate * dot(i.d, j) - dot(i.dd, D.k),
                       D.rate * dot(i.d, D.k) + dot(i.dd, j));
}

/* docs/models.md A.4.1, A.4.2: publishes the reference position in N axes, with derivatives as seen
 * in N instead of H */
/* A.4-1 */
static void publish_position(const HillFrame *H, Motion ref, Output *y)
{
    y->rho_ref_H = ref.x;
    y->ref.rho = tmul(H->C_HN, ref.x);
    y->ref.drho = tmul(H->C_HN, rate_in_N(H, ref.x, ref.d));
    y->ref.ddrho = tmul(H->C_HN, add(ref.dd, transport(H, ref.x, ref.d)));
}

static void publish_relative_state(const Input *u, const HillFrame *H, vec3 axis_H, Output *y)
{
    vec3 rho_N = sub(u->S.r, u->T.r), arm_N = dcm_of_quat(canonical(u->S.q)).row[0];
    y->rho_H = mul(H->C_HN, rho_N);
    y->drho_H = rate_in_frame(H, y->rho_H, mul(H->C_HN, sub(u->S.v, u->T.v)));
    y->range = norm(rho_N);
    y->beta_t = angle(y->rho_H, axis_H);
    y->beta_p = angle(arm_N, neg(rho_N));
    y->normal_angle = arc_tangent(norm(vec(axis_H.x, axis_H.y, 0)), fabs(axis_H.z));
}

/* publishes the reference of carried_frame.h in N axes and propagates D to the next sample; at
 * range 0 of a first sample the direction is undefined: the reference is NaN, which the FMI adapter
 * rejects */
/* A.4-4 */
static void guide_by_carried_frame(const Parameters *p, const Input *u, const HillFrame *H,
                                   CarriedFrame *D, Output *y, double t, double period)
{
    const Body *T = &u->T;
    Steering steering = p->steering;
    if (p->steer_input) steering.w_steer = clamp(u->steer_max, 0, p->steering.w_steer);
    mat3 C_TN = dcm_of_quat(canonical(T->q)), C_SN = dcm_of_quat(canonical(u->S.q));
    vec3 dw_T = acceleration_of_target(p, u, C_TN, vec(0, 0, 0));
    AngularMotion with_H = {tmul(H->C_HN, H->w_H), tmul(H->C_HN, H->dw_H)};
    AngularMotion with_T = {tmul(C_TN, T->omega), tmul(C_TN, dw_T)};
    if (!D->carried)
        *D = (CarriedFrame){.carried = 1, .q_DN = carried_start(sub(u->S.r, T->r), C_SN)};
    if (!D->turns && (!p->spin_input || u->spin))
        begin_turning(&steering, D, with_H.w, with_T.w, t);
    CarriedMotion motion = carried_rate(&steering, D, with_H, with_T, tmul(C_TN, p->p_T), t);
    AngularMotion W = motion.D;
    mat3 C_DN = dcm_of_quat(D->q_DN);
    Motion ref = carried_position(reference_radius(p, u, t), neg(C_DN.row[0]), W);

    y->rho_ref_H = mul(H->C_HN, ref.x);
    y->attitude_guard = 0;
    y->ref = (Reference){ref.x, ref.d, ref.dd, D->q_DN, mul(C_DN, W.w), mul(C_DN, W.dw)};
    D->q_DN = integrate_carried(D->q_DN, W, period);
    D->b_D = integrated_steering(&steering, D->b_D, motion.db_D, period);
}

static void guide(const Parameters *p, const Input *u, State *x, Output *y, double t, double period)
{
    HillFrame H = hill_frame(p->mu, u->T.r, u->T.v);
    Motion axis = grasp_axis(p, u, &H, t);
    publish_relative_state(u, &H, axis.x, y);
    if (p->frame) {
        guide_by_carried_frame(p, u, &H, &x->D, y, t, period);
        return;
    }
    publish_position(&H, reference_position(reference_radius(p, u, t), axis), y);
    reference_attitude(p, &H, axis, &x->k_H, y);
    if (p->roll.rate_max > 0) limit_roll(p, &H, axis, &x->roll, y, t, period);
}

/* state before the first sample; a first sample inside the guard, with the grasp axis near z of
 * H, thus uses k = x of H */
static const State none = {.k_H = {1, 0, 0}};

/* A.4-6 */
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    State first = *x = none;
    guide(p, u, &first, y, t, 0);
    if (!u->active) y->attitude_guard = y->roll_limited = 0;
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s)) {
        if (u->active) guide(p, u, x, y, s.t, s.period);
        else initialize(p, u, x, y, s.t);
    }
}

FMU_MODEL("sync_guidance",
          "Guidance for the synchronised approach to the grasp point of a tumbling target");
