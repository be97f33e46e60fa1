/* filter_geometry.h - relative motion at a sample of the safety filter, and the acceleration,
 * constant over a sample period, that is needed to stop before the edge of a rule.
 *
 *   rho = r_S - r_T,   v = v_S - v_T,   g = gravity(r_S) - gravity(r_T)                        (1)
 *   W = C_TN^T omega_TN_T,   v_T = v - W x rho,   a_T = g - 2 W x v_T - W x (W x rho)          (2)
 *   the same as seen in the Hill frame of rate w_H = r_T x v_TN_N / |r_T|^2: v_H, a_H          (3)
 *   a_F = |F_max| / (m (1 - mass_error)),   e_p' = e_p + a_F T_r^2/2,   e_v' = e_v + a_F T_r   (4)
 * W: angular velocity of the target; v_T, a_T: velocity and free acceleration as seen from the
 * target; m: mass; T_r, e_p, e_v: parameters reaction, position_error, velocity_error; e_p', e_v':
 * these errors enlarged by the motion in the time T_r; a_F: largest acceleration by the force.
 * Vectors are in N axes. docs/models.md M.1 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef FILTER_GEOMETRY_H
#define FILTER_GEOMETRY_H

#include "filter_ports.h"
#include "tracking.h"

typedef struct {
    /* P: sample period; R: range; a_F, e_p', e_v' of (4); turn: largest change of F/m in a sample
     * period by the rotation of S [m/s2] */
    double P, R, a_F, e_p, e_v, turn;
    vec3 rho, v, out, g; /* out: unit vector from the target to the servicer */
    vec3 W, v_T, a_T, w_H, v_H, a_H;
    mat3 C_SN, C_TN;
    int sphere, corridor, speed, drift; /* 1: the rule is in force */
} Geometry;

/* relative acceleration without force, as seen in a frame that rotates at the constant rate w */
static inline vec3 seen_in_frame(vec3 g, vec3 w, vec3 rho, vec3 v)
{
    return sub(g, add(scale(2, cross(w, v)), cross(w, cross(w, rho))));
}

static inline vec3 point_mass_gravity(double mu, vec3 r)
{
    double rr = dot(r, r);
    return mu == 0 ? vec(0, 0, 0) : scale(-mu / (rr * sqrt(rr)), r);
}

static inline void find_rules(const FilterParameters *p, const FilterInput *u, Geometry *g)
{
    g->sphere = p->keep_out_radius > 0 && !(p->keep_out_opens && u->approaching);
    g->corridor = p->use_corridor && u->approaching;
    g->speed = p->use_speed_limit && u->approaching;
    g->drift = p->passive_time > 0 && g->sphere;
}

static inline void find_frames(const FilterParameters *p, const FilterInput *u, Geometry *g)
{
    vec3 r = u->T.r;
    g->C_SN = dcm_of_quat(attitude_in(u->S.q));
    g->C_TN = dcm_of_quat(attitude_in(u->T.q));
    g->out = g->R > 0 ? scale(1 / g->R, g->rho) : g->C_SN.row[0];
    g->W = tmul(g->C_TN, u->T.omega);
    g->v_T = sub(g->v, cross(g->W, g->rho));
    g->a_T = seen_in_frame(g->g, g->W, g->rho, g->v_T);
    g->w_H = p->mu == 0 ? vec(0, 0, 0) : scale(1 / dot(r, r), cross(r, u->T.v));
    g->v_H = sub(g->v, cross(g->w_H, g->rho));
    g->a_H = seen_in_frame(g->g, g->w_H, g->rho, g->v_H);
}

static inline Geometry geometry(const FilterParameters *p, const FilterInput *u, double P)
{
    double T_r = p->reaction, a_F = norm(p->F_max) / (p->mass * (1 - p->mass_error));
    Geometry g = {.P = P, .a_F = a_F, .rho = sub(u->S.r, u->T.r), .v = sub(u->S.v, u->T.v)};
    g.R = norm(g.rho);
    g.g = sub(point_mass_gravity(p->mu, u->S.r), point_mass_gravity(p->mu, u->T.r));
    g.e_p = p->position_error + a_F * T_r * T_r / 2;
    g.e_v = p->velocity_error + a_F * T_r;
    g.turn = P * norm(u->S.omega) * a_F;
    find_frames(p, u, &g);
    find_rules(p, u, &g);
    return g;
}

/* ---- one gap: distance d from the edge of a rule and its rate of change w, under an acceleration
 * that is held for a period P; a_b: deceleration for braking; e_p, e_v: errors of d and w ---- */
typedef struct { double d, w, a_b, e_p, e_v; } Gap;

/* (6): gap that remains to the edge of the rule when the servicer has braked to rest */
static inline double barrier_of(const Gap *x)
{
    return x->w < 0 ? x->d - x->w * x->w / (2 * x->a_b) : x->d;
}

/* (7): least acceleration away from the edge with which the gap is >= 0 during the period and the
 * barrier of (6) is >= 0 at its end. If d <= 0: acceleration that brings w to recover_speed in the
 * period, but at most a_b more than the acceleration that stops a decrease of d in the period. */
static inline double least_acceleration(const Gap *x, double P, double recover_speed)
{
    double r = 2 * x->d + P * x->w, half = x->a_b * P / 2;
    if (x->d <= 0) return smaller((recover_speed - x->w) / P, x->a_b + larger(-x->w, 0) / P);
    if (r < 0) return x->w * x->w / (2 * x->d);
    return (half - sqrt(half * half + x->a_b * r) - x->w) / P;
}

/* (8): acceleration of (7), but at most a_b if the barrier is so little negative that errors of the
 * state may be the cause */
static inline double needed_acceleration(const Gap *x, double P, double recover_speed)
{
    double alpha = least_acceleration(x, P, recover_speed);
    double E = 2 * (x->e_p + x->e_v * (larger(-x->w, 0) + x->e_v) / x->a_b);
    return barrier_of(x) >= -E ? smaller(alpha, x->a_b) : alpha;
}

#endif
