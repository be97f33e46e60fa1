/* two_links.h - base and two links with parallel joint axes: configuration, mass matrix and loads
 * in base axes.
 *
 * Generalised speeds u = [omega of the base; joint rates]; the origin is the centre of mass of the
 * robot. Body k has its x axis along the link; joint 1 lies on the x axis of the base, r[0] from
 * its centre of mass. Equations: docs/models.md D. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef TWO_LINKS_H
#define TWO_LINKS_H

#include "vec3.h"

enum { BODIES = 3, JOINTS = 2, SPEEDS = 5 };

/* parameters of base, link 1 and link 2, one entry each: moments of inertia about the centre of
 * mass; distance l from the inboard joint to the centre of mass, r from there to the outboard
 * joint */
typedef struct {
    double mass[BODIES], Ixx[BODIES], Iyy[BODIES], Izz[BODIES];
    double l[BODIES], r[BODIES];
} Links;

typedef struct {
    double mass, sigma; /* sigma: rate relative to the base about z */
    mat3 inertia;
    vec3 rho;       /* centre of mass of the body, from the origin */
    vec3 D[JOINTS]; /* derivatives of rho with respect to the joint angles */
    vec3 c;         /* terms of the acceleration that are quadratic in the joint rates */
    /* angular and linear velocity of the body per unit of each generalised speed */
    vec3 Jw[SPEEDS], Jv[SPEEDS];
} Part;
typedef struct { Part part[BODIES]; } Robot;

/* Rz(g) diag(Ixx, Iyy, Izz) Rz(g)^T: inertia of body k in base axes, along = (cos g, sin g, 0) */
static inline mat3 turned_inertia(const Links *p, int k, vec3 along)
{
    double c = along.x, s = along.y, difference = p->Ixx[k] - p->Iyy[k];
    double xx = p->Iyy[k] + c * c * difference, yy = p->Iyy[k] + s * s * difference,
           xy = c * s * difference;
    return rows(vec(xx, xy, 0), vec(xy, yy, 0), vec(0, 0, p->Izz[k]));
}

/* adds two segments of lengths a and b to the position of a body, and sets the derivatives of this
 * position by the joint angles and the terms of its acceleration that are quadratic in the joint
 * rates; joint 1 turns both segments, joint 2 the second one */
static inline void place_body(Part *part, double a, double b, vec3 along_1, vec3 along_2,
                              const double dq[JOINTS])
{
    vec3 z = vec(0, 0, 1), both = scale(b, along_2), first = scale(a, along_1);
    double s1 = dq[0], s2 = dq[0] + dq[1];
    part->rho = add(part->rho, add(first, both));
    part->D[0] = cross(z, add(first, both));
    part->D[1] = cross(z, both);
    part->c = neg(add(scale(s1 * s1, first), scale(s2 * s2, both)));
}

/* moves the origin of all positions from the centre of mass of the base to the centre of mass of
 * the robot */
static inline void refer_to_centre_of_mass(Robot *robot)
{
    double mass = 0;
    vec3 rho = vec(0, 0, 0), D0 = rho, D1 = rho, c = rho;
    for (int k = 0; k < BODIES; k++) {
        const Part *b = &robot->part[k];
        mass += b->mass;
        rho = add(rho, scale(b->mass, b->rho));
        D0 = add(D0, scale(b->mass, b->D[0]));
        D1 = add(D1, scale(b->mass, b->D[1]));
        c = add(c, scale(b->mass, b->c));
    }
    for (int k = 0; k < BODIES; k++) {
        Part *b = &robot->part[k];
        b->rho = sub(b->rho, scale(1 / mass, rho));
        b->D[0] = sub(b->D[0], scale(1 / mass, D0));
        b->D[1] = sub(b->D[1], scale(1 / mass, D1));
        b->c = sub(b->c, scale(1 / mass, c));
    }
}

/* Jw_k = [1, z (k >= 1), z (k = 2)],  Jv_k = [-rho_k~, D_k1, D_k2]; 1: unit matrix, z (..): z axis
 * for these bodies k and 0 for the others, rho~: matrix of the vector product, D_kj: derivative of
 * rho_k by the angle of joint j */
static inline void partial_velocities(Part *b, int k)
{
    vec3 z = vec(0, 0, 1), none = vec(0, 0, 0), axes[3] = {vec(1, 0, 0), vec(0, 1, 0), z};
    for (int i = 0; i < 3; i++) {
        b->Jw[i] = axes[i];
        b->Jv[i] = cross(axes[i], b->rho);
    }
    for (int j = 0; j < JOINTS; j++) {
        b->Jw[3 + j] = k > j ? z : none;
        b->Jv[3 + j] = b->D[j];
    }
}

static inline Robot robot_at(const Links *p, const double q[JOINTS], const double dq[JOINTS])
{
    SineCosine first = sine_and_cosine(q[0]), both = sine_and_cosine(q[0] + q[1]);
    vec3 none = vec(0, 0, 0), joint_1 = vec(p->r[0], 0, 0);
    vec3 along_0 = vec(1, 0, 0), along_1 = vec(first.c, first.s, 0),
         along_2 = vec(both.c, both.s, 0);
    Robot robot = {{{.mass = p->mass[0], .rho = none, .inertia = turned_inertia(p, 0, along_0)},
                    {.mass = p->mass[1],
                     .rho = joint_1,
                     .inertia = turned_inertia(p, 1, along_1),
                     .sigma = dq[0]},
                    {.mass = p->mass[2],
                     .rho = joint_1,
                     .inertia = turned_inertia(p, 2, along_2),
                     .sigma = dq[0] + dq[1]}}};
    place_body(&robot.part[1], p->l[1], 0, along_1, along_2, dq);
    place_body(&robot.part[2], p->l[1] + p->r[1], p->l[2], along_1, along_2, dq);
    refer_to_centre_of_mass(&robot);
    for (int k = 0; k < BODIES; k++) partial_velocities(&robot.part[k], k);
    return robot;
}

/* ---- mass matrix H and its linear system ---- */
typedef struct { double at[SPEEDS][SPEEDS]; } Matrix;
typedef struct { double at[SPEEDS]; } Column;

static inline Matrix mass_matrix(const Robot *robot)
{
    Matrix H = {{{0}}};
    for (int k = 0; k < BODIES; k++) {
        const Part *b = &robot->part[k];
        for (int i = 0; i < SPEEDS; i++)
            for (int j = 0; j < SPEEDS; j++)
                H.at[i][j] +=
                    dot(b->Jw[i], mul(b->inertia, b->Jw[j])) + b->mass * dot(b->Jv[i], b->Jv[j]);
    }
    return H;
}

/* x of H x = y for the upper left n x n block of H, by Cholesky decomposition; the other
 * elements of x are 0 */
static inline Column solution(Matrix H, Column y, int n)
{
    Column x = {{0}};
    for (int j = 0; j < n; j++) {
        for (int k = 0; k < j; k++) H.at[j][j] -= H.at[j][k] * H.at[j][k];
        H.at[j][j] = sqrt(H.at[j][j]);
        for (int i = j + 1; i < n; i++) {
            for (int k = 0; k < j; k++) H.at[i][j] -= H.at[i][k] * H.at[j][k];
            H.at[i][j] /= H.at[j][j];
        }
    }
    for (int i = 0; i < n; i++) {
        x.at[i] = y.at[i];
        for (int k = 0; k < i; k++) x.at[i] -= H.at[i][k] * x.at[k];
        x.at[i] /= H.at[i][i];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++) x.at[i] -= H.at[k][i] * x.at[k];
        x.at[i] /= H.at[i][i];
    }
    return x;
}

/* adds the generalised force of a torque and a force on one body k: Jw_k^T torque + Jv_k^T force */
static inline void add_generalised_force(Column *to, const Part *b, vec3 torque, vec3 force)
{
    for (int i = 0; i < SPEEDS; i++) to->at[i] += dot(b->Jw[i], torque) + dot(b->Jv[i], force);
}

static inline Column inertial_loads(const Robot *robot, vec3 w, const double dq[JOINTS])
{
    Column b = {{0}};
    for (int k = 0; k < BODIES; k++) {
        const Part *part = &robot->part[k];
        vec3 z = vec(0, 0, 1), w_k = add(w, scale(part->sigma, z));
        vec3 relative = add(scale(dq[0], part->D[0]), scale(dq[1], part->D[1]));
        vec3 accel = sum3(cross(w, cross(w, part->rho)), scale(2, cross(w, relative)), part->c);
        vec3 alpha = scale(part->sigma, cross(w, z));
        vec3 torque = add(mul(part->inertia, alpha), cross(w_k, mul(part->inertia, w_k)));
        add_generalised_force(&b, part, torque, scale(part->mass, accel));
    }
    return b;
}

static inline Column gravity_gradient_loads(const Robot *robot, double g, vec3 a)
{
    Column Q = {{0}};
    for (int k = 0; k < BODIES; k++) {
        const Part *b = &robot->part[k];
        vec3 torque = scale(3 * g, cross(a, mul(b->inertia, a)));
        vec3 force = scale(g * b->mass, sub(scale(3 * dot(a, b->rho), a), b->rho));
        add_generalised_force(&Q, b, torque, force);
    }
    return Q;
}

#endif
