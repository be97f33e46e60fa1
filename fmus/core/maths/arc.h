/* arc.h - motion between two instants as a cubic, and the least value of a margin along it.
 *
 * Positions and velocities of both ends define the cubic (Hermite), stored by its control points
 *   p_0,   p_0 + h v_0/3,   p_1 - h v_1/3,   p_1
 * A part of an arc lies in the convex hull of its own control points, and the distance between part
 * and hull decreases with the square of the length of the part. The velocity is interpolated
 * linearly from v_0 to v_1.
 *
 * A margin has a value at a point and a lower bound of its values on a part. Parts are halved until
 * bound and value agree within the resolution, so that no minimum between the ends is missed. A
 * path around a sphere needs about ten parts, a distant pass one. After MOST_PARTS, which only
 * meaningless inputs reach, the bound of the remaining arc is used. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef ARC_H
#define ARC_H

#include "vec3.h"

#define SHORTEST_PART 0x1p-40 /* a narrower part is not halved: its bound is used */
#define NEVER         INFINITE

enum { MOST_PARTS = 1 << 16 };

typedef struct { vec3 p[4], v[2]; } Arc;

static inline Arc hermite(vec3 p0, vec3 v0, vec3 p1, vec3 v1, double h)
{
    return (Arc){{p0, add(p0, scale(h / 3, v0)), sub(p1, scale(h / 3, v1)), p1}, {v0, v1}};
}

static inline vec3 between(vec3 a, vec3 b, double s) { return add(a, scale(s, sub(b, a))); }

/* polar form (blossom) of the cubic with control points p: three equal arguments give the point
 * at that parameter, mixed arguments give the control points of a part */
static inline vec3 blossom(const vec3 p[4], double a, double b, double c)
{
    vec3 q0 = between(p[0], p[1], a), q1 = between(p[1], p[2], a), q2 = between(p[2], p[3], a);
    return between(between(q0, q1, b), between(q1, q2, b), c);
}

static inline vec3 arc_position(const Arc *arc, double s) { return blossom(arc->p, s, s, s); }
static inline vec3 arc_velocity(const Arc *arc, double s)
{
    return between(arc->v[0], arc->v[1], s);
}

static inline Arc arc_part(const Arc *arc, double a, double b)
{
    const vec3 *p = arc->p;
    if (a == 0 && b == 1) return *arc;
    return (Arc){
        {blossom(p, a, a, a), blossom(p, a, a, b), blossom(p, a, b, b), blossom(p, b, b, b)},
        {arc_velocity(arc, a), arc_velocity(arc, b)}};
}

/* least component of the control points along u: no point of the arc has a smaller component */
static inline double least_along(const Arc *arc, vec3 u)
{
    return smaller(smaller(dot(u, arc->p[0]), dot(u, arc->p[1])),
                   smaller(dot(u, arc->p[2]), dot(u, arc->p[3])));
}

/* Bernstein coefficients of |p|^2 along an arc, a polynomial of degree 6 whose values are
 * between the least and the largest coefficient. A bound is exact if its coefficient is the first
 * or the last, as for nearly every monotonic distance, and close for a nearly constant distance. */
enum { SQUARE = 7 };
typedef struct { double c[SQUARE], least, most; } Square;

static inline Square square_along(const vec3 p[4])
{
    Square q = {{dot(p[0], p[0]), dot(p[0], p[1]), (2 * dot(p[0], p[2]) + 3 * dot(p[1], p[1])) / 5,
                 (dot(p[0], p[3]) + 9 * dot(p[1], p[2])) / 10,
                 (2 * dot(p[1], p[3]) + 3 * dot(p[2], p[2])) / 5, dot(p[2], p[3]), dot(p[3], p[3])},
                INFINITY,
                0};
    for (int i = 0; i < SQUARE; i++) {
        q.least = smaller(q.least, q.c[i]);
        q.most = larger(q.most, q.c[i]);
    }
    return q;
}

static inline double least_norm(const vec3 p[4]) { return sqrt(larger(0, square_along(p).least)); }

/* ---- margins along an arc ---- */
typedef double MarginValue(const void *rule, vec3 p, vec3 v);
typedef double MarginBound(const void *rule, const Arc *part);
typedef struct {
    MarginValue *value;
    MarginBound *bound;
    const void *rule;
} Margin;

static inline double value_at(const Margin *m, const Arc *arc, double s)
{
    return m->value(m->rule, arc_position(arc, s), arc_velocity(arc, s));
}

/* a part of the parameter range 0..1: start s and width w; w is a power of two that divides s */
typedef struct { double s, w; } Part;

static inline Part next_part(Part x)
{
    double s = x.s + x.w, w = x.w;
    while (s < 1 && floor_of(s / (2 * w)) == s / (2 * w)) w *= 2;
    return (Part){s, w};
}
static inline Part left_half(Part x) { return (Part){x.s, x.w / 2}; }

/* resolution with which a least value is computed: 1e-7 m or m/s, or the rounding error of the
 * arc if that is larger */
static inline double resolution(const Arc *arc)
{
    double size = norm(arc->p[0]) + norm(arc->p[1]) + norm(arc->p[2]) + norm(arc->p[3]);
    return larger(1e-7, 1e-12 * size);
}

/* lower bound of the least margin on the arc; the bound is below the least margin by at most the
 * resolution */
static inline double least_on(const Margin *m, const Arc *arc)
{
    double best = smaller(value_at(m, arc, 0), value_at(m, arc, 1)), lowest = best;
    double tolerance = resolution(arc);
    Part x = {0, 1};
    for (unsigned parts = 0; x.s < 1; parts++) {
        int decided = parts == MOST_PARTS;
        if (decided) x.w = 1 - x.s;
        Arc part = arc_part(arc, x.s, x.s + x.w);
        double bound = m->bound(m->rule, &part);
        decided = decided || bound >= best - tolerance || x.w < SHORTEST_PART;
        if (decided) lowest = smaller(lowest, bound);
        else best = smaller(best, value_at(m, arc, x.s + x.w / 2));
        x = decided ? next_part(x) : left_half(x);
    }
    return smaller(best, lowest);
}

/* parameter in 0..1 of the arc at which the margin first falls below zero, or NEVER */
static inline double first_below_zero(const Margin *m, const Arc *arc)
{
    Part x = {0, 1};
    for (unsigned parts = 0; x.s < 1; parts++) {
        Arc part = arc_part(arc, x.s, x.s + x.w);
        int clear = m->bound(m->rule, &part) >= 0;
        int last = x.w < SHORTEST_PART || parts >= MOST_PARTS;
        if (!clear && (last || value_at(m, arc, x.s) < 0)) return x.s;
        x = clear ? next_part(x) : left_half(x);
    }
    return NEVER;
}

#endif
