/* los_guidance.c - hovering in front of a feature of a rotating target, camera axis on the target,
 * solar panels to the Sun.
 *
 *   rho_ref = rho_f R(q_TN) p_T                         R: rotation from T axes to N axes
 *   D:  X = r/|r|,   Y = chi x X / |chi x X|,   Z = X x Y,
 *           r = r_TN - r_SN: actual line of sight, chi: to the Sun
 *
 * The first and second derivatives of rho_ref, X, Y and Z are derivatives as seen in N. The target
 * turns torque-free, or under gravity gradient if use_gravity_gradient = 1. alpha_DN_D follows from
 * r'', which is computed from differential gravity and the last commanded force: the servicer does
 * not know manoeuvres of the target. q_DN never changes sign from sample to sample. Where the Sun
 * or its opposite is within guard_angle of the line of sight, the last Y from outside this angle is
 * held and made normal to X. Flags: attitude_guard = 1 where Y is held; los_guard = 1 where the
 * magnitude of the elevation of the actual or desired line of sight is above elevation_limit,
 * because azimuth is singular at +-90 deg, or where the range is below range_limit. A range of
 * zero violates the rule of the output `range`. A sample with active = 0 resets the state; its
 * flags are 0. Source: Yin, Luo, Wei & Yuan 2017, equations (2) and (5); docs/models.md C.1 to
 * C.3. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "body_rows.h"
#include "directions.h"
#include "earth.h"
#include "line_of_sight.h"
#include "reference_rows.h"
#include "rigid_body.h"
#include "time_grid.h"

typedef struct {
    double mu;
    mat3 J_T;
    double use_gravity_gradient;
    vec3 p_T, sun_N;
    double rho_f, force_scale, up_axis, guard_angle, elevation_limit, range_limit, sample_period;
} Parameters;
typedef struct {
    Body T, S;
    vec3 F_cmd_S;
    double active;
} Input;
typedef struct {
    vec3 y_N;  /* held Y: of the last sample outside the guard, or any normal; 0: none yet */
    quat q_DN; /* q_DN of the last sample; 0: none yet */
} State;
typedef struct {
    Reference ref;
    double range;
    Motion los, los_ref;
    double beta_t, beta_p, attitude_guard, los_guard;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.mu = MU_WGS84,
          .J_T = {{{100, 0, 0}, {0, 150, 0}, {0, 0, 90}}},
          .p_T = {1, 0, 0},
          .sun_N = {0.3, 0.9, 0.3},
          .rho_f = 20,
          .force_scale = 100,
          .up_axis = UP_IS_Y,
          .guard_angle = 1e-3,
          .elevation_limit = 4 * PI / 9,
          .range_limit = 5},
    .u = {.T = {.r = {7158140, 0, 0}, .v = {0, 7462.286, 0}, .q = {1, 0, 0, 0}},
          .S = {.r = {7157960, 180, 158.7450786638754}, .v = {0, 7462.286, 0}, .q = {1, 0, 0, 0}},
          .active = 1},
};

static const Variable variables[] = {
    NONNEGATIVE(mu, "m3/s2", "gravitational parameter of the planet; 0 = deep space"),
    MATRIX(J_T, "kg.m2", "inertia of the target as known to the software, body axes"),
    SWITCH(use_gravity_gradient, "1: the software models the gravity gradient on the target"),
    PARAMETER(p_T, "1", "unit vector from the target to the feature, target axes"),
    PARAMETER(sun_N, "1", "direction to the Sun, N axes, of any length"),
    POSITIVE(rho_f, "m", "hovering distance between the centres of mass, along p_T"),
    POSITIVE(force_scale, "kg", "mass by which F_cmd_S is divided to predict the acceleration"),
    PARAMETER(up_axis, "1", UP_AXIS_TEXT),
    POSITIVE(guard_angle, "rad",
             "panel axis (Y of D) is held if the line of sight is within this angle of the Sun or "
             "its opposite"),
    POSITIVE(elevation_limit, "rad",
             "magnitude of actual or desired elevation above which los_guard = 1"),
    NONNEGATIVE(range_limit, "m", "los_guard = 1 below this range"),
    SAMPLE_PERIOD,

    BODY_INPUTS("T", T, "target"),
    BODY_INPUTS("S", S, "servicer"),
    INPUT(F_cmd_S, "N", "force commanded last, servicer axes"),
    OPTIONAL_SWITCH(active, ACTIVE_TEXT),

    REFERENCE_ROWS(OUTPUT_ROW, y, ref),
    ROW_AS(OUTPUT_ROW, y, "range", range, 1, "m", "distance between the centres of mass",
           POSITIVE_VALUE),
    LOS_OUTPUTS("los", los.x, "m", "rad", "line of sight from servicer to target"),
    LOS_OUTPUTS("dlos", los.d, "m/s", "rad/s", "rate of the line of sight"),
    LOS_OUTPUTS("los_ref", los_ref.x, "m", "rad", "desired line of sight"),
    LOS_OUTPUTS("dlos_ref", los_ref.d, "m/s", "rad/s", "rate of the desired line of sight"),
    LOS_OUTPUTS("ddlos_ref", los_ref.dd, "m/s2", "rad/s2",
                "acceleration of the desired line of sight"),
    ANGLE_OUTPUT(beta_t, "angle between the relative position and the feature axis of the target"),
    ANGLE_OUTPUT(
        beta_p,
        "angle between the camera axis (+X of the servicer) and the direction to the target"),
    ALARM(attitude_guard, "1: line of sight near the Sun or its opposite, panel axis held"),
    ALARM(los_guard, "1: |elevation| above elevation_limit or range below range_limit"),
};

/* C.3-8 */
static void check(const Parameters *p, Problems *problems)
{
    check_inertia(problems, "J_T", p->J_T);
    check_up_axis(problems, p->up_axis);
    check_unit_vector(problems, "p_T", p->p_T);
    if (!(norm(p->sun_N) > 0)) reject(problems, "sun_N", norm(p->sun_N), "must not have norm 0");
    if (p->guard_angle >= 1.5)
        reject(problems, "guard_angle", p->guard_angle, "must be below 1.5 rad");
}

/* C.2: n' = w x n, n'' = dw x n + w x n' */
static Motion reference_position(const Parameters *p, const Body *T)
{
    mat3 C_TN = dcm_of_quat(canonical(T->q));
    vec3 torque =
        p->use_gravity_gradient ? gravity_gradient(p->mu, mul(C_TN, T->r), p->J_T) : vec(0, 0, 0);
    vec3 dw_T = solve(p->J_T, sub(torque, cross(T->omega, mul(p->J_T, T->omega))));
    vec3 n = scale(p->rho_f, p->p_T), dn = cross(T->omega, n);
    return (Motion){tmul(C_TN, n), tmul(C_TN, dn),
                    tmul(C_TN, add(cross(dw_T, n), cross(T->omega, dn)))};
}

/* r = r_T - r_S, its rate, and its acceleration without manoeuvres of the target, which the
 * servicer does not know */
static Motion line_to_target(const Parameters *p, const Input *u, vec3 F_cmd_S)
{
    vec3 rho = sub(u->S.r, u->T.r),
         a_S = scale(1 / p->force_scale, tmul(dcm_of_quat(canonical(u->S.q)), F_cmd_S));
    return (Motion){neg(rho), sub(u->T.v, u->S.v),
                    neg(add(differential_gravity(p->mu, u->T.r, rho), a_S))};
}

/* unit vector of r with derivatives. A range |r| below 0.1 m is replaced by 0.1 m, so that the
 * derivatives stay finite near range 0; range 0 itself violates the rule of the output `range`. */
/* C.3-5 */
static Motion direction(Motion r)
{
    double range = norm(r.x);
    if (range < 1e-150) return (Motion){.x = vec(1, 0, 0)};
    if (range < 0.1) r.x = scale(0.1, scale(1 / range, r.x));
    return normalised(r);
}

#define PARALLEL 1e-6 /* sine of the angle below which two unit vectors count as parallel */

/* any direction normal to x */
static vec3 some_normal(vec3 x)
{
    vec3 least = fabs(x.x) < 0.6 ? vec(1, 0, 0) : vec(0, 1, 0);
    return unit(cross(x, least));
}

/* C.3: panel axis y, normal to the line of sight x; outside the guard also normal to the direction
 * of the Sun, inside the guard as near to the held y as possible. If no y is held, or the line of
 * sight is along it, any normal is held. */
/* C.3-2 */
static Motion panel_axis(const Parameters *p, Motion x, State *held, double *guarded)
{
    vec3 chi = unit(p->sun_N);
    Motion w = {cross(chi, x.x), cross(chi, x.d), cross(chi, x.dd)};
    *guarded = norm(w.x) < sine(p->guard_angle);
    if (*guarded && norm(cross(held->y_N, x.x)) < PARALLEL) held->y_N = some_normal(x.x);
    Motion y = normalised(*guarded ? perpendicular_part(held->y_N, x) : w);
    if (!*guarded) held->y_N = y.x;
    return y;
}

/* C.3-3 */
static quat with_continuous_sign(quat q, quat last)
{
    double same = q.w * last.w + q.x * last.x + q.y * last.y + q.z * last.z;
    return same < 0 ? (quat){-q.w, -q.x, -q.y, -q.z} : q;
}

/* C.3-1 */
static void reference_attitude(const Parameters *p, Motion r, State *held, Output *y)
{
    Motion i = direction(r), j = panel_axis(p, i, held, &y->attitude_guard), k = cross_motion(i, j);
    held->q_DN = with_continuous_sign(quat_of_dcm(rows(i.x, j.x, k.x)), held->q_DN);
    y->ref.q = held->q_DN;
    y->ref.omega = frame_rate(i, j, k);
    y->ref.alpha = frame_acceleration(i, j, k);
}

/* C.3-4 */
static void publish_line_of_sight(const Parameters *p, const Input *u, Motion r, Motion ref,
                                  Output *y)
{
    y->range = norm(r.x);
    y->los = line_of_sight(p->up_axis, r).q;
    y->los_ref = line_of_sight(p->up_axis, neg_motion(ref)).q;
    y->beta_t = angle(neg(r.x), ref.x);
    y->beta_p = angle(dcm_of_quat(canonical(u->S.q)).row[0], r.x);
    double elevation = larger(fabs(y->los.x.y), fabs(y->los_ref.x.y));
    y->los_guard = elevation > p->elevation_limit || y->range < p->range_limit;
}

static void guide(const Parameters *p, const Input *u, State *x, Output *y, vec3 F_cmd_S)
{
    Motion ref = reference_position(p, &u->T), r = line_to_target(p, u, F_cmd_S);
    y->ref.rho = ref.x;
    y->ref.drho = ref.d;
    y->ref.ddrho = ref.dd;
    publish_line_of_sight(p, u, r, ref, y);
    reference_attitude(p, r, x, y);
}

/* takes 0 for the last command, as there is none before the start: if the initial outputs depended
 * on this input, they would form an algebraic loop with the controller */
/* C.3-6 */
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    State first = {0};
    (void)t;
    *x = first;
    guide(p, u, &first, y, vec(0, 0, 0));
    if (!u->active) y->attitude_guard = y->los_guard = 0;
}

/* active = 0: resets the state and publishes the outputs of a first sample, with flags of 0 */
/* C.3-7 */
static void publish_inactive(const Parameters *p, const Input *u, State *x, Output *y)
{
    State first = {0}, nothing = {0};
    guide(p, u, &first, y, u->F_cmd_S);
    y->attitude_guard = y->los_guard = 0;
    *x = nothing;
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s)) {
        if (u->active) guide(p, u, x, y, u->F_cmd_S);
        else publish_inactive(p, u, x, y);
    }
}

FMU_MODEL("los_guidance",
          "Guidance for hovering in front of a feature of a rotating target, panels to the Sun");
