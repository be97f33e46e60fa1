/* ideal_propulsion.c - commanded force and torque after saturation and a first-order lag.
 *
 *   c = command limited per axis;   tau dF/dt = c - F   (tau = 0: F = c)
 *   impulse = integral |F| dt per axis,   mdot = (|F_x| + |F_y| + |F_z|) / (Isp g_0)
 *
 * The solution is exact for a command that is constant over the step. A plant assumes that the
 * wrench published at the end of a step is constant during the next step; the resulting error is of
 * first order in step/tau. Equations: docs/models.md A.6. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "fmu.h"
#include "time_grid.h"
#include "vec3.h"

#define STANDARD_GRAVITY 9.80665 /* m/s2 */

typedef struct {
    vec3 F_max, M_max;
    double tau, Isp, max_step;
} Parameters;
typedef struct { vec3 F_cmd_S, M_cmd_S; } Input;
typedef struct { vec3 F, M, impulse, torque_impulse; } State;
typedef struct {
    vec3 F_S, M_S;
    double mdot;
    vec3 F_saturated, M_saturated, impulse, torque_impulse;
} Output;
MODEL_STRUCT;

static const Model start = {.p = {.max_step = 0.1}};

static const Variable variables[] = {
    NONNEGATIVE(F_max, "N", "largest force per body axis; 0 = no limit"),
    NONNEGATIVE(M_max, "N.m", "largest torque per body axis; 0 = no limit"),
    NONNEGATIVE(tau, "s", "time constant of the first-order lag; 0 = none"),
    NONNEGATIVE(Isp, "s", "specific impulse; 0 = no propellant is consumed"),
    GRID(max_step, "internal step"),

    INPUT(F_cmd_S, "N", "commanded force, body axes"),
    INPUT(M_cmd_S, "N.m", "commanded torque, body axes"),

    OUTPUT(F_S, "N", "force on the servicer, body axes"),
    OUTPUT(M_S, "N.m", "torque on the servicer about its centre of mass, body axes"),
    NONNEGATIVE_OUTPUT(mdot, "kg/s",
                       "propellant consumption: sum of |F_S| over the axes / (Isp g_0)"),
    FLAG(F_saturated, "1: the force command of this axis is above its limit"),
    FLAG(M_saturated, "1: the torque command of this axis is above its limit"),
    NONNEGATIVE_OUTPUT(impulse, "N.s", "integral of the absolute force per axis"),
    NONNEGATIVE_OUTPUT(torque_impulse, "N.m.s", "integral of the absolute torque per axis"),
};

static void check(const Parameters *p, Problems *problems) { (void)p, (void)problems; }

/* integral of F over the time h, in which F approaches c and does not change sign */
static double lag_integral(double F, double c, double tau, double h)
{
    return c * h - (F - c) * tau * exponential_less_1(-h / tau);
}

/* advances F of one axis over an internal step, F(t+h) = c + (F-c) exp(-h/tau), and adds the
 * integral of |F| to the impulse; the integral is split where F crosses zero */
static void advance_lag(double *F, double *impulse, double c, double tau, double h)
{
    double before = *F, after = tau > 0 ? before - (before - c) * -exponential_less_1(-h / tau) : c;
    *F = after;
    if (tau == 0) *impulse += fabs(c) * h;
    else if (before * after >= 0) *impulse += fabs(lag_integral(before, c, tau, h));
    else {
        double t_zero = tau * logarithm((before - c) / -c);
        *impulse +=
            fabs(lag_integral(before, c, tau, t_zero)) + fabs(lag_integral(0, c, tau, h - t_zero));
    }
}

static void advance_lag_3(vec3 *F, vec3 *impulse, vec3 c, double tau, double h)
{
    advance_lag(&F->x, &impulse->x, c.x, tau, h);
    advance_lag(&F->y, &impulse->y, c.y, tau, h);
    advance_lag(&F->z, &impulse->z, c.z, tau, h);
}

static void publish(const Parameters *p, const Input *u, const State *x, Output *y)
{
    y->F_S = x->F;
    y->M_S = x->M;
    y->mdot =
        p->Isp > 0 ? (fabs(x->F.x) + fabs(x->F.y) + fabs(x->F.z)) / (p->Isp * STANDARD_GRAVITY) : 0;
    y->F_saturated = unequal(u->F_cmd_S, limited3(u->F_cmd_S, p->F_max));
    y->M_saturated = unequal(u->M_cmd_S, limited3(u->M_cmd_S, p->M_max));
    y->impulse = x->impulse;
    y->torque_impulse = x->torque_impulse;
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    double no_lag = p->tau == 0; /* 1: F = c; with a lag the thrust starts from zero */
    (void)t;
    *x = (State){.F = scale(no_lag, limited3(u->F_cmd_S, p->F_max)),
                 .M = scale(no_lag, limited3(u->M_cmd_S, p->M_max))};
    publish(p, u, x, y);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Substep s = first_substep(t, h, p->max_step); s.h > 0; s = next_substep(s)) {
        advance_lag_3(&x->F, &x->impulse, limited3(u->F_cmd_S, p->F_max), p->tau, s.h);
        advance_lag_3(&x->M, &x->torque_impulse, limited3(u->M_cmd_S, p->M_max), p->tau, s.h);
    }
    publish(p, u, x, y);
}

FMU_MODEL("ideal_propulsion",
          "Ideal propulsion: commanded wrench after saturation and first-order lag");
