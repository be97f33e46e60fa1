/* carried_frame.h - frame D of a fly-around at constant range from any direction: an attitude that
 * is integrated from sample to sample.
 *
 * D rotates with H until t_a, the first sample at which it may turn. Then its angular velocity W
 * changes from w_H of H to w_T of T within T_s, and D is steered until n = -X_D, the direction
 * from target to servicer, is the grasp axis a:
 *   W  = w_H + s (w_T - w_H) + steer + b
 *   dW = dw_H + s (dw_T - dw_H) + s' (w_T - w_H) + d(steer) + db
 *   s  = 10 x^3 - 15 x^4 + 6 x^5,   x = clip((t - t_a)/T_s, 0, 1)
 *   T_s = spin_time, or longer: 1.875 |w_T - w_H|/spin_accel at the start
 *   c  = n x a,   dc = (W x n) x a + n x (w_T x a)
 *   steer = k_steer c,             d(steer) = k_steer dc
 *   if k_steer |c| > w_steer:  steer = w_steer c/|c|,  d(steer) = w_steer (dc - c (c.dc)/c.c)/|c|
 *   b:  its rate in D is k_integral C_DN c while x = 1 and k_steer |c| <= w_steer, else 0;
 *       |b| <= w_steer. b removes the lag of n behind a that an error of the estimate w_T causes
 * D begins at the position of the servicer, with X_D towards the target and the roll angle of S.
 * All vectors are in N axes, derivatives as seen in N. Equations: docs/models.md J.4 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef CARRIED_FRAME_H
#define CARRIED_FRAME_H

#include "motion.h"
#include "reference_rows.h"
#include "small_rotation.h"

typedef struct { double spin_time, k_steer, w_steer, k_integral, spin_accel; } Steering;
typedef struct {
    double carried, t; /* carried: 1 from the first active sample on, which sets q_DN; t: t_a */
    quat q_DN;
    double turns, spin; /* turns: 1 from t_a on; spin: T_s */
    vec3 b_D;
} CarriedFrame;
typedef struct { vec3 w, dw; } AngularMotion; /* angular velocity and its derivative, N axes */
typedef struct {
    AngularMotion D;
    vec3 db_D; /* rate of b as seen in D, D axes */
} CarriedMotion;
typedef struct { double L, d, dd; } Radius;

/* attitude q_DN at the first sample: the rows of C_DN are X, Z x X, Z, with X towards the target
 * and Z along the part of the Z axis of S that is normal to X. If X and the Z axis of S are almost
 * parallel, the Y axis of S is used in place of the Z axis. rho: servicer relative to target */
static inline quat carried_start(vec3 rho, mat3 C_SN)
{
    vec3 X = neg(unit(rho)), z = C_SN.row[2];
    if (norm(cross(z, X)) < 0.1) z = C_SN.row[1];
    vec3 Z = unit(sub(z, scale(dot(z, X), X)));
    return quat_of_dcm(rows(X, cross(Z, X), Z));
}

/* c = n x a, about which D turns to bring n to the grasp axis a; for n almost opposite to a, where
 * n x a vanishes, a small vector along Z_D, so that D leaves this attitude */
static inline vec3 rotation_to_axis(mat3 C_DN, vec3 n, vec3 a)
{
    vec3 c = cross(n, a);
    if (norm(c) < 1e-6 && dot(n, a) < 0) return scale(1e-6, C_DN.row[2]);
    return c;
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

static inline double spin_duration(const Steering *p, vec3 w_H, vec3 w_T)
{
    if (p->spin_accel == 0) return p->spin_time;
    return larger(p->spin_time, 1.875 * norm(sub(w_T, w_H)) / p->spin_accel);
}

static inline void begin_turning(const Steering *p, CarriedFrame *d, vec3 w_H, vec3 w_T, double t)
{
    d->turns = 1;
    d->t = t;
    d->spin = spin_duration(p, w_H, w_T);
}

/* angular velocity W and acceleration dW of D at time t, and the rate of b */
static inline CarriedMotion carried_rate(const Steering *p, const CarriedFrame *d, AngularMotion H,
                                         AngularMotion T, vec3 a, double t)
{
    if (!d->turns) return (CarriedMotion){H, vec(0, 0, 0)};
    mat3 C_DN = dcm_of_quat(d->q_DN);
    double x = clamp((t - d->t) / d->spin, 0, 1), y = 1 - x;
    double s = x * x * x * (10 - 15 * x + 6 * x * x), ds = 30 * x * x * y * y / d->spin;
    vec3 n = neg(C_DN.row[0]), c = rotation_to_axis(C_DN, n, a), difference = sub(T.w, H.w);
    vec3 W = sum3(H.w, scale(s, difference), steer(p, c)), b = tmul(C_DN, d->b_D);
    int integrates = p->k_integral > 0 && x >= 1 && p->k_steer * norm(c) <= p->w_steer;
    vec3 db_D = integrates ? scale(p->k_integral, mul(C_DN, c)) : vec(0, 0, 0);
    if (p->k_integral > 0) W = add(W, b);
    vec3 dc = add(cross(cross(W, n), a), cross(n, cross(T.w, a)));
    vec3 dW = sum4(H.dw, scale(s, sub(T.dw, H.dw)), scale(ds, difference), steer_rate(p, c, dc));
    if (p->k_integral > 0) dW = sum3(dW, cross(W, b), tmul(C_DN, db_D));
    return (CarriedMotion){{W, dW}, db_D};
}

/* b after one sample period; its size is limited to w_steer */
static inline vec3 integrated_steering(const Steering *p, vec3 b_D, vec3 db_D, double period)
{
    vec3 b = add(b_D, scale(period, db_D));
    double size = norm(b);
    return size > p->w_steer ? scale(p->w_steer / size, b) : b;
}

/* reference position rho = L n and its derivatives, for a direction n that is fixed in D; r: range
 * L and its derivatives d = dL/dt and dd = d2L/dt2 */
static inline Motion carried_position(Radius r, vec3 n, AngularMotion D)
{
    vec3 dn = cross(D.w, n), ddn = add(cross(D.dw, n), cross(D.w, dn));
    return (Motion){scale(r.L, n), add(scale(r.d, n), scale(r.L, dn)),
                    sum3(scale(r.dd, n), scale(2 * r.d, dn), scale(r.L, ddn))};
}

/* q_DN one sample period P later: q_DN rot(C_DN (W + dW P/2) P) */
static inline quat integrate_carried(quat q_DN, AngularMotion D, double period)
{
    vec3 phi = scale(period, add(D.w, scale(period / 2, D.dw)));
    return canonical(product(q_DN, rotation(mul(dcm_of_quat(q_DN), phi))));
}

#endif
