/* two_bodies.h - motion of two rigid bodies under a force at a common point and a couple between
 * them, for the prediction of a mechanism over its step.
 *
 *   m_red rho'' = F_N,   J_S dw_S = C_SN (d_S x F_N + M_N) - w_S x J_S w_S
 *                        J_T dw_T = C_TN (-d_T x F_N - M_N) - w_T x J_T w_T,    dq = q [0, w]/2
 *
 * rho = r_S - r_T in N axes, m_red = m_S m_T/(m_S + m_T), rates w in body axes; dw, dq: derivatives
 * with respect to time; d_S, d_T: vectors from the centres of mass to the common point. Equations:
 * docs/models.md I.5 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef TWO_BODIES_H
#define TWO_BODIES_H

#include "pairs.h"

enum { BODY_S, BODY_T };

typedef struct {
    double m_red;
    mat3_pair J, J_inverse;
} TwoMasses;

typedef struct {
    vec3 rho, drho;
    quat_pair q;
    vec3_pair w;
} TwoBodies;

/* F: force on S, -F acts on T; M: moments on S and on T about their centres of mass, which contain
 * d x F; N axes */
typedef struct {
    vec3 F;
    vec3_pair M;
} Wrench;

static inline TwoMasses two_masses(double mass_S, mat3 J_S, double mass_T, mat3 J_T)
{
    TwoMasses m = {.m_red = mass_S * mass_T / (mass_S + mass_T)};
    set_mat(&m.J, BODY_S, J_S);
    set_mat(&m.J, BODY_T, J_T);
    set_mat(&m.J_inverse, BODY_S, inverted(J_S));
    set_mat(&m.J_inverse, BODY_T, inverted(J_T));
    return m;
}

/* dq/dt = q [0, w]/2 */
static inline quat attitude_rate(quat q, vec3 w)
{
    return product(q, (quat){0, w.x / 2, w.y / 2, w.z / 2});
}

static inline vec3 rate_derivative(mat3 J, mat3 J_inverse, vec3 w, vec3 torque)
{
    return mul(J_inverse, sub(torque, cross(w, mul(J, w))));
}

/* rotation matrices C_SN and C_TN */
static inline mat3_pair attitude_matrices(const TwoBodies *x)
{
    mat3_pair C;
    for (int i = 0; i < PAIR; i++) set_mat(&C, i, dcm_of_quat(quat_of(&x->q, i)));
    return C;
}

static inline void two_bodies_derivative(const TwoMasses *restrict m, const TwoBodies *restrict x,
                                         const mat3_pair *restrict C, const Wrench *restrict a,
                                         TwoBodies *restrict dx)
{
    dx->rho = x->drho;
    dx->drho = scale(1 / m->m_red, a->F);
    for (int i = 0; i < PAIR; i++) {
        vec3 w = vec_of(&x->w, i), torque = mul(mat_of_pair(C, i), vec_of(&a->M, i));
        set_quat(&dx->q, i, attitude_rate(quat_of(&x->q, i), w));
        set_vec(&dx->w, i,
                rate_derivative(mat_of_pair(&m->J, i), mat_of_pair(&m->J_inverse, i), w, torque));
    }
}

static inline quat normalised(quat q)
{
    double k = 1 / sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
    return (quat){k * q.w, k * q.x, k * q.y, k * q.z};
}
static inline void normalise(TwoBodies *x)
{
    for (int i = 0; i < PAIR; i++) set_quat(&x->q, i, normalised(quat_of(&x->q, i)));
}

#endif
