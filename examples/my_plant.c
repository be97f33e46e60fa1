/* my_plant.c - propellant that sloshes: a mass on a spring and a damper in a tank at the centre of
 * mass of the servicer.
 *
 *   f = m (omega^2 s + 2 zeta omega ds),   dds = -f/m - (F + f)/m_S
 *
 * s is the place of the mass m in the tank, S axes, m_S the rigid mass, F the force of the actuators,
 * f the force on the tank. The rotation of the servicer is neglected. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "fmu.h"
#include "rk4.h"
#include "time_grid.h"
#include "vec3.h"

typedef struct { double m, omega, zeta, max_step; } Parameters;
typedef struct {
    vec3 F_S;
    double mass;
} Input;
typedef struct { vec3 s, ds; } State;
typedef struct { vec3 s_S, F_slosh_S; } Output;
MODEL_STRUCT;

static const Model start = {.p = {.m = 5, .omega = 0.3, .zeta = 0.02, .max_step = 0.1},
                            .u = {.mass = 95}};

static const Variable variables[] = {
    POSITIVE(m, "kg", "mass that sloshes"),
    POSITIVE(omega, "rad/s", "frequency in a tank at rest"),
    NONNEGATIVE(zeta, "1", "damping ratio"),
    GRID(max_step, "largest internal step"),

    INPUT(F_S, "N", "force of the actuators, body axes"),
    INPUT(mass, "kg", "rigid mass of the servicer"),

    OUTPUT(s_S, "m", "place of the mass in the tank, body axes"),
    OUTPUT(F_slosh_S, "N", "force of the mass on the servicer, body axes"),
};

static void check(const Parameters *p, Problems *problems) { (void)p, (void)problems; }

typedef struct {
    const Parameters *p;
    const Input *u;
} Held; /* over a step */

static vec3 force(const Parameters *p, const State *x)
{
    return scale(p->m, add(scale(p->omega * p->omega, x->s), scale(2 * p->zeta * p->omega, x->ds)));
}

static void derivative(const Held *c, double t, const State *x, State *dx)
{
    vec3 f = force(c->p, x);
    (void)t;
    dx->s = x->ds;
    dx->ds = neg(add(scale(1 / c->p->m, f), scale(1 / c->u->mass, add(c->u->F_S, f))));
}
RK4(integrate, derivative, Held, State)

static void publish(const Parameters *p, const State *x, Output *y)
{
    *y = (Output){.s_S = x->s, .F_slosh_S = force(p, x)};
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    (void)u, (void)t;
    *x = (State){.s = {0, 0, 0}};
    publish(p, x, y);
}

/* the grid of the substeps is absolute: ends of master steps on this grid do not change results */
static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    const Held constant = {p, u};
    for (Substep s = first_substep(t, h, p->max_step); s.h > 0; s = next_substep(s))
        integrate(&constant, s.t, s.h, x);
    publish(p, x, y);
}

FMU_MODEL("my_plant", "Propellant that sloshes: a mass on a spring and a damper");
