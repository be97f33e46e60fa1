/* moving_parts.h - panels hinged to a hub and masses that slosh in it: their constants and their
 * positions at an instant.
 *
 * S is a point of the hub, where the centre of mass of the undeformed vehicle lies; all vectors are
 * in S axes. A coordinate q is the angle of a panel about its hinge axis, or the displacement of a
 * mass along its line; it exists if the part has mass at the start.
 *
 * Panel: mu is its mass, e the unit vector from the hinge to its centre of mass, a the hinge axis,
 * t = a x e; e_0, t_0: at angle 0. I1, I2, I3: moments of inertia about its centre of mass along
 * e, a, t. Slosh mass: r_0 is its position at rest. M: generalised mass of a coordinate; p, l:
 * linear momentum and angular momentum about S of the part per unit rate of its coordinate; w, z:
 * frequency and damping ratio with a fixed hub. Numbers in parentheses: equations of
 * docs/models.md L. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef MOVING_PARTS_H
#define MOVING_PARTS_H

#include "mat3.h"
#include "sym3.h"

enum { PANELS = 4, SLOSHES = 4, PARTS = PANELS + SLOSHES }; /* coordinates, panels first */

/* parameters: each array has one entry per panel, or one per slosh mass */
typedef struct {
    double mass[PANELS];
    vec3 hinge_S[PANELS], arm_S[PANELS], axis_S[PANELS], inertia[PANELS];
    double frequency[PANELS], damping_ratio[PANELS], angle_0[PANELS], rate_0[PANELS];
} Panels;
typedef struct {
    double mass_0[SLOSHES];
    vec3 position_S[SLOSHES], axis_S[SLOSHES];
    double frequency[SLOSHES], damping_ratio[SLOSHES], displacement_0[SLOSHES], rate_0[SLOSHES];
    double travel[SLOSHES], draw[SLOSHES];
} Sloshes;

/* ---- constants that follow from the parameters; doubles only, because a State holds them ---- */
typedef struct {
    double k;    /* index of the coordinate of the part */
    double mass; /* mass at the start */
    /* panel: hinge, e_0, a, t_0; slosh mass: r_0, unused, unit vector of its line, unused */
    vec3 origin, e_0, axis, t_0;
    double d;   /* panel: distance of its centre of mass from the hinge; slosh mass: 1 */
    double I_h; /* inertia of a panel about its hinge axis, I2 + mu d^2 */
    /* p/M, momentum per rate over generalised mass, is P_size t; panel: mu d/I_h; slosh mass: 1,
     * with t along its line */
    double P_size;
    vec3 L_fixed;     /* term of l/M that is constant; panel: I2 a/I_h; slosh mass: r_0 x axis */
    double asymmetry; /* (I1 - I3)/I_h */
    double gyroscopic_t, gyroscopic_e; /* I1 + I2 - I3, I1 - I2 - I3 */
    vec3 I_axis;                       /* I2 a */
    double stiffness, damping;         /* of its coordinate, both over M: w^2, 2 z w */
    double draw;                       /* slosh mass: its share of the propellant consumption */
} Part;
/* sums of p p^T/M, p l^T/M and l l^T/M over parts, as in (7) */
typedef struct {
    sym3 pp, ll;
    mat3 pl;
} Coupling;
typedef struct {
    double count; /* number of parts that exist */
    Part part[PARTS];
    double mass_0, mass; /* at the start: mass of the whole vehicle, mass of the hub */
    vec3 first_moment;   /* h of (3): first moment of the hub about S */
    sym3 inertia;        /* I_h0 of (3): inertia of the hub about S, wheels locked */
    sym3 I_fixed;        /* terms of the inertia I about S that do not depend on the coordinates */
    Coupling sloshes;    /* sums over the slosh masses at the start, constant for all q */
    Coupling drawn;      /* decrease of `sloshes` per kilogram of propellant consumed */
    double draw;         /* D: share of the consumption that comes from the slosh masses */
} Vehicle;

/* inertia of a panel about its centre of mass: I1 e e^T + I2 a a^T + I3 t t^T */
static inline sym3 plate_inertia(vec3 moments, vec3 e, vec3 a, vec3 t)
{
    return sym_add(dyad(moments.x, e), sym_add(dyad(moments.y, a), dyad(moments.z, t)));
}

static inline Part panel_of(const Panels *p, int i)
{
    vec3 axis = unit(p->axis_S[i]), e_0 = unit(p->arm_S[i]);
    vec3 I = p->inertia[i];
    double d = norm(p->arm_S[i]), w = p->frequency[i], I_h = I.y + p->mass[i] * d * d;
    return (Part){.k = i,
                  .mass = p->mass[i],
                  .origin = p->hinge_S[i],
                  .e_0 = e_0,
                  .axis = axis,
                  .t_0 = cross(axis, e_0),
                  .d = d,
                  .I_h = I_h,
                  .P_size = p->mass[i] * d / I_h,
                  .L_fixed = scale(I.y / I_h, axis),
                  .asymmetry = (I.x - I.z) / I_h,
                  .gyroscopic_t = I.x + I.y - I.z,
                  .gyroscopic_e = I.x - I.y - I.z,
                  .I_axis = scale(I.y, axis),
                  .stiffness = w * w,
                  .damping = 2 * p->damping_ratio[i] * w};
}

static inline Part slosh_of(const Sloshes *p, int j)
{
    double w = p->frequency[j];
    return (Part){.k = PANELS + j,
                  .mass = p->mass_0[j],
                  .origin = p->position_S[j],
                  .axis = unit(p->axis_S[j]),
                  .d = 1,
                  .P_size = 1,
                  .L_fixed = cross(p->position_S[j], unit(p->axis_S[j])),
                  .stiffness = w * w,
                  .damping = 2 * p->damping_ratio[j] * w,
                  .draw = p->draw[j]};
}

/* adds k p p^T, k p l^T and k l l^T to the sums */
static inline void add_coupling(Coupling *sum, double k, vec3 p, vec3 l)
{
    sum->pp = sym_add(sum->pp, dyad(k, p));
    sum->pl = plus(sum->pl, outer(scale(k, p), l));
    sum->ll = sym_add(sum->ll, dyad(k, l));
}

/* constant part of the inertia of a panel: I3 1 + (I2 - I3) a a^T, the whole inertia minus
 * (I1 - I3) e e^T, as e, a, t are perpendicular; I: [I1, I2, I3] along e, a, t; axis: a */
static inline sym3 fixed_inertia(vec3 I, vec3 axis)
{
    return sym_add(sym_diagonal(I.z, I.z, I.z), dyad(I.y - I.z, axis));
}

/* (3): constants of the vehicle; mass and inertia of the hub: mass and inertia of the vehicle less
 * the mass and inertia of the undeformed parts */
static inline Vehicle vehicle_of(double mass_0, mat3 J_S, const Panels *panels,
                                 const Sloshes *sloshes)
{
    Vehicle v = {.mass_0 = mass_0, .mass = mass_0, .inertia = sym_of(J_S)};
    for (int k = 0; k < PARTS; k++) {
        int panel = k < PANELS;
        double mass = panel ? panels->mass[k] : sloshes->mass_0[k - PANELS];
        if (!(mass > 0)) continue;
        Part *b = &v.part[(int)v.count++];
        *b = panel ? panel_of(panels, k) : slosh_of(sloshes, k - PANELS);
        vec3 r = panel ? add(b->origin, scale(b->d, b->e_0)) : b->origin;
        v.mass -= mass;
        v.first_moment = sub(v.first_moment, scale(mass, r));
        v.inertia = sym_sub(v.inertia, point_inertia(mass, r));
        v.draw += b->draw;
        if (panel) {
            vec3 I = panels->inertia[k];
            v.inertia = sym_sub(v.inertia, plate_inertia(I, b->e_0, b->axis, b->t_0));
            v.I_fixed = sym_add(v.I_fixed, fixed_inertia(I, b->axis));
        } else {
            add_coupling(&v.sloshes, mass, b->axis, b->L_fixed);
            add_coupling(&v.drawn, b->draw, b->axis, b->L_fixed);
        }
    }
    v.I_fixed = sym_add(v.I_fixed, v.inertia);
    return v;
}

/* ---- the parts at an instant ---- */
typedef struct {
    const Part *part;
    int k;                   /* index of the coordinate q_k of the part */
    double q, rate, mass, M; /* q_k; q_k'; mass at this instant; generalised mass by (5) */
    double md;               /* factor in p = md t */
    /* r: centre of mass from S; t: unit vector of its velocity relative to the hub, r' = d q' t;
     * L: l/M by (5) */
    vec3 r, t, L;
    vec3 e; /* unit vector e of a panel by (1) */
} PlacedPart;
typedef struct {
    double m, used, hub_mass; /* mass of the vehicle; consumed propellant U; mass of the hub */
    vec3 s, c, dc;            /* first moment about S; centre of mass; derivative of c in S axes */
    int count;
    PlacedPart part[PARTS]; /* the parts that exist */
} Placement;

static inline void place_panel(PlacedPart *x, const Part *b, double angle) /* (1) */
{
    SineCosine th = sine_and_cosine(angle);
    vec3 e = add(scale(th.c, b->e_0), scale(th.s, b->t_0));
    vec3 t = cross(b->axis, e), r = add(b->origin, scale(b->d, e));
    x->mass = b->mass, x->M = b->I_h, x->md = b->mass * b->d;
    x->r = r, x->t = t, x->e = e;
    x->L = add(b->L_fixed, scale(b->P_size, cross(r, t)));
}

static inline void place_slosh(PlacedPart *x, const Part *b, double displacement,
                               double used) /* (2) */
{
    x->mass = x->M = x->md = b->mass - b->draw * used;
    x->r = add(b->origin, scale(displacement, b->axis));
    x->t = b->axis;
    x->L = b->L_fixed;
}

/* sets positions of the parts, masses, first moment about S, centre of mass and its velocity, for
 * coordinates q and rates dq after the consumption of `used` kilograms */
static inline void place_parts(Placement *at, const Vehicle *v, double used, const double q[PARTS],
                               const double dq[PARTS])
{
    vec3 s = v->first_moment, momentum = vec(0, 0, 0);
    at->count = (int)v->count;
    for (int i = 0; i < at->count; i++) {
        const Part *b = &v->part[i];
        PlacedPart *x = &at->part[i];
        int k = (int)b->k;
        x->part = b, x->k = k, x->q = q[k], x->rate = dq[k];
        if (k < PANELS) place_panel(x, b, q[k]);
        else place_slosh(x, b, q[k], used);
        s = add(s, scale(x->mass, x->r));
        momentum = add(momentum, scale(x->md * dq[k], x->t));
    }
    at->m = v->mass_0 - used;
    at->used = used;
    at->hub_mass = v->mass - (1 - v->draw) * used;
    at->s = s;
    at->c = scale(1 / at->m, s);
    at->dc = scale(1 / at->m, momentum);
}

#endif
