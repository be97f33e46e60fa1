/* transposition_guidance.c - attitude reference along which a docked assembly swings its module
 * without saturating its gyros.
 *
 * The attitude history (attitude over time, relative to the flight attitude, which has X along the
 * velocity and Z to the Earth) is planned in `initialize` (transposition_plan.h) from parameters
 * only, in working memory of fixed size that is separate from the model and no part of its state.
 * The state contains the nodes of the history and the total momentum at the nodes. Published at a
 * sample: attitude, rate and acceleration of the history, the momentum h that the gyros will have,
 * and its mean rate dh over the coming sample,
 *
 *   h = C_DN H_N - (J_A omega + h_m),   H_N = H_N(t_k) + integral(C_ND tau) from node t_k,
 *   dh = (h(t+T) - h(t))/T,
 *
 * the integral by two-point Gauss quadrature with 16 steps per node interval, so that a controller
 * with the same model follows h within 1e-6 of the saturation momentum. D: reference axes of the
 * base; J_A, h_m, tau: assembly.h; T: sample period. Outside the time window of the plan the
 * reference is the flight attitude and h is constant. Where the coming sample is not within the
 * window, and with T = 0, dh is the rate of h that gives the base the acceleration of the reference
 * at this instant. If no history satisfies the limits, the reference is the flight attitude, with a
 * status and an alarm. Source: patent CN106020225A, corrected (docs/models.md E). */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "assembly_rows.h"
#include "time_grid.h"
#include "transposition_plan.h"

typedef struct {
    Assembly assembly;
    Swing swing;
    vec3 h_0_S;
    double window_start, window, nodes, H_sat, momentum_share, rotation_max;
    double use_plan, scheme, alpha, lambda, weight, iterations_max, sample_period;
} Parameters;
typedef struct { double none; } Input;
typedef struct {
    History history;
    vec3 H_N[MAX_NODES + 1], h_end; /* total momentum at the nodes; h after the window */
} State;
typedef struct {
    AttitudeReference ref;
    vec3 eps_ref;
    double rotation_ref, status, no_plan, iterations, momentum_max, rotation_largest;
    double peak[MAX_ITERATIONS + 1], rotation[MAX_ITERATIONS + 1];
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.assembly = ASSEMBLY_START,
          .swing = SWING_START,
          .window = 5400,
          .nodes = 24, /* so few that planning takes milliseconds; the mission sets 90 */
          .H_sat = 1500,
          .momentum_share = 0.9,
          .rotation_max = 7 * PI / 36,
          .use_plan = 1,
          .alpha = 0.5,
          .lambda = 1e20,
          .iterations_max = 25},
};

static const Variable variables[] = {
    ASSEMBLY_ROWS(assembly),
    SWING_ROWS(swing),
    PARAMETER(h_0_S, "N.m.s", "momentum of the gyros at the start of the window, body axes"),
    PARAMETER(window_start, "s", "start of the time window in which the attitude follows the plan"),
    POSITIVE(window, "s", "length of the window, which must contain the swing"),
    POSITIVE(nodes, "1", "intervals between the nodes of the plan, a whole number, 8 to 120"),
    POSITIVE(H_sat, "N.m.s", "momentum at which the gyros saturate"),
    POSITIVE(momentum_share, "1",
             "part of H_sat below which the planned momentum remains, at most 1"),
    POSITIVE(rotation_max, "rad", "largest rotation from the flight attitude, at most 3.05 rad"),
    SWITCH(use_plan,
           "1: attitude by plan; 0: flight attitude (X forward, Z to the Earth) all the time"),
    NONNEGATIVE(scheme, "1",
                "discretisation: 0 spline, 1 patent CN106020225A, corrected second difference, "
                "2 patent as printed"),
    POSITIVE(alpha, "1", "part of the computed change of the plan that an iteration applies"),
    NONNEGATIVE(lambda, "N2.m2.s6",
                "weight on the second differences of the change of the plan in an iteration"),
    NONNEGATIVE(weight, "1",
                "weight of a node: |h|/max |h| to this power, whole number up to 8; h: momentum of "
                "the gyros"),
    NONNEGATIVE(iterations_max, "1",
                "largest number of iterations of the plan, whole number up to 30"),
    SAMPLE_PERIOD,

    ATTITUDE_REFERENCE_ROWS(OUTPUT_ROW, y, ref),
    OUTPUT(eps_ref, "1",
           "reference attitude relative to the flight attitude, vector part of the quaternion"),
    ANGLE_OUTPUT(rotation_ref, "angle between reference attitude and flight attitude"),
    MODE(status, "outcome of the plan",
         "planned|flight attitude requested|momentum not below the limit|rotation would exceed "
         "rotation_max"),
    ALARM(no_plan,
          "1: no planned attitude satisfies the limits (see status): flight attitude instead"),
    NONNEGATIVE_OUTPUT(iterations, "1", "iterations of the plan"),
    NONNEGATIVE_OUTPUT(momentum_max, "N.m.s", "largest predicted momentum of the gyros"),
    ANGLE_OUTPUT(rotation_largest, "largest angle between reference attitude and flight attitude"),
    NONNEGATIVE_OUTPUT(peak, "N.m.s",
                       "elements: largest momentum of the gyros before each iteration, then after "
                       "the last one (0 if status = 3), then 0"),
    NONNEGATIVE_OUTPUT(
        rotation, "rad",
        "elements: largest rotation before each iteration, then after the last one, then 0"),
};

static void check_whole(Problems *problems, const char *name, double value, double low, double high,
                        const char *rule)
{
    if (value != nearest_whole(value) || value < low || value > high)
        reject(problems, name, value, rule);
}

static void check_window(const Parameters *p, Problems *problems)
{
    const Swing *s = &p->swing;
    if (s->start < p->window_start)
        reject(problems, "swing_start", s->start, "must not be before window_start");
    if (s->start + s->duration > p->window_start + p->window)
        reject(problems, "window", p->window, "must not end before swing_start + swing_duration");
}

/* E.4-6 */
static void check(const Parameters *p, Problems *problems)
{
    check_assembly(problems, &p->assembly);
    check_window(p, problems);
    check_whole(problems, "nodes", p->nodes, 8, MAX_NODES, "must be a whole number from 8 to 120");
    check_whole(problems, "scheme", p->scheme, 0, 2, "must be 0, 1 or 2");
    check_whole(problems, "weight", p->weight, 0, 8, "must be a whole number from 0 to 8");
    check_whole(problems, "iterations_max", p->iterations_max, 0, MAX_ITERATIONS,
                "must be a whole number from 0 to 30");
    if (p->momentum_share > 1)
        reject(problems, "momentum_share", p->momentum_share, "must be at most 1");
    if (p->rotation_max > 3.05)
        reject(problems, "rotation_max", p->rotation_max, "must be at most 3.05 rad");
    if (norm(p->h_0_S) > p->H_sat)
        reject(problems, "h_0_S", norm(p->h_0_S), "must not be larger than H_sat");
}

/* ---- predicted momentum ---- */
static Configuration configuration_at(const Parameters *p, double t)
{
    return configuration(&p->assembly, arm_at(&p->swing, t));
}

static vec3 torque_N_at(const Parameters *p, const State *x, double t)
{
    Configuration c = configuration_at(p, t);
    mat3 C_So = base_motion(&p->assembly, history_at(&x->history, t)).C_So;
    vec3 torque = environment_torque(&p->assembly, &c, C_So);
    return tmul(dcm_of_quat(q_oN(&p->assembly, t)), tmul(C_So, torque));
}

enum { QUADRATURE = 16 }; /* steps of the quadrature per node interval */

static vec3 impulse_N(const Parameters *p, const State *x, double from, double to)
{
    double count = larger(1, ceiling_of(QUADRATURE * (to - from) / x->history.dt - 1e-6));
    double h = (to - from) / count, off = h / 2 / sqrt(3.0);
    vec3 sum = vec(0, 0, 0);
    for (int i = 0; i < QUADRATURE && i < count; i++) {
        double middle = from + (i + 0.5) * h;
        sum = sum3(sum, torque_N_at(p, x, middle - off), torque_N_at(p, x, middle + off));
    }
    return scale(h / 2, sum);
}

static vec3 momentum_D(const Parameters *p, const State *x, vec3 H_N, double t)
{
    Configuration c = configuration_at(p, t);
    BaseMotion s = base_motion(&p->assembly, history_at(&x->history, t));
    mat3 C_DN = matmul(s.C_So, dcm_of_quat(q_oN(&p->assembly, t)));
    return sub(mul(C_DN, H_N), momentum_without_gyros(&c, s.omega));
}

static double node_time(const History *y, int k) { return y->t_0 + k * y->dt; }
static double window_end(const History *y) { return node_time(y, intervals(y)); }

/* E.4-3 */
static vec3 predicted_momentum(const Parameters *p, const State *x, double t)
{
    const History *y = &x->history;
    if (t <= y->t_0) return p->h_0_S;
    if (t >= window_end(y)) return x->h_end;
    int k = index_within((t - y->t_0) / y->dt, intervals(y));
    double node = node_time(y, k);
    vec3 H_N = t > node ? add(x->H_N[k], impulse_N(p, x, node, t)) : x->H_N[k];
    return momentum_D(p, x, H_N, t);
}

/* sets H_N at the nodes and the gyro momentum after the window; returns the largest gyro momentum
 * at the quarters of the node intervals */
static double set_node_momenta(const Parameters *p, State *x)
{
    const History *y = &x->history;
    double part = y->dt / FINE, largest = norm(p->h_0_S);
    Configuration c = configuration_at(p, y->t_0);
    BaseMotion s = base_motion(&p->assembly, history_at(y, y->t_0));
    mat3 C_DN = matmul(s.C_So, dcm_of_quat(q_oN(&p->assembly, y->t_0)));
    vec3 H_N = tmul(C_DN, add(momentum_without_gyros(&c, s.omega), p->h_0_S));
    x->H_N[0] = H_N;
    for (int m = 1; m <= FINE * intervals(y); m++) {
        double from = y->t_0 + (m - 1) * part, to = y->t_0 + m * part;
        H_N = add(H_N, impulse_N(p, x, from, to));
        x->h_end = momentum_D(p, x, H_N, to);
        largest = larger(largest, norm(x->h_end));
        if (m % FINE == 0) x->H_N[m / FINE] = H_N;
    }
    return largest;
}

/* ---- reference ---- */
/* E.4-4 */
static vec3 rate_of_momentum(const Parameters *p, const State *x, const BaseMotion *s, vec3 h,
                             double t)
{
    double T = p->sample_period;
    if (T > 0 && t >= x->history.t_0 && reached(window_end(&x->history), t + T))
        return scale(1 / T, sub(predicted_momentum(p, x, t + T), h));
    Configuration c = configuration_at(p, t);
    return momentum_rate(&c, s->omega, s->domega, h, environment_torque(&p->assembly, &c, s->C_So));
}

/* E.4-2 */
static void guide(const Parameters *p, const State *x, Output *y, double t)
{
    Motion eps = history_at(&x->history, t);
    BaseMotion s = base_motion(&p->assembly, eps);
    y->ref.q = q_SH_of_q_So(s.q_So);
    y->ref.omega = s.omega;
    y->ref.alpha = s.domega;
    y->ref.h = predicted_momentum(p, x, t);
    y->ref.dh = rate_of_momentum(p, x, &s, y->ref.h, t);
    y->eps_ref = eps.x;
    y->rotation_ref = rotation_of(eps.x);
}

static double largest_rotation(const History *y)
{
    double largest = 0;
    for (int m = 0; m <= FINE * intervals(y); m++)
        largest = larger(largest, rotation_of(fine_motion(y, m).x));
    return largest;
}

/* E.4-1, E.4-5 */
static Result planned_history(const Parameters *p, History *y, Workspace *w)
{
    Task task = {
        &p->assembly, &p->swing, p->h_0_S,  p->momentum_share * p->H_sat, p->rotation_max,
        p->alpha,     p->lambda, p->weight, (int)p->iterations_max,       (Scheme)(int)p->scheme};
    if (p->use_plan != 0) return plan(&task, y, w);
    stay_in_flight_attitude(y);
    return (Result){.status = FLIGHT_ATTITUDE};
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t,
                       Workspace *w)
{
    (void)u;
    x->history.n = p->nodes;
    x->history.t_0 = p->window_start;
    x->history.dt = p->window / p->nodes;
    Result r = planned_history(p, &x->history, w);
    y->status = r.status;
    y->no_plan = r.status > FLIGHT_ATTITUDE;
    y->iterations = r.iterations;
    for (int i = 0; i <= r.iterations; i++) {
        y->peak[i] = r.peak[i];
        y->rotation[i] = r.rotation[i];
    }
    y->momentum_max = set_node_momenta(p, x);
    y->rotation_largest = largest_rotation(&x->history);
    guide(p, x, y, t);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    (void)u;
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        guide(p, x, y, s.t);
}

FMU_MODEL_WITH(Workspace, "transposition_guidance",
               "Attitude history of a docked assembly with its gyros below saturation");
