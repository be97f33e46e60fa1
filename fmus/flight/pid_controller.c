/* pid_controller.c - three-axis PID control of line of sight and attitude, a baseline that uses
 * no model.
 *
 *   position, per LOS channel    u = -(Kp e + Ki I + Kd de/dt),   a_L = Sigma u,
 *                                F_cmd = force_scale C_SL a_L
 *   attitude, per body axis      M = -(Kp e + Ki I + Kd w),   e: vector part of q_SD, w: rate error
 *   anti-windup                  dI/dt = e + (u - sat(u))/(Ki T_aw)
 *
 * Sigma = diag(-1,-1,1): signs of the channels range, elevation, azimuth (tracking.h); sat: limited
 * to a_max or M_max. The sampled integral I is computed by explicit Euler steps, after the present
 * I has been used in the command. A T_aw > 0 below the sample period has the effect of T_aw =
 * period, because the back-calculation of one sample would otherwise go beyond the limit and, with
 * T_aw below period/2, diverge. The factor 1/(Ki T_aw) is the usual gain of back-calculation.
 * Equations: docs/models.md C.5 */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "tracking.h"

typedef struct { double Kp, Ki, Kd, T_aw; } Gains;
typedef struct {
    TrackingParameters tracking;
    double wheel_scale;
    Gains range, elevation, azimuth, attitude;
} Parameters;
typedef TrackingInput Input;
typedef struct { vec3 position, attitude; } State; /* integrals of the errors */
typedef struct {
    TrackingOutput common;
    State integral;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.tracking = TRACKING_DEFAULTS,
          .wheel_scale = 10,
          .range = {.Kp = 0.4, .Ki = 0.024, .Kd = 2, .T_aw = 1 / 0.24},
          .elevation = {.Kp = 20, .Ki = 4, .Kd = 48, .T_aw = 0.025},
          .azimuth = {.Kp = 20, .Ki = 4, .Kd = 48, .T_aw = 0.025},
          .attitude = {.Kp = 40, .Ki = 2, .Kd = 60, .T_aw = 10}},
    .u = TRACKING_START,
};

#define GAIN_ROW(member, gain, unit, text)                                               \
    ROW_AS(PARAMETER_ROW, p, #member "." #gain, member.gain, 1, unit, #member ": " text, \
           NONNEGATIVE_VALUE)
#define GAIN_ROWS(member, p_unit, i_unit, d_unit, per)     \
    GAIN_ROW(member, Kp, p_unit, "proportional gain" per), \
        GAIN_ROW(member, Ki, i_unit, "integral gain" per), \
        GAIN_ROW(member, Kd, d_unit, "rate gain" per),     \
        GAIN_ROW(member, T_aw, "s",                        \
                 "time constant of anti-windup while the command is limited; 0 = none")

static const Variable variables[] = {
    TRACKING_PARAMETERS(tracking),
    POSITIVE(wheel_scale, "kg.m2",
             "torque per wheel acceleration, wheel axes = body axes; used if use_wheels = 1"),
    GAIN_ROWS(range, "1/s2", "1/s3", "1/s", ""),
    GAIN_ROWS(elevation, "m/s2", "m/s3", "m/s", ", per rad"),
    GAIN_ROWS(azimuth, "m/s2", "m/s3", "m/s", ", per rad"),
    GAIN_ROWS(attitude, "N.m", "N.m/s", "N.m.s", "; error: vector part of q_SD, rate: domega_S"),

    TRACKING_INPUTS,

    TRACKING_OUTPUTS(common),
    LOS_OUTPUTS("integral", integral.position, "m.s", "rad.s", "integral of the error"),
    TRACKING_OUTPUT("integral_att", integral.attitude, "s", "integral of the vector part of q_SD",
                    ANY_VALUE),
};

/* C.5-6 */
static void check(const Parameters *p, Problems *problems)
{
    check_up_axis(problems, p->tracking.up_axis);
}

/* ---- three axes at once ---- */
typedef struct { vec3 Kp, Ki, Kd, T_aw; } Gains3;

static Gains3 gains(const Gains *a, const Gains *b, const Gains *c)
{
    return (Gains3){vec(a->Kp, b->Kp, c->Kp), vec(a->Ki, b->Ki, c->Ki), vec(a->Kd, b->Kd, c->Kd),
                    vec(a->T_aw, b->T_aw, c->T_aw)};
}

static vec3 pid(const Gains3 *k, vec3 e, vec3 integral, vec3 de)
{
    return neg(sum3(times(k->Kp, e), times(k->Ki, integral), times(k->Kd, de)));
}

/* C.5-2 */
static double back_calculation(double excess, double T_aw, double Ki, double period)
{
    return Ki > 0 && T_aw > 0 ? smaller(period / T_aw, 1) / Ki * excess : 0;
}

/* I += T e + T (u - sat u)/(Ki T_aw), with the period T; limited to +-1e30 as inputs are, so that I
 * always stays finite */
/* C.5-1 */
static vec3 integrated(const Gains3 *k, vec3 integral, vec3 e, vec3 excess, double period)
{
    vec3 back = vec(back_calculation(excess.x, k->T_aw.x, k->Ki.x, period),
                    back_calculation(excess.y, k->T_aw.y, k->Ki.y, period),
                    back_calculation(excess.z, k->T_aw.z, k->Ki.z, period));
    return bounded3(sum3(integral, scale(period, e), back));
}

/* u - sat(u) is computed as u - Sigma sat(a_L), because Sigma changes signs only and the limits are
 * symmetric */
/* C.5-3 */
static void control_position(const Parameters *p, const TrackingError *e, vec3 *integral,
                             double period, Output *y)
{
    Gains3 k = gains(&p->range, &p->elevation, &p->azimuth);
    vec3 u = pid(&k, e->x1, *integral, e->x2);
    command_force(&p->tracking, e, u, &y->common);
    *integral = integrated(&k, *integral, e->x1, sub(u, Sigma(y->common.a_cmd_L)), period);
}

/* C.5-4 */
static void control_attitude(const Parameters *p, const TrackingError *e, vec3 *integral, double t,
                             double period, Output *y)
{
    Gains3 k = gains(&p->attitude, &p->attitude, &p->attitude);
    vec3 q = vector_part(e->q_SD), M = pid(&k, q, *integral, e->w);
    double A = p->wheel_scale;
    command_torque(&p->tracking, t, M, diagonal(A, A, A), &y->common);
    *integral = integrated(&k, *integral, q, sub(M, limited3(M, p->tracking.M_max)), period);
}

static void control(const Parameters *p, const Input *u, State *x, Output *y, double t,
                    double period)
{
    Input in = tracking_in(u);
    TrackingError e = tracking_error(p->tracking.up_axis, &in);
    vec3 resting = x->attitude;

    publish_errors(&e, &y->common);
    control_position(p, &e, &x->position, period, y);
    control_attitude(p, &e, attitude_rests(&p->tracking, t) ? &resting : &x->attitude, t, period,
                     y);
    y->integral = *x;
}

/* C.5-5 */
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    *x = (State){.position = vec(0, 0, 0)};
    control(p, u, x, y, t, 0);
    if (!u->active) command_nothing(&y->common);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->tracking.sample_period); s.left > 0; s = next_sample(s)) {
        if (u->active) control(p, u, x, y, s.t, s.period);
        else initialize(p, u, x, y, s.t);
    }
}

FMU_MODEL("pid_controller", "PID control of line of sight and attitude with anti-windup");
