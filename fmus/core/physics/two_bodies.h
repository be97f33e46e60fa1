/* two_bodies.h - two rigid bodies under a load at one common point and a couple between them: the
 * motion that a mechanism predicts over its step.
 *
 *   m_red drho'' = F_N,   J_S dw_S = C_SN (d_S x F_N + M_N) - w_S x J_S w_S
 *                         J_T dw_T = C_TN (-d_T x F_N - M_N) - w_T x J_T w_T,    dq = q [0, w]/2
 *
 * rho = r_S - r_T in N axes, rates in body axes. Equations: docs/models.md I.5 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef TWO_BODIES_H
#define TWO_BODIES_H

#include "attitude.h"

typedef struct {
    double m_red;
    mat3 J_S, J_T, J_S_inverse, J_T_inverse;
} TwoMasses;

typedef struct {
    vec3 rho, drho;
    quat q_S;
    vec3 w_S;
    quat q_T;
    vec3 w_T;
} TwoBodies;

typedef struct { mat3 C_SN, C_TN; } TwoAttitudes;

/* on S and on T about their centres of mass, N axes; the force on T is -F */
typedef struct { vec3 F, M_S, M_T; } Wrench;

static inline TwoMasses two_masses(double mass_S, mat3 J_S, double mass_T, mat3 J_T)
{
    return (TwoMasses){mass_S * mass_T / (mass_S + mass_T), J_S, J_T, inverted(J_S), inverted(J_T)};
}

/* q [0, w]/2 */
static inline quat attitude_rate(quat q, vec3 w)
{
    return product(q, (quat){0, w.x / 2, w.y / 2, w.z / 2});
}

static inline vec3 rate_derivative(mat3 J, mat3 J_inverse, vec3 w, vec3 torque)
{
    return mul(J_inverse, sub(torque, cross(w, mul(J, w))));
}

static inline TwoAttitudes two_attitudes(const TwoBodies *x)
{
    return (TwoAttitudes){dcm_of_quat(x->q_S), dcm_of_quat(x->q_T)};
}

static inline void two_bodies_derivative(const TwoMasses *m, const TwoBodies *x,
                                         const TwoAttitudes *at, const Wrench *a, TwoBodies *dx)
{
    vec3 M_S = mul(at->C_SN, a->M_S), M_T = mul(at->C_TN, a->M_T);
    dx->rho = x->drho;
    dx->drho = scale(1 / m->m_red, a->F);
    dx->q_S = attitude_rate(x->q_S, x->w_S);
    dx->w_S = rate_derivative(m->J_S, m->J_S_inverse, x->w_S, M_S);
    dx->q_T = attitude_rate(x->q_T, x->w_T);
    dx->w_T = rate_derivative(m->J_T, m->J_T_inverse, x->w_T, M_T);
}

static inline quat normalised(quat q)
{
    double k = 1 / sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
    return (quat){k * q.w, k * q.x, k * q.y, k * q.z};
}
static inline void normalise(TwoBodies *x)
{
    x->q_S = normalised(x->q_S);
    x->q_T = normalised(x->q_T);
}

#endif
