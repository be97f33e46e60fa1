/* resolved_rate.h - joint rates for a required motion of the end effector: generalized Jacobian of
 * a floating base, damping near singular poses, posture, limits of angle and rate.
 *
 *   J = J_m - J_0 H_00^-1 H_0m     (base_floats 0: J_m)          Umetani & Yoshida 1989
 *   dq = z + J^T (J J^T + lambda^2 1)^-1 (y - J z),   z = K_posture (ready - q)
 *   lambda = damping_max (1 - m/manipulability_min) where m < manipulability_min, else 0
 *   m = sqrt(det J J^T), 0 with fewer than six columns
 *
 * J_m, J_0: Jacobians of joints and base; H_00, H_0m: blocks of the inertia matrix for base and
 * joints. y: required twist of the end effector minus the twist that it would have with the joints
 * at rest and the same momentum; m: manipulability; `ready`: joint angles of the posture. The rate
 * of a joint must satisfy K_limit (min - q) <= dq <= K_limit (max - q), min and max: limits of its
 * angle. All joints that violate this in one pass are fixed at their bounds, and the next pass
 * solves for the other joints. Then all rates are scaled by one factor so that none exceeds its
 * limit. Equations: docs/models.md K.3. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef RESOLVED_RATE_H
#define RESOLVED_RATE_H

#include "arm.h"
#include "cholesky.h"

typedef struct {
    double ready[ARM_JOINTS], angle_min[ARM_JOINTS], angle_max[ARM_JOINTS], rate_max[ARM_JOINTS];
    double K_posture, K_limit, damping_max, manipulability_min, base_floats;
} RateLaw;

typedef struct {
    double dq[ARM_JOINTS], limited[ARM_JOINTS];
    double manipulability, damping, rate_scale;
} JointRates;

/* columns of the Jacobian: velocity and angular rate of E for a unit rate of each joint, base
 * axes */
typedef struct {
    int joints;
    vec3s v, w;
} Jacobian;

static inline Twist motion_at(const Jacobian *J, int i)
{
    return (Twist){vec_at(&J->v, i), vec_at(&J->w, i)};
}

static inline Twist tip_motion(Twist t, vec3 p_E) { return (Twist){velocity_at(t, p_E), t.w}; }
static inline double dot_twist(Twist a, Twist b) { return dot(a.v, b.v) + dot(a.w, b.w); }

/* motion of the base for a unit rate of each joint at constant momentum: -H_00^-1 H_0m */
typedef struct { vec3s v, w; } Reaction;

static inline void set_reaction(Reaction *restrict base, const Tree *restrict t)
{
    const Mobility mobility = mobility_of(&t->whole, 1);
    for (int i = 0; i < COLUMNS; i++) {
        Twist answer = base_response(&mobility, column_at(t, i));
        put_vec(&base->v, i, neg(answer.v));
        put_vec(&base->w, i, neg(answer.w));
    }
}

static inline void set_jacobian(Jacobian *restrict J, const Tree *restrict t,
                                const Reaction *restrict base)
{
    const vec3 p_E = t->p_E;
    for (int i = 0; i < COLUMNS; i++) {
        vec3 v = add(vec_at(&t->oa, i), vec_at(&base->v, i));
        vec3 w = add(vec_at(&t->a, i), vec_at(&base->w, i));
        put_vec(&J->v, i, add(v, cross(w, p_E)));
        put_vec(&J->w, i, w);
    }
}

/* ---- one pass: the joints that are not fixed ---- */
/* J J^T (6 x 6) of these joints, of which only the upper triangle is set; last column: the
 * right-hand side, twist y */
typedef struct { double at[6][UPPER]; } Gram;

static inline Gram gram_of(const Jacobian *J, const JointRates *r, Twist y)
{
    sym3 vv = sym_diagonal(0, 0, 0), ww = vv;
    mat3 vw = identity(0);
    int joints = J->joints;
    for (int k = 0; k < joints; k++) {
        vec3 v = vec_at(&J->v, k), w = vec_at(&J->w, k);
        if (r->limited[k]) continue;
        vv = sym_add(vv, upper(v, v));
        vw = plus(vw, outer(v, w));
        ww = sym_add(ww, upper(w, w));
    }
    vec3 a = vw.row[0], b = vw.row[1], c = vw.row[2];
    return (Gram){{{vv.xx, vv.xy, vv.xz, a.x, a.y, a.z, y.v.x},
                   {0, vv.yy, vv.yz, b.x, b.y, b.z, y.v.y},
                   {0, 0, vv.zz, c.x, c.y, c.z, y.v.z},
                   {0, 0, 0, ww.xx, ww.xy, ww.xz, y.w.x},
                   {0, 0, 0, 0, ww.yy, ww.yz, y.w.y},
                   {0, 0, 0, 0, 0, ww.zz, y.w.z}}};
}

/* manipulability sqrt(det J J^T), from the pivots of the elimination of J J^T */
static inline double manipulability_of(const Gram *pivots)
{
    double product = 1;
    for (int i = 0; i < 6; i++) product *= pivots->at[i][i];
    return sqrt(product);
}

static inline void solve_pass(const RateLaw *law, const Jacobian *J, const double z[], Twist y,
                              JointRates *r)
{
    int joints = J->joints, columns = 0;
    for (int i = 0; i < joints; i++) {
        columns += !r->limited[i];
        if (!r->limited[i]) r->dq[i] = z[i];
        y = plus_twist(y, -r->dq[i], motion_at(J, i));
    }
    const Gram G = gram_of(J, r, y);
    double x[6];
    Gram factor = G;
    int regular = solve_upper(factor.at, 6, x);
    double m = regular && columns >= 6 ? manipulability_of(&factor) : 0;
    double least = law->manipulability_min;
    double lambda = m < least ? law->damping_max * (1 - m / least) : 0;
    if (lambda > 0) {
        factor = G;
        for (int i = 0; i < 6; i++) factor.at[i][i] += lambda * lambda;
        regular = solve_upper(factor.at, 6, x);
    }
    r->manipulability = m;
    r->damping = lambda;
    if (!regular) return; /* singular and undamped: dq retains only the posture term z */
    Twist load = {vec(x[0], x[1], x[2]), vec(x[3], x[4], x[5])};
    for (int i = 0; i < joints; i++)
        if (!r->limited[i]) r->dq[i] += dot_twist(motion_at(J, i), load);
}

/* fixes each joint whose rate violates its bounds: sets its rate to the nearer bound; returns the
 * number of joints fixed in this call */
/* K.3-5 */
static inline int fix_joints(const RateLaw *law, const double q[], int joints, JointRates *r)
{
    int broken = 0;
    for (int i = 0; i < joints; i++) {
        double bound = clamp(r->dq[i], law->K_limit * (law->angle_min[i] - q[i]),
                             law->K_limit * (law->angle_max[i] - q[i]));
        if (r->limited[i] || bound == r->dq[i]) continue;
        r->dq[i] = bound;
        r->limited[i] = 1;
        broken++;
    }
    return broken;
}

static inline void scale_rates(const RateLaw *law, int joints, JointRates *r)
{
    r->rate_scale = 1;
    for (int i = 0; i < joints; i++)
        if (fabs(r->dq[i]) * r->rate_scale > law->rate_max[i])
            r->rate_scale = law->rate_max[i] / fabs(r->dq[i]);
    for (int i = 0; i < joints; i++) r->dq[i] *= r->rate_scale;
}

/* xd: required velocity of E relative to the velocity of S, and required angular velocity of E
 * relative to N, base axes; w: angular velocity of the base; q, dq: present joint angles and
 * rates */
/* K.3-4 */
static inline JointRates joint_rates(const RateLaw *law, const Tree *t, vec3 w, const double q[],
                                     const double dq[], Twist xd)
{
    int joints = (int)t->joints;
    Jacobian J;
    Twist base = {vec(0, 0, 0), w}; /* becomes its twist with joints at rest, same momentum */
    Reaction reaction = {.v = {{0}, {0}, {0}}};
    double z[ARM_JOINTS];
    if (law->base_floats && joints > 0) set_reaction(&reaction, t);
    for (int i = 0; i < joints; i++) {
        Twist r = {vec_at(&reaction.v, i), vec_at(&reaction.w, i)};
        z[i] = law->K_posture * (law->ready[i] - q[i]);
        base = plus_twist(base, -dq[i], r);
    }
    J.joints = joints;
    set_jacobian(&J, t, &reaction);
    Twist y = plus_twist(xd, -1, tip_motion(base, t->p_E));

    JointRates solution = {.rate_scale = 1};
    solve_pass(law, &J, z, y, &solution);
    double m = solution.manipulability, lambda = solution.damping;
    for (int pass = 0; pass < ARM_JOINTS && fix_joints(law, q, joints, &solution); pass++)
        solve_pass(law, &J, z, y, &solution);
    solution.manipulability = m;
    solution.damping = lambda;
    scale_rates(law, joints, &solution);
    return solution;
}

#endif
