/* relative_motion.h - model of a servicer's motion relative to a free target: relative position and
 * velocity in N axes, attitude and rate of the target, ratios of its inertias, and the covariance.
 *
 *   rho' = v,   v' = g(r_S) - g(r_S - rho) + a_thrust + a,    r_S = r_j + s v_j
 *   q' = q [0, w]/2,   B w' = -w x B w + 3 mu/r^3 e x B e,    B = J/J11, e: direction of the
 *                                                             target from the planet, T axes
 *
 * rho, v: position and velocity of the servicer relative to the target, q, w: attitude and rate of
 * the target, g: gravity of the planet, r_j, v_j: servicer at sample j, s: time since sample j, r:
 * distance of the target from the planet, kappa: ratios of inertia, d: p_GT_T, position of the
 * tracked point from the target's centre of mass, a: unmodelled acceleration. P is the covariance
 * of the errors, truth minus estimate, in the order rho, v, theta, w, kappa, d, a; the attitude
 * error theta is defined by q_TN = q_hat rot(theta). kappa, d or a with neither start covariance
 * nor noise is not estimated: its rows of P stay 0. docs/models.md F.6. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef RELATIVE_MOTION_H
#define RELATIVE_MOTION_H

#include "covariance.h"
#include "orbit.h"
#include "rk4.h"

enum { RATIOS = 5 };
enum {
    RHO_AT = 0,
    V_AT = 3,
    THETA_AT = 6,
    W_AT = 9,
    KAPPA_AT = 12,
    D_AT = 17,
    ACC_AT = 20,
    ERRORS = 23,
    MOVING = 12
};

typedef struct { double k[RATIOS]; } Ratios; /* J22, J33, J12, J13, J23, each over J11 */
typedef struct {
    vec3 rho, v;
    quat q;
    vec3 w;
    Ratios kappa;
    vec3 d, a;
    double P[ERRORS * ERRORS];
} Estimate;
typedef struct {
    vec3 r, v;
    quat q;
    vec3 thrust_N; /* m/s2, held until the next sample */
} Servicer;        /* servicer at a sample */
typedef struct {
    Orbit planet; /* mu, R_E, J2 */
    double use_J2, use_gravity_gradient;
    double sigma_a, sigma_thrust, sigma_alpha, sigma_kappa, sigma_d, sigma_acc;
} MotionModel;

/* ---- state ---- */
static inline mat3 inertia_of_ratios(double k11, Ratios r)
{
    const double *k = r.k;
    return rows(vec(k11, k[2], k[3]), vec(k[2], k[0], k[4]), vec(k[3], k[4], k[1]));
}

static inline double tidal_rate(const MotionModel *m, double r) /* 3 mu/r^3 [1/s2] */
{
    return m->use_gravity_gradient && m->planet.mu > 0 ? 3 * m->planet.mu / (r * r * r) : 0;
}

static inline vec3 torque_of(mat3 B, vec3 w, double tide, vec3 e)
{
    return sub(scale(tide, cross(e, mul(B, e))), cross(w, mul(B, w)));
}

/* direction of the target from the planet, target axes; arbitrary in deep space */
static inline vec3 radial_T(quat q_TN, vec3 r_T)
{
    double r = norm(r_T);
    return r > 0 ? scale(1 / r, mul(dcm_of_quat(q_TN), r_T)) : vec(1, 0, 0);
}

typedef struct {
    vec3 rho, v;
    quat q;
    vec3 w;
} Moving; /* members of Estimate that are integrated */
typedef struct {
    const MotionModel *model;
    const Servicer *S;
    mat3 B;
    vec3 a;
} MotionContext;

static inline void relative_derivative(const MotionContext *c, double s, const Moving *x,
                                       Moving *dx)
{
    const Orbit *planet = &c->model->planet;
    vec3 r_S = add(c->S->r, scale(s, c->S->v)), r_T = sub(r_S, x->rho);
    vec3 tide = sub(gravity(planet, c->model->use_J2, r_S), gravity(planet, c->model->use_J2, r_T));
    vec3 e = radial_T(canonical(x->q), r_T);
    quat dq = product(x->q, (quat){0, x->w.x / 2, x->w.y / 2, x->w.z / 2});
    *dx = (Moving){x->v, sum3(tide, c->S->thrust_N, c->a), dq,
                   solve(c->B, torque_of(c->B, x->w, tidal_rate(c->model, norm(r_T)), e))};
}

RK4(integrate_motion, relative_derivative, MotionContext, Moving)

static inline void propagate_state(const MotionModel *model, const Servicer *S, Estimate *x,
                                   double T)
{
    const MotionContext context = {model, S, inertia_of_ratios(1, x->kappa), x->a};
    Moving m = {x->rho, x->v, x->q, x->w};
    integrate_motion(&context, 0, T, &m);
    x->rho = m.rho, x->v = m.v, x->q = canonical(m.q), x->w = m.w;
}

/* ---- transition: F = Phi - I = A T + A^2 T^2/2 ---- */
static inline void translation_blocks(const MotionModel *model, vec3 r_T, double T, double *F)
{
    mat3 G = gravity_gradient_matrix(model->planet.mu, r_T);
    put_block(F, ERRORS, RHO_AT, RHO_AT, scaled(T * T / 2, G));
    put_block(F, ERRORS, RHO_AT, V_AT, identity(T));
    put_block(F, ERRORS, RHO_AT, ACC_AT, identity(T * T / 2));
    put_block(F, ERRORS, V_AT, RHO_AT, scaled(T, G));
    put_block(F, ERRORS, V_AT, V_AT, scaled(T * T / 2, G));
    put_block(F, ERRORS, V_AT, ACC_AT, identity(T));
}

typedef struct {
    mat3 inverse_B, th_th, w_th, w_w; /* B^-1, blocks of system matrix A for errors theta, w */
    mat3 B;
    vec3 w, dw, e;
    double tide;
} Rotation;

/* A_th,th = -w~,   A_w,th = B^-1 tide (e~ B - (B e)~) e~,   A_w,w = B^-1 ((B w)~ - w~ B);
 * tide = 3 mu/r^3; v~: matrix of the vector product v x */
static inline Rotation rotation_of(const MotionModel *model, const Estimate *x, vec3 r_T)
{
    mat3 B = inertia_of_ratios(1, x->kappa);
    vec3 e = radial_T(x->q, r_T);
    Rotation r = {
        .inverse_B = inverted(B), .B = B, .w = x->w, .e = e, .tide = tidal_rate(model, norm(r_T))};
    mat3 tilt = plus(matmul(tilde(e), B), tilde(neg(mul(B, e))));
    mat3 spin = plus(tilde(mul(B, x->w)), scaled(-1, matmul(tilde(x->w), B)));
    r.th_th = tilde(neg(x->w));
    r.w_th = matmul(r.inverse_B, scaled(r.tide, matmul(tilt, tilde(e))));
    r.w_w = matmul(r.inverse_B, spin);
    r.dw = mul(r.inverse_B, torque_of(B, x->w, r.tide, e));
    return r;
}

static inline void rotation_blocks(const Rotation *r, double T, double *F)
{
    mat3 th_th = plus(matmul(r->th_th, r->th_th), r->w_th), th_w = plus(r->th_th, r->w_w);
    mat3 w_th = plus(matmul(r->w_th, r->th_th), matmul(r->w_w, r->w_th));
    mat3 w_w = plus(r->w_th, matmul(r->w_w, r->w_w));
    double h = T * T / 2;
    put_block(F, ERRORS, THETA_AT, THETA_AT, plus(scaled(T, r->th_th), scaled(h, th_th)));
    put_block(F, ERRORS, THETA_AT, W_AT, plus(identity(T), scaled(h, th_w)));
    put_block(F, ERRORS, W_AT, THETA_AT, plus(scaled(T, r->w_th), scaled(h, w_th)));
    put_block(F, ERRORS, W_AT, W_AT, plus(scaled(T, r->w_w), scaled(h, w_w)));
}

static inline void put_column(double *F, size_t row, size_t column, vec3 a)
{
    F[row * ERRORS + column] = a.x;
    F[(row + 1) * ERRORS + column] = a.y;
    F[(row + 2) * ERRORS + column] = a.z;
}

/* A_w,kappa_i = B^-1 (-w x E_i w + tide e x E_i e - E_i w'),   E_i = dB/dkappa_i */
static inline void inertia_columns(const Rotation *r, double T, double *F)
{
    for (size_t i = 0; i < RATIOS; i++) {
        Ratios one = {{0}};
        one.k[i] = 1;
        mat3 E = inertia_of_ratios(0, one);
        vec3 A = mul(r->inverse_B, sub(torque_of(E, r->w, r->tide, r->e), mul(E, r->dw)));
        put_column(F, THETA_AT, KAPPA_AT + i, scale(T * T / 2, A));
        put_column(F, W_AT, KAPPA_AT + i, add(scale(T, A), scale(T * T / 2, mul(r->w_w, A))));
    }
}

static inline int ratios_are_estimated(const Estimate *x)
{
    double sum = 0;
    for (size_t i = KAPPA_AT; i < D_AT; i++) sum += x->P[i * (ERRORS + 1)];
    return sum > 0;
}

static inline void relative_transition(const MotionModel *model, const Servicer *S,
                                       const Estimate *x, double T, double *F)
{
    vec3 r_T = sub(S->r, x->rho);
    Rotation r = rotation_of(model, x, r_T);
    memset(F, 0, MOVING * ERRORS * sizeof *F);
    translation_blocks(model, r_T, T, F);
    rotation_blocks(&r, T, F);
    if (ratios_are_estimated(x)) inertia_columns(&r, T, F);
}

/* ---- noise ---- */
static inline void add_diagonal(double *P, size_t from, size_t to, double variance)
{
    for (size_t i = from; i < to; i++) P[i * (ERRORS + 1)] += variance;
}

static inline void add_motion_noise(const MotionModel *m, vec3 thrust_N, double *P, double T)
{
    double thrust = m->sigma_thrust * m->sigma_thrust * dot(thrust_N, thrust_N);
    add_white_acceleration(P, ERRORS, RHO_AT, V_AT, m->sigma_a * m->sigma_a + thrust, T);
    add_white_acceleration(P, ERRORS, THETA_AT, W_AT, m->sigma_alpha * m->sigma_alpha, T);
    add_diagonal(P, KAPPA_AT, D_AT, m->sigma_kappa * m->sigma_kappa * T);
    add_diagonal(P, D_AT, ACC_AT, m->sigma_d * m->sigma_d * T);
    add_diagonal(P, ACC_AT, ERRORS, m->sigma_acc * m->sigma_acc * T);
}

/* propagates the estimate from the sample S to the next */
static inline void propagate_relative(const MotionModel *model, const Servicer *S, Estimate *x,
                                      double T)
{
    double F[MOVING * ERRORS];
    relative_transition(model, S, x, T, F);
    propagate_state(model, S, x, T);
    propagate_covariance(x->P, F, MOVING, ERRORS);
    add_motion_noise(model, S->thrust_N, x->P, T);
    symmetrise(x->P, ERRORS);
}

#endif
