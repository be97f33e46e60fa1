/* star_tracker.c - star tracker: attitude of A relative to N, with noise in its own axes.
 *
 *   q_AN = q_SN q_AS rot(sigma_A (o) z_0..2)
 *
 * A: axes of the star tracker; rot(a): quaternion of a small rotation a; z: standard normal draws;
 * (o): product element by element. There is no measurement while the servicer turns faster than
 * rate_max, with the Sun within sun_cone of the boresight (+X of A), during an outage or a drop-out
 * (u_3 < p_drop, u_3: uniform draw in (0, 1)). The measured attitude is the attitude at one
 * instant: the exposure takes no time. Equations: docs/models.md F.2. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "mounting.h"
#include "sensor.h"
#include "small_rotation.h"

typedef struct {
    double sample_period;
    RandomStream random;
    quat q_AS;
    vec3 sigma_A;
    double rate_max;
    Sun sun;
    Outage outage;
} Parameters;
typedef struct {
    quat q_SN;
    vec3 omega_SN_S;
} Input;
typedef struct { double unused; } State;
typedef struct {
    quat q_AN;
    double star_time, star_valid;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.sample_period = 0.5,
          .random = {.stream = 1},
          .q_AS = {1, 0, 0, 0},
          .sigma_A = {1.94e-4, 2.9e-5, 2.9e-5},
          .rate_max = 0.05,
          .sun = {.direction = {1, 0, 0}}},
    .u = {.q_SN = {1, 0, 0, 0}},
};

static const Variable variables[] = {
    SENSOR_PERIOD_ROW,
    RANDOM_ROWS(random),
    PARAMETER(q_AS, "1", "attitude of the star tracker relative to the servicer, scalar first"),
    NONNEGATIVE(sigma_A, "rad", "standard deviation of the noise per axis; X is the boresight"),
    NONNEGATIVE(rate_max, "rad/s", "no measurement while the servicer turns faster"),
    SUN_ROWS(sun),
    OUTAGE_ROWS(outage),

    INPUT(q_SN, "1", "attitude of the servicer relative to N, scalar first"),
    INPUT(omega_SN_S, "rad/s", "angular velocity of the servicer relative to N, body axes"),

    OUTPUT(q_AN, "1", "measured attitude of the star tracker relative to N, scalar first"),
    OUTPUT(star_time, "s", "time of the last sample; -1 = none yet"),
    FLAG(star_valid, "1: a measurement was taken at star_time"),
};

static void check(const Parameters *p, Problems *problems)
{
    check_random(problems, &p->random);
    check_unit_quaternion(problems, "|q_AS|", p->q_AS);
    check_unit_vector(problems, "|sun_N|", p->sun.direction);
    check_probability(problems, "p_drop", p->outage.p_drop);
}

static int can_measure(const Parameters *p, const Input *u, quat q_AN, double t, const Draws *d)
{
    return norm(u->omega_SN_S) <= p->rate_max && !sun_in_cone(&p->sun, q_AN) &&
           !in_outage(&p->outage, t) && !dropped(&p->outage, uniform(d, 3));
}

static void measure(const Parameters *p, const Input *u, State *x, Output *y, Sample s)
{
    const Draws d = draws_of_sample(&p->random, s.index);
    quat q_AN = canonical(product(u->q_SN, p->q_AS));
    (void)x;
    *y = (Output){.q_AN = {1, 0, 0, 0}, .star_time = s.t};
    y->star_valid = can_measure(p, u, q_AN, s.t, &d);
    if (y->star_valid)
        y->q_AN = canonical(product(q_AN, rotation(times(p->sigma_A, normals(&d, 0)))));
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    (void)p, (void)u, (void)t;
    x->unused = 0;
    *y = (Output){.q_AN = {1, 0, 0, 0}, .star_time = -1};
}

SAMPLED(step, measure)

FMU_MODEL("star_tracker",
          "Star tracker: attitude with noise, blinded by the Sun and by fast turns");
