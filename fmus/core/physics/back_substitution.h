/* back_substitution.h - motion of a hub and of the parts that move in it, (6), (7), (10), (12) of
 * docs/models.md L: the parts are eliminated, six equations of the hub are left.
 *
 *     q_k'' = g_k - P_k.A - L_k.alpha,     P_k = p_k/M_k,  L_k = l_k/M_k
 *
 * so that no equation divides by a mass that may vanish. All vectors in S axes. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef BACK_SUBSTITUTION_H
#define BACK_SUBSTITUTION_H

#include "mat3.h"
#include "moving_parts.h"

/* I of (4): sum mass (r.r 1 - r r^T) = tr(Q) 1 - Q of Q = sum mass r r^T */
static inline sym3 inertia_about_S(const Vehicle *v, const Placement *at)
{
    sym3 I = v->steady, Q = sym_diagonal(0, 0, 0);
    for (int i = 0; i < at->count; i++) {
        const Placed *x = &at->part[i];
        Q = sym_add(Q, dyad(x->mass, x->r));
        if (x->k < PANELS) I = sym_add(I, dyad(x->of->lean * x->of->I_h, x->e));
    }
    double trace = Q.xx + Q.yy + Q.zz;
    return sym_add(I, sym_sub(sym_diagonal(trace, trace, trace), Q));
}

/* ---- (7): [U V; V^T W] [A; alpha] = [force; moment] ---- */
typedef struct {
    sym3 I, U, W;
    mat3 V;
} Inertia;
typedef struct { vec3 A, alpha; } Acceleration;

static inline void feel_inertia(Inertia *felt, const Vehicle *v, const Placement *at)
{
    sym3 I = inertia_about_S(v, at), U = sym_diagonal(at->m, at->m, at->m), W = I;
    mat3 V = tilde(neg(at->s));
    U = sym_sub(U, v->sloshes.pp), V = minus(V, v->sloshes.pl), W = sym_sub(W, v->sloshes.ll);
    if (v->draw > 0) {
        U = sym_add(U, sym_scaled(at->used, v->drawn.pp));
        V = plus(V, scaled(at->used, v->drawn.pl));
        W = sym_add(W, sym_scaled(at->used, v->drawn.ll));
    }
    for (int i = 0; i < at->count && at->part[i].k < PANELS; i++) {
        const Placed *x = &at->part[i];
        U = sym_sub(U, dyad(x->md * x->of->push, x->t));
        V = minus(V, outer(scale(x->md, x->t), x->L));
        W = sym_sub(W, dyad(x->M, x->L));
    }
    felt->I = I, felt->U = U, felt->V = V, felt->W = W;
}

/* V^T X of X = K V, K symmetric: symmetric too */
static inline sym3 congruent(mat3 V, mat3 X)
{
    return sym_add(upper(V.row[0], X.row[0]),
                   sym_add(upper(V.row[1], X.row[1]), upper(V.row[2], X.row[2])));
}

/* A = U^-1 (force - V alpha), (W - V^T U^-1 V) alpha = moment - V^T U^-1 force; a hub that is held
 * has alpha = 0 */
static inline Acceleration acceleration(const Inertia *x, vec3 force, vec3 moment, int held)
{
    sym3 inverse = sym_inverted(x->U);
    vec3 A = sym_mul(inverse, force);
    if (held) return (Acceleration){A, vec(0, 0, 0)};
    mat3 across = matmul(mat_of(inverse), x->V);
    sym3 rest = sym_sub(x->W, congruent(x->V, across));
    vec3 alpha = sym_mul(sym_inverted(rest), sub(moment, tmul(x->V, A)));
    return (Acceleration){sub(A, mul(across, alpha)), alpha};
}

/* ---- (10) ---- */
/* tidal field: g (3 n (n.x) - x) at x from the centre of mass, g = 0: none */
typedef struct {
    double g;
    vec3 n;
} Tide;

static inline vec3 tidal(const Tide *f, vec3 x)
{
    return scale(f->g, sub(scale(3 * dot(f->n, x), f->n), x));
}

/* M_gg = 3 g n x (I_C n),   I_C = I - m (c.c 1 - c c^T) */
static inline vec3 tidal_torque(const Tide *f, const Placement *at, const sym3 *I)
{
    sym3 I_C = sym_sub(*I, point_inertia(at->m, at->c));
    return scale(3 * f->g, cross(f->n, sym_mul(I_C, f->n)));
}

/* Q_k/M_k; a.(n x I_i n) = (I3 - I1) (n.e)(n.t) */
static inline double tidal_drift(const Tide *f, const Placed *x, vec3 c)
{
    double pull = x->of->push * dot(x->t, tidal(f, sub(x->r, c)));
    if (x->k >= PANELS) return pull;
    return pull - 3 * f->g * x->of->lean * dot(f->n, x->e) * dot(f->n, x->t);
}

/* ---- what velocities, springs and tides alone do (6) ---- */
typedef struct {
    vec3 F, M;       /* N_F + sum g_k p_k, N_M + sum g_k l_k */
    double g[PARTS]; /* accelerations of the parts in a hub with A = alpha = 0 */
} Drift;

/* Force b + g p = md (g t + 2 q' w x t - q'^2 e) of a part on the whole, its moment. Of a panel, as
 * r = r_H + d e, (I1 - I3 - mu d^2)(w.e)(w.t) - mu d t.(w x (w x r_H)) is (I1 - I3)(w.e)(w.t) - mu d
 * t.(w x (w x r)); and as I_i is diagonal in the axes e, a, t,
 * I_i (w x a) + a x (I_i w) + I2 w x a = (I1 + I2 - I3)(w.t) e - (I2 + I3 - I1)(w.e) t */
static inline void drift(Drift *sum, const Placement *at, vec3 w, const Tide *f)
{
    vec3 F = vec(0, 0, 0), M = F;
    for (int i = 0; i < at->count; i++) {
        const Placed *x = &at->part[i];
        const Part *b = x->of;
        int panel = x->k < PANELS;
        double u = x->rate, w_t = dot(w, x->t), w_e = panel ? dot(w, x->e) : 0;
        double g = b->push * (dot(w, w) * dot(x->t, x->r) - w_t * dot(w, x->r)) +
                   b->lean * w_e * w_t - b->stiffness * x->q - b->damping * u;
        if (f->g != 0) g += tidal_drift(f, x, at->c);
        vec3 push = add(scale(g, x->t), scale(2 * u, cross(w, x->t)));
        if (panel) {
            push = sub(push, scale(u * u, x->e));
            M = add(M, sum3(scale(u * b->turn_t * w_t, x->e), scale(u * b->turn_e * w_e, x->t),
                            scale(g, b->spin)));
        }
        push = scale(x->md, push);
        F = add(F, push);
        M = add(M, cross(x->r, push));
        sum->g[i] = g;
    }
    sum->F = F;
    sum->M = M;
}

/* ---- (12) ----
 * omega_top, from the compliance of each coordinate in the free undeformed vehicle:
 * M_k (X^-1)_kk = 1 + p_k.A + l_k.alpha under the load P_k, L_k on the hub */
static inline double highest_mode(const Vehicle *v)
{
    const double rest[PARTS] = {0};
    Placement at;
    place_parts(&at, v, 0, rest, rest);
    Inertia felt;
    feel_inertia(&felt, v, &at);
    double sum = 0;
    for (int i = 0; i < at.count; i++) {
        const Placed *x = &at.part[i];
        vec3 P = scale(x->of->push, x->t);
        Acceleration a = acceleration(&felt, P, x->L, 0);
        sum += x->of->stiffness * (1 + x->md * dot(x->t, a.A) + x->M * dot(x->L, a.alpha));
    }
    return sqrt(sum);
}

#endif
