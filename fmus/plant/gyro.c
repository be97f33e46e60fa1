/* gyro.c - rate-integrating gyro, coning compensated: the rotation over the last period.
 *
 *   phi = rotation vector of q_SN(n-1)* q_SN(n)
 *   b+  = b + sigma_u sqrt(P) z_3..5
 *   m   = (I + M) phi + P (b + b+)/2 + sqrt(sigma_v^2 P + sigma_u^2 P^3/12) z_0..2
 *
 * m: measured increment dtheta_S, P: period, b: bias, b+: bias at the end of the period, M:
 * misalignment, z: standard normal draws of the sample. With quantum > 0, m is rounded to multiples
 * of quantum, and the rounding residue is added to the next increment. The first sample only
 * records the attitude and gives no increment. Source: Farrenkopf 1978; equations: docs/models.md
 * F.2. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "sensor.h"
#include "small_rotation.h"

typedef struct {
    double sample_period;
    RandomStream random;
    double sigma_v, sigma_u;
    vec3 bias_0, sigma_bias_0;
    mat3 misalignment;
    double quantum;
} Parameters;
typedef struct { quat q_SN; } Input;
typedef struct {
    double started;
    quat q;
    vec3 bias, residue;
} State;
typedef struct {
    vec3 dtheta_S;
    double gyro_time, gyro_valid;
    vec3 bias_S;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.sample_period = 0.1,
          .random = {.stream = 2},
          .sigma_v = 2.04e-5,
          .sigma_u = 8e-8,
          .bias_0 = {4.8e-6, -4.8e-6, 4.8e-6}},
    .u = {.q_SN = {1, 0, 0, 0}},
};

static const Variable variables[] = {
    SENSOR_PERIOD_ROW,
    RANDOM_ROWS(random),
    NONNEGATIVE(sigma_v, "1", "angle random walk [rad/s^0.5]"),
    NONNEGATIVE(sigma_u, "1", "rate random walk [rad/s^1.5]"),
    PARAMETER(bias_0, "rad/s", "bias at the start, body axes"),
    NONNEGATIVE(sigma_bias_0, "rad/s",
                "standard deviation of the bias at the start about bias_0, per axis"),
    MATRIX(misalignment, "1",
           "M of measured = (I + M) true rotation, body axes; diagonal: scale factor errors"),
    NONNEGATIVE(quantum, "rad", "the increments are multiples of this angle; 0 = not rounded"),

    INPUT(q_SN, "1", "attitude of the servicer relative to N, scalar first"),

    OUTPUT(dtheta_S, "rad", "measured rotation vector over the last period, body axes"),
    OUTPUT(gyro_time, "s", "time of the last sample, where the increment ends; -1 = no sample yet"),
    FLAG(gyro_valid, "1: dtheta_S is a measured increment; 0: none yet"),
    OUTPUT(bias_S, "rad/s", "true bias, body axes"),
};

static void check(const Parameters *p, Problems *problems) { check_random(problems, &p->random); }

static vec3 quantised(double quantum, vec3 m, vec3 *residue)
{
    if (quantum == 0) return m;
    vec3 a = add(*residue, m);
    vec3 rounded = scale(quantum, vec(nearest_whole(a.x / quantum), nearest_whole(a.y / quantum),
                                      nearest_whole(a.z / quantum)));
    *residue = sub(a, rounded);
    return rounded;
}

static vec3 measured_increment(const Parameters *p, vec3 phi, State *x, const Draws *d)
{
    double P = p->sample_period;
    vec3 before = x->bias;
    x->bias = add(before, scale(p->sigma_u * sqrt(P), normals(d, 3)));
    double sigma = sqrt(p->sigma_v * p->sigma_v * P + p->sigma_u * p->sigma_u * P * P * P / 12);
    vec3 m = sum4(phi, mul(p->misalignment, phi), scale(P / 2, add(before, x->bias)),
                  scale(sigma, normals(d, 0)));
    return quantised(p->quantum, m, &x->residue);
}

static void measure(const Parameters *p, const Input *u, State *x, Output *y, Sample s)
{
    const Draws d = draws_of_sample(&p->random, s.index);
    quat q = canonical(u->q_SN);
    y->dtheta_S = vec(0, 0, 0);
    if (x->started > 0)
        y->dtheta_S = measured_increment(p, rotation_vector(product(conjugate(x->q), q)), x, &d);
    y->gyro_time = s.t;
    y->gyro_valid = x->started;
    y->bias_S = x->bias;
    x->q = q;
    x->started = 1;
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    const Draws d = draws_of_run(&p->random);
    (void)u, (void)t;
    *x = (State){.q = {1, 0, 0, 0}, .bias = add(p->bias_0, times(p->sigma_bias_0, normals(&d, 0)))};
    *y = (Output){.gyro_time = -1, .bias_S = x->bias};
}

SAMPLED(step, measure)

FMU_MODEL("gyro", "Rate-integrating gyro with angle and rate random walk, bias and quantisation");
