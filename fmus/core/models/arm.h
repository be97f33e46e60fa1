/* arm.h - a base body with an arm of up to seven joints: geometry, mass matrix, velocity terms,
 * loads, in base axes.
 *
 *   u = [v; w; dq]        velocity of S, angular velocity of the base, joint rates
 *   H du/dt + b = Q       H = sum_k Jw_k^T I_k Jw_k + m_k Jv_k^T Jv_k, joint_inertia on its diagonal
 *
 * Everything refers to S, the centre of mass of the base: a joint at unit rate moves what is
 * outboard of it as the twist [o x a; a], momenta and loads are wrenches at S, and an element of H
 * or Q is the product of the two. So H takes one pass inward over composite bodies, b one outward
 * and one inward. The base leaves the system before it is solved, since H_00 is inverted by mass and
 * inertia about C. Every link frame is parallel to the base at joint angle zero.
 * Equations: docs/models.md K.1. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef ARM_H
#define ARM_H

#include "attitude.h"
#include "cholesky.h"
#include "mat3.h"
#include "sym3.h"

enum { ARM_JOINTS = 7 };

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

static inline sym3 link_inertia(const Arm *arm, int i)
{
    vec3 d = arm->inertia[i], p = arm->products[i];
    return (sym3){d.x, d.y, d.z, p.x, p.y, p.z};
}

typedef struct { vec3 v, w; } Twist;  /* of what moves: velocity of its point at S, rate */
typedef struct { vec3 F, M; } Wrench; /* force, and moment about S; or momentum */
typedef struct {
    vec3 v, w;
    double joint[ARM_JOINTS];
} Speeds; /* u or du/dt */
typedef struct {
    Wrench base;
    double joint[ARM_JOINTS];
} Forces; /* Q or b; or momenta */

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
    vec3 h; /* first moment about S */
    sym3 I; /* inertia about S */
} Composite;

static inline Wrench momentum_of(const Composite *b, vec3 v, vec3 w)
{
    return (Wrench){add(scale(b->m, v), cross(w, b->h)), add(sym_mul(b->I, w), cross(b->h, v))};
}

/* mass and inertia of a body whose centre of mass is S */
static inline Composite body_at_S(double m, mat3 J_S)
{
    return (Composite){m, vec(0, 0, 0), sym_of(J_S)};
}

/* what it asks for to turn at a constant rate, S at rest */
static inline Wrench turning_terms(const Composite *b, vec3 w)
{
    return (Wrench){cross(w, cross(w, b->h)), cross(w, sym_mul(b->I, w))};
}

/* ---- geometry ---- */
typedef struct {
    mat3 R;      /* link axes to base axes */
    vec3 o;      /* the own joint, and */
    Twist screw; /* its motion at unit rate */
    double m;    /* masses: by weigh() */
    vec3 c;
    sym3 I; /* about c */
} Link;
typedef struct {
    int joints;
    Link link[ARM_JOINTS];
    mat3 R_A; /* last link: axes to base axes */
    vec3 p_E;
} Tree;

/* R Rot(axis, q), Rodrigues: turns vectors by +q about the unit vector; a = R axis */
static inline mat3 turned_about(mat3 R, vec3 axis, vec3 a, double q)
{
    SineCosine t = sine_and_cosine(q);
    vec3 sine = scale(t.s, axis), rest = scale(1 - t.c, axis);
    return rows(sum3(scale(t.c, R.row[0]), cross(R.row[0], sine), scale(a.x, rest)),
                sum3(scale(t.c, R.row[1]), cross(R.row[1], sine), scale(a.y, rest)),
                sum3(scale(t.c, R.row[2]), cross(R.row[2], sine), scale(a.z, rest)));
}

/* a_i = R_(i-1) axis_i,  o_i = o_(i-1) + R_(i-1) offset_i,  R_i = R_(i-1) Rot(axis_i, q_i) */
static inline void place(Tree *t, const Arm *arm, const double q[])
{
    int joints = (int)arm->joints;
    mat3 R = identity(1);
    vec3 o = vec(0, 0, 0);
    for (int i = 0; i < joints; i++) {
        vec3 a = mul(R, arm->axis[i]);
        o = add(o, mul(R, arm->offset[i]));
        R = turned_about(R, arm->axis[i], a, q[i]);
        t->link[i].R = R;
        t->link[i].o = o;
        t->link[i].screw = (Twist){cross(o, a), a};
    }
    t->joints = joints;
    t->R_A = R;
    t->p_E = add(o, mul(R, arm->p_EA_A));
}

/* c_i = o_i + R_i centre_i,  I_i = R_i L_i R_i^T, of the same trace */
static inline void weigh(Tree *t, const Arm *arm)
{
    int joints = t->joints;
    for (int i = 0; i < joints; i++) {
        Link *k = &t->link[i];
        vec3 x = k->R.row[0], y = k->R.row[1], z = k->R.row[2];
        sym3 L = link_inertia(arm, i);
        vec3 Lx = sym_mul(L, x), Ly = sym_mul(L, y);
        double xx = dot(x, Lx), yy = dot(y, Ly), zz = L.xx + L.yy + L.zz - xx - yy;
        k->m = arm->mass[i];
        k->c = add(k->o, mul(k->R, arm->centre[i]));
        k->I = (sym3){xx, yy, zz, dot(x, Ly), dot(z, Lx), dot(z, Ly)};
    }
}

/* attitude of E relative to S */
static inline quat tip_attitude(const Arm *arm, const Tree *t)
{
    return product(quat_of_dcm(transpose(t->R_A)), arm->q_EA);
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

/* ---- H ---- */
typedef struct {
    const Arm *arm;
    const Tree *tree;
    Composite whole;          /* H_00 = [m 1, -h~; h~, I] */
    Wrench joint[ARM_JOINTS]; /* H_0m: momentum at unit rate of each joint */
} MassMatrix;

static inline double joint_element(const MassMatrix *H, int i, int j) /* H_mm, i <= j */
{
    double rotor = i == j ? H->arm->joint_inertia[i] : 0;
    return power(H->tree->link[i].screw, H->joint[j]) + rotor;
}

static inline Composite with_link(Composite b, const Link *k)
{
    return (Composite){b.m + k->m, add(b.h, scale(k->m, k->c)),
                       sym_add(b.I, sym_add(k->I, point_inertia(k->m, k->c)))};
}

static inline void set_mass_matrix(MassMatrix *H, const Arm *arm, const Tree *t,
                                   const Composite *base)
{
    Composite outboard = {0, vec(0, 0, 0), sym_diagonal(0, 0, 0)};
    int joints = t->joints;
    for (int i = joints; i-- > 0;) {
        Twist screw = t->link[i].screw;
        outboard = with_link(outboard, &t->link[i]);
        H->joint[i] = momentum_of(&outboard, screw.v, screw.w);
    }
    H->arm = arm;
    H->tree = t;
    H->whole =
        (Composite){outboard.m + base->m, add(outboard.h, base->h), sym_add(outboard.I, base->I)};
}

static inline vec3 centre_of(const Composite *b) { return scale(1 / b->m, b->h); }

/* of C, from S */
static inline vec3 velocity_of_centre(const MassMatrix *H, const Speeds *u)
{
    vec3 p = cross(u->w, H->whole.h);
    int joints = H->tree->joints;
    for (int i = 0; i < joints; i++) p = add(p, scale(u->joint[i], H->joint[i].F));
    return add(u->v, scale(1 / H->whole.m, p));
}

/* rows of the base in H times u */
static inline Wrench base_rows(const MassMatrix *H, const Speeds *u)
{
    Wrench sum = momentum_of(&H->whole, u->v, u->w);
    int joints = H->tree->joints;
    for (int i = 0; i < joints; i++) sum = plus_wrench(sum, u->joint[i], H->joint[i]);
    return sum;
}

/* rows of the joints in H times u */
static inline void set_joint_rows(double row[ARM_JOINTS], const MassMatrix *H, const Speeds *u)
{
    int joints = H->tree->joints;
    for (int j = 0; j < joints; j++) {
        row[j] = power((Twist){u->v, u->w}, H->joint[j]) + joint_element(H, j, j) * u->joint[j];
        for (int i = 0; i < j; i++) {
            double H_ij = joint_element(H, i, j);
            row[i] += H_ij * u->joint[j];
            row[j] += H_ij * u->joint[i];
        }
    }
}

/* ---- H x = y ---- */
/* H_00^-1: mass and inertia about C; no inertia where the base does not turn */
typedef struct {
    double per_mass;
    vec3 c;
    sym3 per_inertia;
} Mobility;

static inline Mobility mobility_of(const Composite *whole, int turns)
{
    vec3 c = centre_of(whole);
    sym3 I_C = sym_sub(whole->I, point_inertia(whole->m, c));
    return (Mobility){1 / whole->m, c, turns ? sym_inverted(I_C) : sym_diagonal(0, 0, 0)};
}

/* H_00^-1 y:  w = I_C^-1 (M - c x F),  v = F/m - w x c */
static inline Twist base_answer(const Mobility *base, Wrench y)
{
    vec3 w = sym_mul(base->per_inertia, sub(y.M, cross(base->c, y.F)));
    return (Twist){sub(scale(base->per_mass, y.F), cross(w, base->c)), w};
}

typedef struct {
    int turns, joints, joint[ARM_JOINTS]; /* the base turns; how many joints move, and which */
} Moving;

static inline Twist less_twist(Twist a, Twist b) { return (Twist){sub(a.v, b.v), sub(a.w, b.w)}; }

/* x of H x = y for what moves, the rest stands: 0. NaN where H is not positive definite.
 *   (H_mm - H_m0 H_00^-1 H_0m) x_m = y_m - H_m0 H_00^-1 y_0,   x_0 = H_00^-1 (y_0 - H_0m x_m)
 * An element on the left is the momentum of one joint times the screw of the other on a base that
 * answers it. */
static inline Speeds solved(const MassMatrix *H, const Moving *k, const Forces *y)
{
    enum { WIDTH = ARM_JOINTS + 2 };
    double a[ARM_JOINTS][WIDTH], x[ARM_JOINTS];
    Mobility base = mobility_of(&H->whole, k->turns);
    Speeds found = {.joint = {0}};
    Wrench left = y->base;
    int n = k->joints;
    for (int r = 0; r < n; r++) {
        int i = k->joint[r];
        Twist answer = base_answer(&base, H->joint[i]);
        Twist screw = less_twist(H->tree->link[i].screw, answer);
        for (int s = r; s < n; s++) a[r][s] = power(screw, H->joint[k->joint[s]]);
        a[r][r] += H->arm->joint_inertia[i];
        a[r][n] = y->joint[i] - power(answer, y->base);
        a[r][n + 1] = 0;
    }
    int good = H->whole.m > 0 && solve_upper(&a[0][0], n, WIDTH, x);
    for (int s = 0; s < n; s++) {
        int i = k->joint[s];
        found.joint[i] = good ? x[s] : NAN;
        left = plus_wrench(left, -found.joint[i], H->joint[i]);
    }
    Twist of_base = base_answer(&base, left);
    found.v = of_base.v;
    found.w = of_base.w;
    return found;
}

/* ---- loads on the bodies, and Q or b of them ---- */
typedef struct { Wrench base, link[ARM_JOINTS]; } Loads;

static inline Forces projected(const Tree *t, const Loads *loads)
{
    Forces Q = {.joint = {0}};
    Wrench sum = {{0, 0, 0}, {0, 0, 0}};
    int joints = t->joints;
    for (int i = joints; i-- > 0;) {
        sum = plus_wrench(sum, 1, loads->link[i]);
        Q.joint[i] = power(t->link[i].screw, sum);
    }
    Q.base = plus_wrench(sum, 1, loads->base);
    return Q;
}

/* of a field in which all bodies fall with C, what is left at x from C: G x = g (3 a (a.x) - x) */
typedef struct {
    mat3 G;
    vec3 at_S;
} Tide;

static inline Tide tide_about(vec3 c, double g, vec3 a)
{
    mat3 G = plus(identity(-g), scaled(3 * g, outer(a, a)));
    return (Tide){G, neg(mul(G, c))};
}

/* w~ w~ + alpha~ - G: what a' less the tide grows by with the place on a body */
static inline mat3 growth(vec3 w, vec3 alpha, const mat3 *G)
{
    double xx = w.x * w.x, yy = w.y * w.y, zz = w.z * w.z;
    double xy = w.x * w.y, xz = w.x * w.z, yz = w.y * w.z;
    return minus(rows(vec(-yy - zz, xy - alpha.z, xz + alpha.y),
                      vec(xy + alpha.z, -xx - zz, yz - alpha.x),
                      vec(xz - alpha.y, yz + alpha.x, -xx - yy)),
                 *G);
}

/* integral of r x A r dm over a body of inertia I: I alpha' + w x I w - 3 g a x (I a). With the
 * second moments trace(I)/2 1 - I of the mass, rows of A times theirs. */
static inline vec3 moment_of(const mat3 *A, const sym3 *I)
{
    double half = (I->xx + I->yy + I->zz) / 2;
    vec3 x = vec(half - I->xx, -I->xy, -I->xz), y = vec(-I->xy, half - I->yy, -I->yz),
         z = vec(-I->xz, -I->yz, half - I->zz);
    return vec(dot(A->row[2], y) - dot(A->row[1], z), dot(A->row[0], z) - dot(A->row[2], x),
               dot(A->row[1], x) - dot(A->row[0], y));
}

/* whose Q is b less that of the tide: what the motion asks for with du/dt = 0, as forces
 * m (a' - G x) at c and moments I alpha' + w x I w - 3 g a x (I a).
 *   alpha'_i = alpha'_(i-1) + w_(i-1) x a_i dq_i */
static inline void set_velocity_loads(Loads *loads, const Tree *t, const Composite *base, vec3 w,
                                      const double dq[], const Tide *tide)
{
    vec3 o = vec(0, 0, 0), alpha = o, accel = neg(tide->at_S);
    mat3 grows = growth(w, alpha, &tide->G);
    int joints = t->joints;
    loads->base = (Wrench){add(scale(base->m, accel), mul(grows, base->h)),
                           add(cross(base->h, accel), moment_of(&grows, &base->I))};
    for (int i = 0; i < joints; i++) {
        const Link *k = &t->link[i];
        vec3 turning = scale(dq[i], k->screw.w);
        accel = add(accel, mul(grows, sub(k->o, o)));
        alpha = add(alpha, cross(w, turning));
        w = add(w, turning);
        o = k->o;
        grows = growth(w, alpha, &tide->G);
        vec3 force = scale(k->m, add(accel, mul(grows, sub(k->c, o))));
        loads->link[i] = wrench_at(k->c, force, moment_of(&grows, &k->I));
    }
}

#endif
