/* filter_drift.h - drift without thrust after a force that is held for one sample, by the equations
 * of Clohessy and Wiltshire, and rows: half spaces of forces after which the drift misses the
 * keep-out sphere.
 *
 *   q_j = Phi_rr(j Delta) x_1 + Phi_rv(j Delta) v_1,   j = 0..K,   Delta = passive_time/K       (18)
 * K: passive_points; q_j: point j of the drift relative to the target, at the time j Delta after
 * the end of the sample, which lasts P seconds; Phi_rr, Phi_rv: parts of the transition matrix;
 * x_1, v_1: position and velocity at the end of the sample without force; a force u adds P^2/2 a to
 * x_1 and P a to v_1, a = C_HN C_SN^T u/m; n: orbital rate; m: mass. Chord j leads from q_j to
 * q_(j+1); sag at point j: |q_(j-1) - 2 q_j + q_(j+1)|/8, the distance by which the curved drift
 * departs from a chord there.
 * The margin of a chord is its distance from the target minus the larger sag of its two points, the
 * radius of the sphere and passive_margin (19). Vectors are in Hill axes. Equation
 * numbers: docs/models.md M.4 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef FILTER_DRIFT_H
#define FILTER_DRIFT_H

#include "filter_rows.h"
#include "orbit.h"

typedef struct {
    int count; /* K */
    double P, n, clear;
    double t[MOST_POINTS + 1];
    SineCosine turned[MOST_POINTS + 1]; /* sine, cosine of n j Delta */
    mat3 force_to_a;                    /* C_HN C_SN^T / m */
    vec3 x_1, v_1;
    vec3 free[MOST_POINTS + 1]; /* q_j without force */
} DriftFan;
typedef struct {
    vec3 nearest;
    double sag, margin;
} Chord;
typedef struct {
    double margin;
    int chord;
} Worst;

/* position q_j of a drift that starts at x with the velocity v: Phi_rr x + Phi_rv v, or x + t v if
 * n = 0 */
static inline vec3 clohessy_wiltshire(const DriftFan *f, int j, vec3 x, vec3 v)
{
    double n = f->n, t = f->t[j], s = f->turned[j].s, c = f->turned[j].c;
    if (n == 0) return add(x, scale(t, v));
    double lag = 6 * (s - n * t), sweep = 4 * s - 3 * n * t;
    return vec((4 - 3 * c) * x.x + (s * v.x + 2 * (1 - c) * v.y) / n,
               lag * x.x + x.y + (2 * (c - 1) * v.x + sweep * v.y) / n, c * x.z + s * v.z / n);
}

/* Phi_rr^T d: gradient of q_j.d with respect to the start position x_1 of the drift */
static inline vec3 position_sensitivity(const DriftFan *f, int j, vec3 d)
{
    double s = f->turned[j].s, c = f->turned[j].c;
    return vec((4 - 3 * c) * d.x + 6 * (s - f->n * f->t[j]) * d.y, d.y, c * d.z);
}
/* Phi_rv^T d: gradient of q_j.d with respect to the start velocity v_1 of the drift */
static inline vec3 velocity_sensitivity(const DriftFan *f, int j, vec3 d)
{
    double n = f->n, t = f->t[j], s = f->turned[j].s, c = f->turned[j].c;
    if (n == 0) return scale(t, d);
    double sweep = 4 * s - 3 * n * t;
    return scale(1 / n, vec(s * d.x + 2 * (c - 1) * d.y, 2 * (1 - c) * d.x + sweep * d.y, s * d.z));
}

static inline void drift_points(const DriftFan *f, vec3 u, vec3 q[])
{
    vec3 a = mul(f->force_to_a, u);
    vec3 x = add(f->x_1, scale(f->P * f->P / 2, a)), v = add(f->v_1, scale(f->P, a));
    for (int j = 0; j <= f->count; j++) q[j] = clohessy_wiltshire(f, j, x, v);
}

static inline DriftFan drift_fan(const FilterParameters *p, const FilterInput *u, const Geometry *g)
{
    mat3 C_HN = hill_frame(p->mu, u->T.r, u->T.v).C_HN;
    DriftFan f;
    memset(&f, 0, sizeof f);
    f.count = (int)p->passive_points, f.P = g->P, f.n = norm(g->w_H);
    double Delta = p->passive_time / p->passive_points;
    SineCosine one = sine_and_cosine(f.n * Delta), now = {0, 1};
    for (int j = 0; j <= f.count; j++) {
        f.t[j] = j * Delta;
        f.turned[j] = now;
        now = (SineCosine){now.s * one.c + now.c * one.s, now.c * one.c - now.s * one.s};
    }
    f.clear = p->keep_out_radius + p->passive_margin;
    f.force_to_a = scaled(1 / p->mass, matmul_t(C_HN, g->C_SN));
    vec3 moved = add(scale(g->P, g->v_H), scale(g->P * g->P / 2, g->a_H));
    f.x_1 = mul(C_HN, add(g->rho, moved));
    f.v_1 = mul(C_HN, add(g->v_H, scale(g->P, g->a_H)));
    drift_points(&f, vec(0, 0, 0), f.free);
    return f;
}

/* ---- chords ---- */
static inline vec3 nearest_of_chord(vec3 a, vec3 b)
{
    vec3 along = sub(b, a);
    double square = dot(along, along), part = square > 0 ? -dot(a, along) / square : 0;
    return add(a, scale(clamp(part, 0, 1), along));
}

static inline double sag_at(const vec3 q[], int last, int j)
{
    int i = j == 0 ? 1 : j < last ? j : last - 1;
    return norm(sum3(q[i - 1], scale(-2, q[i]), q[i + 1])) / 8;
}

static inline Chord chord(const DriftFan *f, const vec3 q[], int j)
{
    vec3 nearest = nearest_of_chord(q[j], q[j + 1]);
    double sag = larger(sag_at(q, f->count, j), sag_at(q, f->count, j + 1));
    return (Chord){nearest, sag, norm(nearest) - sag - f->clear};
}

static inline Worst worst_chord(const DriftFan *f, const vec3 q[])
{
    Worst w = {INFINITY, 0};
    for (int j = 0; j < f->count; j++) {
        double margin = chord(f, q, j).margin;
        if (margin < w.margin) w = (Worst){margin, j};
    }
    return w;
}

/* the chord with the least margin after a force u, among the drifts with the least and with the
 * largest possible mass of the servicer */
static inline Worst worst_drift(const FilterParameters *p, const DriftFan *f, vec3 u)
{
    vec3 q[MOST_POINTS + 1];
    memset(q, 0, sizeof q);
    drift_points(f, scale(1 / (1 - p->mass_error), u), q);
    Worst light = worst_chord(f, q);
    drift_points(f, scale(1 / (1 + p->mass_error), u), q);
    Worst heavy = worst_chord(f, q);
    return heavy.margin < light.margin ? heavy : light;
}

/* (20): adds a row for each end of chord j except q_0: with forces that satisfy the row, this end
 * lies beyond a plane, whose distance from the target is the radius of the sphere plus
 * passive_margin and sag. The normal of the plane points from the target to the nearest point of
 * chord j in the drift without force. */
static inline void add_drift_rows(const FilterParameters *p, const DriftFan *f, int j, Rows *rows)
{
    Chord free = chord(f, f->free, j);
    double distance = norm(free.nearest), P = f->P;
    if (distance == 0) return;
    vec3 n = scale(1 / distance, free.nearest);
    for (int end = 0; end < 2; end++, j++) {
        vec3 moved = add(scale(P * P / 2, position_sensitivity(f, j, n)),
                         scale(P, velocity_sensitivity(f, j, n)));
        vec3 row = tmul(f->force_to_a, moved);
        double s = norm(row), missing = f->clear + free.sag - dot(n, f->free[j]);
        double share = missing > 0 ? 1 + p->mass_error : 1 - p->mass_error;
        if (j > 0 && s >= 1e-12) add_row(rows, DRIFT, scale(1 / s, row), missing / s * share);
    }
}

#endif
