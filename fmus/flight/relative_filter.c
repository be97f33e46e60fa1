/* relative_filter.c - extended Kalman filter: motion of the target relative to the servicer, from
 * poses that arrive late.
 *
 *   r_GK_K = C_KN (C_TN^T d - rho) - C_KS p_KS_S + noise,    q_TK = (q_SN q_KS)* q_TN rot(noise)
 *
 * K: camera; G: origin of the tracked model, at d in T axes from the centre of mass of the target;
 * rho: position of S relative to T; p_KS_S: place of the camera in S axes.
 *
 * A pose belongs to the sample of its time stamp. Two estimates are stored: the anchor at the last
 * pose, or at the oldest stored sample if that is later; and the head at the present sample. A
 * pose moves the anchor to its sample. If the pose is used, the head is propagated again from the
 * anchor, over the stored samples of the servicer, at most 15. So poses that arrive late, but in the
 * order of their stamps, have the same effect as without delay. A pose older than the anchor is not
 * used. Equations: docs/models.md F.6. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "body_rows.h"
#include "earth.h"
#include "measurements.h"
#include "pose_update.h"
#include "rigid_body.h"

typedef struct {
    double sample_period;
    MotionModel model;
    mat3 J_T;
    vec3 p_GT_T;
    double mass_hat;
    vec3 rho_0_H, drho_0_H, sigma_TN_0, omega_TN_T_0;
    StartSigmas sigma_0;
    PoseModel pose;
    double use_time_stamp;
    GateParameters gate;
} Parameters;
typedef struct {
    vec3 r_GK_K;
    quat q_TK;
    double pose_time, pose_valid;
    Body S;
    vec3 F_cmd_S;
} Input;
typedef struct {
    Estimate head, anchor;
    /* index: number of the last sample; late: number of poses too old or from the future */
    double started, index, anchor_index, late;
    Track pose;
    Servicer ring[HISTORY];
} State;
typedef struct {
    Body T, S;
    Ratios inertia_hat;
    vec3 p_GT_T_hat, a_hat_N;
    vec3 sigma_rho_N, sigma_drho_N, sigma_theta_T, sigma_omega_T;
    Ratios sigma_inertia;
    vec3 sigma_p_T, sigma_acc_N;
    double pose_nis, pose_rejected, pose_late, pose_age, relative_valid;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.sample_period = 0.1,
          .model = {.planet = {EARTH},
                    .use_J2 = 1,
                    .use_gravity_gradient = 1,
                    .sigma_a = 3e-5,
                    .sigma_thrust = 0.1,
                    .sigma_alpha = 3e-5,
                    .sigma_acc = 1e-6},
          .J_T = {{{100, 0, 0}, {0, 150, 0}, {0, 0, 90}}},
          .p_GT_T = {0.6, 0, 0},
          .mass_hat = 95,
          .rho_0_H = {0, 20, 0},
          .sigma_0 = {.rho = 1, .drho = 0.05, .att = 0.5, .omega = 0.02, .acc = 3e-4},
          .pose = {.camera = CAMERA_START,
                   .noise = POSE_NOISE_START,
                   .sigma_mount = 1e-4,
                   .flip_axis = {1, 0, 0}},
          .use_time_stamp = 1,
          .gate = {.gate = 22.46, .reset_after = 10, .age_max = 5, .acquire = 1}},
    .u = {.q_TK = {1, 0, 0, 0},
          .pose_time = -1,
          .S = {.r = {7158140, 0, 0}, .v = {0, 7462.286, 0}, .q = {1, 0, 0, 0}}},
};

static const Variable variables[] = {
    GRID(sample_period, "sample period of the software"),
    NONNEGATIVE_AS("mu", model.planet.mu, "m3/s2",
                   "gravitational parameter of the planet; 0 = deep space"),
    NONNEGATIVE_AS("R_E", model.planet.R_E, "m", "equatorial radius of the planet"),
    NONNEGATIVE_AS("J2", model.planet.J2, "1", "second zonal harmonic of the planet"),
    ROW_AS(PARAMETER_ROW, p, "use_J2", model.use_J2, 1, "1",
           "1: the software models the oblateness of the planet", SWITCH_VALUE),
    ROW_AS(PARAMETER_ROW, p, "use_gravity_gradient", model.use_gravity_gradient, 1, "1",
           "1: the software models the gravity gradient on the target", SWITCH_VALUE),
    MATRIX(J_T, "kg.m2",
           "inertia of the target as known to the software, body axes; its scale does "
           "not matter"),
    PARAMETER(p_GT_T, "m",
              "position of the tracked point from the target's centre of mass, target "
              "axes"),
    POSITIVE(mass_hat, "kg", "mass of the servicer as known to the software"),
    PARAMETER(rho_0_H, "m",
              "position of the servicer relative to the target at the start, Hill axes"),
    PARAMETER(drho_0_H, "m/s",
              "velocity of the servicer relative to the target at the start, as seen in the Hill "
              "frame"),
    PARAMETER(sigma_TN_0, "1",
              "attitude of the target at the start, modified Rodrigues parameters"),
    PARAMETER(omega_TN_T_0, "rad/s", "angular velocity of the target at the start, target axes"),
    NONNEGATIVE_AS("sigma_rho_0", sigma_0.rho, "m",
                   "standard deviation of the position at the start, per axis"),
    NONNEGATIVE_AS("sigma_drho_0", sigma_0.drho, "m/s",
                   "standard deviation of the velocity at the start and at acquisition, per axis"),
    NONNEGATIVE_AS("sigma_att_0", sigma_0.att, "rad",
                   "standard deviation of the attitude at the start, per axis"),
    NONNEGATIVE_AS("sigma_omega_0", sigma_0.omega, "rad/s",
                   "standard deviation of the angular velocity at the start and at "
                   "acquisition, per axis"),
    NONNEGATIVE_AS("sigma_inertia_0", sigma_0.inertia, "1",
                   "standard deviation of inertia_hat at the start and at acquisition; "
                   "not estimated if 0 and sigma_kappa = 0"),
    NONNEGATIVE_AS("sigma_p_0", sigma_0.p, "m",
                   "standard deviation of p_GT_T_hat at the start and at acquisition; "
                   "not estimated if 0 and sigma_d = 0"),
    NONNEGATIVE_AS("sigma_acc_0", sigma_0.acc, "m/s2",
                   "standard deviation of a_hat_N at the start and at acquisition, per axis"),
    NONNEGATIVE_AS("sigma_a", model.sigma_a, "1",
                   "density of white acceleration noise, per axis, in m/s^1.5"),
    NONNEGATIVE_AS("sigma_thrust", model.sigma_thrust, "1",
                   "noise of the thrust: its relative error times the root of the burn time, in "
                   "s^0.5"),
    NONNEGATIVE_AS("sigma_alpha", model.sigma_alpha, "1",
                   "density of white angular acceleration noise of the target, per axis, in "
                   "rad/s^1.5"),
    NONNEGATIVE_AS("sigma_kappa", model.sigma_kappa, "1",
                   "random walk of the ratios of inertia, in 1/s^0.5"),
    NONNEGATIVE_AS("sigma_d", model.sigma_d, "1", "random walk of p_GT_T, per axis, in m/s^0.5"),
    NONNEGATIVE_AS("sigma_acc", model.sigma_acc, "1",
                   "random walk of a_hat_N, per axis, in m/s^2.5"),
    CAMERA_ROWS(pose.camera),
    POSE_NOISE_ROWS(pose.noise),
    NONNEGATIVE_AS("sigma_mount", pose.sigma_mount, "rad",
                   "uncertainty of the camera's attitude relative to N, per axis"),
    SWITCH(use_time_stamp,
           "1: a pose is used as measured at pose_time, 0: at the sample of its arrival"),
    ROW_AS(PARAMETER_ROW, p, "resolve_flip", pose.resolve_flip, 1, "1",
           "1: a pose is turned by half a turn about flip_axis if that is nearer the "
           "estimate",
           SWITCH_VALUE),
    PARAMETER_AS("flip_axis", pose.flip_axis, "1",
                 "axis of the half turn, unit vector, target axes"),
    GATE_ROWS(gate),

    INPUT(r_GK_K, "m", "measured position of the tracked point from the camera, camera axes"),
    INPUT(q_TK, "1", "measured attitude of the target relative to the camera, scalar first"),
    INPUT(pose_time, "s", "time of the pose"),
    INPUT(pose_valid, "1", "1: a pose was measured at pose_time"),
    BODY_ROWS(INPUT_ROW, u, "S", "_hat", S, "servicer as estimated"),
    INPUT(F_cmd_S, "N", "force commanded from the previous sample to this one, servicer axes"),

    BODY_OUTPUTS("T", T, "target"),
    BODY_OUTPUTS("S", S, "servicer as sampled from the inputs"),
    OUTPUT(inertia_hat, "1", "J22, J33, J12, J13, J23 of the target over J11"),
    OUTPUT(p_GT_T_hat, "m",
           "estimated position of the tracked point from the centre of mass, target "
           "axes"),
    OUTPUT(a_hat_N, "m/s2",
           "estimated unmodelled acceleration of the servicer relative to the target, N axes"),
    NONNEGATIVE_OUTPUT(sigma_rho_N, "m", "standard deviation of the relative position, N axes"),
    NONNEGATIVE_OUTPUT(sigma_drho_N, "m/s", "standard deviation of the relative velocity, N axes"),
    NONNEGATIVE_OUTPUT(sigma_theta_T, "rad", "standard deviation of the attitude, target axes"),
    NONNEGATIVE_OUTPUT(sigma_omega_T, "rad/s",
                       "standard deviation of the angular velocity, target axes"),
    NONNEGATIVE_OUTPUT(sigma_inertia, "1", "standard deviation of each element of inertia_hat"),
    NONNEGATIVE_OUTPUT(sigma_p_T, "m", "standard deviation of p_GT_T_hat, per axis"),
    NONNEGATIVE_OUTPUT(sigma_acc_N, "m/s2", "standard deviation of a_hat_N, per axis"),
    NONNEGATIVE_OUTPUT(pose_nis, "1", "normalised innovation squared of the last pose"),
    NONNEGATIVE_OUTPUT(pose_rejected, "1", "poses outside the innovation gate since the start"),
    NONNEGATIVE_OUTPUT(pose_late, "1",
                       "poses not used since the start, because too old or from the future"),
    OUTPUT(pose_age, "s", "time since pose_time of the last pose used; before the first: t + 1 s"),
    FLAG(relative_valid, "1: acquired, a pose has been used, and pose_age is at most age_max"),
};

/* F.6-8 */
static void check(const Parameters *p, Problems *problems)
{
    check_inertia(problems, "J_T", p->J_T);
    check_unit_quaternion(problems, "|q_KS|", p->pose.camera.q_KS);
    check_unit_vector(problems, "|flip_axis|", p->pose.flip_axis);
}

/* ---- start ---- */
static Ratios ratios_of(mat3 J)
{
    double k = 1 / J.row[0].x;
    return (Ratios){
        {k * J.row[1].y, k * J.row[2].z, k * J.row[0].y, k * J.row[0].z, k * J.row[1].z}};
}

static void start_estimate(const Parameters *p, const Input *u, Estimate *x)
{
    HillFrame H = hill_frame(p->model.planet.mu, u->S.r, u->S.v);
    x->rho = tmul(H.C_HN, p->rho_0_H);
    x->v = tmul(H.C_HN, rate_in_N(&H, p->rho_0_H, p->drho_0_H));
    x->q = quat_of_mrp(p->sigma_TN_0);
    x->w = p->omega_TN_T_0;
    x->kappa = ratios_of(p->J_T);
    x->d = p->p_GT_T;
    x->a = vec(0, 0, 0);
    start_covariance(&p->sigma_0, x->P);
    add_diagonal(x->P, RHO_AT, V_AT, p->sigma_0.rho * p->sigma_0.rho);
    add_diagonal(x->P, THETA_AT, W_AT, p->sigma_0.att * p->sigma_0.att);
}

/* ---- late poses: ring buffer of samples, anchor, head ---- */
static Servicer *sample_of(State *x, double index) { return &x->ring[place_of(index)]; }

/* F.6-6 */
static void move_anchor(const Parameters *p, State *x, double index)
{
    for (; x->anchor_index < index; x->anchor_index++)
        propagate_relative(&p->model, sample_of(x, x->anchor_index), &x->anchor, p->sample_period);
}

static void restart_head(const Parameters *p, State *x, double k)
{
    x->head = x->anchor;
    for (double j = x->anchor_index; j < k; j++)
        propagate_relative(&p->model, sample_of(x, j), &x->head, p->sample_period);
}

/* updates the anchor by a pose; returns 1 if the anchor changed */
/* F.6-3 */
static int use_pose(const Parameters *p, const Input *u, State *x)
{
    quat q_SN = sample_of(x, x->anchor_index)->q;
    Pose m = pose_at(&p->pose, u->r_GK_K, u->q_TK, q_SN, x->anchor.q);
    Decision verdict = ACQUISITION;
    if (x->pose.acquired > 0) {
        Estimate copy = x->anchor;
        verdict = decide(&p->gate, &x->pose, update_both(&p->pose, &copy, &m));
        if (verdict == REJECTED) return 0;
        if (verdict == ACCEPTED) x->anchor = copy;
    }
    if (verdict == ACQUISITION) {
        acquire(&p->pose, &p->sigma_0, &x->anchor, &m);
        note_acquired(&x->pose);
    }
    note_used(&x->pose, u->pose_time);
    return 1;
}

/* F.6-1, F.6-2 */
static void take_pose(const Parameters *p, const Input *u, State *x, double k)
{
    x->pose.last = u->pose_time;
    double m = p->use_time_stamp ? nearest_whole(u->pose_time / p->sample_period) : k;
    if (m < x->anchor_index || m > k) {
        x->late++;
        return;
    }
    move_anchor(p, x, m);
    if (use_pose(p, u, x)) restart_head(p, x, k);
}

/* ---- sampling ---- */
static void begin(const Parameters *p, const Input *u, State *x, double k)
{
    x->started = 1;
    x->index = x->anchor_index = k;
    x->late = 0;
    x->pose = new_track(&p->gate, -p->sample_period / 2);
    start_estimate(p, u, &x->anchor);
    x->head = x->anchor;
}

static Servicer coasted(Servicer s, double T)
{
    s.r = add(s.r, scale(T, s.v));
    return s;
}

/* propagates the head to sample k. Before a new sample overwrites the oldest in the ring buffer, an
 * anchor at the oldest moves to the next one. A sample skipped because the master rounds time is
 * stored as a copy of the sample before it, with the position propagated by the velocity. */
/* F.6-5 */
static void advance(const Parameters *p, const Input *u, State *x, double k)
{
    Servicer *last = sample_of(x, x->index);
    last->thrust_N = scale(1 / p->mass_hat, tmul(dcm_of_quat(last->q), u->F_cmd_S));
    for (; x->index < k; x->index++) {
        Servicer now = *sample_of(x, x->index);
        propagate_relative(&p->model, &now, &x->head, p->sample_period);
        move_anchor(p, x, x->index + 1 - (HISTORY - 1));
        *sample_of(x, x->index + 1) = coasted(now, p->sample_period);
    }
}

static Ratios sigma_ratios(const double *P)
{
    Ratios s;
    for (size_t i = 0; i < RATIOS; i++) s.k[i] = sqrt(P[(KAPPA_AT + i) * (ERRORS + 1)]);
    return s;
}

static void publish_sigmas(const double *P, Output *y)
{
    y->sigma_rho_N = sigma_at(P, ERRORS, RHO_AT);
    y->sigma_drho_N = sigma_at(P, ERRORS, V_AT);
    y->sigma_theta_T = sigma_at(P, ERRORS, THETA_AT);
    y->sigma_omega_T = sigma_at(P, ERRORS, W_AT);
    y->sigma_inertia = sigma_ratios(P);
    y->sigma_p_T = sigma_at(P, ERRORS, D_AT);
    y->sigma_acc_N = sigma_at(P, ERRORS, ACC_AT);
}

/* F.6-4 */
static void publish(const Parameters *p, const Input *u, const State *x, Output *y, double t)
{
    const Estimate *e = &x->head;
    y->S = u->S;
    y->S.q = canonical(u->S.q);
    y->T = (Body){sub(u->S.r, e->rho), sub(u->S.v, e->v), e->q, e->w};
    y->inertia_hat = e->kappa;
    y->p_GT_T_hat = e->d;
    y->a_hat_N = e->a;
    publish_sigmas(e->P, y);
    y->pose_nis = x->pose.nis;
    y->pose_rejected = x->pose.rejected;
    y->pose_late = x->late;
    y->pose_age = age(&x->pose, t);
    y->relative_valid = is_valid(&p->gate, &x->pose, t);
}

static void filter(const Parameters *p, const Input *u, State *x, Output *y, Sample s)
{
    if (x->started > 0) advance(p, u, x, s.index);
    else begin(p, u, x, s.index);
    *sample_of(x, s.index) = (Servicer){u->S.r, u->S.v, canonical(u->S.q), vec(0, 0, 0)};
    if (is_new(&x->pose, u->pose_time, u->pose_valid)) take_pose(p, u, x, s.index);
    publish(p, u, x, y, s.t);
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    begin(p, u, x, 0);
    x->started = 0;
    publish(p, u, x, y, t);
}

/* F.6-7 */
static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        filter(p, u, x, y, s);
}

FMU_MODEL("relative_filter",
          "Motion of the target relative to the servicer by an extended Kalman filter");
