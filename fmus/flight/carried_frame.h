/* carried_frame.h - frame D of a fly-around at constant range from any direction: an attitude that
 * is integrated from sample to sample.
 *
 * D rotates with H at first, then with T, and is steered until n = -X_D equals the grasp axis a:
 *   W  = w_H + s (w_T - w_H) + steer,   dW = dw_H + s (dw_T - dw_H) + s' (w_T - w_H) + d(steer)
 *   s  = 10 x^3 - 15 x^4 + 6 x^5,   x = clip((t - t_a)/spin_time, 0, 1)
 *   c  = n x a,   dc = (W x n) x a + n x (w_T x a)
 *   steer = k_steer c,             d(steer) = k_steer dc
 *   beyond w_steer: w_steer c/|c|, w_steer (dc - c (c.dc)/c.c)/|c|
 * It begins at the position of the servicer, with X_D towards the target and the roll angle of S.
 * All vectors are in N axes, derivatives as seen in N. Equations: docs/models.md J.4 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef CARRIED_FRAME_H
#define CARRIED_FRAME_H

#include "motion.h"
#include "reference_rows.h"
#include "small_rotation.h"

typedef struct { double spin_time, k_steer, w_steer; } Steering;
typedef struct {
    double carried, t;
    quat q_DN;
} CarriedFrame; /* carried: 1 after the first sample; t: time of the first sample */
typedef struct { vec3 w, dw; } AngularMotion; /* angular velocity and its derivative, N axes */
typedef struct { double L, d, dd; } Radius;

/* rows X, Z x X, Z: X towards the target, Z as near as possible to the Z axis of S, or to its Y
 * axis if Z of S is almost parallel to X */
static inline quat carried_start(vec3 rho, mat3 C_SN)
{
    vec3 X = neg(unit(rho)), z = C_SN.row[2];
    if (norm(cross(z, X)) < 0.1) z = C_SN.row[1];
    vec3 Z = unit(sub(z, scale(dot(z, X), X)));
    return quat_of_dcm(rows(X, cross(Z, X), Z));
}

/* c = n x a, the rotation towards the grasp axis; for n opposite to a a small rotation about Z_D */
static inline vec3 rotation_to_axis(mat3 C_DN, vec3 n, vec3 a)
{
    vec3 c = cross(n, a);
    return norm(c) < 1e-6 && dot(n, a) < 0 ? scale(1e-6, C_DN.row[2]) : c;
}

static inline vec3 steer(const Steering *p, vec3 c)
{
    double size = norm(c);
    return scale(p->k_steer * size > p->w_steer ? p->w_steer / size : p->k_steer, c);
}
static inline vec3 steer_rate(const Steering *p, vec3 c, vec3 dc)
{
    double size = norm(c);
    if (p->k_steer * size <= p->w_steer) return scale(p->k_steer, dc);
    return scale(p->w_steer / size, sub(dc, scale(dot(c, dc) / dot(c, c), c)));
}

/* W, dW of D at t */
static inline AngularMotion carried_rate(const Steering *p, const CarriedFrame *d, AngularMotion H,
                                         AngularMotion T, vec3 a, double t)
{
    mat3 C_DN = dcm_of_quat(d->q_DN);
    double x = clamp((t - d->t) / p->spin_time, 0, 1), y = 1 - x;
    double s = x * x * x * (10 - 15 * x + 6 * x * x), ds = 30 * x * x * y * y / p->spin_time;
    vec3 n = neg(C_DN.row[0]), c = rotation_to_axis(C_DN, n, a), difference = sub(T.w, H.w);
    vec3 W = sum3(H.w, scale(s, difference), steer(p, c));
    vec3 dc = add(cross(cross(W, n), a), cross(n, cross(T.w, a)));
    return (AngularMotion){
        W, sum4(H.dw, scale(s, sub(T.dw, H.dw)), scale(ds, difference), steer_rate(p, c, dc))};
}

/* rho = L n for n that turns with D */
static inline Motion carried_position(Radius r, vec3 n, AngularMotion D)
{
    vec3 dn = cross(D.w, n), ddn = add(cross(D.dw, n), cross(D.w, dn));
    return (Motion){scale(r.L, n), add(scale(r.d, n), scale(r.L, dn)),
                    sum3(scale(r.dd, n), scale(2 * r.d, dn), scale(r.L, ddn))};
}

/* q_DN rot(C_DN (W + dW P/2) P) */
static inline quat integrate_carried(quat q_DN, AngularMotion D, double period)
{
    vec3 phi = scale(period, add(D.w, scale(period / 2, D.dw)));
    return canonical(product(q_DN, rotation(mul(dcm_of_quat(q_DN), phi))));
}

#endif
