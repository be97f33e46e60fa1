/* moving_parts.h - panels hinged to a hub and masses that slosh in it: geometry, and the motion of
 * the hub with them by back-substitution.
 *
 * S is a point of the hub, where the centre of mass of the undeformed vehicle lies; all vectors in
 * S axes. A coordinate is the angle of a panel about its hinge axis, or the displacement of a mass
 * along its line; it exists if the part has mass at the start. Equations: docs/models.md L. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef MOVING_PARTS_H
#define MOVING_PARTS_H

#include "mat3.h"
#include "vec3.h"

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

/* ---- what the parameters say, once and for all ---- */
typedef struct {
    double mass;               /* at the start */
    vec3 place, out, axis, up; /* hinge, e_0, a, a x e_0; of a slosh mass: r_0, -, p, - */
    double d;                  /* from the hinge to the centre of mass */
    vec3 inertia;              /* I1, I2, I3 */
    double I_h;                /* I2 + mu d^2 */
    double stiffness, damping; /* of the unit of generalised mass: w^2, 2 z w */
    double draw;
} Part;
typedef struct {
    Part part[PARTS];
    double mass_0, mass; /* of the whole and of the hub, at the start */
    vec3 first_moment;   /* h of the hub about S */
    mat3 inertia;        /* I_h0 of the hub about S, wheels locked */
    double draw;         /* D: share of the consumption that the slosh masses give */
} Vehicle;

static inline mat3 point_inertia(double mass, vec3 r) /* mass (r.r 1 - r r^T) */
{
    return scaled(mass, inertia_product(r, r));
}

static inline mat3 plate_inertia(vec3 moments, vec3 e, vec3 a, vec3 t) /* I1 ee + I2 aa + I3 tt */
{
    return plus(scaled(moments.x, outer(e, e)),
                plus(scaled(moments.y, outer(a, a)), scaled(moments.z, outer(t, t))));
}

static inline Part panel_of(const Panels *p, int i)
{
    vec3 axis = unit(p->axis_S[i]), out = unit(p->arm_S[i]);
    double d = norm(p->arm_S[i]), w = p->frequency[i];
    return (Part){.mass = p->mass[i],
                  .place = p->hinge_S[i],
                  .out = out,
                  .axis = axis,
                  .up = cross(axis, out),
                  .d = d,
                  .inertia = p->inertia[i],
                  .I_h = p->inertia[i].y + p->mass[i] * d * d,
                  .stiffness = w * w,
                  .damping = 2 * p->damping_ratio[i] * w};
}

static inline Part slosh_of(const Sloshes *p, int j)
{
    double w = p->frequency[j];
    return (Part){.mass = p->mass_0[j],
                  .place = p->position_S[j],
                  .axis = unit(p->axis_S[j]),
                  .stiffness = w * w,
                  .damping = 2 * p->damping_ratio[j] * w,
                  .draw = p->draw[j]};
}

/* (3): the hub is what the undeformed parts leave of the vehicle */
static inline Vehicle vehicle_of(double mass_0, mat3 J_S, const Panels *panels,
                                 const Sloshes *sloshes)
{
    Vehicle v = {.mass_0 = mass_0, .mass = mass_0, .inertia = J_S};
    for (int k = 0; k < PARTS; k++) {
        int panel = k < PANELS;
        double mass = panel ? panels->mass[k] : sloshes->mass_0[k - PANELS];
        if (!(mass > 0)) continue;
        Part *b = &v.part[k];
        *b = panel ? panel_of(panels, k) : slosh_of(sloshes, k - PANELS);
        vec3 r = panel ? add(b->place, scale(b->d, b->out)) : b->place;
        mat3 own = plate_inertia(b->inertia, b->out, b->axis, b->up);
        v.mass -= mass;
        v.first_moment = sub(v.first_moment, scale(mass, r));
        v.inertia = minus(v.inertia, plus(own, point_inertia(mass, r)));
        v.draw += b->draw;
    }
    return v;
}

static inline int has_parts(const Vehicle *v)
{
    for (int k = 0; k < PARTS; k++)
        if (v->part[k].mass > 0) return 1;
    return 0;
}

/* ---- where the parts are ---- */
typedef struct {
    double mass, M, rate; /* generalised mass (5), rate of the coordinate */
    vec3 r, dr;           /* centre of mass from S, its velocity in the hub */
    vec3 e, t, spin;      /* (1), th' a; of a slosh mass 0 */
    mat3 inertia;         /* I_i */
    vec3 p, l, p_M, l_M;  /* (5), and the same over M */
} Placed;
typedef struct {
    int count, coordinate[PARTS];
    Placed part[PARTS]; /* those that exist */
    double m, hub_mass;
    vec3 s, c, dc; /* first moment, centre of mass, its velocity in the hub */
    mat3 I;
} Placement;

static inline Placed placed_panel(const Part *b, double angle, double rate) /* (1), (5) */
{
    SineCosine th = sine_and_cosine(angle);
    vec3 e = add(scale(th.c, b->out), scale(th.s, b->up)), t = cross(b->axis, e);
    vec3 r = add(b->place, scale(b->d, e)), p = scale(b->mass * b->d, t);
    vec3 l = add(scale(b->inertia.y, b->axis), cross(r, p));
    return (Placed){.mass = b->mass,
                    .M = b->I_h,
                    .rate = rate,
                    .r = r,
                    .dr = scale(b->d * rate, t),
                    .e = e,
                    .t = t,
                    .spin = scale(rate, b->axis),
                    .inertia = plate_inertia(b->inertia, e, b->axis, t),
                    .p = p,
                    .l = l,
                    .p_M = scale(1 / b->I_h, p),
                    .l_M = scale(1 / b->I_h, l)};
}

static inline Placed placed_slosh(const Part *b, double mass, double place, double rate)
{
    vec3 r = add(b->place, scale(place, b->axis)), l_M = cross(r, b->axis);
    return (Placed){.mass = mass,
                    .M = mass,
                    .rate = rate,
                    .r = r,
                    .dr = scale(rate, b->axis),
                    .p = scale(mass, b->axis),
                    .l = scale(mass, l_M),
                    .p_M = b->axis,
                    .l_M = l_M};
}

/* (4), (8); used: propellant U gone so far */
static inline Placement place_parts(const Vehicle *v, double used, const double q[PARTS],
                                    const double dq[PARTS])
{
    Placement at = {.m = v->mass_0 - used,
                    .hub_mass = v->mass - (1 - v->draw) * used,
                    .s = v->first_moment,
                    .I = v->inertia};
    for (int k = 0; k < PARTS; k++) {
        const Part *b = &v->part[k];
        if (!(b->mass > 0)) continue;
        Placed *x = &at.part[at.count];
        *x = k < PANELS ? placed_panel(b, q[k], dq[k])
                        : placed_slosh(b, b->mass - b->draw * used, q[k], dq[k]);
        at.coordinate[at.count++] = k;
        at.s = add(at.s, scale(x->mass, x->r));
        at.dc = add(at.dc, scale(x->mass, x->dr));
        at.I = plus(at.I, plus(x->inertia, point_inertia(x->mass, x->r)));
    }
    at.c = scale(1 / at.m, at.s);
    at.dc = scale(1 / at.m, at.dc);
    return at;
}

/* ---- equations of motion ---- */
/* matrix of (7): [U V; V^T W] [A; alpha] = [force; moment] */
typedef struct { mat3 U, V, W; } Inertia;
typedef struct { vec3 A, alpha; } Acceleration;

static inline Inertia felt_inertia(const Placement *at)
{
    Inertia x = {identity(at->m), scaled(-1, tilde(at->s)), at->I};
    for (int i = 0; i < at->count; i++) {
        const Placed *b = &at->part[i];
        x.U = minus(x.U, outer(b->p, b->p_M));
        x.V = minus(x.V, outer(b->p, b->l_M));
        x.W = minus(x.W, outer(b->l, b->l_M));
    }
    return x;
}

/* A = U^-1 (force - V alpha), (W - V^T U^-1 V) alpha = moment - V^T U^-1 force; a hub that is held
 * has alpha = 0 */
static inline Acceleration acceleration(const Inertia *x, vec3 force, vec3 moment, int held)
{
    mat3 inverse = inverted(x->U), across = matmul(inverse, x->V);
    vec3 alpha = vec(0, 0, 0);
    if (!held)
        alpha =
            solve(minus(x->W, matmul(transpose(across), x->V)), sub(moment, tmul(across, force)));
    return (Acceleration){sub(mul(inverse, force), mul(across, alpha)), alpha};
}

/* tidal field: g (3 n (n.x) - x) at x from the centre of mass, g = 0: none */
typedef struct {
    double g;
    vec3 n;
} Tide;

static inline vec3 tidal(const Tide *f, vec3 x)
{
    return scale(f->g, sub(scale(3 * dot(f->n, x), f->n), x));
}

/* what velocities, springs and tides alone do (6), (10) */
typedef struct {
    vec3 F, M;       /* N_F + sum g_k p_k, N_M + sum g_k l_k */
    double g[PARTS]; /* accelerations of the coordinates in a hub with A = alpha = 0 */
} Drift;

static inline double panel_drift(const Part *b, const Placed *x, vec3 w, vec3 x_c, const Tide *f)
{
    vec3 I = b->inertia, hinge = cross(w, cross(w, b->place));
    double md = b->mass * b->d;
    double loads = (I.x - I.z - md * b->d) * dot(w, x->e) * dot(w, x->t) - md * dot(x->t, hinge);
    double tide =
        md * dot(x->t, tidal(f, x_c)) + 3 * f->g * dot(b->axis, cross(f->n, mul(x->inertia, f->n)));
    return (loads + tide) / b->I_h;
}

static inline double slosh_drift(const Part *b, const Placed *x, vec3 w, vec3 x_c, const Tide *f)
{
    return dot(b->axis, sub(tidal(f, x_c), cross(w, cross(w, x->r))));
}

/* N_M but for r x b: th' [I_i (omega x a) + a x (I_i omega) + I2 omega x a] */
static inline vec3 spin_moment(const Part *b, const Placed *x, vec3 w)
{
    vec3 across = cross(w, b->axis);
    return scale(x->rate, sum3(mul(x->inertia, across), cross(b->axis, mul(x->inertia, w)),
                               scale(b->inertia.y, across)));
}

static inline Drift drift(const Vehicle *v, const Placement *at, const double q[PARTS], vec3 w,
                          const Tide *f)
{
    Drift sum = {{0, 0, 0}, {0, 0, 0}, {0}};
    for (int i = 0; i < at->count; i++) {
        int k = at->coordinate[i];
        const Part *b = &v->part[k];
        const Placed *x = &at->part[i];
        vec3 x_c = sub(x->r, at->c), push = scale(2 * x->mass, cross(w, x->dr));
        double g = -b->stiffness * q[k] - b->damping * x->rate;
        if (k < PANELS) {
            g += panel_drift(b, x, w, x_c, f);
            push = sub(push, scale(x->mass * b->d * x->rate * x->rate, x->e));
            sum.M = add(sum.M, spin_moment(b, x, w));
        } else g += slosh_drift(b, x, w, x_c, f);
        sum.F = sum3(sum.F, push, scale(g, x->p));
        sum.M = sum3(sum.M, cross(x->r, push), scale(g, x->l));
        sum.g[k] = g;
    }
    return sum;
}

/* (12): omega_top, from the compliance of each coordinate in the free undeformed vehicle:
 * M_k (X^-1)_kk = 1 + p_k.A + l_k.alpha under the load p_k/M_k, l_k/M_k on the hub */
static inline double highest_mode(const Vehicle *v)
{
    const double rest[PARTS] = {0};
    Placement at = place_parts(v, 0, rest, rest);
    Inertia x = felt_inertia(&at);
    double sum = 0;
    for (int i = 0; i < at.count; i++) {
        const Placed *b = &at.part[i];
        Acceleration a = acceleration(&x, b->p_M, b->l_M, 0);
        sum += v->part[at.coordinate[i]].stiffness * (1 + dot(b->p, a.A) + dot(b->l, a.alpha));
    }
    return sqrt(sum);
}

#endif
