/* arm.h - a base body with an arm of up to seven joints: geometry, mass matrix, velocity terms,
 * loads, in base axes.
 *
 *   u = [v; w; dq]        velocity of S, angular velocity of the base, joint rates
 *   H du/dt + b = Q       H = sum_k Jw_k^T I_k Jw_k + m_k Jv_k^T Jv_k, joint_inertia on its diagonal
 *
 * Everything refers to S, the centre of mass of the base: a joint at unit rate moves what is
 * outboard of it as the twist [o x a; a], momenta and loads are wrenches at S, and an element of H
 * or Q is the product of the two. So H takes one pass inward over composite bodies, b one outward
 * and one inward. Every link frame is parallel to the base at joint angle zero.
 * Equations: docs/models.md K.1. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef ARM_H
#define ARM_H

#include "attitude.h"
#include "cholesky.h"
#include "mat3.h"

enum { ARM_JOINTS = 7, ARM_SPEEDS = 6 + ARM_JOINTS };

/* zero pose, base axes: axis, joint from the joint before (the first: from S), centre of mass from
 * the own joint, inertia about it (xx, yy, zz and xy, xz, yz), the rotor's seen through the gear */
typedef struct {
    double joints;
    vec3 axis[ARM_JOINTS], offset[ARM_JOINTS];
    double mass[ARM_JOINTS];
    vec3 centre[ARM_JOINTS], inertia[ARM_JOINTS], products[ARM_JOINTS];
    double joint_inertia[ARM_JOINTS];
    vec3 p_EA_A;
    quat q_EA;
} Arm;

typedef struct { vec3 v, w; } Twist;  /* of what moves: velocity of its point at S, rate */
typedef struct { vec3 F, M; } Wrench; /* force, and moment about S; or momentum */

static inline double power(Twist t, Wrench load) { return dot(t.v, load.F) + dot(t.w, load.M); }
static inline Wrench plus_wrench(Wrench a, Wrench b)
{
    return (Wrench){add(a.F, b.F), add(a.M, b.M)};
}
static inline Wrench wrench_at(vec3 p, vec3 F, vec3 M) { return (Wrench){F, add(M, cross(p, F))}; }
static inline vec3 velocity_at(Twist t, vec3 p) { return add(t.v, cross(t.w, p)); }

/* ---- geometry ---- */
typedef struct {
    mat3 R; /* link axes to base axes */
    vec3 o, c;
    Twist screw; /* of the own joint */
    double m;
    mat3 I; /* about c */
} Link;
typedef struct {
    int joints;
    double m_0;
    mat3 J_S;
    Link link[ARM_JOINTS];
    mat3 R_A; /* last link: axes to base axes */
    vec3 p_E;
} Tree;

/* Rodrigues: turns vectors by +q about the unit vector a */
static inline mat3 turned_about(vec3 a, double q)
{
    SineCosine t = sine_and_cosine(q);
    return plus(plus(identity(t.c), scaled(t.s, tilde(a))), scaled(1 - t.c, outer(a, a)));
}

static inline mat3 symmetric_of(vec3 diagonal, vec3 products)
{
    return rows(vec(diagonal.x, products.x, products.y), vec(products.x, diagonal.y, products.z),
                vec(products.y, products.z, diagonal.z));
}

/* a_i = R_(i-1) axis_i,  o_i = o_(i-1) + R_(i-1) offset_i,  R_i = R_(i-1) Rot(axis_i, q_i) */
static inline Tree tree_in(const Arm *arm, double m_0, mat3 J_S, const double q[])
{
    int joints = (int)arm->joints;
    Tree t = {.joints = joints, .m_0 = m_0, .J_S = J_S};
    mat3 R = identity(1);
    vec3 o = vec(0, 0, 0);
    for (int i = 0; i < joints; i++) {
        vec3 a = mul(R, arm->axis[i]);
        o = add(o, mul(R, arm->offset[i]));
        R = matmul(R, turned_about(arm->axis[i], q[i]));
        mat3 L = symmetric_of(arm->inertia[i], arm->products[i]);
        t.link[i] = (Link){R,
                           o,
                           add(o, mul(R, arm->centre[i])),
                           {cross(o, a), a},
                           arm->mass[i],
                           matmul(R, matmul_t(L, R))};
    }
    t.R_A = R;
    t.p_E = add(o, mul(R, arm->p_EA_A));
    return t;
}

/* attitude of E relative to S */
static inline quat tip_attitude(const Arm *arm, const Tree *t)
{
    return product(quat_of_dcm(transpose(t->R_A)), arm->q_EA);
}

/* ---- composite bodies ---- */
typedef struct {
    double m;
    vec3 h; /* first moment about S */
    mat3 I; /* inertia about S */
} Composite;

static inline mat3 spread(vec3 c) /* c.c 1 - c c^T: inertia of a unit mass at c */
{
    return minus(identity(dot(c, c)), outer(c, c));
}

static inline Composite with_link(Composite b, const Link *k)
{
    return (Composite){b.m + k->m, add(b.h, scale(k->m, k->c)),
                       plus(b.I, plus(k->I, scaled(k->m, spread(k->c))))};
}

static inline Wrench momentum_of(const Composite *b, Twist t)
{
    return (Wrench){add(scale(b->m, t.v), cross(t.w, b->h)), add(mul(b->I, t.w), cross(b->h, t.v))};
}

static inline Composite whole(const Tree *t)
{
    Composite all = {t->m_0, vec(0, 0, 0), t->J_S};
    int joints = t->joints;
    for (int i = 0; i < joints; i++) all = with_link(all, &t->link[i]);
    return all;
}

/* ---- H ---- */
typedef struct { double at[ARM_SPEEDS][ARM_SPEEDS]; } Matrix;
typedef struct { double at[ARM_SPEEDS]; } Column;

static inline vec3 vector_at(const double *x) { return vec(x[0], x[1], x[2]); }
static inline void set_vector(double *x, vec3 a) { x[0] = a.x, x[1] = a.y, x[2] = a.z; }
static inline void set_wrench(double *x, Wrench l)
{
    set_vector(x, l.F);
    set_vector(x + 3, l.M);
}

/* H_00 = [m 1, -h~; h~, I] of the whole */
static inline void set_base_block(Matrix *H, const Composite *all)
{
    for (int j = 0; j < 3; j++) {
        vec3 e = vec(j == 0, j == 1, j == 2), none = vec(0, 0, 0);
        set_wrench(H->at[j], momentum_of(all, (Twist){e, none}));
        set_wrench(H->at[3 + j], momentum_of(all, (Twist){none, e}));
    }
}

static inline void set_both(Matrix *H, int i, int j, double value)
{
    H->at[i][j] = H->at[j][i] = value;
}

/* rows and columns of the joints; what is outboard of the base */
static inline Composite set_joint_rows(Matrix *H, const Arm *arm, const Tree *t)
{
    Composite outboard = {0, vec(0, 0, 0), identity(0)};
    int joints = t->joints;
    for (int i = joints; i-- > 0;) {
        outboard = with_link(outboard, &t->link[i]);
        Wrench momentum = momentum_of(&outboard, t->link[i].screw);
        double base[6];
        set_wrench(base, momentum);
        for (int j = 0; j < 6; j++) set_both(H, 6 + i, j, base[j]);
        for (int j = 0; j < i; j++) set_both(H, 6 + i, 6 + j, power(t->link[j].screw, momentum));
        H->at[6 + i][6 + i] = power(t->link[i].screw, momentum) + arm->joint_inertia[i];
    }
    return outboard;
}

static inline void add_base(Matrix *H, const Composite *outboard, const Tree *t)
{
    Composite all = {outboard->m + t->m_0, outboard->h, plus(outboard->I, t->J_S)};
    set_base_block(H, &all);
}

static inline Matrix mass_matrix(const Arm *arm, const Tree *t)
{
    Matrix H = {{{0}}};
    Composite outboard = set_joint_rows(&H, arm, t);
    add_base(&H, &outboard, t);
    return H;
}

/* x of H x = y for so many joints; NaN where H is not positive definite */
static inline Column solved(Matrix H, Column y, int joints)
{
    int n = 6 + joints;
    if (cholesky(&H.at[0][0], n, ARM_SPEEDS)) cholesky_solve(&H.at[0][0], n, ARM_SPEEDS, y.at);
    else
        for (int i = 0; i < n; i++) y.at[i] = NAN;
    return y;
}

/* ---- loads on the bodies, and Q or b of them ---- */
typedef struct { Wrench base, link[ARM_JOINTS]; } Loads;

static inline Column projected(const Tree *t, const Loads *loads)
{
    Column Q = {{0}};
    Wrench sum = {{0, 0, 0}, {0, 0, 0}};
    int joints = t->joints;
    for (int i = joints; i-- > 0;) {
        sum = plus_wrench(sum, loads->link[i]);
        Q.at[6 + i] = power(t->link[i].screw, sum);
    }
    set_wrench(Q.at, plus_wrench(sum, loads->base));
    return Q;
}

/* motion of the last link, S at rest */
static inline Twist tip_twist(const Tree *t, vec3 w, const double dq[])
{
    Twist sum = {vec(0, 0, 0), w};
    int joints = t->joints;
    for (int i = 0; i < joints; i++) {
        sum.v = add(sum.v, scale(dq[i], t->link[i].screw.v));
        sum.w = add(sum.w, scale(dq[i], t->link[i].screw.w));
    }
    return sum;
}

/* b: what the motion asks for with du/dt = 0, as forces m a' at c and moments I alpha' + w x I w.
 *   alpha'_i = alpha'_(i-1) + w_(i-1) x a_i dq_i,   a' of a point r further out on the same body:
 *   a' + alpha' x r + w x (w x r) */
static inline Column velocity_terms(const Tree *t, vec3 w, const double dq[])
{
    Loads loads = {.base = {vec(0, 0, 0), cross(w, mul(t->J_S, w))}};
    vec3 o = vec(0, 0, 0), alpha = o, accel = o;
    int joints = t->joints;
    for (int i = 0; i < joints; i++) {
        const Link *k = &t->link[i];
        vec3 d = sub(k->o, o), r = sub(k->c, k->o), turning = scale(dq[i], k->screw.w);
        accel = sum3(accel, cross(alpha, d), cross(w, cross(w, d)));
        alpha = add(alpha, cross(w, turning));
        w = add(w, turning);
        o = k->o;
        vec3 a_c = sum3(accel, cross(alpha, r), cross(w, cross(w, r)));
        vec3 spin = add(mul(k->I, alpha), cross(w, mul(k->I, w)));
        loads.link[i] = wrench_at(k->c, scale(k->m, a_c), spin);
    }
    return projected(t, &loads);
}

/* a row of H times x */
static inline double row_times(const double *row, const double *x, int n)
{
    double sum = 0;
    for (int i = 0; i < n; i++) sum += row[i] * x[i];
    return sum;
}

#endif
