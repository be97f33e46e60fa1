/* surfaces.h - outer surfaces of the assembly of two bodies, base 0 and module 1: a box around the
 * centre of mass of each body, with six one-sided faces, and flat two-sided panels, each on one of
 * the bodies. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SURFACES_H
#define SURFACES_H

#include "mat3.h"

enum { BOX_FACES = 6, PANELS = 4, FACETS = 2 * BOX_FACES + PANELS };

typedef struct { vec3 of[PANELS]; } PanelVectors;
typedef struct {
    vec3 box_0, box_1; /* lengths of the edges along the body axes, m; 0: no box */
    double panel_area[PANELS], panel_body[PANELS];
    PanelVectors panel_position, panel_normal; /* from the centre of mass of the body, body axes */
} Surfaces;

typedef struct {
    double area, two_sided;
    vec3 normal, centre;
} Facet;

static inline Facet box_face(vec3 edges, int k) /* face k: +x -x +y -y +z -z */
{
    double side = k % 2 ? -1 : 1;
    vec3 axis[3] = {vec(side, 0, 0), vec(0, side, 0), vec(0, 0, side)}, n = axis[k / 2];
    double area[3] = {edges.y * edges.z, edges.x * edges.z, edges.x * edges.y};
    return (Facet){area[k / 2], 0, n, scale(0.5, times(edges, n))};
}

static inline Facet panel(const Surfaces *s, int k)
{
    return (Facet){s->panel_area[k], 1, s->panel_normal.of[k], s->panel_position.of[k]};
}

static inline int body_of_facet(const Surfaces *s, int k)
{
    return k < 2 * BOX_FACES ? k / BOX_FACES : s->panel_body[k - 2 * BOX_FACES] != 0;
}
static inline Facet facet(const Surfaces *s, int k)
{
    if (k >= 2 * BOX_FACES) return panel(s, k - 2 * BOX_FACES);
    return box_face(k < BOX_FACES ? s->box_0 : s->box_1, k % BOX_FACES);
}

/* area of a facet, projected on the plane normal to the direction v of the flow [m2] */
static inline double area_in_flow(Facet f, vec3 v)
{
    double facing = -dot(f.normal, v);
    return f.area * (f.two_sided != 0 ? fabs(facing) : larger(0, facing));
}

#endif
