/* attitude_filter.c - multiplicative extended Kalman filter: attitude and gyro bias from gyro and
 * star tracker.
 *
 *   q = q_hat rot(theta),  error state (theta, b)
 *   propagation by an increment    phi = dtheta - T b,   q <- q quat_of_rotation_vector(phi)
 *   star tracker of sample m       q_m = q_AN q_AS* D,   y = err(q* q_m)
 *
 * A: axes of the star tracker; m: sample at which it measured; T: sample period; b: bias of the
 * gyro; dtheta: increment of the gyro; D: quaternion of the servicer's rotation from sample m to
 * the present sample (not a frame here); y: residual, with err the small rotation vector of a
 * quaternion. The published rate is the mean of the last period, or 0 if gyro_valid is 0. Source:
 * Lefferts, Markley & Shuster 1982, Farrenkopf 1978; equations: docs/models.md F.4. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "covariance.h"
#include "measurements.h"
#include "mounting.h"
#include "small_rotation.h"

enum { THETA = 0, BIAS = 3, STATES = 6 };

typedef struct {
    double sample_period, sigma_v, sigma_u;
    vec3 sigma_A;
    quat q_AS;
    vec3 sigma_SN_0;
    double sigma_att_0, sigma_bias_0;
    GateParameters gate;
} Parameters;
typedef struct {
    vec3 dtheta_S;
    double gyro_time, gyro_valid;
    quat q_AN;
    double star_time, star_valid;
} Input;
typedef struct {
    quat q;
    vec3 bias;
    double P[STATES * STATES];
} Estimate;
typedef struct {
    Estimate estimate;
    /* started: 1 after the first sample; first, index: numbers of the first and last sample;
     * gyro_last: gyro_time of the last increment used */
    double started, first, index, gyro_last;
    Track star;
    quat rotations[HISTORY]; /* per sample: rotation since the previous sample */
} State;
typedef struct {
    quat q_SN;
    vec3 omega_SN_S, bias_hat_S, sigma_theta_S, sigma_bias_S;
    double star_nis, star_rejected, star_age, attitude_valid;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.sample_period = 0.1,
          .sigma_v = 2.04e-5,
          .sigma_u = 8e-8,
          .sigma_A = {1.94e-4, 2.9e-5, 2.9e-5},
          .q_AS = {1, 0, 0, 0},
          .sigma_att_0 = 0.1,
          .sigma_bias_0 = 1e-3,
          .gate = {.gate = 16.27, .reset_after = 10, .age_max = 60, .acquire = 1}},
    .u = {.gyro_time = -1, .q_AN = {1, 0, 0, 0}, .star_time = -1},
};

static const Variable variables[] = {
    GRID(sample_period, "sample period of the software, equal to the period of the gyro"),
    NONNEGATIVE(sigma_v, "1", "angle random walk of the gyro [rad/s^0.5]"),
    NONNEGATIVE(sigma_u, "1", "rate random walk of the gyro [rad/s^1.5]"),
    NONNEGATIVE(sigma_A, "rad",
                "noise of the star tracker about each of its axes, X is the boresight"),
    PARAMETER(q_AS, "1", "attitude of the star tracker relative to the servicer, scalar first"),
    PARAMETER(sigma_SN_0, "1", "attitude at the start, modified Rodrigues parameters"),
    NONNEGATIVE(sigma_att_0, "rad", "standard deviation of the attitude at the start, per axis"),
    NONNEGATIVE(sigma_bias_0, "rad/s",
                "standard deviation of the bias at the start and at acquisition, per axis"),
    GATE_ROWS(gate),

    INPUT(dtheta_S, "rad",
          "increment of the gyro: rotation vector over the last period, body axes"),
    INPUT(gyro_time, "s", "time at which dtheta_S ends"),
    INPUT(gyro_valid, "1", "1: the gyro has measured an increment that ends at gyro_time"),
    INPUT(q_AN, "1", "measured attitude of the star tracker relative to N, scalar first"),
    INPUT(star_time, "s", "time of the measured attitude"),
    INPUT(star_valid, "1", "1: an attitude was measured at star_time"),

    OUTPUT(q_SN, "1", "attitude of the servicer relative to N, scalar first"),
    OUTPUT(omega_SN_S, "rad/s",
           "mean angular velocity of the servicer relative to N over the last period, body axes; "
           "0 if gyro_valid is 0"),
    OUTPUT(bias_hat_S, "rad/s", "estimated bias of the gyro, body axes"),
    NONNEGATIVE_OUTPUT(sigma_theta_S, "rad", "standard deviation of the attitude, body axes"),
    NONNEGATIVE_OUTPUT(sigma_bias_S, "rad/s", "standard deviation of the bias, body axes"),
    NONNEGATIVE_OUTPUT(star_nis, "1", "normalised innovation squared of the last measurement"),
    NONNEGATIVE_OUTPUT(star_rejected, "1", "measurements rejected since the start"),
    OUTPUT(star_age, "s",
           "time since star_time of the last measurement used; before the first: t + 1 s"),
    FLAG(attitude_valid, "1: acquired, and the last measurement used is at most age_max old"),
};

/* F.4-8 */
static void check(const Parameters *p, Problems *problems)
{
    check_unit_quaternion(problems, "|q_AS|", p->q_AS);
}

/* ---- propagation ---- */

/* sets the upper three rows of F = Phi - I, as the other rows are 0, with the transition matrix
 * Phi = [C(quat_of_rotation_vector(phi)), -T (I - phi~/2 + phi~ phi~/6); 0, I] of (theta, b) */
static void transition(vec3 phi, double T, double *F)
{
    mat3 C = dcm_of_quat(quat_of_rotation_vector(phi)), cross_phi = tilde(phi);
    mat3 mean = plus(identity(1),
                     plus(scaled(-0.5, cross_phi), scaled(1.0 / 6, matmul(cross_phi, cross_phi))));
    put_block(F, STATES, THETA, THETA, plus(C, identity(-1)));
    put_block(F, STATES, THETA, BIAS, scaled(-T, mean));
}

/* Q = [(s_v^2 T + s_u^2 T^3/3) I, -s_u^2 T^2/2 I; ., s_u^2 T I] */
static void add_noise(const Parameters *p, double *P)
{
    double T = p->sample_period, v = p->sigma_v * p->sigma_v, u = p->sigma_u * p->sigma_u;
    add_block(P, STATES, THETA, THETA, identity(v * T + u * T * T * T / 3));
    add_block(P, STATES, THETA, BIAS, identity(-u * T * T / 2));
    add_block(P, STATES, BIAS, THETA, identity(-u * T * T / 2));
    add_block(P, STATES, BIAS, BIAS, identity(u * T));
}

/* propagates the estimate over one sample period and returns the rotation in this period */
/* F.4-5 */
static quat propagate(const Parameters *p, vec3 dtheta, Estimate *estimate)
{
    double F[3 * STATES];
    vec3 phi = sub(dtheta, scale(p->sample_period, estimate->bias));
    quat step = quat_of_rotation_vector(phi);
    estimate->q = canonical(product(estimate->q, step));
    transition(phi, p->sample_period, F);
    propagate_covariance(estimate->P, F, 3, STATES);
    add_noise(p, estimate->P);
    symmetrise(estimate->P, STATES);
    return step;
}

/* ---- star tracker ---- */

/* covariance of an attitude measured n = `delay` samples ago; D: the servicer's rotation
 * since then, T: sample period, C_AS: servicer axes to axes of the star tracker:
 * R = C^T diag(sigma_A^2) C + n T sigma_v^2 I,   C = C_AS C(D)^T */
static mat3 star_noise(const Parameters *p, quat D, double delay)
{
    mat3 C = matmul_t(dcm_of_quat(canonical(p->q_AS)), dcm_of_quat(D));
    vec3 s = times(p->sigma_A, p->sigma_A);
    mat3 R = matmul(transpose(C), matmul(diagonal(s.x, s.y, s.z), C));
    return plus(R, identity(delay * p->sample_period * p->sigma_v * p->sigma_v));
}

/* rotation from sample m to sample k: product of the rotations stored for samples m + 1 .. k */
static quat rotation_since(const State *x, double m, double k)
{
    quat D = {1, 0, 0, 0};
    while (m++ < k) D = product(D, x->rotations[place_of(m)]);
    return D;
}

/* F.4-1 */
static void acquire(const Parameters *p, Estimate *estimate, quat q, mat3 R)
{
    estimate->q = canonical(q);
    memset(estimate->P, 0, sizeof estimate->P);
    put_block(estimate->P, STATES, THETA, THETA, R);
    put_block(estimate->P, STATES, BIAS, BIAS, identity(p->sigma_bias_0 * p->sigma_bias_0));
    symmetrise(estimate->P, STATES);
}

static double update(Estimate *estimate, quat q, mat3 R)
{
    double dx[STATES];
    Residual m = {.y = rotation_error(product(conjugate(estimate->q), q)), .R = R, .count = 1};
    m.block[0].at = THETA;
    m.block[0].H = identity(1);
    double nis = update_covariance(estimate->P, STATES, &m, dx);
    estimate->q = canonical(product(estimate->q, rotation(three(dx + THETA))));
    estimate->bias = add(estimate->bias, three(dx + BIAS));
    return nis;
}

/* F.4-2, F.4-3 */
static void update_by_star(const Parameters *p, const Input *u, State *x, double k)
{
    x->star.last = u->star_time;
    double m = nearest_whole(u->star_time / p->sample_period);
    if (m > k || k - m >= HISTORY || m < x->first) return;
    quat D = rotation_since(x, m, k), q_AN = canonical(u->q_AN), q_AS = canonical(p->q_AS);
    quat q = product(product(q_AN, conjugate(q_AS)), D);
    mat3 R = star_noise(p, D, k - m);
    Estimate copy = x->estimate;
    Decision verdict =
        x->star.acquired ? decide(&p->gate, &x->star, update(&copy, q, R)) : ACQUISITION;
    if (verdict == REJECTED) return;
    note_used(&x->star, u->star_time);
    if (verdict == ACCEPTED) {
        x->estimate = copy;
    } else {
        acquire(p, &x->estimate, q, R);
        note_acquired(&x->star);
    }
}

/* ---- sampling ---- */
static State start_state(const Parameters *p, double k)
{
    State x = {.first = k,
               .index = k - 1,
               .gyro_last = -1,
               .star = new_track(&p->gate, -1),
               .estimate = {.q = quat_of_mrp(p->sigma_SN_0)}};
    put_block(x.estimate.P, STATES, THETA, THETA, identity(p->sigma_att_0 * p->sigma_att_0));
    put_block(x.estimate.P, STATES, BIAS, BIAS, identity(p->sigma_bias_0 * p->sigma_bias_0));
    return x;
}

/* F.4-4 */
static void publish(const Parameters *p, const Input *u, const State *x, Output *y, double t)
{
    y->q_SN = x->estimate.q;
    y->omega_SN_S = vec(0, 0, 0);
    if (u->gyro_valid > 0)
        y->omega_SN_S = sub(scale(1 / p->sample_period, u->dtheta_S), x->estimate.bias);
    y->bias_hat_S = x->estimate.bias;
    y->sigma_theta_S = sigma_at(x->estimate.P, STATES, THETA);
    y->sigma_bias_S = sigma_at(x->estimate.P, STATES, BIAS);
    y->star_nis = x->star.nis;
    y->star_rejected = x->star.rejected;
    y->star_age = age(&x->star, t);
    y->attitude_valid = is_valid(&p->gate, &x->star, t);
}

/* F.4-6 */
static void filter(const Parameters *p, const Input *u, State *x, Output *y, Sample s)
{
    if (!x->started) {
        *x = start_state(p, s.index);
        x->started = 1;
    }
    while (x->index < s.index) x->rotations[place_of(++x->index)] = (quat){1, 0, 0, 0};
    if (u->gyro_valid > 0 && u->gyro_time > x->gyro_last) {
        x->gyro_last = u->gyro_time;
        x->rotations[place_of(s.index)] = propagate(p, u->dtheta_S, &x->estimate);
    }
    if (is_new(&x->star, u->star_time, u->star_valid)) update_by_star(p, u, x, s.index);
    publish(p, u, x, y, s.t);
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    *x = start_state(p, 0);
    publish(p, u, x, y, t);
}

/* F.4-7 */
static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        filter(p, u, x, y, s);
}

FMU_MODEL("attitude_filter", "Attitude and gyro bias by a multiplicative extended Kalman filter");
