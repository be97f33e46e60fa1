/* safety_rules.h - the margins of the safety monitor: keep-out zone, approach corridor, speed,
 * plume.
 *
 *   zone      b (|p|_Z - 1),                                b: smallest half axis
 *               |p|_Z = |D^-1 p| (ellipsoid) or max |p_i|/d_i (box), D = diag(d)
 *   corridor  max(a sin alpha - d cos alpha, a - L)         L = 0: no end
 *   speed     v_0 + k |p| - |v|
 *   plume     max(d cos beta - a sin beta, |p| - R)
 * d_i: half axes of the zone; alpha, L: half angle and length of the corridor; v_0, k:
 * speed_at_zero, speed_slope; beta, R: half angle and range of the plume. p: position of the
 * servicer from the target (corridor: from the apex); a: component along the axis of the cone, d:
 * distance from the axis. The axis of the plume is the direction of the force: the exhaust leaves
 * against it, and the target is at -p. A margin is positive where the rule is satisfied, and zero on
 * the edge. The margin of the speed is in m/s. The others change by at most 1 m per metre of
 * displacement: they are never more than the distance to the edge. They equal this distance for a
 * sphere, for a cone where the side is nearest, and for a box in front of the two faces normal to
 * its smallest half axis.
 *
 * Bounds on a part of an arc: a norm is bounded by the Bernstein coefficients of its square,
 * any other convex margin lies above its tangent plane at the middle, a concave one has its least
 * value at a control point. docs/models.md G.2, G.3 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SAFETY_RULES_H
#define SAFETY_RULES_H

#include "arc.h"

enum { NO_ZONE, ELLIPSOID, BOX };

static inline vec3 middle(const Arc *part)
{
    const vec3 *p = part->p;
    return scale(0.125, add(add(p[0], p[3]), scale(3, add(p[1], p[2]))));
}

static inline vec3 unit_or_zero(vec3 a)
{
    double n = norm(a);
    return n > 0 ? scale(1 / n, a) : a;
}

/* ---- keep-out zone: a norm, which is convex ---- */
typedef struct {
    double shape;
    vec3 half;
} Zone;

static inline double smallest(vec3 a) { return smaller(a.x, smaller(a.y, a.z)); }
static inline vec3 over(vec3 a, vec3 b) { return vec(a.x / b.x, a.y / b.y, a.z / b.z); }

/* gradient of |p|_Z at p. |p|_Z = gradient . p, as the norm is homogeneous; |p'|_Z >= gradient .
 * p' at every other point p', as it is convex. */
static inline vec3 zone_gradient(const Zone *z, vec3 p)
{
    vec3 e = over(p, z->half);
    if (z->shape == ELLIPSOID) return over(unit_or_zero(e), z->half);
    double x = fabs(e.x), y = fabs(e.y), w = fabs(e.z);
    if (x >= y && x >= w) return vec((e.x < 0 ? -1 : 1) / z->half.x, 0, 0);
    if (y >= w) return vec(0, (e.y < 0 ? -1 : 1) / z->half.y, 0);
    return vec(0, 0, (e.z < 0 ? -1 : 1) / z->half.z);
}

static inline double zone_value(const void *rule, vec3 p, vec3 v)
{
    const Zone *z = rule;
    (void)v;
    return smallest(z->half) * (dot(zone_gradient(z, p), p) - 1);
}

static inline double zone_bound(const void *rule, const Arc *part)
{
    const Zone *z = rule;
    vec3 e[4];
    if (z->shape == BOX)
        return smallest(z->half) * (least_along(part, zone_gradient(z, middle(part))) - 1);
    for (int i = 0; i < 4; i++) e[i] = over(part->p[i], z->half);
    return smallest(z->half) * (least_norm(e) - 1);
}

/* ---- approach corridor: a cone, whose margin is concave; no limit beyond its length ---- */
typedef struct {
    vec3 apex, axis;
    double half_angle, length;
} Corridor;

static inline double corridor_value(const void *rule, vec3 p, vec3 v)
{
    const Corridor *c = rule;
    vec3 q = sub(p, c->apex);
    double a = dot(q, c->axis), d = norm(sub(q, scale(a, c->axis)));
    SineCosine half = sine_and_cosine(c->half_angle);
    double inside = a * half.s - d * half.c;
    (void)v;
    return c->length > 0 ? larger(inside, a - c->length) : inside;
}

static inline double corridor_bound(const void *rule, const Arc *part)
{
    Corridor cone = *(const Corridor *)rule;
    double end = least_along(part, cone.axis) - dot(cone.apex, cone.axis) - cone.length;
    double within = cone.length > 0 ? end : -INFINITE, inside = INFINITY;
    cone.length = 0;
    for (int i = 0; i < 4; i++)
        inside = smaller(inside, corridor_value(&cone, part->p[i], part->v[0]));
    return larger(inside, within);
}

/* ---- speed ---- */
typedef struct { double at_zero, slope; } SpeedLimit;

static inline double speed_value(const void *rule, vec3 p, vec3 v)
{
    const SpeedLimit *l = rule;
    return l->at_zero + l->slope * norm(p) - norm(v);
}

/* lower bound of the margin v_0 + k |p| - |v| on a part of an arc. |p| is the square root of p^2,
 * which is concave and lies above its chord: |p| >= (p^2 + lo hi)/(lo + hi) for lo <= |p| <= hi.
 * |v| is convex along the arc and lies below the line between |v| at both ends. With both
 * replacements the margin is a polynomial, which is nowhere below its smallest Bernstein
 * coefficient. */
static inline double speed_bound(const void *rule, const Arc *part)
{
    const SpeedLimit *l = rule;
    Square q = square_along(part->p);
    double lo = sqrt(larger(0, q.least)), hi = sqrt(q.most), least = INFINITY;
    double v0 = norm(part->v[0]), v1 = norm(part->v[1]);
    for (int i = 0; i < SQUARE; i++) {
        double range = hi > 0 ? (q.c[i] + lo * hi) / (lo + hi) : 0;
        least = smaller(least, l->slope * range - (v0 + i * (v1 - v0) / (SQUARE - 1)));
    }
    return l->at_zero + least;
}

/* ---- plume: the outside of a cone of finite length; both parts of the margin are convex ---- */
typedef struct {
    vec3 force; /* unit vector of the force */
    double half_angle, range;
} Plume;

static inline double plume_value(const void *rule, vec3 p, vec3 v)
{
    const Plume *c = rule;
    double a = dot(p, c->force), d = norm(sub(p, scale(a, c->force)));
    SineCosine half = sine_and_cosine(c->half_angle);
    (void)v;
    return larger(d * half.c - a * half.s, norm(p) - c->range);
}

static inline double plume_bound(const void *rule, const Arc *part)
{
    const Plume *c = rule;
    vec3 q = middle(part), aside = unit_or_zero(sub(q, scale(dot(q, c->force), c->force)));
    SineCosine half = sine_and_cosine(c->half_angle);
    vec3 plane = sub(scale(half.c, aside), scale(half.s, c->force));
    return larger(least_along(part, plane), least_norm(part->p) - c->range);
}

#endif
