/* optimal_problem.h - path of least impulse between two states with constraints, improved by one
 * iteration of the alternating direction method of multipliers at a time.
 *
 *   min sum_k kappa us |C_k u_k|_1     u_k: acceleration held over node k, N axes
 *   box |(C_k u_k)_i| <= most_i,  cone |p - (p.a) a| <= t (p.a) + o,  slab low <= n.p <= high or
 *   ball |p - n| <= high,  speed |v - v_c| <= v_max,  end p = p_end, v = v_end by weights
 *
 * Node k is the interval k of `nodes` equal intervals of the horizon T, the time to the end of the
 * path. p_k, v_k: position and velocity at the end of this interval; C_k: N axes to servicer axes;
 * us: largest force/mass; kappa us: threshold in (16); t, o: tangent of the cone's half angle,
 * radius of the cone at p.a = 0. The end is not a constraint: its deviations have quadratic weights.
 * The unit of time is T: positions are stored as p/T^2, velocities as v/T, and the matrices depend
 * only on the number of nodes and on whether the speed is limited. The step of the accelerations is
 * a Riccati recursion with the same gains for the three axes; the projections onto the constraints
 * have closed forms. Equations (4) to (19): section N of docs/models.md. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef OPTIMAL_PROBLEM_H
#define OPTIMAL_PROBLEM_H

#include "vec3.h"

enum { NODES = 60 };

#define RELAXATION      1.6 /* factor of over-relaxation, the 1.6 in (12) */
#define POSITION_WEIGHT 480.0
#define SPEED_WEIGHT    30.0
#define END_FACTOR      3e3 /* weight of the end state divided by the weight of a node */
#define NEAR_THE_LIMIT  (1 - 1e-12)

typedef struct {
    mat3 C;            /* N axes to servicer axes */
    vec3 a;            /* axis of the cone */
    double tangent, o; /* of the cone: tangent of the half angle, radius at p.a = 0 */
    vec3 n;            /* normal of the slab, or centre of the ball */
    double low, high;  /* bounds of the slab; high: also radius of the ball */
    double has_ball;   /* 1: ball, 0: slab */
    vec3 place;        /* position of the goal at the end of the interval */
    vec3 v_centre;     /* v_c: velocity relative to which v_max limits the speed */
    double v_max;
    vec3 p_free, v_free; /* of the motion without force, at the end of the interval */
} Node;                  /* data of one node; positions p/T^2, velocities v/T */

typedef struct {
    Node node[NODES];
    vec3 p_end, v_end; /* p/T^2, v/T */
    vec3 most;         /* largest acceleration per servicer axis */
    double threshold;  /* kappa us */
    double has_cone, has_speed_limit;
} Problem;

/* one constraint at one node: z is the point inside the set, y the scaled multiplier */
typedef struct { vec3 z, y; } Split;

typedef struct {
    Split u[NODES], cone[NODES], slab[NODES], speed[NODES];
    vec3 p[NODES]; /* path of the last iteration */
} Iterates;

/* progress in the last iteration. residual: square of the largest |path - z| of positions p and
 * accelerations u; change: square of the largest change of z; count: number of nodes at which
 * the box, the cone, or the slab or ball limits the path */
typedef struct {
    double residual_p, residual_u, change_p, change_u;
    double count_box, count_cone, count_slab;
} Progress;

/* ---- gains, (13) ---- */
typedef struct { double p, v, R_inverse; } NodeGains;
typedef struct { NodeGains node[NODES]; } Gains;

/* (13): gains of all nodes, from the last to the first:
 * P <- A^T (P - b b^T/R) A + Q with A = [1 h; 0 1] */
static inline void set_gains(Gains *g, int nodes, int has_speed_limit)
{
    double h = 1.0 / nodes, Q_p = 2 * POSITION_WEIGHT, Q_v = has_speed_limit ? SPEED_WEIGHT : 0;
    double pp = Q_p + END_FACTOR * POSITION_WEIGHT, pv = 0, vv = Q_v + END_FACTOR * SPEED_WEIGHT;
    for (int k = nodes - 1; k >= 0; k--) {
        double B_p = h * h / 2, b_p = pp * B_p + pv * h, b_v = pv * B_p + vv * h;
        double R = 1 + (b_p * B_p + b_v * h);
        g->node[k] = (NodeGains){b_p / R, b_v / R, 1 / R};
        double s_pp = pp - b_p * b_p / R, s_pv = pv - b_p * b_v / R, s_vv = vv - b_v * b_v / R;
        pp = s_pp + Q_p;
        vv = h * h * s_pp + 2 * h * s_pv + s_vv + Q_v;
        pv = h * s_pp + s_pv;
    }
}

/* ---- projections, (16) to (19) ---- */
static inline double shrunk(double b, double threshold)
{
    double left = fabs(b) - threshold;
    return left > 0 ? (b < 0 ? -left : left) : 0;
}

/* (16): shrinks x by the threshold and projects it to the box; sets `near` to 1 if a component
 * is at its limit */
static inline vec3 onto_box(const Problem *b, const mat3 *C, vec3 x, int *near)
{
    vec3 body = mul(*C, x);
    body = vec(clamp(shrunk(body.x, b->threshold), -b->most.x, b->most.x),
               clamp(shrunk(body.y, b->threshold), -b->most.y, b->most.y),
               clamp(shrunk(body.z, b->threshold), -b->most.z, b->most.z));
    *near = fabs(body.x) >= NEAR_THE_LIMIT * b->most.x ||
            fabs(body.y) >= NEAR_THE_LIMIT * b->most.y ||
            fabs(body.z) >= NEAR_THE_LIMIT * b->most.z;
    return tmul(*C, body);
}

/* (17) */
static inline vec3 onto_cone(vec3 a, double t, double o, vec3 x)
{
    vec3 opened = scale(o / t, a), from_apex = add(x, opened);
    double along = dot(from_apex, a);
    vec3 across = sub(from_apex, scale(along, a));
    double n = norm(across);
    if (n <= t * along) return x;
    double m = larger(0, (along + t * n) / (1 + t * t));
    vec3 z = n > 0 ? add(scale(m, a), scale(t * m / n, across)) : scale(m, a);
    return sub(z, opened);
}

/* (18) */
static inline vec3 onto_slab(vec3 n, double low, double high, vec3 x)
{
    double l = dot(x, n);
    if (l < low) return add(x, scale(low - l, n));
    return l > high ? add(x, scale(high - l, n)) : x;
}

/* (19) */
static inline vec3 onto_ball(vec3 centre, double radius, vec3 x)
{
    vec3 e = sub(x, centre);
    double n = norm(e);
    return n > radius ? add(centre, scale(radius / n, e)) : x;
}

static inline int differ(vec3 a, vec3 b) { return a.x != b.x || a.y != b.y || a.z != b.z; }

/* ---- one iteration, (9) to (15) ---- */
static inline double square(vec3 a) { return dot(a, a); }

/* (12): x = 1.6 q - 0.6 z + y, the value that is then projected; q: acceleration, position or
 * velocity of this iteration */
static inline vec3 relaxed(vec3 q, Split s)
{
    return add(sub(scale(RELAXATION, q), scale(RELAXATION - 1, s.z)), s.y);
}
static inline void replace_split(Split *s, vec3 x, vec3 z) { *s = (Split){z, sub(x, z)}; }

/* (9): tp_k, the weighted sum of the vectors from the free motion to the points z - y of cone and
 * slab at node k; velocity_pull(): tv_k, the same for the velocity and the speed constraint */
static inline vec3 position_pull(const Problem *b, const Iterates *it, int k)
{
    vec3 p = b->node[k].p_free;
    return scale(POSITION_WEIGHT, add(sub(sub(it->cone[k].z, it->cone[k].y), p),
                                      sub(sub(it->slab[k].z, it->slab[k].y), p)));
}
static inline vec3 velocity_pull(const Problem *b, const Iterates *it, int k)
{
    if (!b->has_speed_limit) return vec(0, 0, 0);
    return scale(SPEED_WEIGHT, sub(sub(it->speed[k].z, it->speed[k].y), b->node[k].v_free));
}

/* (14): sets q of all nodes, from the last to the first; (15) computes the accelerations from q */
static inline void sweep(const Problem *b, const Iterates *it, const Gains *g, int nodes, vec3 q[])
{
    double h = 1.0 / nodes;
    const Node *last = &b->node[nodes - 1];
    vec3 sp = scale(END_FACTOR * POSITION_WEIGHT, sub(b->p_end, last->p_free)),
         sv = scale(END_FACTOR * SPEED_WEIGHT, sub(b->v_end, last->v_free));
    for (int k = nodes - 1; k >= 0; k--) {
        sp = add(sp, position_pull(b, it, k));
        sv = add(sv, velocity_pull(b, it, k));
        vec3 c = sub(it->u[k].z, it->u[k].y);
        q[k] = sum3(c, scale(h * h / 2, sp), scale(h, sv));
        sp = sub(sp, scale(g->node[k].p, q[k]));
        sv = add(sub(sv, scale(g->node[k].v, q[k])), scale(h, sp));
    }
}

/* (12): projects the acceleration u of node k; f: progress to update, or NULL */
static inline void project_u(const Problem *b, int k, vec3 u, Split *s, Progress *f)
{
    int near;
    vec3 before = s->z, x = relaxed(u, *s);
    replace_split(s, x, onto_box(b, &b->node[k].C, x, &near));
    if (!f) return;
    f->count_box += near;
    f->residual_u = larger(f->residual_u, square(sub(u, s->z)));
    f->change_u = larger(f->change_u, square(sub(s->z, before)));
}

/* (12): stores the projection z of the relaxed value x of a position p. f: progress to
 * update, or NULL. Returns whether z differs from x, but always 0 if f is NULL */
static inline int project_position(vec3 p, vec3 x, vec3 z, Split *s, Progress *f)
{
    vec3 before = s->z;
    replace_split(s, x, z);
    if (!f) return 0;
    f->residual_p = larger(f->residual_p, square(sub(p, z)));
    f->change_p = larger(f->change_p, square(sub(z, before)));
    return differ(z, x);
}

static inline void project_p(const Problem *b, int k, vec3 p, Iterates *it, Progress *f)
{
    const Node *node = &b->node[k];
    vec3 x = relaxed(p, it->cone[k]);
    vec3 z = b->has_cone ? onto_cone(node->a, node->tangent, node->o, x) : x;
    int at_cone = project_position(p, x, z, &it->cone[k], f);
    x = relaxed(p, it->slab[k]);
    z = node->has_ball ? onto_ball(node->n, node->high, x)
                       : onto_slab(node->n, node->low, node->high, x);
    int at_slab = project_position(p, x, z, &it->slab[k], f);
    if (!f) return;
    f->count_cone += at_cone;
    f->count_slab += at_slab;
}

static inline void project_v(const Problem *b, int k, vec3 v, Split *s)
{
    vec3 x = relaxed(v, *s);
    replace_split(s, x, onto_ball(b->node[k].v_centre, b->node[k].v_max, x));
}

/* does one iteration: (14) backwards, then (15) and (12) forwards. q: working memory, one element
 * per node; f: set to the progress of the iteration, or NULL */
static inline void iterate(const Problem *b, const Gains *g, int nodes, Iterates *it, vec3 q[],
                           Progress *f)
{
    double h = 1.0 / nodes;
    vec3 x = vec(0, 0, 0), w = vec(0, 0, 0);
    if (f) *f = (Progress){0};
    sweep(b, it, g, nodes, q);
    for (int k = 0; k < nodes; k++) {
        x = add(x, scale(h, w));
        vec3 u = sub(sub(scale(g->node[k].R_inverse, q[k]), scale(g->node[k].p, x)),
                     scale(g->node[k].v, w));
        x = add(x, scale(h * h / 2, u));
        w = add(w, scale(h, u));
        it->p[k] = add(b->node[k].p_free, x);
        project_u(b, k, u, &it->u[k], f);
        project_p(b, k, it->p[k], it, f);
        if (b->has_speed_limit) project_v(b, k, add(b->node[k].v_free, w), &it->speed[k]);
    }
}

/* sets the iterates to the path without force, for a problem without an earlier path */
static inline void start_cold(const Problem *b, int nodes, Iterates *it)
{
    vec3 none = vec(0, 0, 0);
    for (int k = 0; k < nodes; k++) {
        const Node *node = &b->node[k];
        it->u[k] = (Split){none, none};
        it->cone[k] = it->slab[k] = (Split){node->p_free, none};
        it->speed[k] = (Split){node->v_free, none};
    }
}

#endif
