/* range_sensor.c - range finder, independent of the camera: distance of the centres of mass.
 *
 *   R = |r_SN - r_TN|,   range_meas = R + b + (sigma_range_0 + sigma_range_1 R) z_0
 *
 * z_i: standard normal draws, u_i: uniform draws in (0, 1), new for each sample. The bias is
 * b = bias_0 + sigma_bias_0 z_0 with another z_0, drawn once per run. There is no measurement
 * outside range_min to range_max, during an outage or a drop-out (u_6 < p_drop). A sample is
 * published after `latency`. Equations: docs/models.md F.2. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "sensor.h"

typedef struct {
    double sample_period;
    RandomStream random;
    double sigma_range_0, sigma_range_1, bias_0, sigma_bias_0;
    double range_min, range_max, latency;
    Outage outage;
} Parameters;
typedef struct { vec3 r_TN_N, r_SN_N; } Input;
typedef struct { double range_meas, range_time, range_valid; } Output;
LATE_STATE;
MODEL_STRUCT;

static const Model start = {
    .p = {.sample_period = 0.5,
          .random = {.stream = 5},
          .sigma_range_0 = 0.1,
          .sigma_range_1 = 1e-3,
          .range_min = 0.5,
          .range_max = 5000,
          .latency = 0.1},
    .u = {.r_TN_N = {20, 0, 0}},
};

static const Variable variables[] = {
    SENSOR_PERIOD_ROW,
    RANDOM_ROWS(random),
    NONNEGATIVE(sigma_range_0, "m", "standard deviation of the noise at range 0"),
    NONNEGATIVE(sigma_range_1, "1", "increase of the noise's standard deviation with the range"),
    PARAMETER(bias_0, "m", "bias of the range"),
    NONNEGATIVE(sigma_bias_0, "m",
                "standard deviation of the bias about bias_0, drawn once per seed"),
    NONNEGATIVE(range_min, "m", "no measurement at a smaller distance"),
    NONNEGATIVE(range_max, "m", "no measurement at a larger distance"),
    LATENCY_ROW,
    OUTAGE_ROWS(outage),

    INPUT(r_TN_N, "m", "position of the target, N axes"),
    INPUT(r_SN_N, "m", "position of the servicer, N axes"),

    OUTPUT(range_meas, "m", "measured distance of the centres of mass; 0 = no measurement"),
    OUTPUT(range_time, "s", "time of the published sample; -1 = none yet"),
    FLAG(range_valid, "1: a range was measured at range_time"),
};

static void check(const Parameters *p, Problems *problems)
{
    check_random(problems, &p->random);
    check_probability(problems, "p_drop", p->outage.p_drop);
    check_range(problems, p->range_min, p->range_max);
    check_latency(problems, p->latency, p->sample_period);
}

static double bias(const Parameters *p)
{
    const Draws d = draws_of_run(&p->random);
    return p->bias_0 + p->sigma_bias_0 * normal(&d, 0);
}

static Output measured_range(const Parameters *p, const Input *u, Sample s)
{
    const Draws d = draws_of_sample(&p->random, s.index);
    double R = norm(sub(u->r_SN_N, u->r_TN_N));
    Output y = {.range_time = s.t};
    y.range_valid = R >= p->range_min && R <= p->range_max && !in_outage(&p->outage, s.t) &&
                    !dropped(&p->outage, uniform(&d, 6));
    if (y.range_valid > 0)
        y.range_meas = R + bias(p) + (p->sigma_range_0 + p->sigma_range_1 * R) * normal(&d, 0);
    return y;
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    (void)p, (void)u, (void)t;
    *x = (State){.ring = {{0}}};
    *y = (Output){.range_time = -1};
}

LATE_STEP(measured_range)

FMU_MODEL("range_sensor", "Range finder: distance of servicer and target, with noise and latency");
