/* arm.h - base body with an arm of up to seven joints at an instant, in base axes: geometry,
 * masses, mass matrix.
 *
 *   u = [v; w; dq]        velocity of S, angular velocity of the base, joint rates
 *   H = sum_k Jw_k^T I_k Jw_k + m_k Jv_k^T Jv_k, joint_inertia on its diagonal
 *
 * Of body k: mass m_k, inertia I_k, Jacobians Jv_k and Jw_k of its velocity and angular velocity.
 * All quantities refer to S, the centre of mass of the base: a joint at o with the axis a and unit
 * rate moves the outboard links with the twist [o x a; a], momenta and loads are wrenches at S, and
 * an element of H is the product of a twist and a wrench. H is therefore computed in one inward
 * pass over composite bodies. The block of the base is inverted by mass and inertia about C, the
 * centre of mass of base and arm. E: tip of the arm. Every link frame is parallel to the base at
 * joint angle zero. Sums and products along the arm run from link to link; all other loops process
 * all links at once (columns.h). Equations: docs/models.md K.1. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef ARM_H
#define ARM_H

#include "attitude.h"
#include "columns.h"
#include "mat3.h"

enum { ARM_JOINTS = 7 };

/* per joint and its outboard link, in the zero pose and base axes: joint axis, joint from the
 * previous joint (the first: from S), mass of the link, its centre of mass from its joint, inertia
 * about the centre of mass (xx, yy, zz and xy, xz, yz), inertia of the rotor seen through the
 * gear. p_EA_A, q_EA: position of E from the last joint and attitude of E, in axes A of the last
 * link; without joints in axes of the base. */
typedef struct {
    double joints;
    vec3 axis[ARM_JOINTS], offset[ARM_JOINTS];
    double mass[ARM_JOINTS];
    vec3 centre[ARM_JOINTS], inertia[ARM_JOINTS], products[ARM_JOINTS];
    double joint_inertia[ARM_JOINTS];
    vec3 p_EA_A;
    quat q_EA;
} Arm;

static inline sym3 link_inertia(const Arm *arm, int i)
{
    vec3 d = arm->inertia[i], p = arm->products[i];
    return (sym3){d.x, d.y, d.z, p.x, p.y, p.z};
}

typedef struct { vec3 v, w; } Twist;  /* velocity at S, angular velocity */
typedef struct { vec3 F, M; } Wrench; /* force, and moment about S; or momentum */
typedef struct {
    vec3 v, w;
    double joint[COLUMNS];
} Speeds; /* u or du/dt */
typedef struct {
    Wrench base;
    double joint[COLUMNS];
} Forces; /* generalised forces Q or b in H du/dt + b = Q, or momenta H u */

static inline double power(Twist t, Wrench load) { return dot(t.v, load.F) + dot(t.w, load.M); }
static inline Wrench plus_wrench(Wrench a, double k, Wrench b) /* a + k b */
{
    return (Wrench){add(a.F, scale(k, b.F)), add(a.M, scale(k, b.M))};
}
static inline Wrench wrench_at(vec3 p, vec3 F, vec3 M) { return (Wrench){F, add(M, cross(p, F))}; }
static inline vec3 velocity_at(Twist t, vec3 p) { return add(t.v, cross(t.w, p)); }

/* ---- composite bodies ---- */
typedef struct {
    double m;
    vec3 h; /* first moment of mass about S */
    sym3 I; /* inertia about S */
} Composite;

static inline Wrench momentum_of(const Composite *b, vec3 v, vec3 w)
{
    return (Wrench){add(scale(b->m, v), cross(w, b->h)), add(sym_mul(b->I, w), cross(b->h, v))};
}

/* composite body with its centre of mass at S, mass m and inertia J_S */
static inline Composite body_at_S(double m, mat3 J_S)
{
    return (Composite){m, vec(0, 0, 0), sym_of(J_S)};
}

/* wrench at S that a body needs to turn at the constant rate w about S, which is at rest */
static inline Wrench gyroscopic_wrench(const Composite *b, vec3 w)
{
    return (Wrench){cross(w, cross(w, b->h)), cross(w, sym_mul(b->I, w))};
}

/* ---- geometry ---- */
/* parameters of the arm, one element per link; a link that does not exist has no mass and does
 * not turn */
typedef struct {
    int joints;
    vec3 shoulder;             /* vector from S to the first joint */
    vec3s axis, reach, centre; /* reach: from the joint to the next joint; last link: to E */
    sym3s inertia;
    double mass[COLUMNS], rotor[COLUMNS];
} Chain;

typedef struct {
    double m[COLUMNS];
    vec3s h;
    sym3s I;
} Composites;

/* positions and inertias of the links at an instant, base axes */
typedef struct {
    mat3s R;        /* link axes to base axes */
    vec3s o, reach; /* o: position of the joint; reach: as in Chain */
    Composites own; /* set by set_link_inertias() */
} Links;

/* kinematic tree of base and arm at an instant, base axes; doubles only, as part of a State */
typedef struct {
    double joints, rotor[COLUMNS];
    vec3s a, oa; /* axis of each joint and o x a: the twist at unit rate is [o x a; a] */
    mat3 R_A;    /* axes of the last link to base axes */
    vec3 p_E;
    Composite links; /* all links together: set by set_mass_matrix() */
    Composite whole; /* links and base, H_00 = [m 1, -h~; h~, I] */
    vec3s F, M;      /* H_0m: momentum at unit rate of each joint */
} Tree;

static inline Composite composite_at(const Composites *b, int i)
{
    return (Composite){b->m[i], vec_at(&b->h, i), sym_at(&b->I, i)};
}
static inline void put_composite(Composites *b, int i, Composite one)
{
    b->m[i] = one.m;
    put_vec(&b->h, i, one.h);
    put_sym(&b->I, i, one.I);
}
static inline Composite combined(Composite a, Composite b)
{
    return (Composite){a.m + b.m, add(a.h, b.h), sym_add(a.I, b.I)};
}

static inline Twist screw_at(const Tree *t, int i)
{
    return (Twist){vec_at(&t->oa, i), vec_at(&t->a, i)};
}

static inline void set_chain(Chain *c, const Arm *arm)
{
    static const Arm none = {.joints = 0};
    int last = (int)arm->joints - 1;
    c->joints = last + 1;
    c->shoulder = last < 0 ? arm->p_EA_A : arm->offset[0];
    for (int i = 0; i < COLUMNS; i++) {
        const Arm *of = i <= last ? arm : &none;
        int k = i <= last ? i : 0;
        put_vec(&c->axis, i, of->axis[k]);
        put_vec(&c->reach, i,
                i == last  ? arm->p_EA_A
                : i < last ? arm->offset[i + 1]
                           : vec(0, 0, 0));
        put_vec(&c->centre, i, of->centre[k]);
        put_sym(&c->inertia, i, link_inertia(of, k));
        c->mass[i] = of->mass[k];
        c->rotor[i] = of->joint_inertia[k];
    }
}

/* Rot(a, q) = c 1 + (1 - c) a a^T + s a~, Rodrigues: rotates vectors by +q about the unit vector
 * a */
static inline mat3 turn_about(vec3 a, double s, double c)
{
    vec3 k = scale(1 - c, a), b = scale(s, a);
    double xy = k.x * a.y, xz = k.x * a.z, yz = k.y * a.z;
    return rows(vec(c + k.x * a.x, xy - b.z, xz + b.y), vec(xy + b.z, c + k.y * a.y, yz - b.x),
                vec(xz - b.y, yz + b.x, c + k.z * a.z));
}

/* sets the rotation matrices of the links: R_i = R_(i-1) Rot(axis_i, q_i) */
static inline void rotate_links(mat3s *restrict R, const Chain *restrict arm, const double q[])
{
    double s[COLUMNS] = {0}, c[COLUMNS] = {[ARM_JOINTS] = 1};
    mat3s turn;
    for (int i = 0; i < ARM_JOINTS; i++) {
        SineCosine of = sine_and_cosine(i < arm->joints ? q[i] : 0);
        s[i] = of.s;
        c[i] = of.c;
    }
    for (int i = 0; i < COLUMNS; i++)
        put_mat(&turn, i, turn_about(vec_at(&arm->axis, i), s[i], c[i]));
    mat3 product_of_turns = mat_at(&turn, 0);
    put_mat(R, 0, product_of_turns);
    for (int i = 1; i < ARM_JOINTS; i++) {
        product_of_turns = matmul(product_of_turns, mat_at(&turn, i));
        put_mat(R, i, product_of_turns);
    }
    put_mat(R, ARM_JOINTS, product_of_turns);
}

/* a_i = R_i axis_i, the same on both sides of the joint; position of joint i:
 * o_i = o_(i-1) + R_(i-1) offset_i */
static inline void place_links(Tree *restrict t, Links *restrict k, const Chain *restrict arm,
                               const double q[])
{
    rotate_links(&k->R, arm, q);
    for (int i = 0; i < COLUMNS; i++) {
        mat3 R = mat_at(&k->R, i);
        put_vec(&t->a, i, mul(R, vec_at(&arm->axis, i)));
        put_vec(&k->reach, i, mul(R, vec_at(&arm->reach, i)));
    }
    t->p_E = partial_sums(&k->o, arm->shoulder, &k->reach);
    for (int i = 0; i < COLUMNS; i++) put_vec(&t->oa, i, cross(vec_at(&k->o, i), vec_at(&t->a, i)));
    t->joints = arm->joints;
    memcpy(t->rotor, arm->rotor, sizeof t->rotor);
    t->R_A = mat_at(&k->R, COLUMNS - 1);
}

/* R L R^T; the rotation preserves the trace, which gives the third diagonal element */
static inline sym3 rotated_inertia(mat3 R, sym3 L)
{
    vec3 x = R.row[0], y = R.row[1], z = R.row[2], Lx = sym_mul(L, x), Ly = sym_mul(L, y);
    double xx = dot(x, Lx), yy = dot(y, Ly);
    return (sym3){xx, yy, L.xx + L.yy + L.zz - xx - yy, dot(x, Ly), dot(z, Lx), dot(z, Ly)};
}

/* sets centre of mass and inertia of every link, moved to S: c_i = o_i + R_i centre_i, I_i = R_i
 * L_i R_i^T */
static inline void set_link_inertias(Links *restrict k, const Chain *restrict arm)
{
    for (int i = 0; i < COLUMNS; i++) {
        mat3 R = mat_at(&k->R, i);
        double m = arm->mass[i];
        vec3 c = add(vec_at(&k->o, i), mul(R, vec_at(&arm->centre, i)));
        sym3 I = sym_add(rotated_inertia(R, sym_at(&arm->inertia, i)), point_inertia(m, c));
        put_composite(&k->own, i, (Composite){m, scale(m, c), I});
    }
}

/* attitude of the end effector relative to the base */
static inline quat tip_attitude(const Arm *arm, const Tree *t)
{
    return product(quat_of_dcm(transpose(t->R_A)), arm->q_EA);
}

static inline Twist plus_twist(Twist a, double k, Twist b) /* a + k b */
{
    return (Twist){add(a.v, scale(k, b.v)), add(a.w, scale(k, b.w))};
}

/* velocity and angular velocity of the last link, as a twist at S */
static inline Twist tip_twist(const Tree *t, const Speeds *u)
{
    Twist sum = {u->v, u->w};
    int joints = (int)t->joints;
    for (int i = 0; i < joints; i++) sum = plus_twist(sum, u->joint[i], screw_at(t, i));
    return sum;
}

/* ---- mass matrix H ---- */
static inline Wrench column_at(const Tree *t, int i)
{
    return (Wrench){vec_at(&t->F, i), vec_at(&t->M, i)};
}

static inline void set_mass_matrix(Tree *t, const Links *k, const Composite *base)
{
    Composites outboard;
    Composite sum = {0, vec(0, 0, 0), sym_diagonal(0, 0, 0)};
    t->links = sum;
    t->whole = *base;
    if (t->joints == 0) return;
    for (int i = COLUMNS; i-- > 0;) {
        sum = combined(composite_at(&k->own, i), sum);
        put_composite(&outboard, i, sum);
    }
    t->links = sum;
    t->whole = combined(sum, *base);
    for (int i = 0; i < COLUMNS; i++) {
        Twist screw = screw_at(t, i);
        Composite b = composite_at(&outboard, i);
        Wrench p = momentum_of(&b, screw.v, screw.w);
        put_vec(&t->F, i, p.F);
        put_vec(&t->M, i, p.M);
    }
}

static inline vec3 centre_of(const Composite *b) { return scale(1 / b->m, b->h); }

/* rows of the base in H, times u: momentum of base and arm */
static inline Wrench base_rows(const Tree *t, const Speeds *u)
{
    Wrench sum = momentum_of(&t->whole, u->v, u->w);
    int joints = (int)t->joints;
    for (int i = 0; i < joints; i++) sum = plus_wrench(sum, u->joint[i], column_at(t, i));
    return sum;
}

/* rows of the joints in H, times u. Element (j, i) of H is the twist at unit rate of the inboard
 * joint of the two, times the momentum at unit rate of the outboard joint. The first loop sums over
 * the base and the joints i < j, the second loop over the joints i >= j. */
static inline void set_joint_rows(double row[COLUMNS], const Tree *t, const Speeds *u)
{
    int joints = (int)t->joints;
    Twist inboard = {u->v, u->w};
    Wrench outboard = {{0, 0, 0}, {0, 0, 0}};
    for (int j = 0; j < joints; j++) {
        row[j] = power(inboard, column_at(t, j)) + t->rotor[j] * u->joint[j];
        inboard = plus_twist(inboard, u->joint[j], screw_at(t, j));
    }
    for (int j = joints; j-- > 0;) {
        outboard = plus_wrench(outboard, u->joint[j], column_at(t, j));
        row[j] += power(screw_at(t, j), outboard);
    }
}

/* H_00^-1 in the form of inverse mass and inverse inertia about C; the inverse inertia is 0 if
 * the base does not turn */
typedef struct {
    double inverse_mass;
    vec3 c;
    sym3 inverse_inertia;
} Mobility;

static inline Mobility mobility_of(const Composite *whole, int turns)
{
    vec3 c = centre_of(whole);
    sym3 I_C = sym_sub(whole->I, point_inertia(whole->m, c));
    return (Mobility){1 / whole->m, c, turns ? sym_inverted(I_C) : sym_diagonal(0, 0, 0)};
}

/* twist of the base H_00^-1 y, y = [F; M] a wrench:  w = I_C^-1 (M - c x F),  v = F/m - w x c */
static inline Twist base_response(const Mobility *base, Wrench y)
{
    vec3 w = sym_mul(base->inverse_inertia, sub(y.M, cross(base->c, y.F)));
    return (Twist){sub(scale(base->inverse_mass, y.F), cross(w, base->c)), w};
}

#endif
