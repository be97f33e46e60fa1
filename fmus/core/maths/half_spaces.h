/* half_spaces.h - the point nearest to a given one in the intersection of half spaces n.u >= c.
 *
 * Half spaces are added one after the other. If a new half space excludes the point found so far,
 * the next point lies on the plane of this half space. If an earlier half space excludes the point
 * of this plane nearest to the given one, the next point lies on the line in which the planes of
 * both half spaces meet; on this line the earlier half spaces leave an interval (Seidel's
 * incremental method in three dimensions, in a fixed order). The work is bounded: at most n planes,
 * n^2/2 lines and n^3/6 points for n half spaces. Equations: docs/models.md M.5. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef HALF_SPACES_H
#define HALF_SPACES_H

#include "vec3.h"

enum { MOST_ROWS = 26, ALL_SATISFIED = -1 };
#define END_OF_LINE 1e30 /* largest |s| on an unbounded line of points `from` + s `along` */

typedef struct {
    vec3 n; /* unit normal */
    double c, rule, failed;
} Row; /* half space n.u >= c; rule: number of its safety rule; failed: 1 if c was relaxed */
typedef struct {
    Row row[MOST_ROWS];
    int count;
} Rows;

static inline int excludes(const Row *r, vec3 u, double tol) { return dot(r->n, u) < r->c - tol; }

/* sets u to the point nearest to `from` that satisfies the first `before` rows, on the line
 * through `from` in the direction `along`; returns 0 if no point of the line satisfies them */
static inline int nearest_on_line(const Row row[], int before, vec3 from, vec3 along, double tol,
                                  vec3 *u)
{
    double lo = -END_OF_LINE, hi = END_OF_LINE, parallel = 1e-18 * dot(along, along);
    for (int k = 0; k < before; k++) {
        double q = dot(row[k].n, along), e = row[k].c - dot(row[k].n, from);
        if (q * q < parallel) {
            if (e > tol) return 0;
        } else if (q > 0) lo = larger(lo, e / q);
        else hi = smaller(hi, e / q);
    }
    if (lo > hi + tol) return 0;
    *u = add(from, scale(smaller(larger(0, lo), hi), along));
    return 1;
}

/* sets u to the point nearest to u_0 that satisfies the rows before row `before`, on the plane
 * of row `before`; returns 0 if no point of the plane satisfies them */
static inline int nearest_on_plane(const Row row[], int before, vec3 u_0, double tol, vec3 *u)
{
    vec3 n = row[before].n, p = add(u_0, scale(row[before].c - dot(n, u_0), n));
    *u = p;
    for (int j = 0; j < before; j++) {
        if (!excludes(&row[j], *u, tol)) continue;
        /* direction in the plane of row `before` towards the half space of row j */
        vec3 h = sub(row[j].n, scale(dot(n, row[j].n), n));
        double square = dot(h, h);
        if (square < 1e-12) return 0;
        vec3 from = add(p, scale((row[j].c - dot(row[j].n, p)) / square, h));
        if (!nearest_on_line(row, j, from, cross(n, row[j].n), tol, u)) return 0;
    }
    return 1;
}

/* (21) of docs/models.md M.5: sets u to the point nearest to u_0 that satisfies the first `number`
 * rows. Returns ALL_SATISFIED, or the index of the first row that no point satisfies together with
 * the rows before it. A row counts as satisfied if it is violated by at most tol. */
static inline int nearest_point(const Row row[], int number, vec3 u_0, double tol, vec3 *u)
{
    *u = u_0;
    for (int i = 0; i < number; i++)
        if (excludes(&row[i], *u, tol) && !nearest_on_plane(row, i, u_0, tol, u)) return i;
    return ALL_SATISFIED;
}

#endif
