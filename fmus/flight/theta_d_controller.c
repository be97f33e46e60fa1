/* theta_d_controller.c - theta-D control of line of sight and attitude: nonlinear optimal control
 * by an expansion around a linear quadratic regulator; baseline for comparisons, with a
 * full model.
 *
 *   dx/dt = (A0 + A(x,t)) x + B v,     cost = integral of x^T Q x + v^T R v,     S = B R^-1 B^T,
 *           Ac = A0 - S T0
 *   T0:  A0^T T0 + T0 A0 - T0 S T0 + Q = 0
 *   T1:  T1 Ac + Ac^T T1 = -eps_1 (T0 A + A^T T0)
 *   T2:  T2 Ac + Ac^T T2 = -eps_2 (T1 A + A^T T1 - T1 S T1),
 *           eps_i = 1 - k_i exp(-l_i (t - t_0))
 *   v = -R^-1 B^T (T0 + T1 + T2) x,     t_0: first sample in use, for attitude not before t_att
 *
 * Position: x = (x1, x2), A0 = [0 I; 0 0], B = [0; I], A x = f(x) - f(0), u = g^-1 (v - f(0));
 *   x1: LOS coordinates minus their reference, x2 = dx1/dt, of which dx2/dt = f + g u;
 *   f(0): kinematics of the reference, differential gravity, minus the reference acceleration.
 * Attitude: x = (e, w), A0 = [0 I/2; 0 0], A = [0 (T(q_SD) - I)/2; 0 0], B = [0; J_hat^-1],
 *   e: vector part of q_SD, de/dt = T(q_SD) w/2, w: rate error;
 *   wd, wdd: rate and angular acceleration of the reference, S axes;
 *   M = -R^-1 B^T (T0 + T1 + T2) x + omega x (J_hat omega + A_hat Omega) + J_hat (wdd - w x wd).
 * Definitions in full: tracking.h.
 * The costs are squares of acceleration (position) and torque (attitude): so R of range and of
 * attitude has no unit. T0 and the inverse of the Lyapunov operator are computed from the weights
 * and J_hat at the start.
 * Source: Xin & Balakrishnan 2002 as used by Yin, Luo, Wei & Yuan 2017; docs/models.md C.5, with
 * the terms that a reference of variable range adds. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "earth.h"
#include "riccati.h"
#include "rigid_body.h"
#include "tracking.h"

typedef struct { double Q_error, Q_rate, R; } Weights;
typedef struct {
    TrackingParameters tracking;
    double mu;
    mat3 J_hat, A_hat;
    Weights range, elevation, azimuth, attitude;
    double k_1, k_2, l_1, l_2, k_att, l_att;
} Parameters;
typedef TrackingInput Input;
typedef struct {
    mat6 T0, S;
    LyapunovInverse solver;
    double t_0;
} Expansion;
typedef struct {
    Expansion position, attitude;
    double rested; /* 1: the last sample had active = 0 */
} State;
typedef struct { TrackingOutput common; } Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.tracking = TRACKING_DEFAULTS,
          .mu = MU_WGS84,
          .J_hat = {{{50, 0, 0}, {0, 45, 0}, {0, 0, 60}}},
          .A_hat = {{{10, 0, 0}, {0, 10, 0}, {0, 0, 10}}},
          .range = {.Q_error = 0.04, .Q_rate = 1.0884, .R = 1},
          .elevation = {.Q_error = 100, .Q_rate = 2900, .R = 1e4},
          .azimuth = {.Q_error = 100, .Q_rate = 2900, .R = 1e4},
          .attitude = {.Q_error = 900, .Q_rate = 2100, .R = 1},
          .k_1 = 0.9,
          .k_2 = 0.9,
          .l_1 = 0.1,
          .l_2 = 0.1,
          .k_att = 0.9,
          .l_att = 0.1},
    .u = TRACKING_START,
};

#define WEIGHT_ROW(member, weight, unit, text)                            \
    ROW_AS(PARAMETER_ROW, p, #member "." #weight, member.weight, 1, unit, \
           #member ": weight in the cost of the square of " text, POSITIVE_VALUE)
#define WEIGHT_ROWS(member, error_unit, rate_unit, R_unit, of)      \
    WEIGHT_ROW(member, Q_error, error_unit, "the error" of),        \
        WEIGHT_ROW(member, Q_rate, rate_unit, "the rate error" of), \
        WEIGHT_ROW(member, R, R_unit, "the control" of)
#define ANGLE_WEIGHTS(member) WEIGHT_ROWS(member, "m2/s4", "m2/s2", "m2", ", angles in rad")

static const Variable variables[] = {
    TRACKING_PARAMETERS(tracking),
    NONNEGATIVE(mu, "m3/s2", "gravitational parameter of the planet; 0 = deep space"),
    MATRIX(J_hat, "kg.m2",
           "inertia of the servicer as known to the software, wheels locked, body axes"),
    MATRIX(A_hat, "kg.m2",
           "matrix from wheel speeds to wheel momentum in body axes, as known to the software"),
    WEIGHT_ROWS(range, "1/s4", "1/s2", "1", ""),
    ANGLE_WEIGHTS(elevation),
    ANGLE_WEIGHTS(azimuth),
    WEIGHT_ROWS(attitude, "N2.m2", "N2.m2.s2", "1",
                "; error: vector part of q_SD, rate: domega_S, control: torque"),
    NONNEGATIVE(
        k_1, "1",
        "position: share of T1, first correction of the expansion, suppressed at the start; at "
        "most 1"),
    NONNEGATIVE(
        k_2, "1",
        "position: share of T2, second correction of the expansion, suppressed at the start; at "
        "most 1"),
    NONNEGATIVE(l_1, "1/s", "position: rate at which the suppression of T1 decays"),
    NONNEGATIVE(l_2, "1/s", "position: rate at which the suppression of T2 decays"),
    NONNEGATIVE(k_att, "1",
                "attitude: part of T1 and T2 that is suppressed at the start, at most 1"),
    NONNEGATIVE(l_att, "1/s", "attitude: rate at which the suppression of T1 and T2 decays"),

    TRACKING_INPUTS,

    TRACKING_OUTPUTS(common),
};

static void check_part(Problems *problems, const char *name, double k)
{
    if (k > 1) reject(problems, name, k, "must be in [0, 1]");
}

/* C.5-11 */
static void check(const Parameters *p, Problems *problems)
{
    check_up_axis(problems, p->tracking.up_axis);
    check_inertia(problems, "J_hat", p->J_hat);
    check_positive_definite(problems, "A_hat", p->A_hat);
    check_part(problems, "k_1", p->k_1);
    check_part(problems, "k_2", p->k_2);
    check_part(problems, "k_att", p->k_att);
}

/* ---- chains dx1/dt = link x2, dx2/dt = input; link: 1 for position, 1/2 for attitude ---- */
typedef struct { vec3 x1, x2; } Chain;

static void set_block(mat6 *m, int row, int column, mat3 b)
{
    for (int i = 0; i < 3; i++) {
        m->at[row + i][column] = b.row[i].x;
        m->at[row + i][column + 1] = b.row[i].y;
        m->at[row + i][column + 2] = b.row[i].z;
    }
}

static vec3 block_times(const mat6 *m, int row, int column, vec3 a)
{
    const double *r0 = &m->at[row][column], *r1 = &m->at[row + 1][column],
                 *r2 = &m->at[row + 2][column];
    return vec(r0[0] * a.x + r0[1] * a.y + r0[2] * a.z, r1[0] * a.x + r1[1] * a.y + r1[2] * a.z,
               r2[0] * a.x + r2[1] * a.y + r2[2] * a.z);
}

static mat3 diagonal3(vec3 d) { return diagonal(d.x, d.y, d.z); }

static void expand(double link, mat3 S, vec3 Q_error, vec3 Q_rate, Expansion *x)
{
    mat6 A0 = {{{0}}}, Q = {{{0}}};
    x->S = A0;
    set_block(&A0, 0, 3, diagonal(link, link, link));
    set_block(&x->S, 3, 3, S);
    set_block(&Q, 0, 0, diagonal3(Q_error));
    set_block(&Q, 3, 3, diagonal3(Q_rate));
    x->T0 = riccati(A0, x->S, Q, &x->solver);
    lyapunov_inverse(sum6(1, A0, -1, product6(x->S, x->T0)), &x->solver);
}

static mat6 with_transpose(mat6 a) { return sum6(1, a, 1, transpose6(a)); }

/* rows 4 to 6 (of 6) of (T0 + T1 + T2) x, with A, eps_1, eps_2 and x of this sample */
/* C.5-7 */
static vec3 costate(const Expansion *e, mat6 A, double eps_1, double eps_2, Chain x)
{
    mat6 T1 = lyapunov(&e->solver, sum6(-eps_1, with_transpose(product6(e->T0, A)), 0, A));
    mat6 quadratic = sum6(1, with_transpose(product6(T1, A)), -1, product6(product6(T1, e->S), T1));
    mat6 T2 = lyapunov(&e->solver, sum6(-eps_2, quadratic, 0, A));
    mat6 T = sum6(1, sum6(1, e->T0, 1, T1), 1, T2);
    return add(block_times(&T, 3, 0, x.x1), block_times(&T, 3, 3, x.x2));
}

/* ---- position ---- */
static vec3 per_channel(vec3 a, vec3 b) { return vec(a.x / b.x, a.y / b.y, a.z / b.z); }
static vec3 position_R(const Parameters *p)
{
    return vec(p->range.R, p->elevation.R, p->azimuth.R);
}

static void expand_position(const Parameters *p, Expansion *x)
{
    vec3 Q_error = vec(p->range.Q_error, p->elevation.Q_error, p->azimuth.Q_error);
    vec3 Q_rate = vec(p->range.Q_rate, p->elevation.Q_rate, p->azimuth.Q_rate);
    expand(1, diagonal3(per_channel(vec(1, 1, 1), position_R(p))), Q_error, Q_rate, x);
}

#define STRAIGHT 1e-8 /* rad: below this x, sin(x)/x is 1 to the last bit */

static double sin_over(double x) { return fabs(x) < STRAIGHT ? 1 : sine(x) / x; }

/* rows 4 to 6 of A, with A x = f(x) - f(0): kinematics of the actual motion minus kinematics of the
 * reference */
static mat6 kinematic_matrix(const TrackingError *e)
{
    vec3 d = e->now.q.d, dr = e->ref.q.d;
    double rho = e->now.rho_safe, rho_r = e->ref.rho_safe, ce = e->now.ce_safe,
           ce_r = e->ref.ce_safe;
    SineCosine sum = sine_and_cosine(e->now.q.x.y + e->ref.q.x.y);
    double S = sin_over(e->x1.y), tangent = e->now.se / ce, closing = -2 * dr.x / rho;

    mat6 A = {{{0}}};
    set_block(&A, 3, 0,
              rows(vec(d.y * d.y + d.z * d.z * ce * ce, -rho_r * dr.z * dr.z * sum.s * S, 0),
                   vec(-closing * dr.y / rho_r, -dr.z * dr.z * sum.c * S, 0),
                   vec(-closing * dr.z / rho_r, 2 * dr.y * dr.z * S / (ce * ce_r), 0)));
    set_block(&A, 3, 3,
              rows(vec(0, rho_r * (d.y + dr.y), rho_r * ce * ce * (d.z + dr.z)),
                   vec(-2 * d.y / rho, closing, -e->now.se * ce * (d.z + dr.z)),
                   vec(-2 * d.z / rho, 2 * tangent * d.z, closing + 2 * tangent * dr.y)));
    return A;
}

/* f(0): dx2/dt on the reference without control */
static vec3 bias(const Parameters *p, const Input *u, const TrackingError *e)
{
    vec3 gravity = mul(e->now.C_LN, differential_gravity(p->mu, u->T.r, sub(u->S.r, u->T.r)));
    LineOfSight ref = e->ref;
    vec3 kinematics = los_accelerations(&ref, vec(0, 0, 0));
    vec3 g = vec(1, 1 / e->now.rho_safe, 1 / (e->now.rho_safe * e->now.ce_safe));
    return sub(add(kinematics, times(g, Sigma(gravity))), ref.q.dd);
}

/* C.5-10 */
static void control_position(const Parameters *p, const Input *u, const TrackingError *e,
                             const Expansion *x, double t, Output *y)
{
    double age = t - x->t_0, eps_1 = 1 - p->k_1 * exponential(-p->l_1 * age),
           eps_2 = 1 - p->k_2 * exponential(-p->l_2 * age);
    vec3 v = neg(per_channel(costate(x, kinematic_matrix(e), eps_1, eps_2, (Chain){e->x1, e->x2}),
                             position_R(p)));
    vec3 g_inverse = vec(1, e->now.rho_safe, e->now.rho_safe * e->now.ce_safe);
    command_force(&p->tracking, e, times(g_inverse, sub(v, bias(p, u, e))), &y->common);
}

/* ---- attitude ---- */
static mat3 inverse_of(mat3 m)
{
    return transpose(rows(solve(m, vec(1, 0, 0)), solve(m, vec(0, 1, 0)), solve(m, vec(0, 0, 1))));
}

static mat3 scaled3(double k, mat3 m)
{
    return rows(scale(k, m.row[0]), scale(k, m.row[1]), scale(k, m.row[2]));
}

static void expand_attitude(const Parameters *p, Expansion *x)
{
    mat3 B = inverse_of(p->J_hat);
    double e = p->attitude.Q_error, w = p->attitude.Q_rate;
    expand(0.5, scaled3(1 / p->attitude.R, matmul_t(B, B)), vec(e, e, e), vec(w, w, w), x);
}

/* A = [0 (T(q) - I)/2; 0 0] */
static mat6 attitude_matrix(quat q)
{
    mat6 A = {{{0}}};
    double d = (q.w - 1) / 2;
    set_block(
        &A, 0, 3,
        rows(vec(d, -q.z / 2, q.y / 2), vec(q.z / 2, d, -q.x / 2), vec(-q.y / 2, q.x / 2, d)));
    return A;
}

/* C.5-9 */
static void control_attitude(const Parameters *p, const Input *u, const TrackingError *e,
                             const Expansion *x, double t, Output *y)
{
    double eps = 1 - p->k_att * exponential(-p->l_att * larger(t - x->t_0, 0));
    vec3 lambda =
        costate(x, attitude_matrix(e->q_SD), eps, eps, (Chain){vector_part(e->q_SD), e->w});
    vec3 momentum = add(mul(p->J_hat, u->S.omega), mul(p->A_hat, u->wheel_speed));
    vec3 forward = add(cross(u->S.omega, momentum), mul(p->J_hat, sub(e->wdd, cross(e->w, e->wd))));
    vec3 M = sub(forward, scale(1 / p->attitude.R, solve(p->J_hat, lambda)));
    command_torque(&p->tracking, t, M, p->A_hat, &y->common);
}

/* ---- one sample ---- */
static void control(const Parameters *p, const Input *u, const State *x, Output *y, double t)
{
    Input in = tracking_in(u);
    TrackingError e = tracking_error(p->tracking.up_axis, &in);
    publish_errors(&e, &y->common);
    control_position(p, &in, &e, &x->position, t, y);
    control_attitude(p, &in, &e, &x->attitude, t, y);
}

/* sets t_0 of the terms eps_i: t for position, the later of t and t_att for attitude */
/* C.5-8 */
static void begin(const Parameters *p, State *x, double t)
{
    x->position.t_0 = t;
    x->attitude.t_0 = larger(t, p->tracking.t_att);
}

static void sample(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    if (x->rested || !u->active) begin(p, x, t);
    control(p, u, x, y, t);
    if (!u->active) command_nothing(&y->common);
    x->rested = !u->active;
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    expand_position(p, &x->position);
    expand_attitude(p, &x->attitude);
    begin(p, x, t);
    sample(p, u, x, y, t);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    double period = p->tracking.sample_period;
    for (Sample s = first_sample(t, h, period); s.left > 0; s = next_sample(s))
        sample(p, u, x, y, s.t);
}

FMU_MODEL("theta_d_controller",
          "Theta-D suboptimal control of line of sight and attitude with a full model");
