/* attitude.h - direction cosines, unit quaternions, modified Rodrigues parameters.
 *
 * Attitude of frame B relative to frame N: C_BN maps N components to B components; the quaternion
 * q_BN is scalar first with v_N = q v_B q*; the MRP is sigma_BN = q_vec / (1 + q_0). Equations:
 * docs/models.md A.1. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef ATTITUDE_H
#define ATTITUDE_H

#include "vec3.h"

typedef struct { double w, x, y, z; } quat;

static inline vec3 vector_part(quat q) { return vec(q.x, q.y, q.z); }
static inline quat conjugate(quat q) { return (quat){q.w, -q.x, -q.y, -q.z}; }

/* Hamilton product a b; for example q_BN = q_MN q_BM */
static inline quat product(quat a, quat b)
{
    vec3 av = vector_part(a), bv = vector_part(b);
    vec3 v = sum3(scale(a.w, bv), scale(b.w, av), cross(av, bv));
    return (quat){a.w * b.w - dot(av, bv), v.x, v.y, v.z};
}

/* the same attitude with unit norm and q_0 >= 0; for a rotation by pi, with q_0 = 0, the first
 * nonzero component is positive */
static inline quat canonical(quat q)
{
    double n = sqrt(q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z);
    double first = q.w != 0 ? q.w : q.x != 0 ? q.x : q.y != 0 ? q.y : q.z;
    double k = (first < 0 ? -1 : 1) / n;
    return (quat){k * q.w, k * q.x, k * q.y, k * q.z};
}

/* C = I - 2 q_0 q~ + 2 q~^2 for a unit quaternion; q~: cross-product matrix of its vector part */
static inline mat3 dcm_of_quat(quat q)
{
    double w = q.w, x = q.x, y = q.y, z = q.z;
    return rows(vec(1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
                vec(2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
                vec(2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)));
}

/* quaternion of a rotation matrix by Shepperd: divides by the largest of the four components;
 * q_0 >= 0 */
static inline quat quat_of_dcm(mat3 c)
{
    double xx = c.row[0].x, yy = c.row[1].y, zz = c.row[2].z, trace = xx + yy + zz;
    double x = c.row[1].z - c.row[2].y, y = c.row[2].x - c.row[0].z, z = c.row[0].y - c.row[1].x;
    double xy = c.row[0].y + c.row[1].x, yz = c.row[1].z + c.row[2].y, zx = c.row[2].x + c.row[0].z;

    if (trace >= xx && trace >= yy && trace >= zz) return canonical((quat){1 + trace, x, y, z});
    if (xx >= yy && xx >= zz) return canonical((quat){x, 1 + xx - yy - zz, xy, zx});
    if (yy >= zz) return canonical((quat){y, xy, 1 + yy - zz - xx, yz});
    return canonical((quat){z, zx, yz, 1 + zz - xx - yy});
}

static inline vec3 mrp_of_quat(quat q) /* |sigma| <= 1 */
{
    quat c = canonical(q);
    return scale(1 / (1 + c.w), vector_part(c));
}

static inline quat quat_of_mrp(vec3 s)
{
    double ss = dot(s, s);
    vec3 v = scale(2 / (1 + ss), s);
    return canonical((quat){(1 - ss) / (1 + ss), v.x, v.y, v.z});
}

/* (1): C(s) = I - 4 (1-s.s)/(1+s.s)^2 s~ + 8/(1+s.s)^2 s~^2 */
static inline mat3 dcm_of_mrp(vec3 s)
{
    double ss = dot(s, s), d = (1 + ss) * (1 + ss), a = 4 * (1 - ss) / d, b = 8 / d;
    return rows(
        vec(1 - b * (s.y * s.y + s.z * s.z), b * s.x * s.y + a * s.z, b * s.x * s.z - a * s.y),
        vec(b * s.x * s.y - a * s.z, 1 - b * (s.x * s.x + s.z * s.z), b * s.y * s.z + a * s.x),
        vec(b * s.x * s.z + a * s.y, b * s.y * s.z - a * s.x, 1 - b * (s.x * s.x + s.y * s.y)));
}

/* (3) of docs/models.md A.1: mrp_G: G(s) w = (1-s.s) w + 2 s x w + 2 s (s.w); mrp_G_transposed:
 * G(s)^T w; mrp_rate: ds/dt = G(s) w / 4 */
static inline vec3 mrp_G(vec3 s, vec3 w)
{
    return sum3(scale(1 - dot(s, s), w), scale(2, cross(s, w)), scale(2 * dot(s, w), s));
}
static inline vec3 mrp_G_transposed(vec3 s, vec3 w)
{
    return sum3(scale(1 - dot(s, s), w), scale(-2, cross(s, w)), scale(2 * dot(s, w), s));
}
static inline vec3 mrp_rate(vec3 s, vec3 w) { return scale(0.25, mrp_G(s, w)); }

/* MRP inside the unit sphere for the attitude s: s or its shadow */
static inline vec3 mrp_inside(vec3 s)
{
    double ss = dot(s, s);
    return ss > 1 ? scale(-1 / ss, s) : s;
}

#endif
