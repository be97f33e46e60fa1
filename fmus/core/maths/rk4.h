/* rk4.h - classical Runge-Kutta of fourth order on a struct of doubles.
 *
 *     static void derivative(const Context *c, double t, const State *x, State *dx);
 *     RK4(integrate, derivative, Context, State)
 *
 * defines  integrate(const Context *c, double t, double h, State *x),  a step from t to t + h.
 * Models call rk4() only through this macro, which checks the types of the derivative. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef RK4_H
#define RK4_H

#include <stddef.h>

enum { RK4_MAX_STATES = 40 };

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

/* defines `name`, an integrator of `derivative`. Its arrays hold at most RK4_MAX_STATES numbers:
 * a larger State does not compile. */
#define RK4(name, derivative, Context, State)                                                   \
    typedef char name##_fits[sizeof(State) <= RK4_MAX_STATES * sizeof(double) ? 1 : -1];        \
    static inline void name##_rates(const void *context, double t, const double *x, double *dx) \
    {                                                                                           \
        derivative((const Context *)context, t, (const State *)(const void *)x,                 \
                   (State *)(void *)dx);                                                        \
    }                                                                                           \
    static inline void name(const Context *context, double t, double h, State *x)               \
    {                                                                                           \
        rk4(name##_rates, context, t, h, (double *)(void *)x, sizeof *x / sizeof(double));      \
    }

#endif
