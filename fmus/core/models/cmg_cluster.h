/* cmg_cluster.h - six single-gimbal control moment gyros, gimbal axes in a pentagonal pyramid.
 *
 *   g_0 = Z,  g_i = (sin b cos p_i, sin b sin p_i, cos b),  tan b = 2,  p_i = 72 deg (i-1)
 *   h  = h_w sum(s_i cos d_i + t_i sin d_i),   t_i = g_i x s_i
 *   h' = h_w A(d) d',                          A_i = -s_i sin d_i + t_i cos d_i
 *
 * g_i, s_i: gimbal axis and spin axis at gimbal angle zero of gyro i; b: angle of the gimbal axes
 * from Z; p_i: their azimuths; d: gimbal angles; h_w: momentum of one wheel; h: momentum of the
 * cluster. The gimbal axes are normal to the faces of a regular dodecahedron: the lines of any two
 * intersect at 63.4 deg, so that the largest momentum is nearly equal in all directions. Source:
 * docs/models.md E.6. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef CMG_CLUSTER_H
#define CMG_CLUSTER_H

#include "mat3.h"

enum { GYROS = 6 };

/* gimbal angles with zero total momentum, far from singular angles */
#define GIMBALS_AT_START {0.3 * PI, -0.6 * PI, 0.8 * PI, 0, -0.8 * PI, 0.6 * PI}

typedef struct { vec3 g, s, t; } Gyro; /* gimbal axis, spin axis at zero, torque axis at zero */

static inline Gyro gyro_axes(int i)
{
    if (i == 0) return (Gyro){vec(0, 0, 1), vec(1, 0, 0), vec(0, 1, 0)};
    double root = sqrt(5.0), c1 = (root - 1) / 4, c2 = -(root + 1) / 4; /* cos 72, cos 144 deg */
    double s1 = sqrt(10 + 2 * root) / 4, s2 = sqrt(10 - 2 * root) / 4;
    double c[] = {1, c1, c2, c2, c1}, s[] = {0, s1, s2, -s2, -s1};
    double sin_b = 2 / root, cos_b = 1 / root, ci = c[i - 1], si = s[i - 1];
    vec3 g = vec(sin_b * ci, sin_b * si, cos_b), spin = vec(-si, ci, 0);
    return (Gyro){g, spin, cross(g, spin)};
}

static inline vec3 spin_axis(Gyro a, double d) /* direction of the wheel's momentum */
{
    SineCosine turn = sine_and_cosine(d);
    return add(scale(turn.c, a.s), scale(turn.s, a.t));
}
static inline vec3 torque_axis(Gyro a, double d) /* A_i, derivative of spin_axis */
{
    SineCosine turn = sine_and_cosine(d);
    return sub(scale(turn.c, a.t), scale(turn.s, a.s));
}

static inline vec3 cluster_momentum(double h_w, const double d[GYROS])
{
    vec3 sum = vec(0, 0, 0);
    for (int i = 0; i < GYROS; i++) sum = add(sum, spin_axis(gyro_axes(i), d[i]));
    return scale(h_w, sum);
}

static inline vec3 cluster_rate(double h_w, const double d[GYROS], const double dd[GYROS])
{
    vec3 sum = vec(0, 0, 0);
    for (int i = 0; i < GYROS; i++) sum = add(sum, scale(dd[i], torque_axis(gyro_axes(i), d[i])));
    return scale(h_w, sum);
}

static inline mat3 A_A_transposed(const double d[GYROS])
{
    mat3 sum = diagonal(0, 0, 0);
    for (int i = 0; i < GYROS; i++) {
        vec3 A = torque_axis(gyro_axes(i), d[i]);
        sum = plus(sum, outer(A, A));
    }
    return sum;
}

static inline double
singularity_measure(const double d[GYROS]) /* m = sqrt(det A A^T), 0: singular */
{
    return sqrt(larger(0, determinant(A_A_transposed(d))));
}

/* largest momentum of the cluster along the unit vector u: h_w sum sqrt(1 - (g_i.u)^2) */
static inline double envelope(double h_w, vec3 u)
{
    double sum = 0;
    for (int i = 0; i < GYROS; i++) sum += norm(cross(gyro_axes(i).g, u));
    return h_w * sum;
}

#endif
