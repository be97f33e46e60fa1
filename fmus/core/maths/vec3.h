/* vec3.h - vectors and 3x3 matrices, passed by value: a formula is one expression, and no arguments
 * alias. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef VEC3_H
#define VEC3_H

#include "portable_math.h"

typedef struct { double x, y, z; } vec3;
typedef struct { vec3 row[3]; } mat3; /* row major: row[i] is the i-th row */

static inline vec3 vec(double x, double y, double z) { return (vec3){x, y, z}; }
static inline vec3 add(vec3 a, vec3 b) { return vec(a.x + b.x, a.y + b.y, a.z + b.z); }
static inline vec3 sub(vec3 a, vec3 b) { return vec(a.x - b.x, a.y - b.y, a.z - b.z); }
static inline vec3 neg(vec3 a) { return vec(-a.x, -a.y, -a.z); }
static inline vec3 scale(double k, vec3 a) { return vec(k * a.x, k * a.y, k * a.z); }
static inline vec3 times(vec3 a, vec3 b)
{
    return vec(a.x * b.x, a.y * b.y, a.z * b.z);
} /* per axis */
static inline vec3 sum3(vec3 a, vec3 b, vec3 c) { return add(add(a, b), c); }
static inline vec3 sum4(vec3 a, vec3 b, vec3 c, vec3 d) { return add(sum3(a, b, c), d); }
static inline double dot(vec3 a, vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline double norm(vec3 a) { return sqrt(dot(a, a)); }
/* largest absolute value of the components */
static inline double largest_size(vec3 a)
{
    return larger(fabs(a.x), larger(fabs(a.y), fabs(a.z)));
}
static inline vec3 unit(vec3 a) { return scale(1 / norm(a), a); }

static inline vec3 cross(vec3 a, vec3 b)
{
    return vec(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

/* angle between two directions, exact also near 0 and pi; 0 or pi if one of them vanishes [rad] */
static inline double angle(vec3 a, vec3 b) { return arc_tangent(norm(cross(a, b)), dot(a, b)); }

static inline double clamp(double value, double low, double high)
{
    return smaller(larger(value, low), high);
}

/* value limited to +-limit; with a limit of 0 the value is not limited */
static inline double limited(double value, double limit)
{
    return limit > 0 ? clamp(value, -limit, limit) : value;
}
static inline vec3 limited3(vec3 a, vec3 limit)
{
    return vec(limited(a.x, limit.x), limited(a.y, limit.y), limited(a.z, limit.z));
}

static inline vec3 unequal(vec3 a, vec3 b) /* per axis: 1 if a and b differ, else 0 */
{
    return vec(a.x != b.x, a.y != b.y, a.z != b.z);
}

static inline mat3 rows(vec3 a, vec3 b, vec3 c) { return (mat3){{a, b, c}}; }
static inline mat3 diagonal(double a, double b, double c)
{
    return rows(vec(a, 0, 0), vec(0, b, 0), vec(0, 0, c));
}
static inline mat3 identity(double k) { return diagonal(k, k, k); } /* k times the unit matrix */
static inline vec3 mul(mat3 m, vec3 a)
{
    return vec(dot(m.row[0], a), dot(m.row[1], a), dot(m.row[2], a));
}
static inline vec3 tmul(mat3 m, vec3 a) /* transpose(m) a */
{
    return sum3(scale(a.x, m.row[0]), scale(a.y, m.row[1]), scale(a.z, m.row[2]));
}

static inline mat3 transpose(mat3 m)
{
    return rows(vec(m.row[0].x, m.row[1].x, m.row[2].x), vec(m.row[0].y, m.row[1].y, m.row[2].y),
                vec(m.row[0].z, m.row[1].z, m.row[2].z));
}

static inline mat3 matmul(mat3 a, mat3 b)
{
    return rows(tmul(b, a.row[0]), tmul(b, a.row[1]), tmul(b, a.row[2]));
}
static inline mat3 matmul_t(mat3 a, mat3 b) /* a transpose(b) */
{
    return rows(mul(b, a.row[0]), mul(b, a.row[1]), mul(b, a.row[2]));
}

static inline double determinant(mat3 m) { return dot(m.row[0], cross(m.row[1], m.row[2])); }

/* solution x of m x = b for a regular m: the rows of the inverse transpose of m are the cross
 * products of its rows, divided by det m */
static inline vec3 solve(mat3 m, vec3 b)
{
    vec3 x = sum3(scale(b.x, cross(m.row[1], m.row[2])), scale(b.y, cross(m.row[2], m.row[0])),
                  scale(b.z, cross(m.row[0], m.row[1])));
    return scale(1 / determinant(m), x);
}

static inline mat3 inverted(mat3 m)
{
    double k = 1 / determinant(m);
    return transpose(rows(scale(k, cross(m.row[1], m.row[2])), scale(k, cross(m.row[2], m.row[0])),
                          scale(k, cross(m.row[0], m.row[1]))));
}

#endif
