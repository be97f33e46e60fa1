/* arm_dynamics.h - equations of motion of a base body with an arm: velocity-dependent loads and
 * accelerations.
 *
 *   H du/dt + b = Q       u = [v; w; dq]
 *   b = sum_k Jw_k^T (I_k alpha'_k + w_k x I_k w_k) + m_k Jv_k^T a'_k,   alpha', a' with du/dt = 0
 *
 * u: velocity of S, angular velocity of the base, joint rates; H: mass matrix; Q: generalised
 * forces. Of body k: mass m_k, inertia I_k, angular velocity w_k, accelerations a'_k and alpha'_k,
 * partial velocities Jv_k and Jw_k. b is computed in one pass outward along the arm and one inward,
 * together with the gravity gradient. The base is eliminated before the system of the joints is
 * solved. Equations: docs/models.md K.1. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef ARM_DYNAMICS_H
#define ARM_DYNAMICS_H

#include "arm.h"
#include "cholesky.h"

/* ---- H x = y ---- */
typedef struct {
    int turns, joints;     /* turns: 1 if the base turns; joints: how many move */
    double moves[COLUMNS]; /* 1: the joint moves, 0: it is locked */
} DegreesOfFreedom;

/* values of each joint; all are 0 if the joint is locked. v, w: twist of the links outboard of the
 * joint for a unit rate of the joint, including the reaction of the free base; F, M: momentum of
 * these links for the same rate without this reaction, as a wrench; y: element of
 * y_m - H_m0 H_00^-1 y_0, with the indices 0 of the base and m of the joints that move */
typedef struct {
    vec3s v, w, F, M;
    double y[COLUMNS];
} Reduced;

static inline void reduce(Reduced *restrict r, const Tree *restrict t,
                          const DegreesOfFreedom *restrict k, const Forces *restrict y,
                          const Mobility *restrict base)
{
    const Wrench y_0 = y->base;
    for (int i = 0; i < COLUMNS; i++) {
        Wrench p = column_at(t, i);
        Twist answer = base_response(base, p);
        double moves = k->moves[i];
        put_vec(&r->v, i, scale(moves, sub(vec_at(&t->oa, i), answer.v)));
        put_vec(&r->w, i, scale(moves, sub(vec_at(&t->a, i), answer.w)));
        put_vec(&r->F, i, scale(moves, p.F));
        put_vec(&r->M, i, scale(moves, p.M));
        r->y[i] = moves * (y->joint[i] - power(answer, y_0));
    }
}

/* solves H x = y for the joints that move; x is 0 for the other joints. Returns 0 if H is not
 * positive definite. With the rows 0 of the base and m of the joints that move:
 * (H_mm - H_m0 H_00^-1 H_0m) x_m = y_m - H_m0 H_00^-1 y_0, x_0 = H_00^-1 (y_0 - H_0m x_m)
 * An element of the matrix in the first equation is the momentum for a unit rate of one joint times
 * the twist for a unit rate of the other joint, which includes the reaction of the free base. */
static inline int solve_joints(double x[COLUMNS], const Tree *t, const DegreesOfFreedom *k,
                               const Forces *y, const Mobility *base)
{
    double a[COLUMNS][UPPER];
    Reduced r;
    int joints = (int)t->joints;
    reduce(&r, t, k, y, base);
    for (int i = 0; i < joints; i++) {
        vec3 v = vec_at(&r.v, i), w = vec_at(&r.w, i);
        for (int j = 0; j < COLUMNS; j++)
            a[i][j] = dot(v, vec_at(&r.F, j)) + dot(w, vec_at(&r.M, j));
        a[i][i] += k->moves[i] > 0 ? t->rotor[i] : 1;
        a[i][joints] = r.y[i];
    }
    return solve_upper(a, joints, x);
}

static inline Speeds solve_for_speeds(const Tree *t, const DegreesOfFreedom *k, const Forces *y)
{
    const Mobility base = mobility_of(&t->whole, k->turns);
    Speeds solution = {.joint = {0}};
    Wrench remainder = y->base;
    int joints = k->joints > 0 ? (int)t->joints : 0;
    int good = t->whole.m > 0 && (!joints || solve_joints(solution.joint, t, k, y, &base));
    for (int i = 0; i < joints; i++) {
        if (!good && k->moves[i] > 0) solution.joint[i] = NAN;
        remainder = plus_wrench(remainder, -solution.joint[i], column_at(t, i));
    }
    Twist base_motion = base_response(&base, remainder);
    solution.v = base_motion.v;
    solution.w = base_motion.w;
    return solution;
}

/* ---- loads on the bodies and the generalised forces Q or b ---- */
/* tidal field: gravity at a point minus gravity at C, the centre of mass of base and arm. The
 * difference is G x = g (3 a (a.x) - x), with the position x of the point relative to C,
 * g = mu/r^3, and the unit vector a from the planet to C. at_S: the difference at S */
typedef struct {
    mat3 G;
    vec3 at_S;
} TidalField;

static inline TidalField tidal_field_about(vec3 c, double g, vec3 a)
{
    mat3 G = plus(identity(-g), scaled(3 * g, outer(a, a)));
    return (TidalField){G, neg(mul(G, c))};
}

/* w~ w~ + alpha~ - G: derivative of (a' minus the tidal acceleration) with respect to the position
 * of the point in a body with angular velocity w and angular acceleration alpha; w~: matrix of the
 * vector product, w~ b = w x b */
static inline mat3 acceleration_gradient(vec3 w, vec3 alpha, mat3 G)
{
    double xx = w.x * w.x, yy = w.y * w.y, zz = w.z * w.z;
    double xy = w.x * w.y, xz = w.x * w.z, yz = w.y * w.z;
    return minus(rows(vec(-yy - zz, xy - alpha.z, xz + alpha.y),
                      vec(xy + alpha.z, -xx - zz, yz - alpha.x),
                      vec(xz - alpha.y, yz + alpha.x, -xx - yy)),
                 G);
}

/* integral of r x A r dm over a body with inertia I; r: position from the point to which I refers.
 * For A of acceleration_gradient() the integral is I alpha + w x I w - 3 g a x (I a), with w, alpha
 * of that function and g, a of TidalField. The second moments of the mass, the integral of
 * r r^T dm, are (trace(I)/2) 1 - I with the identity 1. */
static inline vec3 moment_of(mat3 A, sym3 I)
{
    double half = (I.xx + I.yy + I.zz) / 2;
    vec3 x = vec(half - I.xx, -I.xy, -I.xz), y = vec(-I.xy, half - I.yy, -I.yz),
         z = vec(-I.xz, -I.yz, half - I.zz);
    return vec(dot(A.row[2], y) - dot(A.row[1], z), dot(A.row[0], z) - dot(A.row[2], x),
               dot(A.row[1], x) - dot(A.row[0], y));
}

/* wrench at S that gives each point of a body the acceleration a + A r; r: its position from S */
static inline Wrench inertial_load(Composite b, vec3 a, mat3 A)
{
    return (Wrench){add(scale(b.m, a), mul(A, b.h)), add(cross(b.h, a), moment_of(A, b.I))};
}

/* difference d: acceleration a' with du/dt = 0, minus the tidal acceleration. at_o: d at each
 * joint; A: gradient A_i of d on the link outboard of each joint i (A_0: on the base). For joint i
 * at position o_i with axis a_i:
 *   w_i = w_(i-1) + a_i dq_i,   alpha'_i = alpha'_(i-1) + w_(i-1) x a_i dq_i,
 *   d(o_(i+1)) = d(o_i) + A_i (o_(i+1) - o_i) */
typedef struct {
    vec3s at_o;
    mat3s A;
} AccelerationFields;

static inline void set_acceleration_fields(AccelerationFields *restrict f, const Tree *restrict t,
                                           const Links *restrict k, const Speeds *u,
                                           const TidalField *tidal, mat3 A_0)
{
    vec3s joint_turning, rate, coriolis, alpha, increment;
    const mat3 G = tidal->G;
    const vec3 none = vec(0, 0, 0);
    for (int i = 0; i < COLUMNS; i++)
        put_vec(&joint_turning, i, scale(u->joint[i], vec_at(&t->a, i)));
    partial_sums(&rate, u->w, &joint_turning);
    for (int i = 0; i < COLUMNS; i++)
        put_vec(&coriolis, i, cross(vec_at(&rate, i), vec_at(&joint_turning, i)));
    partial_sums(&alpha, none, &coriolis);
    for (int i = 0; i < COLUMNS; i++) {
        mat3 A = acceleration_gradient(add(vec_at(&rate, i), vec_at(&joint_turning, i)),
                                       add(vec_at(&alpha, i), vec_at(&coriolis, i)), G);
        put_mat(&f->A, i, A);
        put_vec(&increment, i, mul(A, vec_at(&k->reach, i)));
    }
    partial_sums(&f->at_o, sub(mul(A_0, vec_at(&k->o, 0)), tidal->at_S), &increment);
}

/* sets b->joint: for each joint, the moment about its axis of the loads on all links outboard of
 * this joint; returns the sum of the loads on all links, which acts on the base */
static inline Wrench set_joint_forces(Forces *b, const Tree *t, const Links *k, const Speeds *u,
                                      const TidalField *tidal, mat3 A_0)
{
    AccelerationFields f;
    vec3s F, M;
    Wrench sum = {vec(0, 0, 0), vec(0, 0, 0)};
    set_acceleration_fields(&f, t, k, u, tidal, A_0);
    for (int i = 0; i < COLUMNS; i++) {
        mat3 A = mat_at(&f.A, i);
        vec3 at_S = sub(vec_at(&f.at_o, i), mul(A, vec_at(&k->o, i)));
        Wrench load = inertial_load(composite_at(&k->own, i), at_S, A);
        put_vec(&F, i, load.F);
        put_vec(&M, i, load.M);
    }
    for (int i = COLUMNS; i-- > 0;) {
        sum = plus_wrench(sum, 1, (Wrench){vec_at(&F, i), vec_at(&M, i)});
        put_vec(&F, i, sum.F);
        put_vec(&M, i, sum.M);
    }
    for (int i = 0; i < COLUMNS; i++)
        b->joint[i] = power(screw_at(t, i), (Wrench){vec_at(&F, i), vec_at(&M, i)});
    return sum;
}

/* b - Q_gg: loads of the motion with du/dt = 0, minus the loads Q_gg by the gravity gradient */
static inline Forces velocity_forces(const Tree *t, const Links *k, const Composite *base,
                                     const Speeds *u, const TidalField *tidal)
{
    Forces b = {.joint = {0}};
    mat3 A_0 = acceleration_gradient(u->w, vec(0, 0, 0), tidal->G);
    b.base = inertial_load(*base, neg(tidal->at_S), A_0);
    if (t->joints > 0) b.base = plus_wrench(b.base, 1, set_joint_forces(&b, t, k, u, tidal, A_0));
    return b;
}

#endif
