/* cmg_steering.c - gimbal rates of six gyros for a commanded rate of momentum: singularity-robust
 * inverse with null motion.
 *
 *   d' = A^T (A A^T + lam E)^-1 h'/h_w + k_n (1 - A^+ A) grad m,   m = sqrt(det A A^T)
 *   lam = lam_0 exp(-m),   E = [1 e3 e2; e3 1 e1; e2 e1 1],   e_j = 0.01 sin(pi t/2 + phi_j)
 *   dm/dd_i = m dA_i . (A A^T)^-1 A_i,   dA_i = -s_i cos d_i - t_i sin d_i
 *
 * d: gimbal angles; A_i: column i of A, direction of the torque of gyro i at unit gimbal rate;
 * s_i, t_i: its spin and torque axes at d_i = 0; h_w: momentum of one wheel; phi = 0, pi/2, pi.
 * The pseudoinverse A^+ omits singular values below 1e-3 of the largest. All rates are scaled by
 * one factor if one exceeds the limit. Sampled: one sample reads the inputs once and holds the
 * rates.
 * Source: docs/models.md E.6. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "cmg_cluster.h"
#include "fmu.h"
#include "symmetric3.h"
#include "time_grid.h"

typedef struct {
    double use_cluster, h_w, gimbal_rate_max, lambda_0, k_null, sample_period;
} Parameters;
typedef struct {
    vec3 hdot_cmd_S;
    double gimbal_angle[GYROS];
} Input;
typedef struct { double unused; } State;
typedef struct {
    double gimbal_rate_cmd[GYROS], singularity, damping, rate_limited;
    vec3 hdot_missing_S;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.use_cluster = 1, .h_w = 350, .gimbal_rate_max = 0.1, .lambda_0 = 0.01, .k_null = 0.02},
    .u = {.gimbal_angle = GIMBALS_AT_START},
};

static const Variable variables[] = {
    SWITCH(use_cluster, "1: gimbal rates by this law; 0: all gimbal rates are 0"),
    POSITIVE(h_w, "N.m.s", "momentum of the wheel of one gyro"),
    POSITIVE(gimbal_rate_max, "rad/s", "largest gimbal rate"),
    NONNEGATIVE(lambda_0, "1", "value of the output damping at a singularity"),
    NONNEGATIVE(k_null, "rad2/s", "gain of the null motion"),
    SAMPLE_PERIOD,

    INPUT(hdot_cmd_S, "N.m", "commanded rate of change of the momentum of the gyros, body axes"),
    INPUT(gimbal_angle, "rad",
          "gimbal angles; gimbal axes: z, then five at atan(2) from z, azimuths 0, 72 .. 288 deg; "
          "spin axes at 0: x, then in xy at azimuth + 90 deg"),

    OUTPUT(gimbal_rate_cmd, "rad/s", "commanded gimbal rates, per gyro"),
    NONNEGATIVE_OUTPUT(singularity, "1",
                       "sqrt(det A A^T), A: torque axes of the six gyros; 0 = singular"),
    NONNEGATIVE_OUTPUT(damping, "1", "damping of the inverse of A A^T: lambda_0 exp(-singularity)"),
    FLAG(rate_limited, "1: the rates are scaled down to the limit"),
    OUTPUT(hdot_missing_S, "N.m",
           "commanded rate of momentum minus the rate that the gimbal rates achieve, body axes"),
};

static void check(const Parameters *p, Problems *problems)
{
    (void)p;
    (void)problems;
}

#define SINGULAR 1e-9 /* m below this counts as 0, with gradient 0 */
#define SMALLEST_SHARE \
    1e-3 /* A^+ omits singular values that are below this share of the largest one of A */
#define DITHER 0.01 /* amplitude of e_j */

typedef struct { vec3 A[GYROS], dA[GYROS]; } Columns;

static Columns columns_at(const double d[GYROS])
{
    Columns c;
    for (int i = 0; i < GYROS; i++) {
        c.A[i] = torque_axis(gyro_axes(i), d[i]);
        c.dA[i] = neg(spin_axis(gyro_axes(i), d[i]));
    }
    return c;
}

/* E.6-3 */
static mat3 dither(double t) /* E */
{
    SineCosine w = sine_and_cosine(PI / 2 * t);
    double e1 = DITHER * w.s, e2 = DITHER * w.c, e3 = -DITHER * w.s;
    return rows(vec(1, e3, e2), vec(e3, 1, e1), vec(e2, e1, 1));
}

/* (1 - A^+ A) grad m: the part of grad m that does not change the momentum */
/* E.6-2 */
static void null_motion(const Columns *c, mat3 AAt, double m, double rate[GYROS])
{
    double gradient[GYROS];
    vec3 momentum_rate = vec(0, 0, 0);
    for (int i = 0; i < GYROS; i++) {
        gradient[i] = m > SINGULAR ? m * dot(c->dA[i], solve(AAt, c->A[i])) : 0;
        momentum_rate = add(momentum_rate, scale(gradient[i], c->A[i]));
    }
    vec3 correction = mul(pseudo_inverse(AAt, SMALLEST_SHARE * SMALLEST_SHARE), momentum_rate);
    for (int i = 0; i < GYROS; i++) rate[i] = gradient[i] - dot(c->A[i], correction);
}

static double largest_rate(const double rate[GYROS])
{
    double largest = 0;
    for (int i = 0; i < GYROS; i++) largest = larger(largest, fabs(rate[i]));
    return largest;
}

/* E.6-1 */
static void publish(const Parameters *p, const Input *u, const double rate[GYROS], Output *y)
{
    double largest = largest_rate(rate), limit = p->gimbal_rate_max;
    y->rate_limited = largest > limit;
    for (int i = 0; i < GYROS; i++)
        y->gimbal_rate_cmd[i] = y->rate_limited != 0 ? rate[i] * (limit / largest) : rate[i];
    y->hdot_missing_S =
        sub(u->hdot_cmd_S, cluster_rate(p->h_w, u->gimbal_angle, y->gimbal_rate_cmd));
}

/* E.6-4 */
static void steer(const Parameters *p, const Input *u, Output *y, double t)
{
    Columns c = columns_at(u->gimbal_angle);
    mat3 AAt = A_A_transposed(u->gimbal_angle);
    double rate[GYROS];
    y->singularity = singularity_measure(u->gimbal_angle);
    y->damping = p->lambda_0 * exponential(-y->singularity);
    vec3 multiplier =
        solve(plus(AAt, scaled(y->damping, dither(t))), scale(1 / p->h_w, u->hdot_cmd_S));
    null_motion(&c, AAt, y->singularity, rate);
    for (int i = 0; i < GYROS; i++)
        rate[i] = p->use_cluster * (dot(c.A[i], multiplier) + p->k_null * rate[i]);
    publish(p, u, rate, y);
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    (void)x;
    steer(p, u, y, t);
}

/* E.6-5 */
static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    (void)x;
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        steer(p, u, y, s.t);
}

FMU_MODEL("cmg_steering", "Singularity-robust steering of six control moment gyros");
