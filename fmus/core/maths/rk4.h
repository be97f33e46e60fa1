/* rk4.h - classical Runge-Kutta of fourth order on a plain array of doubles. */
#ifndef RK4_H
#define RK4_H

#include <stddef.h>

enum { RK4_MAX_STATES = 32 };

typedef void Derivative(const void *context, double t, const double *x, double *dx);

static inline void rk4(Derivative *f, const void *context, double t, double h, double *x, size_t n)
{
    double k1[RK4_MAX_STATES], k2[RK4_MAX_STATES], k3[RK4_MAX_STATES], k4[RK4_MAX_STATES],
        s[RK4_MAX_STATES];

    f(context, t, x, k1);
    for (size_t i = 0; i < n; i++) s[i] = x[i] + h / 2 * k1[i];
    f(context, t + h / 2, s, k2);
    for (size_t i = 0; i < n; i++) s[i] = x[i] + h / 2 * k2[i];
    f(context, t + h / 2, s, k3);
    for (size_t i = 0; i < n; i++) s[i] = x[i] + h * k3[i];
    f(context, t + h, s, k4);
    for (size_t i = 0; i < n; i++) x[i] += h / 6 * (k1[i] + 2 * k2[i] + 2 * k3[i] + k4[i]);
}

#endif
