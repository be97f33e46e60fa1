/* spline.h - cubic spline through equidistant nodes with zero slope at both ends.
 *
 * y_k, m_k: value and second derivative at node k, k = 0 to n; dt: distance of the nodes.
 *   2 m_0 + m_1 = 6 (y_1 - y_0)/dt^2
 *   m_{k-1} + 4 m_k + m_{k+1} = 6 (y_{k-1} - 2 y_k + y_{k+1})/dt^2
 *   m_{n-1} + 2 m_n = 6 (y_{n-1} - y_n)/dt^2 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SPLINE_H
#define SPLINE_H

#include "motion.h"

enum { SPLINE_MAX = 120 }; /* most intervals */

static inline void spline_curvature(int n, double dt, const vec3 *y, vec3 *m)
{
    double upper[SPLINE_MAX + 1] = {0}; /* upper diagonal of the matrix after elimination */
    for (int k = 0; k <= n; k++) {
        vec3 left = k > 0 ? sub(y[k - 1], y[k]) : vec(0, 0, 0);
        vec3 right = k < n ? sub(y[k + 1], y[k]) : vec(0, 0, 0);
        vec3 rhs = scale(6 / (dt * dt), add(left, right));
        double pivot = k == 0 ? 2 : (k < n ? 4 : 2) - upper[k - 1];
        upper[k] = 1 / pivot;
        m[k] = scale(1 / pivot, k > 0 ? sub(rhs, m[k - 1]) : rhs);
    }
    for (int k = n - 1; k >= 0; k--) m[k] = sub(m[k], scale(upper[k], m[k + 1]));
}

/* value and derivatives at the fraction b (0 .. 1) of interval k */
static inline Motion spline_at(double dt, const vec3 *y, const vec3 *m, int k, double b)
{
    double a = 1 - b, dt2 = dt * dt / 6;
    vec3 chord = scale(1 / dt, sub(y[k + 1], y[k]));
    return (Motion){sum4(scale(a, y[k]), scale(b, y[k + 1]), scale((a * a * a - a) * dt2, m[k]),
                         scale((b * b * b - b) * dt2, m[k + 1])),
                    sum3(chord, scale((1 - 3 * a * a) * dt / 6, m[k]),
                         scale((3 * b * b - 1) * dt / 6, m[k + 1])),
                    add(scale(a, m[k]), scale(b, m[k + 1]))};
}

#endif
