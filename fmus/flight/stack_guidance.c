/* stack_guidance.c - detumbling of the docked stack: the rate decreases to 0 along a smooth
 * profile, about its initial axis, as fast as a share of the wheels' torque allows; wheels are
 * unloaded.
 *
 *   T = max(duration_min, 1.875 max_i |(J w_0)_i| / max(lim_i - g_i, 0.1 lim_i))
 *       lim_i = torque_share wheel_accel_max A_w,ii,   g_i = |(w_0 x (J w_0 + A_w Omega))_i|
 *   x = (t - t_0)/T in 0..1,   s = 1 - (10 x^3 - 15 x^4 + 6 x^5),   e = w_0/|w_0|
 *   theta = |w_0| T (x - 5 x^4/2 + 3 x^5 - x^6),   q_DN = q_0 [cos(theta/2), e sin(theta/2)]
 *   omega_DN_D = s w_0,   alpha_DN_D = -30 x^2 (1 - x)^2 w_0/T
 *   M_unload_S = clip(-k_unload A_w (Omega - wheel_speed_ref), +-M_unload_max) while unloading
 *
 * J: inertia of the stack; A_w, Omega: inertia and speeds of the wheels; w_0, q_0: angular velocity
 * and attitude at the start t_0. The axis is fixed in N and in D, so rate and acceleration are the
 * exact derivatives. The orbit is not controlled: the reference position is the present one.
 * M_unload_S is a torque of thrusters; the wheels produce the opposite torque at the same time.
 * Equations: docs/models.md I.6 */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "body_rows.h"
#include "reference_rows.h"
#include "rigid_body.h"
#include "time_grid.h"
#include "unloading.h"

typedef struct {
    mat3 J_stack, A_w;
    double wheel_accel_max, torque_share, duration_min;
    Unloading unload;
    double sample_period;
} Parameters;
typedef struct {
    Body T, S;
    vec3 wheel_speed;
    double active;
} Input;
typedef struct {
    double begun, t_0;
    quat q_0;
    vec3 w_0;
    double duration, unloading;
} State;
typedef struct {
    Reference ref;
    vec3 M_unload_S;
    double duration, progress, done, unloading;
    vec3 momentum_S;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.J_stack = {{{300, 0, 0}, {0, 550, 0}, {0, 0, 390}}},
          .A_w = {{{12, 0, 0}, {0, 15, 0}, {0, 0, 10}}},
          .wheel_accel_max = 0.01,
          .torque_share = 0.5,
          .duration_min = 60,
          .unload = {.on = 0.7, .off = 0.1, .k = 0.02, .most = 0.05, .speed_max = 0.3}},
    .u = {.T = {.q = {1, 0, 0, 0}}, .S = {.q = {1, 0, 0, 0}}, .active = 1},
};

static const Variable variables[] = {
    MATRIX(J_stack, "kg.m2",
           "inertia of the stack with wheels about its centre of mass, servicer axes"),
    MATRIX(A_w, "kg.m2", "wheel inertia matrix: wheel speeds to wheel momentum in body axes"),
    POSITIVE(wheel_accel_max, "rad/s2", "largest wheel acceleration, per wheel"),
    POSITIVE_AS("wheel_speed_max", unload.speed_max, "rad/s", "largest wheel speed, per wheel"),
    POSITIVE(torque_share, "1", "share of the wheels' torque that the profile may use"),
    POSITIVE(duration_min, "s", "shortest duration of the profile"),
    NONNEGATIVE_AS(
        "unload_on", unload.on, "1",
        "unloading begins when a wheel is this share of wheel_speed_max off wheel_speed_ref"),
    NONNEGATIVE_AS("unload_off", unload.off, "1",
                   "unloading ends when every wheel is within this share of wheel_speed_max of "
                   "wheel_speed_ref"),
    NONNEGATIVE_AS("k_unload", unload.k, "1/s",
                   "gain of unloading: torque per wheel momentum to remove"),
    NONNEGATIVE_AS("M_unload_max", unload.most, "N.m",
                   "largest torque of unloading, per body axis"),
    PARAMETER_AS("wheel_speed_ref", unload.ref, "rad/s", "wheel speeds that unloading approaches"),
    SAMPLE_PERIOD,

    BODY_INPUTS("T", T, "target"),
    BODY_INPUTS("S", S, "servicer"),
    INPUT(wheel_speed, "rad/s", "wheel speeds relative to the body"),
    OPTIONAL_SWITCH(active, ACTIVE_TEXT),

    REFERENCE_ROWS(OUTPUT_ROW, y, ref),
    OUTPUT(M_unload_S, "N.m", "torque of thrusters that unloads the wheels, servicer axes"),
    NONNEGATIVE_OUTPUT(duration, "s", "duration of the profile"),
    NONNEGATIVE_OUTPUT(progress, "1", "elapsed share of the profile"),
    FLAG(done, "1: the profile is over"),
    FLAG(unloading, "1: thrusters unload the wheels"),
    OUTPUT(momentum_S, "N.m.s", "angular momentum of stack and wheels, servicer axes"),
};

/* I.6-6 */
static void check(const Parameters *p, Problems *problems)
{
    check_inertia(problems, "J_stack", p->J_stack);
    check_positive_definite(problems, "A_w", p->A_w);
    check_unloading(&p->unload, problems);
}

static vec3 momentum(const Parameters *p, vec3 w, vec3 wheel_speed)
{
    return add(mul(p->J_stack, w), mul(p->A_w, wheel_speed));
}

/* ---- profile ---- */
/* duration for one axis; `spin`, `gyroscopic`, A: elements for this axis of J w_0, of w_0 x
 * (J w_0 + A_w Omega) and of the diagonal of A_w. The torque 1.875 J w_0/T peaks in the
 * middle and the gyroscopic torque at the start: the sum of both peaks bounds the torque. */
static double duration_of_axis(const Parameters *p, double spin, double gyroscopic, double A)
{
    double lim = p->torque_share * p->wheel_accel_max * A;
    return 1.875 * fabs(spin) / larger(lim - fabs(gyroscopic), 0.1 * lim);
}

/* I.6-2 */
static double duration(const Parameters *p, vec3 w, vec3 wheel_speed)
{
    vec3 spin = mul(p->J_stack, w), g = cross(w, momentum(p, w, wheel_speed));
    double x = duration_of_axis(p, spin.x, g.x, p->A_w.row[0].x),
           y = duration_of_axis(p, spin.y, g.y, p->A_w.row[1].y),
           z = duration_of_axis(p, spin.z, g.z, p->A_w.row[2].z);
    return larger(p->duration_min, larger(x, larger(y, z)));
}

static State initial_state(const Parameters *p, const Input *u, double t)
{
    return (State){.begun = 1,
                   .t_0 = t,
                   .q_0 = canonical(u->S.q),
                   .w_0 = u->S.omega,
                   .duration = duration(p, u->S.omega, u->wheel_speed)};
}

/* I.6-1 */
static void set_reference_on_profile(const State *s, double x, Reference *ref)
{
    double rate = norm(s->w_0), gone = x * x * x * (10 + x * (-15 + 6 * x));
    double way = x + x * x * x * x * (-2.5 + x * (3 - x));
    SineCosine half = sine_and_cosine(rate * s->duration * way / 2);
    vec3 e = rate < 1e-12 ? vec(0, 0, 0) : scale(half.s / rate, s->w_0);
    ref->q = canonical(product(s->q_0, (quat){half.c, e.x, e.y, e.z}));
    ref->omega = scale(1 - gone, s->w_0);
    ref->alpha = scale(-30 * x * x * (1 - x) * (1 - x) / s->duration, s->w_0);
}

/* ---- one sample ---- */
/* I.6-3 */
static void guide(const Parameters *p, const Input *u, const State *s, Output *y, double t)
{
    double x = clamp((t - s->t_0) / s->duration, 0, 1);
    y->ref.rho = sub(u->S.r, u->T.r);
    y->ref.drho = sub(u->S.v, u->T.v);
    y->ref.ddrho = vec(0, 0, 0);
    set_reference_on_profile(s, x, &y->ref);
    y->duration = s->duration;
    y->progress = x;
    y->done = x == 1;
    y->momentum_S = momentum(p, u->S.omega, u->wheel_speed);
}

/* publishes the profile that would begin now and stores none; also called for samples with
 * active = 0 */
/* I.6-5 */
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    const State first = initial_state(p, u, t);
    guide(p, u, &first, y, t);
    y->M_unload_S = vec(0, 0, 0);
    y->unloading = 0;
    *x = (State){.begun = 0};
}

/* I.6-4 */
static void sample(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    if (!x->begun) *x = initial_state(p, u, t);
    guide(p, u, x, y, t);
    y->unloading = x->unloading = unloading_is_on(&p->unload, u->wheel_speed, x->unloading);
    y->M_unload_S = unloading_torque(&p->unload, x->unloading, p->A_w, u->wheel_speed);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s)) {
        if (u->active) sample(p, u, x, y, s.t);
        else initialize(p, u, x, y, s.t);
    }
}

FMU_MODEL("stack_guidance",
          "Detumbling of the docked stack within the wheels' torque, unloading of the wheels");
