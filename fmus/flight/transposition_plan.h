/* transposition_plan.h - attitude history of an assembly along which the momentum of its gyros
 * stays below a limit.
 *
 * Unknown: eps at the nodes 1 .. N-2 of an equidistant grid; eps_0 = eps_{N-1} = eps_N = 0. Between
 * the nodes eps is a cubic spline with zero slope at both ends. Momentum by the balance about N,
 *
 *   H_N(t) = H_N(0) + integral(C_NS tau),   h_cmg = C_SN H_N - (J_A omega_0 + h_m),
 *
 * trapezoidal rule on a quarter of the grid. Until max |h| on that finer grid is below the limit:
 *
 *   eps <- eps - alpha (J^T W J + lambda S)^-1 J^T W h,   J = dh/deps,
 *   S = D2^T D2 (x) 1_3/dt^4,   D2: second difference
 *
 * J by central differences of what is local, dh/deps, dh/deps' and d(C_NS tau)/deps at one instant,
 * chained with the linear map from the nodes to spline and slope. The patent's own discretisation
 * (SCHEME_PATENT) takes differences of the nodes and explicit Euler steps for h instead. Working
 * memory is allocated for the time of planning only. Source: docs/models.md E.4. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef TRANSPOSITION_PLAN_H
#define TRANSPOSITION_PLAN_H

#include "assembly.h"
#include "cholesky.h"
#include "spline.h"

#include <stdlib.h>

enum {
    MAX_NODES = SPLINE_MAX,
    FINE = 4, /* steps of the momentum history from node to node */
    MAX_FINE = FINE * MAX_NODES,
    MAX_UNKNOWN_NODES = MAX_NODES - 2,
    MAX_UNKNOWNS = 3 * MAX_UNKNOWN_NODES,
    MAX_ITERATIONS = 30
};

typedef enum { SCHEME_SPLINE, SCHEME_PATENT, SCHEME_AS_PRINTED } Scheme;
typedef enum { PLANNED, FLIGHT_ATTITUDE, NOT_BELOW_LIMIT, ROTATION_TOO_LARGE, NO_MEMORY } Status;

typedef struct {
    const Assembly *assembly;
    const Swing *swing;
    vec3 h_0_S;
    double limit, rotation_max;   /* N m s, rad */
    double alpha, lambda, weight; /* weight: power of |h|/max in W */
    int max_iterations;
    Scheme scheme;
} Task;

typedef struct {
    double n, t_0, dt; /* n intervals */
    vec3 eps[MAX_NODES + 1], curvature[MAX_NODES + 1];
} History;

typedef struct {
    Status status;
    int iterations;
    double peak[MAX_ITERATIONS + 1], rotation[MAX_ITERATIONS + 1]; /* before each iteration */
} Result;

static inline int intervals(const History *y) { return (int)y->n; }

static inline Motion history_at(const History *y, double t) /* at rest outside the window */
{
    double u = (t - y->t_0) / y->dt;
    if (!(u >= 0 && u < y->n)) return (Motion){vec(0, 0, 0), vec(0, 0, 0), vec(0, 0, 0)};
    int k = (int)floor_of(u);
    return spline_at(y->dt, y->eps, y->curvature, k, u - k);
}

static inline void bend(History *y) { spline_curvature(intervals(y), y->dt, y->eps, y->curvature); }

static inline void stay_in_flight_attitude(History *y)
{
    for (int k = 0; k <= intervals(y); k++) y->eps[k] = y->curvature[k] = vec(0, 0, 0);
}

/* ---- working memory: what does not depend on the attitude, and the normal equations ---- */
typedef struct {
    Configuration at[MAX_FINE + 1];
    mat3 C_oN[MAX_FINE + 1];
    double value[MAX_FINE + 1][MAX_UNKNOWN_NODES];  /* d eps(fine point)/d eps_j */
    double slope[MAX_NODES + 1][MAX_UNKNOWN_NODES]; /* d eps'(node)/d eps_j */
    vec3 H_N[MAX_FINE + 1], h[MAX_FINE + 1];
    mat3 sum[MAX_UNKNOWN_NODES];
    double jacobian[3 * MAX_NODES][MAX_UNKNOWNS], normal[MAX_UNKNOWNS][MAX_UNKNOWNS],
        step[MAX_UNKNOWNS];
} Workspace;

static inline double fine_time(const History *y, int m) { return y->t_0 + m * y->dt / FINE; }

static inline Motion fine_motion(const History *y, int m)
{
    int k = m < FINE * intervals(y) ? m / FINE : intervals(y) - 1;
    return spline_at(y->dt, y->eps, y->curvature, k, (double)(m - FINE * k) / FINE);
}

static inline void prepare_basis(const History *shape, Workspace *w)
{
    History unit_node = *shape;
    for (int j = 0; j < intervals(shape) - 2; j++) {
        stay_in_flight_attitude(&unit_node);
        unit_node.eps[j + 1] = vec(1, 0, 0);
        bend(&unit_node);
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

/* h_cmg for a given total momentum */
static inline vec3 momentum_of(const Task *task, const Configuration *c, vec3 H_o, Motion eps)
{
    Turning s = turning(task->assembly, eps);
    return sub(mul(s.C_So, H_o), carried_momentum(c, s.omega));
}

static inline void integrate(const Task *task, const History *y, Workspace *w)
{
    vec3 before = torque_N(task, w, 0, y->eps[0]);
    Turning first = turning(task->assembly, fine_motion(y, 0));
    vec3 H_S = add(carried_momentum(&w->at[0], first.omega), task->h_0_S);
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

/* of momentum_of by eps (rate = 0) or eps' (rate = 1) */
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

static inline void store_block(Workspace *w, int k, int j, mat3 block) /* dh_k/deps_{j+1} */
{
    for (int r = 0; r < 3; r++) {
        double *to = &w->jacobian[3 * (k - 1) + r][3 * j];
        to[0] = block.row[r].x;
        to[1] = block.row[r].y;
        to[2] = block.row[r].z;
    }
}

/* dh_k/deps_j = C_SN integral(d(C_NS tau)/deps deps/deps_j) + (dh/deps) delta_jk + (dh/deps')
 * deps'/deps_j */
static inline void jacobian_row(const Task *task, const History *y, Workspace *w, int k)
{
    Motion eps = fine_motion(y, FINE * k);
    mat3 C_SN = matmul(turning(task->assembly, eps).C_So, w->C_oN[FINE * k]);
    mat3 by_eps = momentum_by(task, w, FINE * k, eps, 0),
         by_rate = momentum_by(task, w, FINE * k, eps, 1);
    for (int j = 0; j < intervals(y) - 2; j++) {
        mat3 block = plus(matmul(C_SN, w->sum[j]), scaled(w->slope[k][j], by_rate));
        store_block(w, k, j, j + 1 == k ? plus(block, by_eps) : block);
    }
}

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
        if (m % FINE == 0) jacobian_row(task, y, w, m / FINE);
        before = here;
    }
}

/* ---- the patent's differences: eps' = (e_{k+1} - e_k)/dt,
 * eps'' = (e_{k+1} - 2 e_k + e_{k-1})/dt^2, printed (e_{k+1} + 2 e_k - e_{k-1})/dt^2,
 * h_{k+1} = h_k + dt h'(e_{k-1}, e_k, e_{k+1}, h_k) ---- */
static inline vec3 patent_rate(const Task *task, const Configuration *c, double dt, const vec3 e[3],
                               vec3 h)
{
    double middle = task->scheme == SCHEME_AS_PRINTED ? 2 : -2;
    vec3 dd = scale(1 / (dt * dt), sum3(e[2], scale(middle, e[1]),
                                        task->scheme == SCHEME_AS_PRINTED ? neg(e[0]) : e[0]));
    Turning s = turning(task->assembly, (Motion){e[1], scale(1 / dt, sub(e[2], e[1])), dd});
    return momentum_rate(c, s.omega, s.domega, h, environment_torque(task->assembly, c, s.C_So));
}

static inline void three_nodes(const History *y, int k, vec3 e[3])
{
    e[0] = y->eps[k > 0 ? k - 1 : 0];
    e[1] = y->eps[k];
    e[2] = y->eps[k + 1];
}

static inline void patent_history(const Task *task, const History *y, Workspace *w)
{
    vec3 e[3];
    w->h[0] = task->h_0_S;
    for (int k = 0; k < intervals(y); k++) {
        const Configuration *c = &w->at[FINE * k];
        three_nodes(y, k, e);
        vec3 rate = patent_rate(task, c, y->dt, e, w->h[FINE * k]);
        w->h[FINE * (k + 1)] = add(w->h[FINE * k], scale(y->dt, rate));
    }
}

static inline mat3 patent_rate_by(const Task *task, const Configuration *c, double dt, int node,
                                  const vec3 e[3], vec3 h)
{
    vec3 up[3], down[3], changed[3] = {e[0], e[1], e[2]};
    for (int axis = 0; axis < 3; axis++) {
        changed[node] = moved(e[node], axis, difference);
        up[axis] = patent_rate(task, c, dt, changed, h);
        changed[node] = moved(e[node], axis, -difference);
        down[axis] = patent_rate(task, c, dt, changed, h);
    }
    return columns_of(up, down, difference);
}

/* dh_{k+1} = (1 - dt [omega]x) dh_k + dt dh'/de_i de_i */
static inline void patent_jacobian(const Task *task, const History *y, Workspace *w)
{
    vec3 e[3];
    int unknown_nodes = intervals(y) - 2;
    for (int j = 0; j < unknown_nodes; j++) w->sum[j] = diagonal(0, 0, 0);
    for (int k = 0; k < intervals(y); k++) {
        const Configuration *c = &w->at[FINE * k];
        three_nodes(y, k, e);
        Motion eps = {e[1], scale(1 / y->dt, sub(e[2], e[1])), vec(0, 0, 0)};
        mat3 spin = tilde(turning(task->assembly, eps).omega);
        mat3 turn = minus(diagonal(1, 1, 1), scaled(y->dt, spin));
        for (int j = 0; j < unknown_nodes; j++) w->sum[j] = matmul(turn, w->sum[j]);
        for (int i = 0; i < 3; i++) {
            int j = k + i - 2; /* node k + i - 1 is unknown number j */
            if (j < 0 || j >= unknown_nodes) continue;
            mat3 by = patent_rate_by(task, c, y->dt, i, e, w->h[FINE * k]);
            w->sum[j] = plus(w->sum[j], scaled(y->dt, by));
        }
        for (int j = 0; j < unknown_nodes; j++) store_block(w, k + 1, j, w->sum[j]);
    }
}

/* ---- the iteration ---- */
static inline double largest_momentum(const Task *task, const History *y, const Workspace *w)
{
    double largest = 0;
    int stride = task->scheme == SCHEME_SPLINE ? 1 : FINE;
    for (int m = 0; m <= FINE * intervals(y); m += stride) largest = larger(largest, norm(w->h[m]));
    return largest;
}

static inline double largest_eps(const History *y) /* of spline and nodes */
{
    double largest = 0;
    for (int m = 0; m <= FINE * intervals(y); m++)
        largest = larger(largest, norm(fine_motion(y, m).x));
    return largest;
}

static inline double weight_of(const Task *task, vec3 h, double largest) /* (|h|/max)^p */
{
    double weight = 1;
    for (int i = 0; i < (int)task->weight; i++) weight *= norm(h) / largest;
    return weight;
}

/* normal += row^T row for one row of J, lower triangle; step += row h */
static inline void add_row(Workspace *w, int unknowns, const double *row, double weight, double h)
{
    for (int i = 0; i < unknowns; i++) {
        double factor = weight * row[i];
        for (int j = 0; j <= i; j++) w->normal[i][j] += factor * row[j];
        w->step[i] += factor * h;
    }
}

/* D2^T D2: 5 or 6 on the diagonal, -4, 1 beside it */
static inline void add_smoothing(Workspace *w, int nodes, double strength)
{
    for (int j = 0; j < nodes; j++)
        for (int c = 0; c < 3; c++) {
            int i = 3 * j + c;
            w->normal[i][i] += strength * (j == 0 || j == nodes - 1 ? 5 : 6);
            if (j >= 1) w->normal[i][i - 3] -= 4 * strength;
            if (j >= 2) w->normal[i][i - 6] += strength;
        }
}

static inline int descend(const Task *task, History *y, Workspace *w, double largest)
{
    int nodes = intervals(y) - 2, unknowns = 3 * nodes;
    for (int i = 0; i < unknowns; i++) {
        w->step[i] = 0;
        for (int j = 0; j <= i; j++) w->normal[i][j] = 0;
    }
    for (int k = 1; k <= intervals(y); k++) {
        vec3 h = w->h[FINE * k];
        double values[3] = {h.x, h.y, h.z}, weight = weight_of(task, h, largest);
        for (int r = 0; r < 3; r++)
            add_row(w, unknowns, w->jacobian[3 * (k - 1) + r], weight, values[r]);
    }
    add_smoothing(w, nodes, task->lambda / (y->dt * y->dt * y->dt * y->dt));
    if (!cholesky(&w->normal[0][0], unknowns, MAX_UNKNOWNS)) return 0;
    cholesky_solve(&w->normal[0][0], unknowns, MAX_UNKNOWNS, w->step);
    for (int j = 0; j < nodes; j++) {
        const double *d = &w->step[3 * j];
        y->eps[j + 1] = sub(y->eps[j + 1], scale(task->alpha, vec(d[0], d[1], d[2])));
    }
    bend(y);
    return 1;
}

static inline Result iterate(const Task *task, History *y, Workspace *w)
{
    Result r = {.status = NOT_BELOW_LIMIT};
    int spline = task->scheme == SCHEME_SPLINE;
    for (;; r.iterations++) {
        double eps = largest_eps(y);
        r.rotation[r.iterations] =
            eps < 1 ? 2 * arc_tangent(eps, sqrt(1 - eps * eps)) : 2 * arc_tangent(1, 0);
        if (!(r.rotation[r.iterations] <= task->rotation_max))
            return r.status = ROTATION_TOO_LARGE, r;
        (spline ? integrate : patent_history)(task, y, w);
        double largest = r.peak[r.iterations] = largest_momentum(task, y, w);
        if (largest < task->limit) return r.status = PLANNED, r;
        if (r.iterations >= task->max_iterations) return r;
        (spline ? spline_jacobian : patent_jacobian)(task, y, w);
        if (!descend(task, y, w, largest)) return r;
    }
}

/* From the flight attitude to a history whose momentum stays below the limit; without one the
 * history is the flight attitude. */
static inline Result plan(const Task *task, History *y)
{
    Result r = {.status = NO_MEMORY};
    Workspace *w = malloc(sizeof *w);
    stay_in_flight_attitude(y);
    if (!w) return r;
    prepare(task, y, w);
    r = iterate(task, y, w);
    free(w);
    if (r.status != PLANNED) stay_in_flight_attitude(y);
    return r;
}

#endif
