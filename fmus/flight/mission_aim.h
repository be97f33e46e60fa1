/* mission_aim.h - aim of the phase CLOSING if aim_radius > 0: first along a line that is tangent to
 * a sphere of radius R_t about the target, then at the second hold point (below: the hold).
 *
 *   R_t: aim_radius,  R_0, d_0: range and direction from the target at the start
 *   phi(R) = acos(R_t/R),   theta = phi(R_0) - phi(R),   theta' = -R_t R'/(R sqrt(R^2 - R_t^2))
 *   V: the frame of the start, X along d_0, turned by theta about n = d_0 x (direction of the hold)
 * theta is the angle that a servicer on the tangent has moved about the target when its range is
 * R. The tangent passes the target on the side of the hold. At the range R_2 + NEAR_HOLD, V
 * begins to turn until X points to the hold. The angle of this turn is a fifth-order polynomial
 * of time, with the peak rate 2 v_2/R_2; R_2, v_2: parameters. docs/models.md J.12 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef MISSION_AIM_H
#define MISSION_AIM_H

#include "mission_profile.h"

#define NEAR_HOLD      1.0  /* m: at a range below R_2 + NEAR_HOLD the closing aims at the hold */
#define SAME_DIRECTION 1e-3 /* rad: n = Z_H if X of V is this near +-(line to the hold) */

enum { AT_HOLD, ON_TANGENT, TURNING };

typedef struct {
    double mode;
    double phi;      /* in mode ON_TANGENT: phi(R_0) */
    double t, angle; /* in mode TURNING: start time and whole angle of the turn */
    mat3 C_VH;       /* frame V at the start of the mode */
    vec3 axis_H;     /* axis about which V turns, n */
} Aim;

typedef struct {
    mat3 C_VH;
    vec3 omega_H; /* angular velocity of V relative to H */
} AimFrame;

static inline vec3 hold_direction(const MissionParameters *p)
{
    SineCosine psi = sine_and_cosine(p->line_angle);
    return vec(psi.c, psi.s, 0);
}

/* phi(R): angle at the target's centre between the directions to a servicer on the tangent at range
 * R > aim_radius and to the point where the tangent touches the sphere */
static inline double tangent_angle(const MissionParameters *p, double R)
{
    return arc_tangent(sqrt(R * R - p->aim_radius * p->aim_radius), p->aim_radius);
}

/* rotation matrix to axes with X along x and Z along `normal`, unit vectors at a right angle */
static inline mat3 frame_about(vec3 x, vec3 normal) { return rows(x, cross(normal, x), normal); }

/* unit normal of the plane through a direction d, the target and the hold */
static inline vec3 normal_to_hold(const MissionParameters *p, vec3 d)
{
    vec3 n = cross(d, hold_direction(p));
    if (norm(n) < SAME_DIRECTION) n = vec(0, 0, 1); /* turn in the orbital plane */
    return unit(n);
}

static inline AimFrame turned_frame(const Aim *aim, double angle, double rate)
{
    SineCosine a = sine_and_cosine(angle);
    mat3 turn = rows(vec(a.c, a.s, 0), vec(-a.s, a.c, 0), vec(0, 0, 1));
    return (AimFrame){matmul(turn, aim->C_VH), scale(rate, aim->axis_H)};
}

/* aim at the start of the closing: ON_TANGENT, or AT_HOLD near the hold or if aim_radius = 0 */
static inline Aim aim_from(const MissionParameters *p, vec3 rho_H, double R)
{
    if (p->aim_radius == 0 || R <= p->R_2 + NEAR_HOLD) return (Aim){AT_HOLD};
    vec3 d = scale(1 / R, rho_H), n = normal_to_hold(p, d);
    return (Aim){ON_TANGENT, tangent_angle(p, R), 0, 0, frame_about(d, n), n};
}

static inline AimFrame frame_on_tangent(const MissionParameters *p, const Aim *aim, vec3 rho_H,
                                        vec3 drho_H)
{
    double R = norm(rho_H), way = sqrt(R * R - p->aim_radius * p->aim_radius);
    double rate = -p->aim_radius * dot(rho_H, drho_H) / (R * R * way);
    return turned_frame(aim, aim->phi - tangent_angle(p, R), rate);
}

static inline Aim turn_to_hold(const MissionParameters *p, const AimFrame *now, double t)
{
    vec3 d = now->C_VH.row[0], n = normal_to_hold(p, d);
    return (Aim){TURNING, 0, t, angle(d, hold_direction(p)), frame_about(d, n), n};
}

static inline AimFrame frame_turning(const MissionParameters *p, const Aim *aim, double t)
{
    double T = 1.875 * aim->angle * p->R_2 / (2 * p->v_2), tau = t - aim->t;
    Distance a = tau < T ? fifth_order_step(0, aim->angle, T, tau) : constant_distance(aim->angle);
    return turned_frame(aim, a.L, a.d);
}

#endif
