/* optimal_motion.h - motion that a solve of optimal_controller predicts: orbit and tide near the
 * target, tumble of the target; and the start of a solve from the result of the previous solve.
 *
 * Equations (1), (2), (23): docs/models.md N. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef OPTIMAL_MOTION_H
#define OPTIMAL_MOTION_H

#include "index.h"
#include "optimal_problem.h"
#include "orbit.h"
#include "rk4.h"

/* ---- orbit of the target near one instant ---- */
typedef struct {
    double k;           /* mu/r^3 [1/s2] */
    vec3 e_r, e_t, e_n; /* axes of the Hill frame at the instant, N components */
    double rate;        /* rate of the Hill frame [rad/s] */
} OrbitNow;

static inline OrbitNow orbit_now(double mu, vec3 r, vec3 v)
{
    HillFrame H = hill_frame(mu, r, v);
    double rr = dot(r, r), k = mu > 0 ? mu / (rr * sqrt(rr)) : 0;
    return (OrbitNow){k, H.C_HN.row[0], H.C_HN.row[1], H.C_HN.row[2], H.w_H.z};
}

/* (2): rotation matrix from N to the Hill frame `after` seconds later */
static inline mat3 hill_axes(const OrbitNow *o, double after)
{
    SineCosine a = sine_and_cosine(o->rate * after);
    return rows(add(scale(a.c, o->e_r), scale(a.s, o->e_t)),
                sub(scale(a.c, o->e_t), scale(a.s, o->e_r)), o->e_n);
}

/* (2): differential gravity at the relative position x, `after` seconds later [m/s2] */
static inline vec3 tide(const OrbitNow *o, double after, vec3 x)
{
    if (o->k == 0) return vec(0, 0, 0);
    vec3 r = hill_axes(o, after).row[0];
    return scale(o->k, sub(scale(3 * dot(r, x), r), x));
}

/* ---- tumble of the target, free of torques ---- */
typedef struct { mat3 J, J_inverse; } Inertia;
typedef struct {
    quat q;
    vec3 w;
} Tumble; /* attitude relative to N, rate in body axes */

static inline vec3 free_rate_change(const Inertia *i, vec3 w)
{
    return mul(i->J_inverse, cross(mul(i->J, w), w));
}

static inline void tumble_rates(const Inertia *i, double t, const Tumble *x, Tumble *dx)
{
    (void)t;
    vec3 half = scale(0.5, x->w);
    *dx = (Tumble){product(x->q, (quat){0, half.x, half.y, half.z}), free_rate_change(i, x->w)};
}
RK4(integrate_tumble, tumble_rates, Inertia, Tumble)

static inline void tumble_on(const Inertia *i, double h, Tumble *x)
{
    integrate_tumble(i, 0, h, x);
    x->q = canonical(x->q);
}

/* propagates the free rotation of the target over a node (interval) of dt seconds, in the least
 * number of steps that are no longer than `longest`, but in at most four */
static inline void tumble_over_node(const Inertia *i, double dt, double longest, Tumble *x)
{
    double ratio = dt / longest;
    int steps = 1 + (ratio > 1) + (ratio > 2) + (ratio > 3);
    for (int s = 0; s < 4; s++)
        if (s < steps) tumble_on(i, dt / steps, x);
}

/* ---- start from the last solve, (23) ---- */
typedef struct { double t, dt; } Grid; /* start [s], length of each of its nodes (intervals) [s] */

/* place of a value on a grid, for linear interpolation in time */
typedef struct {
    int left;
    double part;
} Place; /* node on the left, and fraction of the way to the next node */

/* where a value of node k of the new grid lies on the old grid; `at`: instant to which the value
 * belongs, as a fraction of its node (interval): 1/2 for accelerations, 1 for states */
static inline Place place_on(Grid old, Grid new, int k, double at)
{
    double s = ((new.t - old.t) + (k + at) * new.dt) / old.dt - at;
    int left = index_within(s, NODES - 2);
    return (Place){left, clamp(s, 0, NODES - 1) - left};
}

static inline vec3 between(vec3 a, vec3 b, double part) { return add(a, scale(part, sub(b, a))); }

static inline void move_path(vec3 path[], Grid old, Grid new, double factor)
{
    vec3 before[NODES];
    memcpy(before, path, sizeof before);
    for (int k = 0; k < NODES; k++) {
        Place s = place_on(old, new, k, 1);
        int j = s.left;
        path[k] = scale(factor, between(before[j], before[j + 1], s.part));
    }
}

static inline void move_splits(Split split[], Grid old, Grid new, double at, double factor)
{
    Split before[NODES];
    memcpy(before, split, sizeof before);
    for (int k = 0; k < NODES; k++) {
        Place s = place_on(old, new, k, at);
        int j = s.left;
        split[k].z = scale(factor, between(before[j].z, before[j + 1].z, s.part));
        split[k].y = scale(factor, between(before[j].y, before[j + 1].y, s.part));
    }
}

/* moves the iterates from the old grid to the new one and scales them to the units of the new
 * solve (docs/models.md N.1); the path it->p is converted to metres instead */
static inline void start_from_last(Iterates *it, Grid old, Grid new)
{
    double ratio = old.dt / new.dt, horizon = old.dt *NODES;
    move_splits(it->u, old, new, 0.5, 1);
    move_splits(it->cone, old, new, 1, ratio * ratio);
    move_splits(it->slab, old, new, 1, ratio * ratio);
    move_splits(it->speed, old, new, 1, ratio);
    move_path(it->p, old, new, horizon * horizon);
}

/* ---- path with which the first solve for a goal starts ---- */

/* point at the fraction `part` of the way from a to b: with is_arc on an arc about the target, on
 * which direction and range change at constant rates; else, or if a and b are almost parallel or
 * opposite, on a straight line */
static inline vec3 first_way(vec3 a, vec3 b, int is_arc, double part)
{
    double alpha = angle(a, b);
    if (!is_arc || alpha < 1e-6 || alpha > PI - 1e-3) return between(a, b, part);
    vec3 turned = add(scale(sine((1 - part) * alpha), unit(a)), scale(sine(part * alpha), unit(b)));
    double range = norm(a) + part * (norm(b) - norm(a));
    return scale(range / sine(alpha), turned);
}

#endif
