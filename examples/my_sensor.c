/* my_sensor.c - navigation receiver of the servicer: position and velocity with bias and noise.
 *
 *   r_meas = r_SN + b + sigma_r z_0,   v_meas = v_SN + sigma_v z_3,   b = sigma_b z
 *
 * z are normal draws, per axis. b is drawn once per run, the noise at every sample n. A draw is a
 * function of (seed, stream, n), so that no step size and no saved state changes it. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "sensor.h"

typedef struct {
    double sample_period;
    RandomStream random;
    double sigma_r, sigma_v, sigma_b;
} Parameters;
typedef struct { vec3 r_SN_N, v_SN_N; } Input;
typedef struct { double unused; } State;
typedef struct { vec3 r_meas_N, v_meas_N; } Output;
MODEL_STRUCT;

static const Model start = {.p = {.sample_period = 0.1,
                                  .random = {.stream = 20},
                                  .sigma_r = 0.002,
                                  .sigma_v = 0.0002,
                                  .sigma_b = 0.002}};

static const Variable variables[] = {
    SENSOR_PERIOD_ROW,
    RANDOM_ROWS(random),
    NONNEGATIVE(sigma_r, "m", "noise of the position, per axis"),
    NONNEGATIVE(sigma_v, "m/s", "noise of the velocity, per axis"),
    NONNEGATIVE(sigma_b, "m", "standard deviation of the bias, drawn once per seed, per axis"),

    INPUT(r_SN_N, "m", "position of the servicer, N axes"),
    INPUT(v_SN_N, "m/s", "velocity of the servicer, N axes"),

    OUTPUT(r_meas_N, "m", "measured position of the servicer, N axes"),
    OUTPUT(v_meas_N, "m/s", "measured velocity of the servicer, N axes"),
};

static void check(const Parameters *p, Problems *problems) { check_random(problems, &p->random); }

static void measure(const Parameters *p, const Input *u, State *x, Output *y, Sample s)
{
    const Draws run = draws_of_run(&p->random), d = draws_of_sample(&p->random, s.index);
    (void)x;
    y->r_meas_N =
        sum3(u->r_SN_N, scale(p->sigma_b, normals(&run, 0)), scale(p->sigma_r, normals(&d, 0)));
    y->v_meas_N = add(u->v_SN_N, scale(p->sigma_v, normals(&d, 3)));
}

/* a flight computer needs a position from the start: the first sample */
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    measure(p, u, x, y, (Sample){.t = t});
}

SAMPLED(step, measure)

FMU_MODEL("my_sensor", "Navigation receiver: position and velocity with bias and noise");
