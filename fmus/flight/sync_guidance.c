/* sync_guidance.c - synchronised approach: reference position on the grasp axis of a tumbling
 * target, reference attitude that looks back along it.
 *
 *   rho* = L(t) C_HT p_T,     L = rho_M - (rho_M - rho_0) exp(-beta t)
 *   D:  i = -C_HT p_T,   u = i x z_H,   k = u/|u|,   j = k x i
 *
 * with all derivatives, published as seen in N. Where the grasp axis comes within guard_angle of
 * the orbit normal, k stays where it was at the last sample outside, turned perpendicular to i. The
 * software knows the model of the target (inertia, gravity gradient, Keplerian orbit rate), not its
 * disturbances unless know_M_dist.
 * Source: Zhu & Yang 2009, equations (5) to (7) and (10); derivatives: docs/models.md A.4. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "body_rows.h"
#include "directions.h"
#include "earth.h"
#include "motion.h"
#include "orbit.h"
#include "reference_rows.h"
#include "rigid_body.h"
#include "sinusoid.h"

typedef struct {
    double mu;
    mat3 J_T;
    vec3 p_T;
    double rho_M, rho_0, beta, know_M_dist, use_gravity_gradient, guard_angle, sample_period;
    Sinusoid M_dist_T;
} Parameters;
typedef struct { Body T, S; } Input;
typedef struct { vec3 k_H; } State; /* k of the last sample outside the guard */
typedef struct {
    Reference ref;
    vec3 rho_H, drho_H, rho_ref_H;
    double range, beta_t, beta_p, attitude_guard;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.mu = MU_JGM3,
          .J_T = {{{100, 0, 0}, {0, 150, 0}, {0, 0, 90}}},
          .p_T = {1, 0, 0},
          .rho_M = 4,
          .rho_0 = 20,
          .beta = 1.0 / 120,
          .use_gravity_gradient = 1,
          .guard_angle = PI / 36},
    .u = {.T = {.r = {7158140, 0, 0}, .v = {0, 7462.286, 0}, .q = {1, 0, 0, 0}},
          .S = {.r = {7158140, 20, 0}, .v = {-0.0208, 7462.286, 0}, .q = {1, 0, 0, 0}}},
};

static const Variable variables[] = {
    NONNEGATIVE(mu, "m3/s2", "gravitational parameter of the planet; 0 = deep space"),
    MATRIX(J_T, "kg.m2", "inertia of the target as known to the software, body axes"),
    PARAMETER(p_T, "1", "unit vector from the target to the grasp point, target axes"),
    POSITIVE(rho_M, "m", "final distance on the grasp axis"),
    POSITIVE(rho_0, "m", "distance at t = 0"),
    NONNEGATIVE(beta, "1/s", "rate of approach"),
    SWITCH(know_M_dist, "1: the disturbance torque M_dist_T on the target is known"),
    SWITCH(use_gravity_gradient, "1: the software models the gravity gradient on the target"),
    POSITIVE(
        guard_angle, "rad",
        "smallest angle between grasp axis and orbit normal before the roll reference is held"),
    SAMPLE_PERIOD,
    SINUSOID_ROWS(M_dist_T, "N.m", "disturbance torque on the target, used with know_M_dist"),

    BODY_INPUTS("T", T, "target"),
    BODY_INPUTS("S", S, "servicer"),

    REFERENCE_ROWS(OUTPUT_ROW, y, ref),
    OUTPUT(rho_H, "m", "position of the servicer relative to the target, Hill axes"),
    OUTPUT(drho_H, "m/s", "derivative of rho_H as seen in the Hill frame"),
    OUTPUT(rho_ref_H, "m", "reference position, Hill axes"),
    NONNEGATIVE_OUTPUT(range, "m", "distance between the centres of mass"),
    ANGLE_OUTPUT(beta_t, "angle between the relative position and the grasp axis of the target"),
    ANGLE_OUTPUT(beta_p,
                 "angle between the arm axis (+X of the servicer) and the direction to the target"),
    FLAG(attitude_guard, "1: grasp axis near the orbit normal, roll reference held"),
};

static void check(const Parameters *p, Problems *problems)
{
    check_inertia(problems, "J_T", p->J_T);
    check_unit_vector(problems, "p_T", p->p_T);
    if (p->guard_angle >= 1.5)
        refuse(problems, "guard_angle", p->guard_angle, "must be below 1.5 rad");
}

/* A.4.3: grasp axis in H, derivatives as seen in H, from the target model */
static Motion grasp_axis(const Parameters *p, const Body *T, const HillFrame *H, double t)
{
    mat3 C_TN = dcm_of_quat(canonical(T->q)), C_TH = matmul_t(C_TN, H->C_HN);
    vec3 torque = p->know_M_dist ? sinusoid(&p->M_dist_T, t, t) : vec(0, 0, 0);
    if (p->use_gravity_gradient)
        torque = add(torque, gravity_gradient(p->mu, mul(C_TN, T->r), p->J_T));
    vec3 domega = solve(p->J_T, sub(torque, cross(T->omega, mul(p->J_T, T->omega))));

    vec3 wH_T = mul(C_TH, H->w_H); /* w: angular velocity of T relative to H in T components */
    vec3 w = sub(T->omega, wH_T);
    vec3 dw = add(sub(domega, mul(C_TH, H->dw_H)), cross(w, wH_T));
    vec3 dp = cross(w, p->p_T);
    return (Motion){tmul(C_TH, p->p_T), tmul(C_TH, dp),
                    tmul(C_TH, add(cross(dw, p->p_T), cross(w, dp)))};
}

/* (10): reference position and its derivatives as seen in H */
static Motion reference_position(const Parameters *p, Motion axis, double t)
{
    double decay = (p->rho_M - p->rho_0) * exponential(-p->beta * t);
    double L = p->rho_M - decay, L1 = p->beta * decay, L2 = -p->beta * L1;
    return (Motion){scale(L, axis.x), add(scale(L1, axis.x), scale(L, axis.d)),
                    sum3(scale(L2, axis.x), scale(2 * L1, axis.d), scale(L, axis.dd))};
}

/* (6): u = i x z_H */
static Motion roll_vector(Motion i)
{
    vec3 z = vec(0, 0, 1);
    return (Motion){cross(i.x, z), cross(i.d, z), cross(i.dd, z)};
}

/* A.4.5: attitude, rate and acceleration of D relative to N from its axes i, j, k in H */
static void publish_attitude(const HillFrame *H, Motion i, Motion j, Motion k, Reference *ref)
{
    mat3 C_DH = rows(i.x, j.x, k.x);
    vec3 w_DH = frame_rate(i, j, k), wH_D = mul(C_DH, H->w_H);

    ref->q = quat_of_dcm(matmul(C_DH, H->C_HN));
    ref->omega = add(w_DH, wH_D);
    ref->alpha = sub(add(frame_acceleration(i, j, k), mul(C_DH, H->dw_H)), cross(w_DH, wH_D));
}

/* A.4.5: in the guard u = k_held - (k_held.i) i, k_held constant in H */
static void reference_attitude(const Parameters *p, const HillFrame *H, Motion axis, vec3 *held,
                               Output *y)
{
    Motion i = neg_motion(axis), u = roll_vector(i);
    y->attitude_guard = norm(u.x) < sine(p->guard_angle);
    if (y->attitude_guard) u = normal_part(*held, i);
    Motion k = normalised(u);
    publish_attitude(H, i, cross_motion(k, i), k, &y->ref);
    if (!y->attitude_guard) *held = k.x;
}

/* A.4.1, A.4.2: derivatives as seen in H become derivatives as seen in N, all in N axes */
static void publish_position(const HillFrame *H, Motion ref, Output *y)
{
    y->rho_ref_H = ref.x;
    y->ref.rho = tmul(H->C_HN, ref.x);
    y->ref.drho = tmul(H->C_HN, rate_in_N(H, ref.x, ref.d));
    y->ref.ddrho = tmul(H->C_HN, add(ref.dd, transport(H, ref.x, ref.d)));
}

static void publish_relative_state(const Input *u, const HillFrame *H, vec3 axis_H, Output *y)
{
    vec3 rho_N = sub(u->S.r, u->T.r), arm_N = dcm_of_quat(canonical(u->S.q)).row[0];
    y->rho_H = mul(H->C_HN, rho_N);
    y->drho_H = rate_in_frame(H, y->rho_H, mul(H->C_HN, sub(u->S.v, u->T.v)));
    y->range = norm(rho_N);
    y->beta_t = angle(y->rho_H, axis_H);
    y->beta_p = angle(arm_N, neg(rho_N));
}

static void guide(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    HillFrame H = hill_frame(p->mu, u->T.r, u->T.v);
    Motion axis = grasp_axis(p, &u->T, &H, t);
    publish_relative_state(u, &H, axis.x, y);
    publish_position(&H, reference_position(p, axis, t), y);
    reference_attitude(p, &H, axis, &x->k_H, y);
}

/* inside the guard the grasp axis is near z of H: a first sample there holds x of H */
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    State first = {vec(1, 0, 0)};
    *x = first;
    guide(p, u, &first, y, t);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        guide(p, u, x, y, s.t);
}

FMU_MODEL("sync_guidance",
          "Guidance for the synchronised approach to the grasp point of a tumbling target");
