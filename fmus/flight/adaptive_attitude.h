/* adaptive_attitude.h - attitude law with estimated inertias of body and wheels.
 *
 *   (19) A_hat dOmega = G^T(epsilon) K epsilon/4 + P dw - J_hat wdd - wd x (A_hat Omega + J_hat wd)
 *
 * epsilon: MRP of S relative to D, d epsilon/dt = G(epsilon) dw/4, dw = omega - wd, wd = C_SD
 * omega_d, wdd = C_SD alpha_d; omega: angular velocity of S; omega_d, alpha_d: angular velocity and
 * acceleration of D, in axes D; Omega: wheel speeds, dOmega: commanded wheel acceleration; J_hat,
 * A_hat: estimated inertias of body and wheels; K, P: gains; all others in servicer axes. Source:
 * Zhu & Yang 2009; docs/models.md A.5.2. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef ADAPTIVE_ATTITUDE_H
#define ADAPTIVE_ATTITUDE_H

#include "reference_rows.h"

typedef struct { double v[6]; } Symmetric; /* elements S11 S12 S13 S22 S23 S33 */
typedef struct { Symmetric J, A; } Eta;    /* J: inertia of the body, A: of the wheels */

static inline mat3 full_matrix(Symmetric s)
{
    return rows(vec(s.v[0], s.v[1], s.v[2]), vec(s.v[1], s.v[3], s.v[4]),
                vec(s.v[2], s.v[4], s.v[5]));
}

typedef struct { vec3 epsilon, dw, wd, wdd; } AttitudeError;

static inline AttitudeError attitude_error(quat q_SN, vec3 omega, const Reference *ref)
{
    quat q_SD = product(conjugate(canonical(ref->q)), canonical(q_SN));
    mat3 C_SD = dcm_of_quat(q_SD);
    vec3 wd = mul(C_SD, ref->omega), wdd = mul(C_SD, ref->alpha);
    return (AttitudeError){mrp_of_quat(q_SD), sub(omega, wd), wd, wdd};
}

/* A_hat dOmega, right-hand side of (19): rate of the wheel momentum; the body gets the opposite
 * torque */
static inline vec3 wheel_torque(vec3 K, vec3 P, mat3 J_hat, mat3 A_hat, const AttitudeError *e,
                                vec3 wheel_speed)
{
    vec3 feedback =
        add(scale(0.25, mrp_G_transposed(e->epsilon, times(K, e->epsilon))), times(P, e->dw));
    vec3 momentum = add(mul(A_hat, wheel_speed), mul(J_hat, e->wd));
    return sub(sub(feedback, mul(J_hat, e->wdd)), cross(e->wd, momentum));
}

#endif
