/* relay_controller.c - relays with hysteresis for 13 engines: rates by 8, speed along X by main
 * engine and brakes.
 *
 *   sigma_v = Kp_v e + Kd_v de/dt,   e = (v_T + drho_ref - v_S) . X          0 while translate is 0
 *             law 0: de/dt = -d(v_S . X)/dt,
 *                     which does not differentiate the steps of the required speed
 *   sigma_w = Kp_w dw + Kd_w ddw/dt,   dw = C_SD omega_D - omega_S
 *           per axis; differences over a sample, 0 at first
 *
 * One-sided relays: on where s >= s_on, off where s < s_off (translation: s <= s_off), else as
 * before; s = +-sigma:
 *   P6 P8 / P5 P7   +-sigma_wx    P4 / P2   +-sigma_wy      P1 / P3   +-sigma_wz  (xi2 on, xi1 off)
 *   main P'5 / brakes P'1..P'4   +-sigma_v   (rho2 on, rho1 off)
 * Engines before the / have s = +sigma, those after it s = -sigma. Derivatives are differences over
 * a sample; sigma_v is 0 while translate is 0. Order of the throttles: P1..P8, P'1..P'4, P'5. The
 * other inputs are those that every controller has; this law does not use them.
 * Source: Kozlova & Fomichev 2023 as corrected in docs/models.md B.5, B.8. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "body_rows.h"
#include "reference_rows.h"
#include "thrusters.h"
#include "time_grid.h"

enum { ENGINES = 13, SPEED = 3 };

typedef struct {
    double law, Kp_v, Kd_v, rho1, rho2;
    double Kp_w[3], Kd_w[3], xi1[3], xi2[3];
    double sample_period;
} Parameters;
typedef struct {
    Body T, S;
    vec3 wheel_speed;
    Reference ref;
    double translate, active;
} Input;
typedef struct {
    double started, e[4], on[ENGINES];
} State; /* e: differentiated quantities at the last sample; on: 1 per relay that is on */
typedef struct {
    double throttle[THRUSTERS], translation_firing, sigma_w[3], sigma_v, domega_S[3], e_v;
} Output;
MODEL_STRUCT;

/* signal that switches each engine: sigma_w of an axis or sigma_v, and its sign */
static const struct {
    int channel;
    double sign;
} engines[ENGINES] = {
    {2, 1}, {1, -1},     {2, -1},     {1, 1},      {0, -1},     {0, 1},     {0, -1},
    {0, 1}, {SPEED, -1}, {SPEED, -1}, {SPEED, -1}, {SPEED, -1}, {SPEED, 1},
};

static const Model start = {
    .p = {.law = 1,
          .Kp_v = 1,
          .Kd_v = 0.8,
          .rho1 = 4e-3,
          .rho2 = 5e-3,
          .Kp_w = {50, 50, 50},
          .Kd_w = {40, 40, 40},
          .xi1 = {3e-2, 3e-2, 3e-2},
          .xi2 = {5e-2, 5e-2, 5e-2}},
    .u = {.T = {.q = {1, 0, 0, 0}},
          .S = {.q = {1, 0, 0, 0}},
          .ref = {.q = {1, 0, 0, 0}},
          .active = 1},
};

static const Variable variables[] = {
    SWITCH(law, "speed law of the guidance: 0 scalar (Kd_v acts on the servicer speed), 1 "
                "vector (Kd_v acts on e_v)"),
    NONNEGATIVE(Kp_v, "1", "gain of the speed error"),
    NONNEGATIVE(Kd_v, "s", "gain of the derivative of the speed error"),
    NONNEGATIVE(rho1, "m/s", "value of the switching function at which translation switches off"),
    POSITIVE(rho2, "m/s", "value of the switching function from which translation switches on"),
    NONNEGATIVE(Kp_w, "s", "gain of the rate error, per body axis"),
    NONNEGATIVE(Kd_w, "s2", "gain of the derivative of the rate error, per body axis"),
    NONNEGATIVE(xi1, "1",
                "value of the switching function below which rotation switches off, per body axis"),
    POSITIVE(xi2, "1",
             "value of the switching function from which rotation switches on, per body axis"),
    SAMPLE_PERIOD,

    BODY_INPUTS("T", T, "target"),
    BODY_INPUTS("S", S, "servicer"),
    INPUT(wheel_speed, "rad/s", "wheel speeds relative to the body; not used"),
    REFERENCE_ROWS(INPUT_ROW, u, ref),
    INPUT(translate, "1", "1: translational thrust permitted"),
    OPTIONAL_SWITCH(active, ACTIVE_TEXT),

    NONNEGATIVE_OUTPUT(
        throttle, "1",
        "0 or 1; engines 1 to 8 give the torques +z -y -z +y -x +x -x +x, 9 to 12 brakes, 13 "
        "main engine, the rest is 0"),
    FLAG(translation_firing, "1: main engine or brakes are commanded"),
    OUTPUT(sigma_w, "1",
           "switching functions of rotation, body axes; > 0: positive torque is required"),
    OUTPUT(
        sigma_v, "m/s",
        "switching function of translation; > 0: main engine, < 0: brakes; 0 while translate is 0"),
    OUTPUT(domega_S, "rad/s", "required minus present angular velocity, servicer axes"),
    OUTPUT(e_v, "m/s", "required minus present velocity along +X of the servicer"),
};

/* B.5-5 */
static void check(const Parameters *p, Problems *problems)
{
    char name[16];
    if (p->rho1 >= p->rho2) reject(problems, "rho1", p->rho1, "must be below rho2");
    for (int i = 0; i < 3; i++) {
        snprintf(name, sizeof name, "xi1[%d]", i + 1);
        if (p->xi1[i] >= p->xi2[i]) reject(problems, name, p->xi1[i], "must be below xi2");
    }
}

/* B.5-3 */
static double difference(const State *x, int channel, double now, double period)
{
    return x->started ? (now - x->e[channel]) / period : 0;
}

static void switch_rotation(const Parameters *p, const Input *u, State *x, Output *y, double period)
{
    mat3 C_SD = dcm_of_quat(product(conjugate(canonical(u->ref.q)), canonical(u->S.q)));
    vec3 dw = sub(mul(C_SD, u->ref.omega), u->S.omega);
    const double now[3] = {dw.x, dw.y, dw.z};
    for (int i = 0; i < 3; i++) {
        y->sigma_w[i] = p->Kp_w[i] * now[i] + p->Kd_w[i] * difference(x, i, now[i], period);
        y->domega_S[i] = x->e[i] = now[i];
    }
}

/* B.5-2 */
static void switch_translation(const Parameters *p, const Input *u, State *x, Output *y,
                               double period)
{
    vec3 X = dcm_of_quat(canonical(u->S.q)).row[0];
    y->e_v = dot(add(sub(u->T.v, u->S.v), u->ref.drho), X);
    double now = p->law ? y->e_v : -dot(u->S.v, X);
    double sigma = p->Kp_v * y->e_v + p->Kd_v * difference(x, SPEED, now, period);
    y->sigma_v = u->translate > 0 ? sigma : 0;
    x->e[SPEED] = now;
}

/* new state of a relay: 1 on, 0 off; between its thresholds it stays as `before` */
/* B.5-1 */
static double relay(double s, double s_on, double s_off, int off_at_threshold, double before)
{
    if (s >= s_on) return 1;
    return s < s_off || (off_at_threshold && s == s_off) ? 0 : before;
}

static double relay_of_engine(const Parameters *p, const Output *y, int i, double before)
{
    int channel = engines[i].channel;
    if (channel == SPEED) return relay(engines[i].sign * y->sigma_v, p->rho2, p->rho1, 1, before);
    return relay(engines[i].sign * y->sigma_w[channel], p->xi2[channel], p->xi1[channel], 0,
                 before);
}

static void control(const Parameters *p, const Input *u, State *x, Output *y, double period)
{
    switch_rotation(p, u, x, y, period);
    switch_translation(p, u, x, y, period);
    x->started = 1;
    y->translation_firing = 0;
    for (int i = 0; i < ENGINES; i++) {
        y->throttle[i] = x->on[i] = relay_of_engine(p, y, i, x->on[i]);
        if (engines[i].channel == SPEED && x->on[i] > 0) y->translation_firing = 1;
    }
}

/* B.5-4 */
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    State first = {.started = 0};
    (void)t;
    *x = first;
    control(p, u, &first, y, 0);
    if (u->active) return;
    y->translation_firing = 0;
    for (int i = 0; i < ENGINES; i++) y->throttle[i] = 0;
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s)) {
        if (u->active) control(p, u, x, y, s.period);
        else initialize(p, u, x, y, s.t);
    }
}

FMU_MODEL("relay_controller",
          "Relays with hysteresis for 13 engines: angular rate and speed along the thrust axis");
