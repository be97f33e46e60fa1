/* sym3.h - symmetric 3x3 matrices, stored as six elements: sums, products, inverse, inertia of a
 * point mass, sums of a a^T. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SYM3_H
#define SYM3_H

#include "vec3.h"

typedef struct { double xx, yy, zz, xy, xz, yz; } sym3;

static inline sym3 sym_diagonal(double a, double b, double c) { return (sym3){a, b, c, 0, 0, 0}; }
static inline sym3 sym_add(sym3 a, sym3 b)
{
    return (sym3){a.xx + b.xx, a.yy + b.yy, a.zz + b.zz, a.xy + b.xy, a.xz + b.xz, a.yz + b.yz};
}
static inline sym3 sym_sub(sym3 a, sym3 b)
{
    return (sym3){a.xx - b.xx, a.yy - b.yy, a.zz - b.zz, a.xy - b.xy, a.xz - b.xz, a.yz - b.yz};
}
static inline sym3 sym_scaled(double k, sym3 a)
{
    return (sym3){k * a.xx, k * a.yy, k * a.zz, k * a.xy, k * a.xz, k * a.yz};
}
static inline vec3 sym_mul(sym3 m, vec3 a)
{
    return vec(m.xx * a.x + m.xy * a.y + m.xz * a.z, m.xy * a.x + m.yy * a.y + m.yz * a.z,
               m.xz * a.x + m.yz * a.y + m.zz * a.z);
}

/* upper triangle of a b^T, for sums of such products whose total is symmetric */
static inline sym3 upper(vec3 a, vec3 b)
{
    return (sym3){a.x * b.x, a.y * b.y, a.z * b.z, a.x * b.y, a.x * b.z, a.y * b.z};
}
static inline sym3 dyad(double k, vec3 a) { return upper(scale(k, a), a); } /* k a a^T */

/* inertia of a point mass at r: mass (r.r 1 - r r^T) */
static inline sym3 point_inertia(double mass, vec3 r)
{
    double size = mass * dot(r, r);
    return sym_sub(sym_diagonal(size, size, size), dyad(mass, r));
}

/* inverse of the matrix m, which must be regular, by cofactors */
static inline sym3 sym_inverted(sym3 m)
{
    double xx = m.yy * m.zz - m.yz * m.yz, xy = m.xz * m.yz - m.xy * m.zz,
           xz = m.xy * m.yz - m.xz * m.yy, k = 1 / (m.xx * xx + m.xy * xy + m.xz * xz);
    return (sym3){k * xx, k * (m.xx * m.zz - m.xz * m.xz), k * (m.xx * m.yy - m.xy * m.xy), k * xy,
                  k * xz, k * (m.xy * m.xz - m.xx * m.yz)};
}

/* elements of a matrix that is symmetric up to rounding errors; mat_of() converts them back */
static inline sym3 sym_of(mat3 m)
{
    return (sym3){m.row[0].x,
                  m.row[1].y,
                  m.row[2].z,
                  (m.row[0].y + m.row[1].x) / 2,
                  (m.row[0].z + m.row[2].x) / 2,
                  (m.row[1].z + m.row[2].y) / 2};
}
static inline mat3 mat_of(sym3 m)
{
    return rows(vec(m.xx, m.xy, m.xz), vec(m.xy, m.yy, m.yz), vec(m.xz, m.yz, m.zz));
}

#endif
