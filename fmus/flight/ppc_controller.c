/* ppc_controller.c - low-complexity prescribed performance control of line of sight and attitude,
 * without a model.
 *
 * The generalised state z of each channel (range, elevation, azimuth; three of attitude) is held
 * inside a shrinking funnel:
 *   z = x1 + lambda x2,   L alpha < z < U alpha,
 *           alpha(t) = (alpha_0 - alpha_inf) exp(-beta (t - t_0)) + alpha_inf
 *   (L, U) = (-delta, 1) if z(t_0) >= 0, else (-1, delta)
 *   theta = z/alpha,   s = ln((theta - L)/(U - theta)),
 *           r = (U - L)/((theta - L)(U - theta) alpha) = ds/dz
 *   kappa = sum eta s^2,     u = -k p(r) eta s/(1 - kappa)
 *     law 0, as in the source: p = r;   law 1: p = 1/r;
 *             law 2: p = (alpha (U - L)/4)^2 r, small-signal gain always k eta
 * Position:  x1, x2 in LOS coordinates, servicer acceleration a_L = Sigma u, F_cmd = force_scale
 * C_SL a_L
 * Attitude:  x1 = e, x2 = T(q_SD) w/2, torque M = T(q_SD)^T u; the proof needs equal constants on
 * all three channels
 * t_0: first sample with control; lambda, alpha_0, alpha_inf, beta, delta, k, eta: parameters of
 * the channel; kappa: sum over the three channels of position or of attitude; e: vector part of
 * the attitude error q_SD, w: rate error; Sigma = diag(-1,-1,1); T(q) w = q_0 w + q_vec x w; rho,
 * eps: range and elevation (tracking.h)
 *
 * Without saturation, in continuous time, with 0 < lambda beta < 1 and kappa(t_0) < 1, no channel
 * ever leaves its funnel and kappa stays below 1. Sampled or saturated control can violate both.
 * The law therefore limits theta to 1e-3 (U - L) inside its bounds and kappa to 0.98: it is finite
 * for every input and brings the state back, and `violation` is set. The sample period T should
 * satisfy lambda g k eta T < 1, with g = 1 for range, 1/rho for elevation, 1/(rho cos eps) for
 * azimuth (law 0: with 16 k eta/((U - L) alpha)^2 in place of k eta). A start outside the funnel,
 * or with kappa(t_0) >= 1, is rejected in the first step: start_margin must be > 0. Source: Yin,
 * Luo, Wei & Yuan 2017, equations (8) to (20); docs/models.md C.4. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "tracking.h"

#define INSIDE        1e-3 /* theta stays this fraction of the width from each bound */
#define LARGEST_KAPPA 0.98 /* limit of kappa in the law, below 1 so that u is finite */

typedef struct { double k, eta, lambda, alpha_0, alpha_inf, beta, delta; } Channel;

typedef struct {
    TrackingParameters tracking;
    double wheel_scale, position, law, law_att;
    Channel range, elevation, azimuth, attitude;
} Parameters;
typedef TrackingInput Input;
typedef struct {
    double begun, t_0;
    vec3 rising;
    double margin;
} Funnel; /* rising: per channel, 1 if z(t_0) >= 0; selects (L, U) */
typedef struct { Funnel position, attitude; } State;
typedef struct {
    vec3 z, theta, s, alpha;
    double kappa, violation, start_margin;
} Telemetry;
typedef struct {
    TrackingOutput common;
    Telemetry position, attitude;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.tracking = TRACKING_DEFAULTS,
          .wheel_scale = 10,
          .position = 1,
          .law = 2,
          .law_att = 2,
          .range = {.k = 15,
                    .eta = 0.1,
                    .lambda = 4.3,
                    .alpha_0 = 600,
                    .alpha_inf = 0.5,
                    .beta = 0.2,
                    .delta = 1},
          .elevation = {.k = 300,
                        .eta = 0.1,
                        .lambda = 4,
                        .alpha_0 = 0.8,
                        .alpha_inf = 0.03,
                        .beta = 0.2,
                        .delta = 1},
          .azimuth = {.k = 300,
                      .eta = 0.1,
                      .lambda = 4,
                      .alpha_0 = 0.8,
                      .alpha_inf = 0.03,
                      .beta = 0.2,
                      .delta = 1},
          .attitude = {.k = 800,
                       .eta = 0.1,
                       .lambda = 1.5,
                       .alpha_0 = 1.5,
                       .alpha_inf = 0.01,
                       .beta = 0.25,
                       .delta = 1}},
    .u = TRACKING_START,
};

#define CHANNEL_ROW(member, constant, unit, text)                                                \
    ROW_AS(PARAMETER_ROW, p, #member "." #constant, member.constant, 1, unit, #member ": " text, \
           POSITIVE_VALUE)
#define CHANNEL_ROWS(member, unit, gain_unit)                                                  \
    CHANNEL_ROW(member, k, gain_unit,                                                          \
                "gain in u = -k p eta s/(1 - kappa), p by law or law_att; law 0 multiplies "   \
                "the unit by (unit of alpha_0)^2"),                                            \
        CHANNEL_ROW(member, eta, "1", "weight of the mapped state s, in u (see k) and kappa"), \
        CHANNEL_ROW(member, lambda, "s",                                                       \
                    "weight of the rate in the generalised state: error + lambda rate"),       \
        CHANNEL_ROW(member, alpha_0, unit, "bound of the generalised state at the start"),     \
        CHANNEL_ROW(member, alpha_inf, unit, "final bound of the generalised state"),          \
        CHANNEL_ROW(member, beta, "1/s", "convergence rate of the bound"),                     \
        CHANNEL_ROW(member, delta, "1",                                                        \
                    "overshoot that the funnel allows, as a share of the bound, in (0, 1]")

#define TELEMETRY_ROWS(member, suffix, whose)                                                  \
    TRACKING_OUTPUT("theta" suffix, member.theta, "1",                                         \
                    whose ": generalised state divided by its bound, order as in z" suffix,    \
                    ANY_VALUE),                                                                \
        TRACKING_OUTPUT("s" suffix, member.s, "1",                                             \
                        whose ": mapped state, theta mapped from its bounds to all numbers",   \
                        ANY_VALUE),                                                            \
        TRACKING_OUTPUT("kappa" suffix, member.kappa, "1",                                     \
                        whose ": sum of eta s^2, below 1 by design", NONNEGATIVE_VALUE),       \
        TRACKING_OUTPUT("violation" suffix, member.violation, "1",                             \
                        whose ": 1: outside the funnel or kappa >= 1", ALARM_VALUE),           \
        TRACKING_OUTPUT("start_margin" suffix, member.start_margin, "1",                       \
                        whose                                                                  \
                        ": lesser of 1 - kappa(t_0) and distance of theta(t_0) to the nearer " \
                        "bound; must be > 0",                                                  \
                        POSITIVE_VALUE)

static const Variable variables[] = {
    TRACKING_PARAMETERS(tracking),
    POSITIVE(wheel_scale, "kg.m2",
             "torque per wheel acceleration, wheel axes = body axes; used if use_wheels = 1"),
    SWITCH(position, "1: control of the position; 0: no force, its channels are not evaluated"),
    PARAMETER(law, "1",
              "position: factor p of the gain, with r = ds/dz: 0 = r, 1 = 1/r, "
              "2 = r (alpha (1 + delta)/4)^2"),
    PARAMETER(law_att, "1",
              "attitude: factor p of the gain, codes as for law; stability is not proven for 1"),
    CHANNEL_ROWS(range, "m", "1/s2"),
    CHANNEL_ROWS(elevation, "rad", "m/s2"),
    CHANNEL_ROWS(azimuth, "rad", "m/s2"),
    CHANNEL_ROWS(attitude, "1", "N.m"),

    TRACKING_INPUTS,

    TRACKING_OUTPUTS(common),
    LOS_OUTPUTS("z", position.z, "m", "rad", "generalised state"),
    LOS_OUTPUTS("alpha", position.alpha, "m", "rad", "bound of the generalised state"),
    TELEMETRY_ROWS(position, "", "position"),
    TRACKING_OUTPUT("z_att", attitude.z, "1",
                    "attitude: generalised state e + lambda de/dt, e: vector part of q_SD",
                    ANY_VALUE),
    TRACKING_OUTPUT("alpha_att", attitude.alpha, "1", "attitude: bound of the generalised state",
                    ANY_VALUE),
    TELEMETRY_ROWS(attitude, "_att", "attitude"),
};

static void check_channel(Problems *problems, const char *names[3], const Channel *c)
{
    if (c->lambda * c->beta >= 1)
        reject(problems, names[0], c->lambda * c->beta, "must be below 1");
    if (c->delta > 1) reject(problems, names[1], c->delta, "must be in (0, 1]");
    if (c->alpha_0 < c->alpha_inf)
        reject(problems, names[2], c->alpha_0, "must not be below alpha_inf");
}

#define CHANNEL_NAMES(member) \
    {#member ".lambda * " #member ".beta", #member ".delta", #member ".alpha_0"}
#define CHECK_CHANNEL(member) \
    check_channel(problems, (const char *[])CHANNEL_NAMES(member), &p->member)

static void check_law(Problems *problems, const char *name, double law)
{
    if (law != 0 && law != 1 && law != 2) reject(problems, name, law, "must be 0, 1 or 2");
}

/* C.4-7 */
static void check(const Parameters *p, Problems *problems)
{
    check_up_axis(problems, p->tracking.up_axis);
    check_law(problems, "law", p->law);
    check_law(problems, "law_att", p->law_att);
    CHECK_CHANNEL(range);
    CHECK_CHANNEL(elevation);
    CHECK_CHANNEL(azimuth);
    CHECK_CHANNEL(attitude);
}

/* ---- one channel ---- */
/* u = -gain s/(1 - kappa); margin: > 0 inside the funnel; unkept_s: s of theta before map() limits
 * theta */
typedef struct { double theta, s, alpha, gain, margin, unkept_s; } Mapped;

/* s of (15); 0 for a theta outside the funnel. The law uses a theta that map() limits to the
 * inside: only Mapped.margin shows a violation. */
static double mapped(double theta, double L, double U)
{
    return theta > L && theta < U ? logarithm((theta - L) / (U - theta)) : 0;
}

static double power(double law, double r, double rho)
{
    return law == 0 ? r : law == 1 ? 1 / r : rho * rho * r;
}

/* C.4-1 */
static Mapped map(const Channel *c, double law, double rising, double z, double age)
{
    double L = rising ? -c->delta : -1, U = rising ? 1 : c->delta, width = U - L;
    double alpha = (c->alpha_0 - c->alpha_inf) * exponential(-c->beta * age) + c->alpha_inf;
    double theta = z / alpha, inside = clamp(theta, L + INSIDE * width, U - INSIDE * width);
    double r = width / ((inside - L) * (U - inside) * alpha);
    double gain = c->k * c->eta * power(law, r, alpha * width / 4);
    return (Mapped){theta, mapped(inside, L, U),          alpha,
                    gain,  smaller(theta - L, U - theta), mapped(theta, L, U)};
}

/* ---- three channels: control u and telemetry; the sign of z at the start selects (L, U) ---- */
/* C.4-3 */
static void begin(Funnel *x, vec3 z, double t)
{
    if (x->begun) return;
    *x = (Funnel){1, t, vec(z.x >= 0, z.y >= 0, z.z >= 0), 0};
}

/* C.4-2 */
static vec3 barrier(const Channel *const c[3], double law, Funnel *x, vec3 z, double t,
                    Telemetry *y)
{
    int first = !x->begun;
    begin(x, z, t);
    double age = t - x->t_0;
    Mapped a = map(c[0], law, x->rising.x, z.x, age), b = map(c[1], law, x->rising.y, z.y, age),
           d = map(c[2], law, x->rising.z, z.z, age);
    double kappa = c[0]->eta * a.s * a.s + c[1]->eta * b.s * b.s + c[2]->eta * d.s * d.s;
    double inside = smaller(a.margin, smaller(b.margin, d.margin));
    if (first) { /* start_margin, (18), from theta before map() limits it */
        vec3 s = vec(a.unkept_s, b.unkept_s, d.unkept_s),
             eta = vec(c[0]->eta, c[1]->eta, c[2]->eta);
        x->margin = smaller(1 - dot(s, times(eta, s)), inside);
    }

    *y = (Telemetry){
        z,     vec(a.theta, b.theta, d.theta),  vec(a.s, b.s, d.s), vec(a.alpha, b.alpha, d.alpha),
        kappa, smaller(1 - kappa, inside) <= 0, x->margin};
    return scale(-1 / (1 - smaller(kappa, LARGEST_KAPPA)),
                 vec(a.gain * a.s, b.gain * b.s, d.gain * d.s));
}

/* (12) to (19) */
/* C.4-6 */
static void control_position(const Parameters *p, const TrackingError *e, Funnel *x, double t,
                             Output *y)
{
    if (!p->position) {
        y->position = (Telemetry){.start_margin = 1};
        y->common.F_cmd_S = y->common.a_cmd_L = vec(0, 0, 0);
        return;
    }
    const Channel *channels[3] = {&p->range, &p->elevation, &p->azimuth};
    vec3 z = add(e->x1, times(vec(p->range.lambda, p->elevation.lambda, p->azimuth.lambda), e->x2));
    command_force(&p->tracking, e, barrier(channels, p->law, x, z, t, &y->position), &y->common);
}

/* (20) with T^T in place of T: this makes the gain T J^-1 T^T of the loop positive definite */
static vec3 attitude_torque(const Parameters *p, const TrackingError *e, Funnel *x, double t,
                            Telemetry *y)
{
    const Channel *channels[3] = {&p->attitude, &p->attitude, &p->attitude};
    vec3 z = add(vector_part(e->q_SD), scale(p->attitude.lambda / 2, T_times(e->q_SD, e->w)));
    return T_transposed(e->q_SD, barrier(channels, p->law_att, x, z, t, y));
}

/* before t_att the funnel of the attitude stays as at its start, and the torque command is 0 */
/* C.4-4 */
static void control_attitude(const Parameters *p, const TrackingError *e, Funnel *x, double t,
                             Output *y)
{
    Funnel resting = *x;
    int rests = attitude_rests(&p->tracking, t);
    vec3 M = attitude_torque(p, e, rests ? &resting : x, t, &y->attitude);
    if (rests) y->attitude.violation = 0, y->attitude.start_margin = 1;
    double A = p->wheel_scale;
    command_torque(&p->tracking, t, M, diagonal(A, A, A), &y->common);
}

/* C.4-5 */
static void control(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    Input in = tracking_in(u);
    TrackingError e = tracking_error(p->tracking.up_axis, &in);
    publish_errors(&e, &y->common);
    control_position(p, &e, &x->position, t, y);
    control_attitude(p, &e, &x->attitude, t, y);
}

/* While the initial values of a system are computed, inputs may have any value: start_margin is 1
 * here, and the start is checked in the first step. */
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    State first = {0};
    *x = first;
    control(p, u, &first, y, t);
    y->position.start_margin = y->attitude.start_margin = 1;
    if (u->active) return;
    command_nothing(&y->common);
    y->position.violation = y->attitude.violation = 0;
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    double period = p->tracking.sample_period;
    for (Sample s = first_sample(t, h, period); s.left > 0; s = next_sample(s)) {
        if (u->active) control(p, u, x, y, s.t);
        else initialize(p, u, x, y, s.t);
    }
}

FMU_MODEL("ppc_controller",
          "Model-free prescribed performance control of line of sight and attitude");
