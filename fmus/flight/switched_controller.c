/* switched_controller.c - linear feedback of the relative state whose gains change with the phase
 * of an approach.
 *
 *   F_H = K_rho e + K_drho de,   e = C_HN (rho - rho_ref),   de its derivative as seen in H
 *   phase 1 (far)  ->  2  ->  3 (near)  ->  4 (passive: no thrust) from t_abort on
 *
 * F_H: force in Hill axes, rho: position relative to the target. Phase 1 or 2 ends when the
 * distance along the approach axis, axis_H . rho_H, is no more than its switch_distance (0: the
 * phase does not end). At most one phase ends per sample, and none begins again, except that a
 * sample with active = 0 resets the phase to 1. The gains include their sign: a stable feedback has
 * negative gains. Attitude: torque M = -K_att q_vec - P_att w, with the vector part q_vec of q_SD
 * and the angular velocity w relative to the reference. Per servicer axis the force is limited to
 * F_max, the torque to M_max.
 *
 * Sampled: between two samples force and torque are constant in servicer axes. Source of the
 * phases: the rendezvous benchmark of Chan & Mitra 2017. Equations: docs/models.md H. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "directions.h"
#include "earth.h"
#include "orbit.h"
#include "tracking.h"

enum { FAR = 1, NEAR = 3, PASSIVE, GAIN_SETS = 3 };

typedef struct { mat3 rho, drho; } Gains;
typedef struct {
    double mu;
    Gains K[GAIN_SETS];
    vec3 axis_H;
    double switch_distance[GAIN_SETS - 1], t_abort;
    vec3 F_max, K_att, P_att, M_max;
    double use_wheels, wheel_scale, t_att, sample_period;
} Parameters;
typedef TrackingInput Input;
typedef struct { double phase; } State;
typedef struct {
    vec3 F_cmd_S, M_cmd_S, wheel_accel_cmd, F_saturated;
    vec3 rho_H, drho_H, e_H, de_H;
    quat q_SD;
    double phase, approaching;
} Output;
MODEL_STRUCT;

#define STABLE(k, d)                                       \
    {                                                      \
        {{{-(k), 0, 0}, {0, -(k), 0}, {0, 0, -(k)}}},      \
        {                                                  \
            {                                              \
                {-(d), 0, 0}, {0, -(d), 0}, { 0, 0, -(d) } \
            }                                              \
        }                                                  \
    }

static const Model start = {
    .p = {.mu = MU_JGM3,
          .K = {STABLE(0.04, 4), STABLE(0.04, 4), STABLE(0.04, 4)},
          .axis_H = {0, 1, 0},
          .t_abort = 1e9,
          .K_att = {40, 40, 40},
          .P_att = {60, 60, 60},
          .M_max = {10, 10, 10},
          .wheel_scale = 10},
    .u = TRACKING_START,
};

#define GAIN_ROWS(k, phase)                                                                        \
    ROW_AS(PARAMETER_ROW, p, "K_rho_" #phase, K[k].rho, 3, "N/m",                                  \
           "phase " #phase ": force per position error, Hill axes; one row per force axis",        \
           ANY_VALUE),                                                                             \
        ROW_AS(PARAMETER_ROW, p, "K_drho_" #phase, K[k].drho, 3, "N.s/m",                          \
               "phase " #phase ": force per rate of the error, Hill axes; one row per force axis", \
               ANY_VALUE)

static const Variable variables[] = {
    NONNEGATIVE(mu, "m3/s2", "gravitational parameter of the planet; 0 = deep space"),
    GAIN_ROWS(0, 1),
    GAIN_ROWS(1, 2),
    GAIN_ROWS(2, 3),
    PARAMETER(axis_H, "1",
              "unit vector of the approach axis, along which distances are measured, Hill axes"),
    NONNEGATIVE(
        switch_distance, "m",
        "distances at which phases 1 and 2 end, one element each; 0 = the phase does not end"),
    PARAMETER(t_abort, "s", "no force from this time on"),
    NONNEGATIVE(F_max, "N", "largest commanded force per body axis; 0 = no limit"),
    NONNEGATIVE(K_att, "N.m", "attitude gain per body axis, on the vector part of q_SD"),
    NONNEGATIVE(P_att, "N.m.s", "rate gain per body axis"),
    NONNEGATIVE(M_max, "N.m", "largest commanded torque per body axis; 0 = no limit"),
    SWITCH(use_wheels, "1: torque by wheels (wheel_accel_cmd), 0: by thrusters (M_cmd_S)"),
    POSITIVE(wheel_scale, "kg.m2",
             "torque per wheel acceleration, wheel axes = body axes; used if use_wheels = 1"),
    PARAMETER(t_att, "s", "no attitude control before this time"),
    SAMPLE_PERIOD,

    TRACKING_INPUTS,

    OUTPUT(F_cmd_S, "N", "commanded force, servicer axes"),
    OUTPUT(M_cmd_S, "N.m", "commanded torque, servicer axes; 0 if use_wheels = 1"),
    OUTPUT(wheel_accel_cmd, "rad/s2", "commanded wheel acceleration; 0 if use_wheels = 0"),
    FLAG(F_saturated, "1: the force of this body axis is cut to F_max"),
    OUTPUT(rho_H, "m", "position of the servicer relative to the target, Hill axes"),
    OUTPUT(drho_H, "m/s", "derivative of rho_H as seen in the Hill frame"),
    OUTPUT(e_H, "m", "position error rho_H - rho_ref, Hill axes"),
    OUTPUT(de_H, "m/s", "derivative of e_H as seen in the Hill frame"),
    OUTPUT(q_SD, "1", "attitude of the servicer relative to its reference, scalar first"),
    MODE(phase, "phase of the approach", "|thrust 1|thrust 2|thrust 3|passive"),
    FLAG(
        approaching,
        "1: last phase with thrust, the first with switch_distance 0, else 3 (0: an earlier phase, "
        "passive, or the input active is 0)"),
};

/* H.1-6 */
static void check(const Parameters *p, Problems *problems)
{
    check_unit_vector(problems, "axis_H", p->axis_H);
}

/* ---- phases ---- */
/* H.1-1 */
static double next_phase(const Parameters *p, double phase, double distance, double t)
{
    if (reached(t, p->t_abort)) return PASSIVE;
    if (phase >= NEAR) return phase;
    double end = p->switch_distance[(int)phase - 1];
    return end > 0 && distance <= end ? phase + 1 : phase;
}

/* number of the last phase with thrust: the first one whose switch_distance is 0, else NEAR */
static double last_phase(const Parameters *p)
{
    return p->switch_distance[0] == 0 ? FAR : p->switch_distance[1] == 0 ? FAR + 1 : NEAR;
}

/* ---- law ---- */
/* H.1-2 */
static vec3 force_H(const Parameters *p, double phase, vec3 e, vec3 de)
{
    if (phase == PASSIVE) return vec(0, 0, 0);
    const Gains *K = &p->K[(int)phase - 1];
    return add(mul(K->rho, e), mul(K->drho, de));
}

/* publishes relative state and error, with derivatives as seen in H instead of N */
static void publish_relative_state(const HillFrame *H, const Input *u, Output *y)
{
    vec3 rho_N = sub(u->S.r, u->T.r), drho_N = sub(u->S.v, u->T.v);
    y->rho_H = mul(H->C_HN, rho_N);
    y->drho_H = rate_in_frame(H, y->rho_H, mul(H->C_HN, drho_N));
    y->e_H = mul(H->C_HN, sub(rho_N, u->ref.rho));
    y->de_H = rate_in_frame(H, y->e_H, mul(H->C_HN, sub(drho_N, u->ref.drho)));
}

/* H.1-3 */
static void control_position(const Parameters *p, const Input *u, State *x, double t, Output *y)
{
    HillFrame H = hill_frame(p->mu, u->T.r, u->T.v);
    publish_relative_state(&H, u, y);
    x->phase = next_phase(p, x->phase, dot(p->axis_H, y->rho_H), t);
    vec3 F_N = tmul(H.C_HN, force_H(p, x->phase, y->e_H, y->de_H));
    vec3 F_S = mul(dcm_of_quat(u->S.q), F_N);
    y->F_cmd_S = limited3(F_S, p->F_max);
    y->F_saturated = unequal(F_S, y->F_cmd_S);
}

/* H.1-4 */
static void control_attitude(const Parameters *p, const Input *u, double t, Output *y)
{
    vec3 none = vec(0, 0, 0);
    y->q_SD = canonical(product(conjugate(u->ref.q), u->S.q));
    vec3 w = sub(u->S.omega, mul(dcm_of_quat(y->q_SD), u->ref.omega));
    vec3 M = neg(add(times(p->K_att, vector_part(y->q_SD)), times(p->P_att, w)));
    vec3 cut = reached(t, p->t_att) ? limited3(M, p->M_max) : none;
    y->M_cmd_S = p->use_wheels ? none : cut;
    y->wheel_accel_cmd = p->use_wheels ? scale(-1 / p->wheel_scale, cut) : none;
}

static void control(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    Input in = tracking_in(u);
    control_position(p, &in, x, t, y);
    control_attitude(p, &in, t, y);
    y->phase = x->phase;
    y->approaching = x->phase == last_phase(p);
}

/* While the initial values of a system are computed, inputs may have any value: a change of phase
 * that they cause is not stored, and the first step begins in phase 1. */
/* H.1-5 */
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    State first = {FAR};
    control(p, u, &first, y, t);
    *x = (State){FAR};
    if (u->active) return;
    y->F_cmd_S = y->M_cmd_S = y->wheel_accel_cmd = y->F_saturated = vec(0, 0, 0);
    y->approaching = 0;
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s)) {
        if (u->active) control(p, u, x, y, s.t);
        else initialize(p, u, x, y, s.t);
    }
}

FMU_MODEL("switched_controller",
          "Linear feedback of the relative state with gains that change with the phase");
