/* carried_frame.h - a fly-around at constant range from any direction: D is carried along.
 *
 * D turns with H at first, then with T, and is steered until n = -X_D is the grasp axis a:
 *   W  = w_H + s (w_T - w_H) + steer,   dW = dw_H + s (dw_T - dw_H) + s' (w_T - w_H) + d(steer)
 *   s  = 10 x^3 - 15 x^4 + 6 x^5,   x = clip((t - t_a)/spin_time, 0, 1)
 *   c  = n x a,   dc = (W x n) x a + n x (w_T x a)
 *   steer = k_steer c,             d(steer) = k_steer dc
 *   beyond w_steer: w_steer c/|c|, w_steer (dc - c (c.dc)/c.c)/|c|
 * It begins where the servicer is, X_D towards the target, with the roll of S. All vectors here are
 * in N axes, derivatives as seen in N. docs/models.md J.4 */
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
} Carried;                              /* t: of the first sample */
typedef struct { vec3 w, dw; } Turning; /* angular velocity and its derivative */
typedef struct { double L, d, dd; } Radius;

/* rows X, Z x X, Z: X towards the target, Z as near to that of S as can be; where S looks along
 * its Z, its Y axis */
static inline quat carried_start(vec3 rho, mat3 C_SN)
{
    vec3 X = neg(unit(rho)), z = C_SN.row[2];
    if (norm(cross(z, X)) < 0.1) z = C_SN.row[1];
    vec3 Z = unit(sub(z, scale(dot(z, X), X)));
    return quat_of_dcm(rows(X, cross(Z, X), Z));
}

/* towards the grasp axis; opposite to it about Z_D */
static inline vec3 off_axis(mat3 C_DN, vec3 n, vec3 a)
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
static inline Turning carried_turning(const Steering *p, const Carried *d, Turning H, Turning T,
                                      vec3 a, double t)
{
    mat3 C_DN = dcm_of_quat(d->q_DN);
    double x = clamp((t - d->t) / p->spin_time, 0, 1), y = 1 - x;
    double s = x * x * x * (10 - 15 * x + 6 * x * x), ds = 30 * x * x * y * y / p->spin_time;
    vec3 n = neg(C_DN.row[0]), c = off_axis(C_DN, n, a), apart = sub(T.w, H.w);
    vec3 W = sum3(H.w, scale(s, apart), steer(p, c));
    vec3 dc = add(cross(cross(W, n), a), cross(n, cross(T.w, a)));
    return (Turning){W,
                     sum4(H.dw, scale(s, sub(T.dw, H.dw)), scale(ds, apart), steer_rate(p, c, dc))};
}

/* rho = L n, n turning with D */
static inline Motion carried_position(Radius r, vec3 n, Turning D)
{
    vec3 dn = cross(D.w, n), ddn = add(cross(D.dw, n), cross(D.w, dn));
    return (Motion){scale(r.L, n), add(scale(r.d, n), scale(r.L, dn)),
                    sum3(scale(r.dd, n), scale(2 * r.d, dn), scale(r.L, ddn))};
}

/* q_DN rot(C_DN (W + dW P/2) P) */
static inline quat carried_on(quat q_DN, Turning D, double period)
{
    vec3 phi = scale(period, add(D.w, scale(period / 2, D.dw)));
    return canonical(product(q_DN, rotation(mul(dcm_of_quat(q_DN), phi))));
}

#endif
