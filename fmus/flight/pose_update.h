/* pose_update.h - residuals of position and attitude of a measured pose, for relative_filter, and
 * the estimate at the acquisition, which is set from one pose.
 *
 *   h   = C_KN (C_TN^T d - rho - C_SN^T p_KS_S),   H_1 = [-C_KN, 0, -C_KN C_TN^T d~, 0, 0,
 *                                                         C_KN C_TN^T, 0]
 *   y_2 = err(q_TN* q_SN q_KS q_TK),               H_2 = [0 0 I 0 0 0 0]
 *
 * h: predicted r_GK_K, d: p_GT_T, rho: r_S - r_T, y_2: rotation vector of the attitude residual;
 * H_1, H_2: derivatives with respect to the errors of rho, velocity, attitude, rate, ratios of
 * inertia, d, acceleration (relative_motion.h); a~: matrix with a~ b = a x b. The covariance of the
 * noise is computed for the range predicted before the update. Equations: docs/models.md F.6. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef POSE_UPDATE_H
#define POSE_UPDATE_H

#include "mounting.h"
#include "pose_noise.h"
#include "relative_motion.h"
#include "small_rotation.h"

typedef struct {
    Camera camera;
    PoseNoise noise;
    double sigma_mount, resolve_flip;
    vec3 flip_axis;
} PoseModel;
typedef struct {
    double rho, drho, att, omega;
    Ratios inertia;
    vec3 p;
    double acc;
} StartSigmas;

typedef struct {
    vec3 r; /* measured position r_GK_K */
    quat q; /* measured q_TN */
    mat3 C_KN;
    vec3 lever_S; /* C_SN^T p_KS_S */
} Pose;

static inline Pose pose_at(const PoseModel *p, vec3 r_GK_K, quat q_TK, quat q_SN, quat q_TN_hat)
{
    quat q_KN = canonical(product(q_SN, p->camera.q_KS));
    quat q = canonical(product(q_KN, canonical(q_TK)));
    quat other = product(q, (quat){0, p->flip_axis.x, p->flip_axis.y, p->flip_axis.z});
    quat back = conjugate(q_TN_hat);
    if (p->resolve_flip && fabs(product(back, other).w) > fabs(product(back, q).w)) q = other;
    return (Pose){r_GK_K, q, dcm_of_quat(q_KN), tmul(dcm_of_quat(q_SN), p->camera.p_KS_S)};
}

/* predicted position, h = C_KN (C_TN^T d - rho - C_SN^T p_KS_S) */
static inline vec3 position_predicted(const Pose *m, const Estimate *x)
{
    return mul(m->C_KN, sub(sub(tmul(dcm_of_quat(x->q), x->d), x->rho), m->lever_S));
}

/* covariance of a measured position, R_1 = diag(sigma_r^2) + sigma_mount^2 range^2 I, and of a
 * measured attitude, R_2 = (sigma_t^2 + sigma_mount^2) I; sigma_r, sigma_t: noise of position, per
 * axis, and attitude at this range (pose_noise.h); sigma_mount: uncertainty of the attitude of the
 * camera [rad] */
static inline mat3 position_covariance(const PoseModel *p, double range)
{
    vec3 s = position_noise(&p->noise, range);
    double mount = p->sigma_mount * p->sigma_mount * range * range;
    return diagonal(s.x * s.x + mount, s.y * s.y + mount, s.z * s.z + mount);
}
static inline mat3 attitude_covariance(const PoseModel *p, double range)
{
    double s = attitude_noise(&p->noise, range);
    return identity(s * s + p->sigma_mount * p->sigma_mount);
}

static inline double update(Estimate *x, const Residual *m)
{
    double dx[ERRORS];
    double nis = update_covariance(x->P, ERRORS, m, dx);
    x->rho = add(x->rho, three(dx + RHO_AT));
    x->v = add(x->v, three(dx + V_AT));
    x->q = canonical(product(x->q, rotation(three(dx + THETA_AT))));
    x->w = add(x->w, three(dx + W_AT));
    for (size_t i = 0; i < RATIOS; i++) x->kappa.k[i] += dx[KAPPA_AT + i];
    x->d = add(x->d, three(dx + D_AT));
    x->a = add(x->a, three(dx + ACC_AT));
    return nis;
}

/* updates x by the measured position, with H_1 = [-C_KN, 0, -C_KN C_TN^T d~, 0, 0, C_KN C_TN^T, 0];
 * returns the normalised innovation squared */
static inline double update_position(Estimate *x, const Pose *m, mat3 R)
{
    mat3 C_KT = matmul_t(m->C_KN, dcm_of_quat(x->q));
    Residual residual = {.y = sub(m->r, position_predicted(m, x)),
                         .R = R,
                         .count = 3,
                         .block = {{RHO_AT, scaled(-1, m->C_KN)},
                                   {THETA_AT, scaled(-1, matmul(C_KT, tilde(x->d)))},
                                   {D_AT, C_KT}}};
    return update(x, &residual);
}

static inline double update_attitude(Estimate *x, const Pose *m, mat3 R)
{
    Residual residual = {.y = rotation_error(product(conjugate(x->q), m->q)),
                         .R = R,
                         .count = 1,
                         .block = {{THETA_AT, identity(1)}}};
    return update(x, &residual);
}

static inline double update_both(const PoseModel *p, Estimate *x, const Pose *m)
{
    double range = norm(position_predicted(m, x));
    double nis = update_position(x, m, position_covariance(p, range));
    return nis + update_attitude(x, m, attitude_covariance(p, range));
}

static inline mat3 squared(vec3 s) { return diagonal(s.x * s.x, s.y * s.y, s.z * s.z); }

/* sets the start covariance of the states that a pose does not measure */
static inline void start_covariance(const StartSigmas *s, double *P)
{
    memset(P, 0, ERRORS * ERRORS * sizeof *P);
    add_diagonal(P, V_AT, THETA_AT, s->drho * s->drho);
    add_diagonal(P, W_AT, KAPPA_AT, s->omega * s->omega);
    for (size_t i = 0; i < RATIOS; i++)
        add_diagonal(P, KAPPA_AT + i, KAPPA_AT + i + 1, s->inertia.k[i] * s->inertia.k[i]);
    put_block(P, ERRORS, D_AT, D_AT, squared(s->p));
    add_diagonal(P, ACC_AT, ERRORS, s->acc * s->acc);
}

static inline void put_pair(double *P, size_t row, size_t column, mat3 block)
{
    put_block(P, ERRORS, row, column, block);
    put_block(P, ERRORS, column, row, transpose(block));
}

/* sets rho = C_TN^T d - C_KN^T r_GK_K - C_SN^T p_KS_S, q_TN as measured, and the covariance P that
 * results from the noise of the pose and the start covariance of the other states */
static inline void acquire(const PoseModel *p, const StartSigmas *s, Estimate *x, const Pose *m)
{
    mat3 R_1 = position_covariance(p, norm(m->r)), R_2 = attitude_covariance(p, norm(m->r));
    x->q = canonical(m->q);
    mat3 C_NT = transpose(dcm_of_quat(x->q)), C_NK = transpose(m->C_KN), P_dd = squared(s->p);
    mat3 swing = matmul(C_NT, tilde(x->d));
    x->rho = sub(sub(mul(C_NT, x->d), mul(C_NK, m->r)), m->lever_S);
    start_covariance(s, x->P);
    put_block(x->P, ERRORS, THETA_AT, THETA_AT, R_2);
    put_block(x->P, ERRORS, RHO_AT, RHO_AT,
              plus(matmul(C_NK, matmul_t(R_1, C_NK)),
                   plus(matmul(swing, matmul_t(R_2, swing)), matmul(C_NT, matmul_t(P_dd, C_NT)))));
    put_pair(x->P, RHO_AT, THETA_AT, scaled(-1, matmul(swing, R_2)));
    put_pair(x->P, RHO_AT, D_AT, matmul(C_NT, P_dd));
    symmetrise(x->P, ERRORS);
}

#endif
