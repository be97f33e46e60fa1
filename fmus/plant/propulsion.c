/* propulsion.c - propulsion unit of up to 16 thrusters with switching delay, rise and fall, sampled
 * every T0.
 *
 *   command   P_nom throttle
 *   delay     the present command is adopted after more than Tl/T0 calls in which it differs from
 *             the adopted one (the thrust responds to an on-off command exactly Tl later)
 *   lag       P += k (delayed - P),   k = T0/T2 or 1 - exp(-T0/T2),
 *           T2 = T2up where delayed is not 0, else T2dn
 *   wrench    F = sum P R,   M = sum (L - D_cm) x (P R),   mdot = sum P / (Isp g_0)
 *   impulse   integral of P: each call adds P T0
 *
 * P: thrust of a thruster, P_nom: nominal thrust, L, R: position and direction, D_cm: centre of
 * mass. k is T0/T2, at most 1, or with exact_lag = 1 the second formula. In the lag, a fault
 * replaces `delayed` by the thrust that remains with this fault. A call is the evaluation of the
 * unit at a multiple of T0, for any communication step; a call reads the inputs of the step that
 * contains it. Between calls the thrust is constant, so with a communication step above T0 the
 * published wrench is the wrench of the last call. Source: Kozlova & Fomichev 2023, in which the
 * fall constant, the moment and the delay counter are corrected (docs/models.md B.8). */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "thrusters.h"
#include "time_grid.h"

#define STANDARD_GRAVITY 9.80665 /* m/s2 */

typedef struct {
    Thrusters thrusters;
    double T0, Tl, T2up, T2dn, exact_lag, latch, Isp;
    double fault_kind[THRUSTERS], fault_factor[THRUSTERS], fault_time[THRUSTERS];
} Parameters;
typedef struct { double throttle[THRUSTERS]; } Input;
typedef struct {
    double command, delayed, calls_waited, thrust, impulse, switches;
} Engine; /* units of the members in their order: N, N, calls, N, N.s, 1 */
typedef struct { Engine engine[THRUSTERS]; } State;
typedef struct {
    vec3 F_S, M_S;
    double mdot, thrust[THRUSTERS], impulse[THRUSTERS], switches[THRUSTERS];
} Output;
MODEL_STRUCT;

typedef enum { NO_FAULT, STUCK_ON, STUCK_OFF, REDUCED, FAULT_KINDS } FaultKind;

static const Model start = {
    .p = {.thrusters = PAPER_THRUSTERS, .T0 = 0.1, .Tl = 0.1, .T2up = 0.3, .T2dn = 0.7},
};

static const Variable variables[] = {
    THRUSTER_ROWS(thrusters),
    GRID(T0, "update period: the commands are read and the thrust changes at multiples of T0"),
    NONNEGATIVE(Tl, "s", "switching delay"),
    NONNEGATIVE(T2up, "s", "time constant of the rise; no lag if it is below T0 and exact_lag = 0"),
    NONNEGATIVE(T2dn, "s", "time constant of the fall; no lag if it is below T0 and exact_lag = 0"),
    SWITCH(exact_lag, "lag: 0 = Euler step of length T0, 1 = exact for a command held over T0"),
    SWITCH(latch,
           "1: the delay counter always runs: a command is adopted only every Tl/T0 + 1 updates"),
    NONNEGATIVE(Isp, "s", "specific impulse; 0 = no propellant is consumed"),
    NONNEGATIVE(fault_kind, "1",
                "fault, per thruster: 0 none, 1 stuck on, 2 stuck off, 3 reduced to fault_factor"),
    NONNEGATIVE(fault_factor, "1",
                "remaining part of the commanded thrust with fault 3, per thruster"),
    PARAMETER(fault_time, "s", "the fault acts from this time on, per thruster"),

    INPUT(throttle, "1", "commanded part of the nominal thrust, per thruster, limited to 0..1"),

    OUTPUT(F_S, "N", "force on the servicer at the last update, body axes"),
    OUTPUT(M_S, "N.m",
           "torque on the servicer about its centre of mass at the last update, body axes"),
    NONNEGATIVE_OUTPUT(mdot, "kg/s", "propellant consumption"),
    NONNEGATIVE_OUTPUT(thrust, "N", "thrust, per thruster"),
    NONNEGATIVE_OUTPUT(impulse, "N.s", "cumulative impulse, per thruster"),
    NONNEGATIVE_OUTPUT(switches, "1",
                       "number of times that the command went from off to on, per thruster"),
};

static void check(const Parameters *p, Problems *problems)
{
    char name[32];
    check_thrusters(problems, &p->thrusters);
    for (int i = 0; i < THRUSTERS; i++) {
        double kind = p->fault_kind[i], factor = p->fault_factor[i];
        snprintf(name, sizeof name, "fault_kind[%d]", i + 1);
        if (kind != floor_of(kind) || kind >= FAULT_KINDS)
            reject(problems, name, kind, "must be 0, 1, 2 or 3");
        snprintf(name, sizeof name, "fault_factor[%d]", i + 1);
        if (factor > 1) reject(problems, name, factor, "must be in [0, 1]");
    }
}

/* updates the delayed command (docs/models.md B.6). The counter counts calls while command and
 * delayed command differ (with latch: always). */
static void apply_delay(const Parameters *p, Engine *e)
{
    int no_change = e->command == e->delayed && !p->latch,
        delay_over = e->calls_waited >= p->Tl / p->T0 - ROUNDED_OFF;
    if (no_change || delay_over) {
        e->delayed = e->command;
        e->calls_waited = 0;
    } else e->calls_waited++;
}

static double after_fault(const Parameters *p, int i, double delayed, double t)
{
    if (!reached(t, p->fault_time[i])) return delayed;
    const double with_fault[FAULT_KINDS] = {delayed, p->thrusters.nominal[i], 0,
                                            p->fault_factor[i] * delayed};
    return with_fault[(FaultKind)p->fault_kind[i]];
}

static double lag_factor(const Parameters *p, double T2)
{
    if (p->exact_lag) return T2 > 0 ? 1 - exponential(-p->T0 / T2) : 1;
    return T2 >= p->T0 ? p->T0 / T2 : 1;
}

/* evaluates thruster i at time t: updates delay, lag and impulse */
static void call_thruster(const Parameters *p, Engine *e, int i, double throttle, double t)
{
    double before = e->command;
    e->command = p->thrusters.nominal[i] * clamp(throttle, 0, 1);
    e->switches += before == 0 && e->command > 0;
    apply_delay(p, e);
    double delivered = after_fault(p, i, e->delayed, t);
    e->thrust += lag_factor(p, delivered != 0 ? p->T2up : p->T2dn) * (delivered - e->thrust);
    e->impulse += e->thrust * p->T0;
}

static void publish(const Parameters *p, const State *x, Output *y)
{
    double total = 0;
    y->F_S = y->M_S = vec(0, 0, 0);
    for (int i = 0; i < THRUSTERS; i++) {
        const Engine *e = &x->engine[i];
        Wrench w = thruster_wrench(&p->thrusters, i, e->thrust);
        y->F_S = add(y->F_S, w.F);
        y->M_S = add(y->M_S, w.M);
        y->thrust[i] = e->thrust;
        y->impulse[i] = e->impulse;
        y->switches[i] = e->switches;
        total += e->thrust;
    }
    y->mdot = p->Isp > 0 ? total / (p->Isp * STANDARD_GRAVITY) : 0;
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    (void)u, (void)t;
    *x = (State){.engine = {{0}}};
    publish(p, x, y);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    Sample s = first_sample(t, h, p->T0);
    if (s.left <= 0) return; /* no call in this step: the outputs do not change */
    for (; s.left > 0; s = next_sample(s))
        for (int i = 0; i < THRUSTERS; i++) call_thruster(p, &x->engine[i], i, u->throttle[i], s.t);
    publish(p, x, y);
}

FMU_MODEL("propulsion",
          "Propulsion unit of up to 16 thrusters with switching delay, rise and fall, and faults");
