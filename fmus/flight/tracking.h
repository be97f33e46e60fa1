/* tracking.h - shared by the controllers in line-of-sight (LOS) coordinates: ports, errors,
 * limits, command.
 *
 * Position: x1 = (range rho, elevation eps, azimuth) of the target from the servicer minus its
 * reference, x2 = dx1/dt. The law of the controller gives the control u of dx2/dt = f + g u + d; f:
 * acceleration without control, d: disturbance. The acceleration of the servicer in LOS axes L is
 * a_L = Sigma u; with Sigma = diag(-1,-1,1) the gain g = (1, 1/rho, 1/(rho cos eps))
 * is positive in every channel.
 * Attitude: q_SD = q_DN* q_SN with scalar part >= 0, its vector part e, and the rate error w =
 * omega_SN_S - C_SD omega_DN_D.
 * The limits a_max per LOS axis and M_max per body axis apply here, before the limits of the
 * actuators. Equations: docs/models.md C.1, C.4. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef TRACKING_H
#define TRACKING_H

#include "body_rows.h"
#include "line_of_sight.h"
#include "reference_rows.h"
#include "time_grid.h"

/* ---- ports ---- */
typedef struct {
    Body T, S;
    vec3 wheel_speed;
    Reference ref;
    double active;
} TrackingInput;

#define TRACKING_INPUTS                                                                \
    BODY_INPUTS("T", T, "target"), BODY_INPUTS("S", S, "servicer"),                    \
        INPUT(wheel_speed, "rad/s",                                                    \
              "wheel speeds relative to the body; only theta_d_controller uses them"), \
        REFERENCE_ROWS(INPUT_ROW, u, ref), OPTIONAL_SWITCH(active, ACTIVE_TEXT)

/* start values: 300 m from the target, at rest on the reference, and far from the poles of the LOS
 * angles for every up_axis */
#define TRACKING_START                                                                        \
    {.T = {.r = {7158140, 0, 0}, .v = {0, 7462.286, 0}, .q = {1, 0, 0, 0}},                   \
     .S = {.r = {7157960, 180, 158.7450786638754}, .v = {0, 7462.286, 0}, .q = {1, 0, 0, 0}}, \
     .ref = {.rho = {-180, 180, 158.7450786638754}, .q = {1, 0, 0, 0}},                       \
     .active = 1}

typedef struct {
    vec3 M_max;
    double up_axis, a_max, force_scale, use_wheels, t_att, sample_period;
} TrackingParameters;

#define TRACKING_PARAMETERS(member)                                                               \
    PARAMETER_AS("up_axis", member.up_axis, "1", UP_AXIS_TEXT),                                   \
        NONNEGATIVE_AS("a_max", member.a_max, "m/s2",                                             \
                       "largest commanded acceleration per LOS axis; 0 = no limit"),              \
        NONNEGATIVE_AS("M_max", member.M_max, "N.m",                                              \
                       "largest commanded torque per body axis; 0 = no limit"),                   \
        ROW_AS(PARAMETER_ROW, p, "force_scale", member.force_scale, 1, "kg",                      \
               "commanded force per commanded acceleration", POSITIVE_VALUE),                     \
        ROW_AS(PARAMETER_ROW, p, "use_wheels", member.use_wheels, 1, "1",                         \
               "1: torque by wheels (wheel_accel_cmd), 0: by thrusters (M_cmd_S)", SWITCH_VALUE), \
        PARAMETER_AS("t_att", member.t_att, "s", "no attitude control before this time"),         \
        SAMPLE_PERIOD_AS(member.sample_period, "at every communication step")

#define TRACKING_DEFAULTS \
    {.M_max = {10, 10, 10}, .up_axis = UP_IS_Y, .a_max = 4.9, .force_scale = 100}

typedef struct {
    vec3 F_cmd_S, M_cmd_S, wheel_accel_cmd;
    vec3 a_cmd_L, a_saturated, M_saturated;
    vec3 x1, x2;
    quat q_SD;
    vec3 domega_S;
} TrackingOutput;

#define TRACKING_OUTPUT(name, member, unit, text, rule) \
    ROW_AS(OUTPUT_ROW, y, name, member, 1, unit, text, rule)
#define TRACKING_OUTPUTS(member)                                                                  \
    TRACKING_OUTPUT("F_cmd_S", member.F_cmd_S, "N", "commanded force, servicer axes", ANY_VALUE), \
        TRACKING_OUTPUT("M_cmd_S", member.M_cmd_S, "N.m",                                         \
                        "commanded torque, servicer axes; 0 if use_wheels = 1", ANY_VALUE),       \
        TRACKING_OUTPUT("wheel_accel_cmd", member.wheel_accel_cmd, "rad/s2",                      \
                        "commanded wheel acceleration; 0 if use_wheels = 0", ANY_VALUE),          \
        TRACKING_OUTPUT("a_cmd_L", member.a_cmd_L, "m/s2",                                        \
                        "commanded acceleration of the servicer, within a_max; LOS axes: X to "   \
                        "the target, Y to rising elevation, Z = X x Y",                           \
                        ANY_VALUE),                                                               \
        TRACKING_OUTPUT("a_saturated", member.a_saturated, "1",                                   \
                        "1: the acceleration of this LOS axis is cut to a_max", SWITCH_VALUE),    \
        TRACKING_OUTPUT("M_saturated", member.M_saturated, "1",                                   \
                        "1: the torque of this body axis is cut to M_max", SWITCH_VALUE),         \
        LOS_OUTPUTS("error", member.x1, "m", "rad", "error: actual minus reference"),             \
        LOS_OUTPUTS("derror", member.x2, "m/s", "rad/s", "rate of the error"),                    \
        TRACKING_OUTPUT("q_SD", member.q_SD, "1",                                                 \
                        "attitude of the servicer relative to its reference, scalar first",       \
                        ANY_VALUE),                                                               \
        TRACKING_OUTPUT("domega_S", member.domega_S, "rad/s",                                     \
                        "angular velocity minus reference angular velocity, servicer axes",       \
                        ANY_VALUE)

/* sets the commands and their saturation flags to 0, for samples with active = 0 */
static inline void command_nothing(TrackingOutput *y)
{
    vec3 none = vec(0, 0, 0);
    y->F_cmd_S = y->M_cmd_S = y->wheel_accel_cmd = y->a_cmd_L = none;
    y->a_saturated = y->M_saturated = none;
}

/* ---- inputs: no finite value, however large, may lead to a number that is not finite ---- */
static inline double bounded(double value) { return clamp(value, -1e30, 1e30); }
static inline vec3 bounded3(vec3 a) { return vec(bounded(a.x), bounded(a.y), bounded(a.z)); }

/* unit quaternion with scalar part >= 0; four zeros count as the identity */
static inline quat attitude_in(quat q)
{
    double largest = larger(larger(fabs(q.w), fabs(q.x)), larger(fabs(q.y), fabs(q.z)));
    if (largest == 0) return (quat){1, 0, 0, 0};
    return canonical((quat){q.w / largest, q.x / largest, q.y / largest, q.z / largest});
}

static inline Body body_in(Body b)
{
    return (Body){bounded3(b.r), bounded3(b.v), attitude_in(b.q), bounded3(b.omega)};
}

static inline Reference reference_in(Reference r)
{
    return (Reference){bounded3(r.rho),  bounded3(r.drho),  bounded3(r.ddrho),
                       attitude_in(r.q), bounded3(r.omega), bounded3(r.alpha)};
}

static inline TrackingInput tracking_in(const TrackingInput *u)
{
    return (TrackingInput){body_in(u->T), body_in(u->S), bounded3(u->wheel_speed),
                           reference_in(u->ref), u->active};
}

/* ---- errors ---- */
typedef struct {
    LineOfSight now, ref;
    vec3 x1, x2;
    mat3 C_SN;
    quat q_SD;
    vec3 wd, wdd, w; /* angular rate and acceleration of the reference, rate error; S axes */
} TrackingError;

static inline TrackingError tracking_error(double up, const TrackingInput *u)
{
    TrackingError e;
    vec3 none = vec(0, 0, 0);
    e.now = line_of_sight(up, (Motion){sub(u->T.r, u->S.r), sub(u->T.v, u->S.v), none});
    e.ref = line_of_sight(up, (Motion){neg(u->ref.rho), neg(u->ref.drho), neg(u->ref.ddrho)});
    e.x1 = sub(e.now.q.x, e.ref.q.x);
    e.x1.z = wrapped(e.x1.z);
    e.x2 = sub(e.now.q.d, e.ref.q.d);

    e.C_SN = dcm_of_quat(u->S.q);
    e.q_SD = canonical(product(conjugate(u->ref.q), u->S.q));
    mat3 C_SD = dcm_of_quat(e.q_SD);
    e.wd = mul(C_SD, u->ref.omega);
    e.wdd = mul(C_SD, u->ref.alpha);
    e.w = sub(u->S.omega, e.wd);
    return e;
}

/* dq_vec/dt = T(q) w / 2,  T(q) w = q_0 w + q_vec x w */
static inline vec3 T_times(quat q, vec3 w) { return add(scale(q.w, w), cross(vector_part(q), w)); }
static inline vec3 T_transposed(quat q, vec3 w)
{
    return sub(scale(q.w, w), cross(vector_part(q), w));
}

/* ---- command ---- */
static inline vec3 Sigma(vec3 u) { return vec(-u.x, -u.y, u.z); } /* Sigma = Sigma^-1 */

static inline vec3 limited_acceleration(const TrackingParameters *p, vec3 a_L)
{
    return limited3(a_L, vec(p->a_max, p->a_max, p->a_max));
}

static inline void publish_errors(const TrackingError *e, TrackingOutput *y)
{
    y->x1 = e->x1;
    y->x2 = e->x2;
    y->q_SD = e->q_SD;
    y->domega_S = e->w;
}

static inline void command_force(const TrackingParameters *p, const TrackingError *e, vec3 u,
                                 TrackingOutput *y)
{
    vec3 a_L = Sigma(u);
    y->a_cmd_L = limited_acceleration(p, a_L);
    y->a_saturated = unequal(a_L, y->a_cmd_L);
    y->F_cmd_S = scale(p->force_scale, mul(e->C_SN, tmul(e->now.C_LN, y->a_cmd_L)));
}

static inline int attitude_rests(const TrackingParameters *p, double t)
{
    return !reached(t, p->t_att);
}

/* converts the torque M of the law to a command, within M_max; the torque is 0 before t_att. Wheels
 * produce M by the opposite change of their momentum A_w Omega, Omega: wheel speeds. */
static inline void command_torque(const TrackingParameters *p, double t, vec3 M, mat3 A_w,
                                  TrackingOutput *y)
{
    vec3 none = vec(0, 0, 0);
    if (attitude_rests(p, t)) M = none;
    vec3 cut = limited3(M, p->M_max);
    y->M_saturated = unequal(M, cut);
    y->M_cmd_S = p->use_wheels ? none : cut;
    y->wheel_accel_cmd = p->use_wheels ? neg(solve(A_w, cut)) : none;
}

#endif
