/* transposition_history.h - attitude history of the assembly: eps, the vector part of the
 * quaternion relative to the flight attitude (attitude zero of assembly.h: X along the velocity, Z
 * to the Earth). eps is given at the nodes of an equidistant grid in time, with a cubic spline
 * between them that has zero slope at both ends of the grid. Outside the times of the grid the
 * assembly is at rest in the flight attitude. Source: docs/models.md E.4. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef TRANSPOSITION_HISTORY_H
#define TRANSPOSITION_HISTORY_H

#include "index.h"
#include "spline.h"

enum {
    MAX_NODES = SPLINE_MAX,
    FINE = 4, /* steps of the momentum history per node interval, between fine points */
    MAX_FINE = FINE * MAX_NODES
};

typedef struct {
    double n, t_0, dt; /* number of intervals, time of node 0 [s], interval [s] */
    vec3 eps[MAX_NODES + 1], curvature[MAX_NODES + 1];
} History;

static inline int intervals(const History *y) { return (int)y->n; }

static inline Motion history_at(const History *y, double t) /* at rest outside the grid */
{
    double u = (t - y->t_0) / y->dt;
    if (!(u >= 0 && u < y->n)) return (Motion){vec(0, 0, 0), vec(0, 0, 0), vec(0, 0, 0)};
    int k = index_within(u, intervals(y) - 1);
    return spline_at(y->dt, y->eps, y->curvature, k, u - k);
}

static inline void update_spline(History *y)
{
    spline_curvature(intervals(y), y->dt, y->eps, y->curvature);
}

static inline void stay_in_flight_attitude(History *y)
{
    for (int k = 0; k <= intervals(y); k++) y->eps[k] = y->curvature[k] = vec(0, 0, 0);
}

static inline double fine_time(const History *y, int m) { return y->t_0 + m * y->dt / FINE; }

static inline Motion fine_motion(const History *y, int m)
{
    int k = m < FINE * intervals(y) ? m / FINE : intervals(y) - 1;
    return spline_at(y->dt, y->eps, y->curvature, k, (double)(m - FINE * k) / FINE);
}

/* largest |eps| at the nodes and the quarter points between them */
static inline double largest_eps(const History *y)
{
    double largest = 0;
    for (int m = 0; m <= FINE * intervals(y); m++)
        largest = larger(largest, norm(fine_motion(y, m).x));
    return largest;
}

#endif
