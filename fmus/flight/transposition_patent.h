/* transposition_patent.h - momentum of the gyros along an attitude history, discretised as in the
 * patent: differences of eps between nodes, explicit Euler steps for the momentum.
 *
 *   eps'  = (e_{k+1} - e_k)/dt
 *   eps'' = (e_{k+1} - 2 e_k + e_{k-1})/dt^2,   as printed: (e_{k+1} + 2 e_k - e_{k-1})/dt^2
 *   h_{k+1} = h_k + dt h'(e_{k-1}, e_k, e_{k+1}, h_k)
 *
 * eps: vector part of the quaternion relative to the flight attitude, e_k: eps at node k, dt: time
 * between nodes, h: momentum of the gyros. Scheme 1 uses the first form of eps'', scheme 2 the form
 * that the patent prints. Source: patent CN106020225A; docs/models.md E.4. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef TRANSPOSITION_PATENT_H
#define TRANSPOSITION_PATENT_H

#include "transposition_momentum.h"

static inline vec3 patent_rate(const Task *task, const Configuration *c, double dt, const vec3 e[3],
                               vec3 h)
{
    double middle = task->scheme == SCHEME_AS_PRINTED ? 2 : -2;
    vec3 dd = scale(1 / (dt * dt), sum3(e[2], scale(middle, e[1]),
                                        task->scheme == SCHEME_AS_PRINTED ? neg(e[0]) : e[0]));
    BaseMotion s = base_motion(task->assembly, (Motion){e[1], scale(1 / dt, sub(e[2], e[1])), dd});
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

/* dh_{k+1} = (1 - dt [omega]x) dh_k + dt sum_i dh'/de_i de_i, i: the three nodes of a step */
static inline void patent_jacobian(const Task *task, const History *y, Workspace *w)
{
    vec3 e[3];
    int unknown_nodes = intervals(y) - 2;
    for (int j = 0; j < unknown_nodes; j++) w->sum[j] = diagonal(0, 0, 0);
    for (int k = 0; k < intervals(y); k++) {
        const Configuration *c = &w->at[FINE * k];
        three_nodes(y, k, e);
        Motion eps = {e[1], scale(1 / y->dt, sub(e[2], e[1])), vec(0, 0, 0)};
        mat3 spin = tilde(base_motion(task->assembly, eps).omega);
        mat3 turn = minus(diagonal(1, 1, 1), scaled(y->dt, spin));
        for (int j = 0; j < unknown_nodes; j++) w->sum[j] = matmul(turn, w->sum[j]);
        for (int i = 0; i < 3; i++) {
            int j = k + i - 2; /* index of node k + i - 1 among the unknown nodes */
            if (j < 0 || j >= unknown_nodes) continue;
            mat3 by = patent_rate_by(task, c, y->dt, i, e, w->h[FINE * k]);
            w->sum[j] = plus(w->sum[j], scaled(y->dt, by));
        }
        for (int j = 0; j < unknown_nodes; j++) store_block(w, j, w->sum[j]);
        add_node(task, y, w, k + 1);
    }
}

#endif
