/* moving_parts.h - panels hinged to a hub and masses that slosh in it: what they are, and where.
 *
 * S is a point of the hub, where the centre of mass of the undeformed vehicle lies; all vectors in
 * S axes. A coordinate is the angle of a panel about its hinge axis, or the displacement of a mass
 * along its line; it exists if the part has mass at the start. Equations: docs/models.md L. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef MOVING_PARTS_H
#define MOVING_PARTS_H

#include "mat3.h"
#include "sym3.h"

enum { PANELS = 4, SLOSHES = 4, PARTS = PANELS + SLOSHES }; /* coordinates: panels first */

/* one entry or row each */
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

/* ---- what the parameters say, once and for all; of doubles only, for it is kept in a State ---- */
typedef struct {
    double k;                  /* its coordinate */
    double mass;               /* at the start */
    vec3 place, out, axis, up; /* hinge, e_0, a, a x e_0; of a slosh mass: r_0, -, p, - */
    double d;                  /* r' = d q' t: from hinge to centre of mass; of a slosh mass 1 */
    double I_h;                /* I2 + mu d^2 */
    double push;               /* P = push t: mu d/I_h; of a slosh mass 1 */
    vec3 twist;                /* of L: I2 a/I_h; of a slosh mass r x p, which does not move */
    double lean;               /* (I1 - I3)/I_h */
    double turn_t, turn_e;     /* I1 + I2 - I3, I1 - I2 - I3 */
    vec3 spin;                 /* I2 a */
    double stiffness, damping; /* of the unit of generalised mass: w^2, 2 z w */
    double draw;
} Part;
/* sums of p p^T/M, p l^T/M, l l^T/M of (7) */
typedef struct {
    sym3 pp, ll;
    mat3 pl;
} Coupling;
typedef struct {
    double count; /* of the parts that exist */
    Part part[PARTS];
    double mass_0, mass; /* of the whole and of the hub, at the start */
    vec3 first_moment;   /* h of the hub about S */
    sym3 inertia;        /* I_h0 of the hub about S, wheels locked */
    sym3 steady;         /* of I in (4) what no coordinate moves */
    Coupling sloshes;    /* of the slosh masses, which no coordinate moves, at the start */
    Coupling drawn;      /* what a kilogram of consumption takes of it */
    double draw;         /* D: share of the consumption that the slosh masses give */
} Vehicle;

static inline sym3 plate_inertia(vec3 moments, vec3 e, vec3 a, vec3 t) /* I1 ee + I2 aa + I3 tt */
{
    return sym_add(dyad(moments.x, e), sym_add(dyad(moments.y, a), dyad(moments.z, t)));
}

static inline Part panel_of(const Panels *p, int i)
{
    vec3 axis = unit(p->axis_S[i]), out = unit(p->arm_S[i]);
    vec3 I = p->inertia[i];
    double d = norm(p->arm_S[i]), w = p->frequency[i], I_h = I.y + p->mass[i] * d * d;
    return (Part){.k = i,
                  .mass = p->mass[i],
                  .place = p->hinge_S[i],
                  .out = out,
                  .axis = axis,
                  .up = cross(axis, out),
                  .d = d,
                  .I_h = I_h,
                  .push = p->mass[i] * d / I_h,
                  .twist = scale(I.y / I_h, axis),
                  .lean = (I.x - I.z) / I_h,
                  .turn_t = I.x + I.y - I.z,
                  .turn_e = I.x - I.y - I.z,
                  .spin = scale(I.y, axis),
                  .stiffness = w * w,
                  .damping = 2 * p->damping_ratio[i] * w};
}

static inline Part slosh_of(const Sloshes *p, int j)
{
    double w = p->frequency[j];
    return (Part){.k = PANELS + j,
                  .mass = p->mass_0[j],
                  .place = p->position_S[j],
                  .axis = unit(p->axis_S[j]),
                  .d = 1,
                  .push = 1,
                  .twist = cross(p->position_S[j], unit(p->axis_S[j])),
                  .stiffness = w * w,
                  .damping = 2 * p->damping_ratio[j] * w,
                  .draw = p->draw[j]};
}

/* sum + k (p p^T, p l^T, l l^T) */
static inline void couple(Coupling *sum, double k, vec3 p, vec3 l)
{
    sum->pp = sym_add(sum->pp, dyad(k, p));
    sum->pl = plus(sum->pl, outer(scale(k, p), l));
    sum->ll = sym_add(sum->ll, dyad(k, l));
}

/* I_i but for (I1 - I3) e e^T: as e, a, t are perpendicular, I3 1 + (I2 - I3) a a^T */
static inline sym3 steady_inertia(vec3 I, vec3 axis)
{
    return sym_add(sym_diagonal(I.z, I.z, I.z), dyad(I.y - I.z, axis));
}

/* (3): the hub is what the undeformed parts leave of the vehicle */
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
        vec3 r = panel ? add(b->place, scale(b->d, b->out)) : b->place;
        v.mass -= mass;
        v.first_moment = sub(v.first_moment, scale(mass, r));
        v.inertia = sym_sub(v.inertia, point_inertia(mass, r));
        v.draw += b->draw;
        if (panel) {
            vec3 I = panels->inertia[k];
            v.inertia = sym_sub(v.inertia, plate_inertia(I, b->out, b->axis, b->up));
            v.steady = sym_add(v.steady, steady_inertia(I, b->axis));
        } else {
            couple(&v.sloshes, mass, b->axis, b->twist);
            couple(&v.drawn, b->draw, b->axis, b->twist);
        }
    }
    v.steady = sym_add(v.steady, v.inertia);
    return v;
}

/* ---- where the parts are ---- */
typedef struct {
    const Part *of;
    int k;                   /* its coordinate, q_k */
    double q, rate, mass, M; /* q_k, q_k', mass as it is now, generalised mass (5) */
    double md;               /* p = md t */
    vec3 r, t, L;            /* centre of mass from S, where it moves to: r' = d q' t; l/M of (5) */
    vec3 e;                  /* (1), of a panel */
} Placed;
typedef struct {
    double m, used, hub_mass; /* used: propellant U gone so far */
    vec3 s, c, dc;            /* first moment, centre of mass, its velocity in the hub */
    int count;
    Placed part[PARTS]; /* those that exist */
} Placement;

static inline void place_panel(Placed *x, const Part *b, double angle) /* (1) */
{
    SineCosine th = sine_and_cosine(angle);
    vec3 e = add(scale(th.c, b->out), scale(th.s, b->up));
    vec3 t = cross(b->axis, e), r = add(b->place, scale(b->d, e));
    x->mass = b->mass, x->M = b->I_h, x->md = b->mass * b->d;
    x->r = r, x->t = t, x->e = e;
    x->L = add(b->twist, scale(b->push, cross(r, t)));
}

static inline void place_slosh(Placed *x, const Part *b, double shift, double used) /* (2) */
{
    x->mass = x->M = x->md = b->mass - b->draw * used;
    x->r = add(b->place, scale(shift, b->axis));
    x->t = b->axis;
    x->L = b->twist;
}

/* (4) but for I, (8) */
static inline void place_parts(Placement *at, const Vehicle *v, double used, const double q[PARTS],
                               const double dq[PARTS])
{
    vec3 s = v->first_moment, flow = vec(0, 0, 0);
    at->count = (int)v->count;
    for (int i = 0; i < at->count; i++) {
        const Part *b = &v->part[i];
        Placed *x = &at->part[i];
        int k = (int)b->k;
        x->of = b, x->k = k, x->q = q[k], x->rate = dq[k];
        if (k < PANELS) place_panel(x, b, q[k]);
        else place_slosh(x, b, q[k], used);
        s = add(s, scale(x->mass, x->r));
        flow = add(flow, scale(x->md * dq[k], x->t));
    }
    at->m = v->mass_0 - used;
    at->used = used;
    at->hub_mass = v->mass - (1 - v->draw) * used;
    at->s = s;
    at->c = scale(1 / at->m, s);
    at->dc = scale(1 / at->m, flow);
}

#endif
