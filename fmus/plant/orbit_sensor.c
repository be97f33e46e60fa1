/* orbit_sensor.c - satellite navigation receiver: fixes of position and velocity of the servicer.
 *
 *   r_fix = r + sigma_fix_r z_0..2,   v_fix = v + sigma_fix_v z_3..5
 *
 * z: standard normal draws. There is no fix during an outage or a drop-out (u_6 < p_drop, with the
 * uniform draw u_6). Equations: docs/models.md F.2. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "sensor.h"

typedef struct {
    double sample_period;
    RandomStream random;
    double sigma_fix_r, sigma_fix_v;
    Outage outage;
} Parameters;
typedef struct { vec3 r_SN_N, v_SN_N; } Input;
typedef struct { double unused; } State;
typedef struct {
    vec3 r_fix_N, v_fix_N;
    double fix_time, fix_valid;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.sample_period = 1, .random = {.stream = 4}, .sigma_fix_r = 5, .sigma_fix_v = 0.05}};

static const Variable variables[] = {
    SENSOR_PERIOD_ROW,
    RANDOM_ROWS(random),
    NONNEGATIVE(sigma_fix_r, "m", "noise of the position, per axis"),
    NONNEGATIVE(sigma_fix_v, "m/s", "noise of the velocity, per axis"),
    OUTAGE_ROWS(outage),

    INPUT(r_SN_N, "m", "position of the servicer, N axes"),
    INPUT(v_SN_N, "m/s", "velocity of the servicer, N axes"),

    OUTPUT(r_fix_N, "m", "measured position of the servicer, N axes"),
    OUTPUT(v_fix_N, "m/s", "measured velocity of the servicer, N axes"),
    OUTPUT(fix_time, "s", "time of the last sample; -1 = none yet"),
    FLAG(fix_valid, "1: a fix was taken at fix_time"),
};

static void check(const Parameters *p, Problems *problems)
{
    check_random(problems, &p->random);
    check_probability(problems, "p_drop", p->outage.p_drop);
}

static void measure(const Parameters *p, const Input *u, State *x, Output *y, Sample s)
{
    const Draws d = draws_of_sample(&p->random, s.index);
    (void)x;
    *y = (Output){.fix_time = s.t};
    y->fix_valid = !in_outage(&p->outage, s.t) && !dropped(&p->outage, uniform(&d, 6));
    if (!y->fix_valid) return;
    y->r_fix_N = add(u->r_SN_N, scale(p->sigma_fix_r, normals(&d, 0)));
    y->v_fix_N = add(u->v_SN_N, scale(p->sigma_fix_v, normals(&d, 3)));
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    (void)p, (void)u, (void)t;
    x->unused = 0;
    *y = (Output){.fix_time = -1};
}

SAMPLED(step, measure)

FMU_MODEL("orbit_sensor", "Satellite navigation receiver: position and velocity with noise");
