/* transposition_momentum.h - momentum of the gyros along an attitude history, and its derivatives
 * with respect to eps at the nodes. The momentum follows from the balance of momentum in N, by the
 * trapezoidal rule with four steps per node interval, which begin and end at fine points:
 *
 *   H_N(t) = H_N(0) + integral(C_NS tau),   h_cmg = C_SN H_N - (J_A omega_0 + h_m)
 *
 * eps: vector part of the quaternion relative to the flight attitude; H: total momentum; J_A:
 * inertia of the assembly; h_m: momentum of the relative motion of its two bodies; omega_0: rate of
 * the base; tau: torque of gravity gradient and drag (assembly.h). The matrix J contains the
 * derivatives of h = h_cmg with respect to eps at the nodes, by the chain rule: central differences
 * give the derivatives of h with respect to eps and eps' and of C_NS tau with respect to eps at one
 * instant; these are multiplied by the linear maps from eps at the nodes to eps and eps' of the
 * spline. Source: docs/models.md E.4. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef TRANSPOSITION_MOMENTUM_H
#define TRANSPOSITION_MOMENTUM_H

#include "assembly.h"
#include "transposition_history.h"

enum {
    MAX_UNKNOWN_NODES = MAX_NODES - 2, /* without the given eps_0 = eps_{N-1} = eps_N = 0 */
    MAX_UNKNOWNS = 3 * MAX_UNKNOWN_NODES
};

typedef enum { SCHEME_SPLINE, SCHEME_PATENT, SCHEME_AS_PRINTED } Scheme;

typedef struct {
    const Assembly *assembly;
    const Swing *swing;
    vec3 h_0_S;
    double limit, rotation_max;   /* N m s, rad */
    double alpha, lambda, weight; /* weight: p of the node weights (|h|/max |h|)^p */
    int max_iterations;
    Scheme scheme;
} Task;

/* ---- working memory: terms that do not depend on the attitude (at, C_oN, value, slope), momenta
 * along the history (H_N, h), and the normal equations ---- */
typedef struct {
    Configuration at[MAX_FINE + 1];
    mat3 C_oN[MAX_FINE + 1];
    double value[MAX_FINE + 1][MAX_UNKNOWN_NODES];  /* [][j]: d eps(fine point)/d eps_{j+1} */
    double slope[MAX_NODES + 1][MAX_UNKNOWN_NODES]; /* [][j]: d eps'(node)/d eps_{j+1} */
    vec3 H_N[MAX_FINE + 1], h[MAX_FINE + 1];
    mat3 sum[MAX_UNKNOWN_NODES];
    double jacobian[3][MAX_UNKNOWNS]; /* three rows of J for one node */
    double normal[MAX_UNKNOWNS][MAX_UNKNOWNS], step[MAX_UNKNOWNS];
    double largest; /* largest |h| of the history */
} Workspace;

static inline void prepare_basis(const History *shape, Workspace *w)
{
    History unit_node = *shape;
    for (int j = 0; j < intervals(shape) - 2; j++) {
        stay_in_flight_attitude(&unit_node);
        unit_node.eps[j + 1] = vec(1, 0, 0);
        update_spline(&unit_node);
        for (int m = 0; m <= FINE * intervals(shape); m++) {
            Motion e = fine_motion(&unit_node, m);
            w->value[m][j] = e.x.x;
            if (m % FINE == 0) w->slope[m / FINE][j] = e.d.x;
        }
    }
}

static inline void prepare(const Task *task, const History *shape, Workspace *w)
{
    for (int m = 0; m <= FINE * intervals(shape); m++) {
        double t = fine_time(shape, m);
        w->at[m] = configuration(task->assembly, arm_at(task->swing, t));
        w->C_oN[m] = dcm_of_quat(q_oN(task->assembly, t));
    }
    prepare_basis(shape, w);
}

/* ---- momentum along a history ---- */
static inline vec3 torque_N(const Task *task, const Workspace *w, int m, vec3 eps)
{
    mat3 C_So = dcm_of_quat((quat){sqrt(1 - dot(eps, eps)), eps.x, eps.y, eps.z});
    return tmul(w->C_oN[m], tmul(C_So, environment_torque(task->assembly, &w->at[m], C_So)));
}

/* gyro momentum h_cmg for the total momentum H_o in axes of the orbital frame o */
static inline vec3 momentum_of(const Task *task, const Configuration *c, vec3 H_o, Motion eps)
{
    BaseMotion s = base_motion(task->assembly, eps);
    return sub(mul(s.C_So, H_o), momentum_without_gyros(c, s.omega));
}

static inline void integrate(const Task *task, const History *y, Workspace *w)
{
    vec3 before = torque_N(task, w, 0, y->eps[0]);
    BaseMotion first = base_motion(task->assembly, fine_motion(y, 0));
    vec3 H_S = add(momentum_without_gyros(&w->at[0], first.omega), task->h_0_S);
    w->H_N[0] = tmul(w->C_oN[0], tmul(first.C_So, H_S));
    w->h[0] = task->h_0_S;
    for (int m = 1; m <= FINE * intervals(y); m++) {
        Motion eps = fine_motion(y, m);
        vec3 torque = torque_N(task, w, m, eps.x);
        w->H_N[m] = add(w->H_N[m - 1], scale(y->dt / FINE / 2, add(before, torque)));
        w->h[m] = momentum_of(task, &w->at[m], mul(w->C_oN[m], w->H_N[m]), eps);
        before = torque;
    }
}

/* ---- Jacobian ---- */
static const double difference = 1e-5;

static inline vec3 moved(vec3 a, int axis, double by)
{
    return add(a, vec(axis == 0 ? by : 0, axis == 1 ? by : 0, axis == 2 ? by : 0));
}
static inline mat3 columns_of(const vec3 up[3], const vec3 down[3], double distance)
{
    mat3 t;
    for (int c = 0; c < 3; c++) t.row[c] = scale(1 / (2 * distance), sub(up[c], down[c]));
    return transpose(t);
}

static inline mat3 torque_by_eps(const Task *task, const Workspace *w, int m, vec3 eps)
{
    vec3 up[3], down[3];
    for (int c = 0; c < 3; c++) {
        up[c] = torque_N(task, w, m, moved(eps, c, difference));
        down[c] = torque_N(task, w, m, moved(eps, c, -difference));
    }
    return columns_of(up, down, difference);
}

/* derivative of momentum_of() with respect to eps (rate = 0) or eps' (rate = 1) */
static inline mat3 momentum_by(const Task *task, const Workspace *w, int m, Motion eps, int rate)
{
    vec3 up[3], down[3], H_o = mul(w->C_oN[m], w->H_N[m]);
    for (int c = 0; c < 3; c++) {
        Motion plus_c = eps, minus_c = eps;
        *(rate ? &plus_c.d : &plus_c.x) = moved(rate ? eps.d : eps.x, c, difference);
        *(rate ? &minus_c.d : &minus_c.x) = moved(rate ? eps.d : eps.x, c, -difference);
        up[c] = momentum_of(task, &w->at[m], H_o, plus_c);
        down[c] = momentum_of(task, &w->at[m], H_o, minus_c);
    }
    return columns_of(up, down, difference);
}

static inline void store_block(Workspace *w, int j, mat3 block) /* dh_k/deps_{j+1} */
{
    for (int r = 0; r < 3; r++) {
        double *to = &w->jacobian[r][3 * j];
        to[0] = block.row[r].x;
        to[1] = block.row[r].y;
        to[2] = block.row[r].z;
    }
}

/* ---- normal equations ---- */
static inline double weight_of(const Task *task, vec3 h, double largest) /* (|h|/max)^p */
{
    double weight = 1;
    for (int i = 0; i < (int)task->weight; i++) weight *= norm(h) / largest;
    return weight;
}

/* adds one row of J: normal += weight row^T row, lower triangle only; step += weight row h */
static inline void add_row(Workspace *w, int unknowns, const double *row, double weight, double h)
{
    for (int i = 0; i < unknowns; i++) {
        double factor = weight * row[i];
        for (int j = 0; j <= i; j++) w->normal[i][j] += factor * row[j];
        w->step[i] += factor * h;
    }
}

/* adds the three rows of J for node k, which w->jacobian contains, to the normal equations; only
 * the rows of one node are stored at a time */
static inline void add_node(const Task *task, const History *y, Workspace *w, int k)
{
    vec3 h = w->h[FINE * k];
    double values[3] = {h.x, h.y, h.z}, weight = weight_of(task, h, w->largest);
    for (int r = 0; r < 3; r++)
        add_row(w, 3 * (intervals(y) - 2), w->jacobian[r], weight, values[r]);
}

/* adds the rows of J for node k to the normal equations:
 * dh_k/deps_j = C_SN integral(d(C_NS tau)/deps deps/deps_j) + (dh/deps) delta_jk
 *               + (dh/deps') deps'/deps_j,   delta_jk: 1 if j = k, else 0 */
static inline void add_momentum_of_node(const Task *task, const History *y, Workspace *w, int k)
{
    Motion eps = fine_motion(y, FINE * k);
    mat3 C_SN = matmul(base_motion(task->assembly, eps).C_So, w->C_oN[FINE * k]);
    mat3 by_eps = momentum_by(task, w, FINE * k, eps, 0),
         by_rate = momentum_by(task, w, FINE * k, eps, 1);
    for (int j = 0; j < intervals(y) - 2; j++) {
        mat3 block = plus(matmul(C_SN, w->sum[j]), scaled(w->slope[k][j], by_rate));
        store_block(w, j, j + 1 == k ? plus(block, by_eps) : block);
    }
    add_node(task, y, w, k);
}

/* adds J^T W J and J^T W h to the normal equations */
static inline void spline_jacobian(const Task *task, const History *y, Workspace *w)
{
    mat3 before = torque_by_eps(task, w, 0, y->eps[0]);
    for (int j = 0; j < intervals(y) - 2; j++) w->sum[j] = diagonal(0, 0, 0);
    for (int m = 1; m <= FINE * intervals(y); m++) {
        mat3 here = torque_by_eps(task, w, m, fine_motion(y, m).x);
        for (int j = 0; j < intervals(y) - 2; j++)
            w->sum[j] =
                plus(w->sum[j], scaled(y->dt / FINE / 2, plus(scaled(w->value[m - 1][j], before),
                                                              scaled(w->value[m][j], here))));
        if (m % FINE == 0) add_momentum_of_node(task, y, w, m / FINE);
        before = here;
    }
}

#endif
