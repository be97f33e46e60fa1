/* safety_escape.h - abort that leaves the target, and rule `escape`, which holds if the drift after
 * an abort ordered now stays outside escape_radius for all bounded errors of navigation and burn.
 *
 *   u   = rho/|rho|, or the axis of the corridor
 *   dv  = abort_speed u - drho
 *   T_b = m |dv|/F,  r = rho + drho T_b/2,  v = drho + dv
 *   c_j = Phi_rr(tau_j) r + Phi_rv(tau_j) v             81 instants of escape_time
 *   n_j = c_j/|c_j|,  a_j = Phi_rr^T n_j,  b_j = Phi_rv^T n_j
 *   h_j = e_r |a_j|_1 + e_v |b_j|_1 + k_p |b_j . dv| + k_n |dv| |b_j| + e_model tau_j^2/2
 *   s_j = D^2/8 (2 n w_j + 3 n^2 r_max),  D = tau_j+1 - tau_j,
 *           w_j = max(2 (|v| + e_v), 1.25 |c_j+1 - c_j|/D)
 *   margin = min_j (dist(chord c_j c_j+1, 0) - k max(h_j, h_j+1) - s_j) - R_k
 *
 * or the margin of the burn where this is less: min(rho . e, r . e, (r + v T_b/2) . e) - e_r |e|_1
 * - R_k, e = rho/|rho|; the path of the burn lies in the triangle of rho, r and r + v T_b/2, the
 * state at the end of the burn. R_k: escape_radius, chosen by `approaching`. h_j is the largest
 * displacement towards the target by errors within e_r, e_v, k_p, k_n, e_model; s_j the largest
 * distance of a path from its chord; k = sqrt(2/(1 + n_j . n_j+1)) covers the directions between
 * n_j and n_j+1. u is the axis if the servicer is inside the corridor and within axis_radius. This
 * dv is for abort_relative = 1; with 0, or with abort_dv_H, dv does not depend on drho. m: mass; F:
 * abort_force; e_r, e_v: bounds of the errors of r and v; k_p, k_n, e_model, r_max: parameters,
 * bounds of errors and range. Phi: transition matrices by the equations of Clohessy and Wiltshire,
 * n = sqrt(mu/a^3). No proof for errors of v during the burn and for the orbital motion during it,
 * and on an orbit with e > 0.01. docs/models.md G.10, G.11 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SAFETY_ESCAPE_H
#define SAFETY_ESCAPE_H

#include "hill_drift.h"
#include "safety_evaluation.h"

/* ---- increment ---- */
typedef struct {
    double is_known, t;
    RelativeState state;
    vec3 axis_H; /* outward axis of the corridor if the servicer is inside, else 0 */
} Known;         /* the last valid state whose range is not 0 */

/* outward axis of the corridor in H axes if the servicer is inside the corridor and within 2
 * axis_radius, else 0. The factor is 2, although an abort uses the axis only within axis_radius,
 * because the last valid state may drift to within axis_radius before the abort. */
static inline vec3 axis_in_hill(const SafetyParameters *p, const SafetyInput *u,
                                const RelativeState *x)
{
    if (!p->use_corridor || norm(x->rho_H) > 2 * p->axis_radius) return vec(0, 0, 0);
    mat3 C_TN = dcm_of_quat(attitude_in(u->T.q));
    vec3 rho_T = mul(C_TN, sub(u->S.r, u->T.r));
    int turns = p->corridor_axes == TARGET_AXES;
    const Corridor cone = corridor_of(p);
    if (corridor_value(&cone, turns ? rho_T : x->rho_H, rho_T) < 0) return vec(0, 0, 0);
    return turns ? mul(x->C_HN, tmul(C_TN, p->corridor_axis)) : p->corridor_axis;
}

static inline Known known_state(const SafetyParameters *p, const SafetyInput *u, Known before,
                                double t)
{
    Known now = {1, t, relative_state(p->mu, (PosVel){u->T.r, u->T.v}, (PosVel){u->S.r, u->S.v}),
                 vec(0, 0, 0)};
    now.axis_H = axis_in_hill(p, u, &now.state);
    return norm(now.state.rho_H) > 0 ? now : before;
}

/* velocity increment of an abort from the state x, H axes; axis_H: as in Known */
static inline vec3 relative_increment(const SafetyParameters *p, const RelativeState *x,
                                      vec3 axis_H)
{
    return sub(outward_velocity(p->abort_speed, x->rho_H, axis_H, p->axis_radius), x->drho_H);
}

/* ---- rule escape ---- */
#define PARTS       2      /* parts of escape_time: its first sixth in 30 steps, the rest in 50 */
#define LEAST_RANGE 1e-150 /* m: added to a range before a division by it */
#define CURVED      1.25   /* largest ratio of the speed on an arc to that along its chord */

static const int steps_of[PARTS] = {30, 50};

typedef struct { double margin, t, dv; } EscapeBound;

typedef struct {
    double n, spread; /* spread: k_n |dv| */
    double speed;     /* 2 (|v| + e_v) */
    double bend;      /* 3 n^2 r_max */
    double model;     /* e_model/2 */
    vec3 rho, r, v, dv;
    vec3 end; /* position at the end of the burn */
} EscapePath; /* rho: position when the abort is ordered; r, v: state from which the drift starts */

typedef struct {
    vec3 c;
    double range, square, h;
} PathPoint;

/* mean motion sqrt(mu/a^3) of the target, from its energy; `rate`, the rate of H, if the orbit is
 * no ellipse */
static inline double mean_motion(double mu, const Body *T, double rate)
{
    double R = norm(T->r), inverse = mu > 0 ? 2 / R - dot(T->v, T->v) / mu : 0;
    return inverse > 0 ? sqrt(mu * inverse) * inverse : rate;
}

static inline EscapePath escape_path(const SafetyParameters *p, const RelativeState *x, vec3 dv,
                                     double n)
{
    double size = norm(dv), F = p->abort_force, T_b = F > 0 ? p->mass * size / F : 0;
    if (F == 0) dv = vec(0, 0, 0), size = 0; /* free drift */
    vec3 r = add(x->rho_H, scale(T_b / 2, x->drho_H)), v = add(x->drho_H, dv);
    return (EscapePath){n,
                        p->k_n * size,
                        2 * (norm(v) + p->e_v),
                        3 * n * n * p->r_max,
                        p->e_model / 2,
                        x->rho_H,
                        r,
                        v,
                        dv,
                        add(r, scale(T_b / 2, v))};
}

static inline double sum_of_sizes(vec3 a) { return fabs(a.x) + fabs(a.y) + fabs(a.z); }

/* G.11 (4) to (6): point c of the path at time tau, and h: largest displacement towards the target
 * by errors within e_r, e_v, k_p, k_n, e_model; nt: sine and cosine of n tau */
static inline PathPoint path_point(const SafetyParameters *p, const EscapePath *e, double tau,
                                   SineCosine nt)
{
    Transition f = transition(e->n, tau, nt);
    vec3 c = drift_position(&f, e->r, e->v), a = position_part(&f, c), b = velocity_part(&f, c);
    double square = dot(c, c), range = sqrt(square);
    double h = p->e_r * sum_of_sizes(a) + p->e_v * sum_of_sizes(b) + p->k_p * fabs(dot(b, e->dv)) +
               e->spread * norm(b);
    return (PathPoint){c, range, square, h / (range + LEAST_RANGE) + e->model * tau * tau};
}

/* result of path_point() at tau = 0, where Phi_rr = I and Phi_rv = 0 */
static inline PathPoint first_point(const SafetyParameters *p, const EscapePath *e)
{
    double range = norm(e->r);
    return (PathPoint){e->r, range, dot(e->r, e->r),
                       p->e_r * sum_of_sizes(e->r) / (range + LEAST_RANGE)};
}

/* lower bound of the range during the burn: least component along rho of the corners rho, r and end
 * of the triangle that contains the path of the burn, minus the position error */
static inline double least_of_burn(const SafetyParameters *p, const EscapePath *e)
{
    double square = dot(e->rho, e->rho);
    double least = smaller(square, smaller(dot(e->rho, e->r), dot(e->rho, e->end)));
    return (least - p->e_r * sum_of_sizes(e->rho)) / (sqrt(square) + LEAST_RANGE);
}

/* constants of all steps of length D: sagitta, G.11 (7), of a path that is nowhere faster than
 * e->speed; longest_2: square of the longest chord to which it applies; turn: sine and cosine of
 * n D */
typedef struct {
    double D, sagitta, longest_2;
    SineCosine turn;
} Stride;

static inline Stride stride(const EscapePath *e, double D)
{
    double longest = e->speed * D / CURVED;
    return (Stride){D, D * D / 8 * (2 * e->n * e->speed + e->bend), longest * longest,
                    sine_and_cosine(e->n * D)};
}

/* sagitta, G.11 (7), of a path faster than e->speed, from the speed along its chord */
static inline double fast_sagitta(const EscapePath *e, double D, double length_2)
{
    return D * D / 8 * (2 * e->n * CURVED * sqrt(length_2) / D + e->bend);
}

/* G.11 (8) without R_k: lower bound of the range on the path from point a to point b. Replaces
 * `least` if the bound is less; tau: time at a */
static inline void compare_path(const EscapePath *e, const Stride *s, const PathPoint *a,
                                const PathPoint *b, double tau, EscapeBound *least)
{
    double along = dot(a->c, b->c), toward = a->square - along;
    double length_2 = toward + b->square - along, h = a->h > b->h ? a->h : b->h;
    double arc = length_2 > s->longest_2 ? fast_sagitta(e, s->D, length_2) : s->sagitta;
    double distance = a->range;
    if (toward > 0)
        distance =
            toward < length_2 ? sqrt(fabs(a->square - toward * toward / length_2)) : b->range;
    double ahead = distance - arc - least->margin;
    /* along > 0: k <= sqrt(2) < 1.5, so the bound is not below `least` */
    if (along > 0 && ahead >= 1.5 * h) return;
    double ranges = a->range * b->range, cosine_2 = ranges > 0 ? 1 + along / ranges : 1;
    double between = sqrt(2 / larger(cosine_2, 1e-6));
    if (ahead >= between * h) return;
    double at = toward <= 0 ? 0 : toward < length_2 ? toward / length_2 : 1;
    *least = (EscapeBound){distance - between * h - arc, tau + at * s->D, least->dv};
}

static inline SineCosine turned(SineCosine a, SineCosine by)
{
    return (SineCosine){a.s * by.c + a.c * by.s, a.c * by.c - a.s * by.s};
}

static inline EscapeBound least_range(const SafetyParameters *p, const EscapePath *e)
{
    const double D[PARTS] = {p->escape_time / 180, p->escape_time / 60};
    EscapeBound least = {least_of_burn(p, e), 0, norm(e->dv)};
    PathPoint a = first_point(p, e);
    SineCosine nt = {0, 1};
    double tau = 0;
    for (int part = 0; part < PARTS; part++) {
        Stride s = stride(e, D[part]);
        for (int j = 0; j < steps_of[part]; j++) {
            nt = turned(nt, s.turn);
            PathPoint b = path_point(p, e, tau + s.D, nt);
            compare_path(e, &s, &a, &b, tau, &least);
            a = b;
            tau += s.D;
        }
    }
    return least;
}

/* G.11-2 */
static inline EscapeBound escape_bound(const SafetyParameters *p, const SafetyInput *u,
                                       const Known *x, vec3 dv_H)
{
    EscapePath path =
        escape_path(p, &x->state, dv_H, mean_motion(p->mu, &u->T, norm(x->state.w_H)));
    return least_range(p, &path);
}

#endif
