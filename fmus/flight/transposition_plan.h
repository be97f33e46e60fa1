/* transposition_plan.h - attitude history of an assembly along which the momentum of its gyros
 * stays below a limit.
 *
 * Unknown: eps at the nodes 1 .. N-2 of an equidistant grid; eps_0 = eps_{N-1} = eps_N = 0. The
 * iteration succeeds when max |h| is below the limit, for the spline also at the quarters of the
 * intervals:
 *
 *   eps <- eps - alpha (J^T W J + lambda S)^-1 J^T W h,   J = dh/deps,
 *   S = D2^T D2 (x) 1_3/dt^4,   D2: second difference
 *
 * eps: attitude relative to the flight attitude (X along the velocity, Z to the Earth), vector part
 * of the quaternion; h: momentum of the gyros at the nodes; W: diagonal matrix of the weights
 * (|h|/max |h|)^weight of the nodes; (x): Kronecker product. h and J are computed by spline and
 * balance of momentum (transposition_momentum.h) or by the differences of patent CN106020225A
 * (transposition_patent.h). Source: docs/models.md E.4. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef TRANSPOSITION_PLAN_H
#define TRANSPOSITION_PLAN_H

#include "cholesky.h"
#include "transposition_momentum.h"
#include "transposition_patent.h"

enum { MAX_ITERATIONS = 30 };

typedef enum { PLANNED, FLIGHT_ATTITUDE, NOT_BELOW_LIMIT, ROTATION_TOO_LARGE } Status;

typedef struct {
    Status status;
    int iterations;
    /* largest |h|, and largest rotation from the flight attitude: before each iteration, then
     * after the last one; with ROTATION_TOO_LARGE the last |h| is not computed and stays 0 */
    double peak[MAX_ITERATIONS + 1], rotation[MAX_ITERATIONS + 1];
} Result;

static inline double largest_momentum(const Task *task, const History *y, const Workspace *w)
{
    double largest = 0;
    int stride = task->scheme == SCHEME_SPLINE ? 1 : FINE;
    for (int m = 0; m <= FINE * intervals(y); m += stride) largest = larger(largest, norm(w->h[m]));
    return largest;
}

/* adds strength D2^T D2 (x) 1_3 to the lower triangle of w->normal. D2^T D2 has 6 on the diagonal
 * (5 at the first and the last node), -4 between adjacent nodes and 1 between nodes two apart. */
static inline void add_smoothing(Workspace *w, int nodes, double strength)
{
    for (int j = 0; j < nodes; j++)
        for (int c = 0; c < 3; c++) {
            int i = 3 * j + c;
            w->normal[i][i] += strength * (j == 0 || j == nodes - 1 ? 5 : 6);
            if (j >= 1) w->normal[i][3 * (j - 1) + c] -= 4 * strength;
            if (j >= 2) w->normal[i][3 * (j - 2) + c] += strength;
        }
}

static inline void clear_equations(Workspace *w, int unknowns)
{
    for (int i = 0; i < unknowns; i++) {
        w->step[i] = 0;
        for (int j = 0; j <= i; j++) w->normal[i][j] = 0;
    }
}

static inline int descend(const Task *task, History *y, Workspace *w)
{
    int nodes = intervals(y) - 2, unknowns = 3 * nodes;
    clear_equations(w, unknowns);
    (task->scheme == SCHEME_SPLINE ? spline_jacobian : patent_jacobian)(task, y, w);
    add_smoothing(w, nodes, task->lambda / (y->dt * y->dt * y->dt * y->dt));
    if (!cholesky(&w->normal[0][0], unknowns, MAX_UNKNOWNS)) return 0;
    cholesky_solve(&w->normal[0][0], unknowns, MAX_UNKNOWNS, w->step);
    for (int j = 0; j < nodes; j++) {
        const double *d = &w->step[3 * j];
        y->eps[j + 1] = sub(y->eps[j + 1], scale(task->alpha, vec(d[0], d[1], d[2])));
    }
    update_spline(y);
    return 1;
}

static inline Result iterate(const Task *task, History *y, Workspace *w)
{
    Result r = {.status = NOT_BELOW_LIMIT};
    for (;; r.iterations++) {
        double eps = largest_eps(y);
        r.rotation[r.iterations] =
            eps < 1 ? 2 * arc_tangent(eps, sqrt(1 - eps * eps)) : 2 * arc_tangent(1, 0);
        if (!(r.rotation[r.iterations] <= task->rotation_max))
            return r.status = ROTATION_TOO_LARGE, r;
        (task->scheme == SCHEME_SPLINE ? integrate : patent_history)(task, y, w);
        w->largest = r.peak[r.iterations] = largest_momentum(task, y, w);
        if (w->largest < task->limit) return r.status = PLANNED, r;
        if (r.iterations >= task->max_iterations) return r;
        if (!descend(task, y, w)) return r;
    }
}

/* plans an attitude history along which the momentum of the gyros stays below the limit. The
 * iteration starts from a constant flight attitude, which is also the result if it fails. */
static inline Result plan(const Task *task, History *y, Workspace *w)
{
    stay_in_flight_attitude(y);
    prepare(task, y, w);
    Result r = iterate(task, y, w);
    if (r.status != PLANNED) stay_in_flight_attitude(y);
    return r;
}

#endif
