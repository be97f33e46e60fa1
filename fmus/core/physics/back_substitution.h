/* back_substitution.h - equations of motion of a hub with moving parts, (6), (7), (10), (12) of
 * docs/models.md L: the coordinates of the parts are eliminated, which leaves six equations of the
 * hub.
 *
 *     q_k'' = g_k - P_k.A - L_k.alpha,     P_k = p_k/M_k,  L_k = l_k/M_k
 *
 * A, alpha: acceleration of the hub at S and its angular acceleration; g_k: q_k'' without them;
 * p_k, l_k, M_k: momenta and generalised mass of part k, as in moving_parts.h. P_k and L_k of a
 * slosh mass do not depend on its mass M_k: no equation divides by a mass that may vanish.
 * All vectors are in S axes. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef BACK_SUBSTITUTION_H
#define BACK_SUBSTITUTION_H

#include "mat3.h"
#include "moving_parts.h"

/* inertia I of the vehicle about S, (4) of docs/models.md L. Each part as a point mass at r adds
 * mass (r.r 1 - r r^T); the sum over the parts is tr(Q) 1 - Q with Q = sum mass r r^T. */
static inline sym3 inertia_about_S(const Vehicle *v, const Placement *at)
{
    sym3 I = v->I_fixed, Q = sym_diagonal(0, 0, 0);
    for (int i = 0; i < at->count; i++) {
        const PlacedPart *x = &at->part[i];
        Q = sym_add(Q, dyad(x->mass, x->r));
        if (x->k < PANELS) I = sym_add(I, dyad(x->part->asymmetry * x->part->I_h, x->e));
    }
    double trace = Q.xx + Q.yy + Q.zz;
    return sym_add(I, sym_sub(sym_diagonal(trace, trace, trace), Q));
}

/* ---- (7): [U V; V^T W] [A; alpha] = [force; moment]: inertia of the hub after elimination of the
 * coordinates of its parts ---- */
typedef struct {
    sym3 I, U, W;
    mat3 V;
} EffectiveInertia;
typedef struct { vec3 A, alpha; } Acceleration;

static inline void set_effective_inertia(EffectiveInertia *effective, const Vehicle *v,
                                         const Placement *at)
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
        const PlacedPart *x = &at->part[i];
        U = sym_sub(U, dyad(x->md * x->part->P_size, x->t));
        V = minus(V, outer(scale(x->md, x->t), x->L));
        W = sym_sub(W, dyad(x->M, x->L));
    }
    effective->I = I, effective->U = U, effective->V = V, effective->W = W;
}

/* V^T X for X = K V with a symmetric K, so that the product is symmetric */
static inline sym3 congruence(mat3 V, mat3 X)
{
    return sym_add(upper(V.row[0], X.row[0]),
                   sym_add(upper(V.row[1], X.row[1]), upper(V.row[2], X.row[2])));
}

/* acceleration A of the hub at S and alpha under a load: A = U^-1 (force - V alpha),
 * (W - V^T U^-1 V) alpha = moment - V^T U^-1 force; held = 1: frozen attitude, alpha = 0 */
static inline Acceleration acceleration(const EffectiveInertia *x, vec3 force, vec3 moment,
                                        int held)
{
    sym3 inverse = sym_inverted(x->U);
    vec3 A = sym_mul(inverse, force);
    if (held) return (Acceleration){A, vec(0, 0, 0)};
    mat3 across = matmul(mat_of(inverse), x->V);
    sym3 rest = sym_sub(x->W, congruence(x->V, across));
    vec3 alpha = sym_mul(sym_inverted(rest), sub(moment, tmul(x->V, A)));
    return (Acceleration){sub(A, mul(across, alpha)), alpha};
}

/* ---- (10) ---- */
/* tidal field of the planet: acceleration g (3 n (n.x) - x) at x from the centre of mass, with
 * g = mu/r^3 and the unit vector n from the planet to the centre of mass; g = 0: no field */
typedef struct {
    double g;
    vec3 n;
} TidalField;

static inline vec3 tidal_acceleration(const TidalField *f, vec3 x)
{
    return scale(f->g, sub(scale(3 * dot(f->n, x), f->n), x));
}

/* gravity-gradient torque M_gg = 3 g n x (I_C n),   I_C = I - m (c.c 1 - c c^T)
 * I, I_C: inertia about S and about the centre of mass c; m: mass of the vehicle */
static inline vec3 tidal_torque(const TidalField *f, const Placement *at, const sym3 *I)
{
    sym3 I_C = sym_sub(*I, point_inertia(at->m, at->c));
    return scale(3 * f->g, cross(f->n, sym_mul(I_C, f->n)));
}

/* Q_k/M_k: acceleration of the coordinate of one part by the tidal field. `pull` is the effect of
 * the field on the centre of mass of the part. A panel adds the gravity-gradient torque about its
 * hinge, 3 g a.(n x I_i n) = 3 g (I3 - I1) (n.e)(n.t), divided by M_k = I_h. I_i: inertia of the
 * panel, with the moments I1, I2, I3 along e (along the panel), a (hinge) and t = a x e;
 * asymmetry = (I1 - I3)/I_h. */
static inline double tidal_part_acceleration(const TidalField *f, const PlacedPart *x, vec3 c)
{
    double pull = x->part->P_size * dot(x->t, tidal_acceleration(f, sub(x->r, c)));
    if (x->k >= PANELS) return pull;
    return pull - 3 * f->g * x->part->asymmetry * dot(f->n, x->e) * dot(f->n, x->t);
}

/* ---- (6): loads and accelerations caused by velocities, springs, dampers and the tidal field, for
 * a hub that does not accelerate ---- */
typedef struct {
    /* force N_F + sum g_k p_k and moment N_M + sum g_k l_k on the hub; N_F, N_M: terms of the
     * rates q_k' */
    vec3 F, M;
    double g[PARTS]; /* accelerations q_k'' of the parts if A = alpha = 0 */
} BiasTerms;

/* A part at r adds the force md (g t + 2 q' w x t - q'^2 e) to F and its moment about S to M; the
 * term with e is 0 for a slosh mass. A panel also adds the couple q' (I_i (w x a) + a x (I_i w) +
 * I2 w x a) + g I2 a to M. md: factor in p = md t, for a panel mu d: its mass mu times the distance
 * d of its centre of mass from the hinge at r_H; g: g_k of the part. For a panel the code uses the
 * right sides of these identities, which hold because r = r_H + d e and I_i is diagonal in the axes
 * e, a, t:
 *   (I1 - I3 - mu d^2)(w.e)(w.t) - mu d t.(w x (w x r_H))
 *     = (I1 - I3)(w.e)(w.t) - mu d t.(w x (w x r)),
 *   I_i (w x a) + a x (I_i w) + I2 w x a = (I1 + I2 - I3)(w.t) e - (I2 + I3 - I1)(w.e) t */
static inline void set_bias_terms(BiasTerms *sum, const Placement *at, vec3 w, const TidalField *f)
{
    vec3 F = vec(0, 0, 0), M = F;
    for (int i = 0; i < at->count; i++) {
        const PlacedPart *x = &at->part[i];
        const Part *b = x->part;
        int panel = x->k < PANELS;
        double u = x->rate, w_t = dot(w, x->t), w_e = panel ? dot(w, x->e) : 0;
        double g = b->P_size * (dot(w, w) * dot(x->t, x->r) - w_t * dot(w, x->r)) +
                   b->asymmetry * w_e * w_t - b->stiffness * x->q - b->damping * u;
        if (f->g != 0) g += tidal_part_acceleration(f, x, at->c);
        vec3 force = add(scale(g, x->t), scale(2 * u, cross(w, x->t)));
        if (panel) {
            force = sub(force, scale(u * u, x->e));
            M = add(M, sum3(scale(u * b->gyroscopic_t * w_t, x->e),
                            scale(u * b->gyroscopic_e * w_e, x->t), scale(g, b->I_axis)));
        }
        force = scale(x->md, force);
        F = add(F, force);
        M = add(M, cross(x->r, force));
        sum->g[i] = g;
    }
    sum->F = F;
    sum->M = M;
}

/* (12): omega_top, an upper bound of the natural frequencies, from the acceleration of each
 * coordinate under a unit force on it in the free undeformed vehicle:
 *   M_k (X^-1)_kk = 1 + p_k.A + l_k.alpha
 * A, alpha: acceleration of the hub under the force P_k and moment L_k; X: mass matrix of hub and
 * coordinates */
static inline double highest_mode(const Vehicle *v)
{
    const double rest[PARTS] = {0};
    Placement at;
    place_parts(&at, v, 0, rest, rest);
    EffectiveInertia effective;
    set_effective_inertia(&effective, v, &at);
    double sum = 0;
    for (int i = 0; i < at.count; i++) {
        const PlacedPart *x = &at.part[i];
        vec3 P = scale(x->part->P_size, x->t);
        Acceleration a = acceleration(&effective, P, x->L, 0);
        sum += x->part->stiffness * (1 + x->md * dot(x->t, a.A) + x->M * dot(x->L, a.alpha));
    }
    return sqrt(sum);
}

#endif
