/* small_rotation.h - attitudes from rotation vectors and back.
 *
 * Small errors of attitude are a = 4 sigma with the modified Rodrigues parameters sigma: a differs
 * from the rotation vector by terms of third order, is exactly invertible and needs no sine. Large
 * rotations, for example as measured by a gyro, are rotation vectors phi. Equations: docs/models.md
 * F.2. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SMALL_ROTATION_H
#define SMALL_ROTATION_H

#include "attitude.h"

/* quaternion of a small rotation a: rot(a) = [1 - s.s, 2 s]/(1 + s.s),  s = a/4 */
static inline quat rotation(vec3 a)
{
    vec3 s = scale(0.25, a);
    double ss = dot(s, s);
    vec3 v = scale(2 / (1 + ss), s);
    return (quat){(1 - ss) / (1 + ss), v.x, v.y, v.z};
}

/* small rotation of a quaternion: err(q) = 4 q_vec/(1 + q_0) with q_0 >= 0 */
static inline vec3 rotation_error(quat q) { return scale(4, mrp_of_quat(q)); }

/* rotation vector phi of a quaternion, |phi| <= pi */
static inline vec3 rotation_vector(quat q)
{
    quat c = canonical(q);
    vec3 v = vector_part(c);
    double n = norm(v);
    return scale(n > 0 ? 2 * arc_tangent(n, c.w) / n : 2, v);
}

/* quaternion of a rotation vector by series: [cos(|phi|/2), sin(|phi|/2)/|phi| phi]. For
 * |phi| <= pi, the terms that are left out are below 1e-16. */
static inline quat quat_of_rotation_vector(vec3 phi)
{
    double x = dot(phi, phi) / 4, c = 1, s = 1;
    for (int k = 24; k > 0; k -= 2) {
        c = 1 - x / (k * (k - 1)) * c;
        s = 1 - x / (k * (k + 1)) * s;
    }
    vec3 v = scale(s / 2, phi);
    return (quat){c, v.x, v.y, v.z};
}

#endif
