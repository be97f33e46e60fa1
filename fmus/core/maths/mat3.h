/* mat3.h - sums of 3x3 matrices, cross-product matrix, inertia of a point mass. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef MAT3_H
#define MAT3_H

#include "vec3.h"

static inline mat3 plus(mat3 a, mat3 b)
{
    return rows(add(a.row[0], b.row[0]), add(a.row[1], b.row[1]), add(a.row[2], b.row[2]));
}
static inline mat3 scaled(double k, mat3 a)
{
    return rows(scale(k, a.row[0]), scale(k, a.row[1]), scale(k, a.row[2]));
}
static inline mat3 minus(mat3 a, mat3 b) { return plus(a, scaled(-1, b)); }
static inline mat3 outer(vec3 a, vec3 b) /* a b^T */
{
    return rows(scale(a.x, b), scale(a.y, b), scale(a.z, b));
}
static inline mat3 tilde(vec3 a) /* [a]x: tilde(a) b = a x b */
{
    return rows(vec(0, -a.z, a.y), vec(a.z, 0, -a.x), vec(-a.y, a.x, 0));
}

/* -([a]x[b]x + [b]x[a]x)/2 = (a.b) 1 - (a b^T + b a^T)/2; with a = b: inertia of a unit mass at
 * the position a */
static inline mat3 inertia_product(vec3 a, vec3 b)
{
    double ab = dot(a, b);
    return minus(diagonal(ab, ab, ab), scaled(0.5, plus(outer(a, b), outer(b, a))));
}

#endif
