/* pose_sensor.c - camera that measures position and attitude of the target, with range-dependent
 * noise and latency.
 *
 *   r = C_KN ((r_T - r_S) + C_TN^T p_GT_T) - C_KS p_KS_S,     q = (q_SN q_KS)* q_TN
 *   r_GK_K = r + sigma_r(|r|) (o) z_0..2,                     q_TK = q rot(sigma_t(|r|) z_3..5)
 *
 * K: camera; p_KS_S, q_KS: its mounting; G: origin of the model of the target that the camera
 * tracks; z: standard normal draws; (o): product element by element. Outliers, flips (half a turn
 * about flip_axis, for a target with this symmetry) and a fault (drift of the position, rotation of
 * the attitude) are added; pose_valid does not show them. A sample is published after `latency`,
 * from a ring buffer of the last 8. Equations: docs/models.md F.2. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "mounting.h"
#include "pose_noise.h"
#include "sensor.h"
#include "small_rotation.h"

typedef struct {
    double sample_period;
    RandomStream random;
    Camera camera;
    vec3 p_GT_T;
    PoseNoise noise;
    double fov, range_min, range_max, latency;
    double p_outlier, outlier_r, outlier_theta, p_flip;
    vec3 flip_axis;
    Sun sun;
    Outage outage;
    double fault_start, fault_duration;
    vec3 fault_drift_K, fault_theta_T;
} Parameters;
typedef struct {
    vec3 r_TN_N;
    quat q_TN;
    vec3 r_SN_N;
    quat q_SN;
} Input;
typedef struct {
    vec3 r_GK_K;
    quat q_TK;
    double pose_time, pose_valid, pose_status;
} Output;
LATE_STATE;
MODEL_STRUCT;

enum {
    OUT_OF_VIEW = 1,
    OUT_OF_RANGE = 2,
    SUN_IN_CONE = 4,
    IN_OUTAGE = 8,
    DROPPED = 16,
    OUTLIER = 32,
    FLIP = 64
};

static const Model start = {
    .p = {.sample_period = 0.5,
          .random = {.stream = 3},
          .camera = CAMERA_START,
          .p_GT_T = {0.6, 0, 0},
          .noise = POSE_NOISE_START,
          .fov = 0.5236,
          .range_min = 0.5,
          .range_max = 100,
          .latency = 0.3,
          .outlier_r = 2,
          .outlier_theta = 1,
          .flip_axis = {1, 0, 0},
          .sun = {.direction = {1, 0, 0}}},
    .u = {.r_TN_N = {20, 0, 0}, .q_TN = {1, 0, 0, 0}, .q_SN = {1, 0, 0, 0}},
};

static const Variable variables[] = {
    SENSOR_PERIOD_ROW,
    RANDOM_ROWS(random),
    CAMERA_ROWS(camera),
    PARAMETER(p_GT_T, "m",
              "position of the tracked point from the target's centre of mass, target axes"),
    POSE_NOISE_ROWS(noise),
    NONNEGATIVE(fov, "rad", "half angle of the field of view about the boresight"),
    NONNEGATIVE(range_min, "m", "no measurement at a smaller distance"),
    NONNEGATIVE(range_max, "m", "no measurement at a larger distance"),
    LATENCY_ROW,
    NONNEGATIVE(p_outlier, "1", "probability of an outlier"),
    NONNEGATIVE(outlier_r, "m", "largest outlier of the position, per axis"),
    NONNEGATIVE(outlier_theta, "rad", "largest outlier of the attitude, per axis"),
    NONNEGATIVE(p_flip, "1",
                "probability of an attitude that is wrong by half a turn about flip_axis"),
    PARAMETER(flip_axis, "1", "axis of the half turn of p_flip, unit vector, target axes"),
    SUN_ROWS(sun),
    OUTAGE_ROWS(outage),
    PARAMETER(fault_start, "s",
              "poses are wrong, but marked valid, from this time on, for fault_duration"),
    NONNEGATIVE(fault_duration, "s", "duration of the fault; 0 = no fault"),
    PARAMETER(fault_drift_K, "m/s", "drift of the position during the fault, camera axes"),
    PARAMETER(fault_theta_T, "rad",
              "constant rotation vector added to the attitude during the fault, target axes"),

    INPUT(r_TN_N, "m", "position of the target, N axes"),
    INPUT(q_TN, "1", "attitude of the target relative to N, scalar first"),
    INPUT(r_SN_N, "m", "position of the servicer, N axes"),
    INPUT(q_SN, "1", "attitude of the servicer relative to N, scalar first"),

    OUTPUT(r_GK_K, "m", "measured position of the tracked point from the camera, camera axes"),
    OUTPUT(q_TK, "1", "measured attitude of the target relative to the camera, scalar first"),
    OUTPUT(pose_time, "s", "time of the published sample; -1 = none yet"),
    FLAG(pose_valid, "1: a measurement was taken at pose_time"),
    NONNEGATIVE_OUTPUT(pose_status, "1",
                       "sum of 1 out of view, 2 out of range, 4 Sun in cone, 8 outage, "
                       "16 dropped, 32 outlier, 64 flip"),
};

static void check(const Parameters *p, Problems *problems)
{
    check_random(problems, &p->random);
    check_unit_quaternion(problems, "|q_KS|", p->camera.q_KS);
    check_unit_vector(problems, "|flip_axis|", p->flip_axis);
    check_unit_vector(problems, "|sun_N|", p->sun.direction);
    check_probability(problems, "p_drop", p->outage.p_drop);
    check_probability(problems, "p_outlier", p->p_outlier);
    check_probability(problems, "p_flip", p->p_flip);
    check_range(problems, p->range_min, p->range_max);
    check_latency(problems, p->latency, p->sample_period);
}

static vec3 true_position(const Parameters *p, const Input *u, quat q_KN)
{
    vec3 point = add(sub(u->r_TN_N, u->r_SN_N), tmul(dcm_of_quat(canonical(u->q_TN)), p->p_GT_T));
    return sub(mul(dcm_of_quat(q_KN), point),
               mul(dcm_of_quat(canonical(p->camera.q_KS)), p->camera.p_KS_S));
}

static int status(const Parameters *p, vec3 r, quat q_KN, double t, const Draws *d)
{
    double R = norm(r);
    return OUT_OF_VIEW * (angle(r, vec(1, 0, 0)) > p->fov) |
           OUT_OF_RANGE * (R < p->range_min || R > p->range_max) |
           SUN_IN_CONE * sun_in_cone(&p->sun, q_KN) | IN_OUTAGE * in_outage(&p->outage, t) |
           DROPPED * dropped(&p->outage, uniform(d, 6)) | OUTLIER * (uniform(d, 7) < p->p_outlier) |
           FLIP * (uniform(d, 14) < p->p_flip);
}

static Output pose_with_noise(const Parameters *p, vec3 r, quat q, const Draws *d)
{
    double R = norm(r);
    vec3 dr = times(position_noise(&p->noise, R), normals(d, 0));
    vec3 dtheta = scale(attitude_noise(&p->noise, R), normals(d, 3));
    return (Output){.r_GK_K = add(r, dr), .q_TK = product(q, rotation(dtheta))};
}

static void add_outliers(const Parameters *p, Output *pose, int status_bits, const Draws *d)
{
    if (status_bits & OUTLIER) {
        pose->r_GK_K = add(pose->r_GK_K, scale(p->outlier_r, symmetric_uniforms(d, 8)));
        pose->q_TK =
            product(pose->q_TK, rotation(scale(p->outlier_theta, symmetric_uniforms(d, 11))));
    }
    if (status_bits & FLIP)
        pose->q_TK = product(pose->q_TK, (quat){0, p->flip_axis.x, p->flip_axis.y, p->flip_axis.z});
}

/* adds drift and rotation by a fault of the tracker, which pose_valid and pose_status do not
 * show */
static void add_fault(const Parameters *p, Output *pose, double t)
{
    double elapsed = t - p->fault_start;
    if (!reached(t, p->fault_start) || reached(t, p->fault_start + p->fault_duration)) return;
    pose->r_GK_K = add(pose->r_GK_K, scale(elapsed, p->fault_drift_K));
    pose->q_TK = product(pose->q_TK, rotation(p->fault_theta_T));
}

static Output measured_pose(const Parameters *p, const Input *u, Sample s)
{
    const Draws d = draws_of_sample(&p->random, s.index);
    quat q_KN = canonical(product(u->q_SN, p->camera.q_KS));
    vec3 r = true_position(p, u, q_KN);
    int status_bits = status(p, r, q_KN, s.t, &d), valid = status_bits % OUTLIER == 0;
    Output pose = {.q_TK = {1, 0, 0, 0}};
    if (valid) {
        pose = pose_with_noise(p, r, product(conjugate(q_KN), canonical(u->q_TN)), &d);
        add_outliers(p, &pose, status_bits, &d);
        add_fault(p, &pose, s.t);
        pose.q_TK = canonical(pose.q_TK);
    }
    pose.pose_time = s.t;
    pose.pose_valid = valid;
    pose.pose_status = status_bits;
    return pose;
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    (void)p, (void)u, (void)t;
    *x = (State){.ring = {{0}}};
    *y = (Output){.q_TK = {1, 0, 0, 0}, .pose_time = -1};
}

LATE_STEP(measured_pose)

FMU_MODEL("pose_sensor", "Camera that measures the pose of the target, with noise and latency");
