/* rigid_body.h - gravity-gradient torque on a rigid body, and the rules for inertia matrices. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef RIGID_BODY_H
#define RIGID_BODY_H

#include "fmu.h"
#include "vec3.h"

/* gravity-gradient torque 3 mu / r^3 rb x (J rb) [N.m], rb: unit vector of r_B, body axes;
 * docs/models.md A.2 */
static inline vec3 gravity_gradient(double mu, vec3 r_B, mat3 J)
{
    if (mu == 0) return vec(0, 0, 0);
    double r = norm(r_B);
    vec3 rb = scale(1 / r, r_B);
    return scale(3 * mu / (r * r * r), cross(rb, mul(J, rb)));
}

#define SYMMETRIC 1e-9

/* true if m is symmetric within a tolerance relative to its largest diagonal element, as
 * rounding errors make a rotated matrix unsymmetric. The matrix is used as given: the relative
 * effect of its unsymmetric part on the motion is as small as the tolerance. */
static inline int is_symmetric(mat3 m)
{
    double largest = larger(fabs(m.row[0].x), larger(fabs(m.row[1].y), fabs(m.row[2].z)));
    double xy = fabs(m.row[0].y - m.row[1].x), xz = fabs(m.row[0].z - m.row[2].x),
           yz = fabs(m.row[1].z - m.row[2].y);
    return larger(xy, larger(xz, yz)) <= SYMMETRIC * largest;
}

static inline int is_positive_definite(mat3 m) /* m symmetric */
{
    double minor = m.row[0].x * m.row[1].y - m.row[0].y * m.row[1].x;
    return m.row[0].x > 0 && minor > 0 && determinant(m) > 0;
}

static inline void check_positive_definite(Problems *problems, const char *name, mat3 m)
{
    if (!is_symmetric(m)) reject(problems, name, m.row[0].y, "must be symmetric");
    if (!is_positive_definite(m))
        reject(problems, name, smaller(m.row[0].x, smaller(m.row[1].y, m.row[2].z)),
               "must be positive definite");
}

/* true if no principal moment exceeds the sum of the other two. This holds if and only if no
 * principal minor of E = trace(J)/2 I - J is negative. */
static inline int satisfies_triangle_inequality(mat3 J)
{
    double half = (J.row[0].x + J.row[1].y + J.row[2].z) / 2, tolerance = -1e-12 * half;
    double a = half - J.row[0].x, b = half - J.row[1].y, c = half - J.row[2].z;
    double d = -J.row[0].y, e = -J.row[0].z, f = -J.row[1].z;
    double determinant_E = a * (b * c - f * f) - d * (d * c - f * e) + e * (d * f - b * e);
    return a >= tolerance && b >= tolerance && c >= tolerance &&
           a * b - d * d >= tolerance * half && a * c - e * e >= tolerance * half &&
           b * c - f * f >= tolerance * half && determinant_E >= tolerance * half * half;
}

static inline void check_inertia(Problems *problems, const char *name, mat3 J)
{
    double largest = larger(J.row[0].x, larger(J.row[1].y, J.row[2].z));
    check_positive_definite(problems, name, J);
    if (!satisfies_triangle_inequality(J))
        reject(problems, name, largest,
               "must satisfy the triangle inequality (no principal moment above the sum of the "
               "other two)");
}

#endif
