/* assembly_controller.c - attitude tracking of a docked assembly with momentum gyros.
 *
 *   q_e = q_DH* q_SH (scalar part >= 0, vector part eps_e),  d_omega = omega_0 - A_e omega_ref
 *   h' = h'_ff + k1 J_A d_omega + k2 J_A eps_e
 *   h'_ff = -J_A (A_e omega_ref' - d_omega x A_e omega_ref) - J_A' omega_0 - h_m'
 *           - omega_0 x (J_A omega_0 + h_m + h) + tau_gg + tau_aero
 *
 * so that a small error angle theta obeys theta'' + k1 theta' + k2/2 theta = 0. h: momentum of the
 * gyros; h' is the command. omega_0, omega_ref: rates of base and reference; A_e: rotation
 * matrix of q_e; J_A, h_m: inertia of the assembly and momentum of the module relative to the base.
 * The command is constant over a sample, while h'_ff changes: with use_plan_rate the feed-forward
 * is the mean momentum rate of the plan over the coming sample, plus the momentum rate of the model
 * at the measured state, minus the one at the reference state. Without errors the momentum then
 * equals the planned momentum at every sample, without a delay of half a sample. law = 0 is the law
 * of the patent as printed: h' = k1 J_A (omega_0 - omega_orb) + k2_printed (eps - eps_b), with eps,
 * eps_b: vector parts of attitude and reference, omega_orb: orbital rate. Sampled controller: one
 * sample reads the inputs once and holds the command. Source: patent CN106020225A, corrected
 * (docs/models.md E.5). */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "assembly_rows.h"
#include "time_grid.h"

typedef struct {
    Assembly assembly;
    double law, k1, k2, k2_printed, use_plan_rate, sample_period;
} Parameters;
typedef struct {
    quat q_SH;
    vec3 omega_SN_S, h_cmg_S;
    Arm arm;
    AttitudeReference ref;
} Input;
typedef struct { double unused; } State;
typedef struct {
    vec3 hdot_cmd_S, eps_e, domega_S, dh_S;
    double attitude_error;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.assembly = ASSEMBLY_START,
          .law = 1,
          .k1 = 0.036,
          .k2 = 8e-4,
          .k2_printed = 3000,
          .use_plan_rate = 1},
    .u = {.q_SH = {0.5, -0.5, -0.5, 0.5}, .ref = {.q = {0.5, -0.5, -0.5, 0.5}}},
};

static const Variable variables[] = {
    ASSEMBLY_ROWS(assembly),
    SWITCH(law, "1: corrected law with feed-forward; 0: law as printed in patent CN106020225A"),
    NONNEGATIVE(k1, "1/s",
                "gain on the angular velocity, 2 zeta omega_c for the bandwidth omega_c"),
    NONNEGATIVE(k2, "1/s2", "gain on the attitude, 2 omega_c^2 for the bandwidth omega_c"),
    NONNEGATIVE(k2_printed, "N.m",
                "gain on the attitude in the law of the patent as printed (law = 0)"),
    SWITCH(use_plan_rate, "feed-forward momentum rate; 1: from dh_ref_D, mean over the next "
                          "sample; 0: from the model, at this sample"),
    SAMPLE_PERIOD,

    INPUT(q_SH, "1", "attitude of the base relative to H, scalar first"),
    INPUT(omega_SN_S, "rad/s", "angular velocity of the base relative to N, body axes"),
    INPUT(h_cmg_S, "N.m.s", "momentum of the gyros, body axes"),
    ROW_AS(INPUT_ROW, u, "arm_angle", arm.angle, 1, "rad",
           "angle of the arm (module about its hinge), positive about +z", ANY_VALUE),
    ROW_AS(INPUT_ROW, u, "arm_rate", arm.rate, 1, "rad/s", "rate of the arm", ANY_VALUE),
    ROW_AS(INPUT_ROW, u, "arm_accel", arm.accel, 1, "rad/s2", "acceleration of the arm", ANY_VALUE),
    ATTITUDE_REFERENCE_ROWS(INPUT_ROW, u, ref),

    OUTPUT(hdot_cmd_S, "N.m", "commanded rate of change of the momentum of the gyros, body axes"),
    OUTPUT(eps_e, "1",
           "attitude of the base relative to the reference, vector part of the quaternion"),
    OUTPUT(domega_S, "rad/s", "angular velocity minus its reference, body axes"),
    OUTPUT(dh_S, "N.m.s", "momentum of the gyros minus h_ref_D, body axes"),
    ANGLE_OUTPUT(attitude_error, "angle of the attitude error"),
};

/* E.5-6 */
static void check(const Parameters *p, Problems *problems)
{
    check_assembly(problems, &p->assembly);
}

typedef struct {
    quat q_So, q_Do;
    mat3 A_e;
    vec3 eps, omega_ref, domega; /* body axes */
} Error;

/* E.5-3 */
static Error error_of(const Input *u)
{
    quat q_So = q_So_of_q_SH(canonical(u->q_SH)), q_Do = q_So_of_q_SH(canonical(u->ref.q));
    quat q_e = canonical(product(conjugate(q_Do), q_So));
    mat3 A_e = dcm_of_quat(q_e);
    vec3 omega_ref = mul(A_e, u->ref.omega);
    return (Error){q_So, q_Do, A_e, vector_part(q_e), omega_ref, sub(u->omega_SN_S, omega_ref)};
}

static vec3 torque_at(const Parameters *p, const Configuration *c, quat q_So)
{
    return environment_torque(&p->assembly, c, dcm_of_quat(q_So));
}

/* term of the feed-forward with use_plan_rate: mean rate of the planned gyro momentum over the
 * coming sample, minus the momentum rate of the model at the present reference state */
/* E.5-2 */
static vec3 mean_rate_correction(const Parameters *p, const Configuration *c, quat q_Do,
                                 const AttitudeReference *r)
{
    vec3 now = momentum_rate(c, r->omega, r->alpha, r->h, torque_at(p, c, q_Do));
    return sub(r->dh, now);
}

/* E.5-1 */
static vec3 feed_forward(const Parameters *p, const Input *u, const Configuration *c,
                         const Error *e)
{
    vec3 domega = sub(mul(e->A_e, u->ref.alpha), cross(e->domega, e->omega_ref));
    vec3 now = momentum_rate(c, u->omega_SN_S, domega, u->h_cmg_S, torque_at(p, c, e->q_So));
    if (p->use_plan_rate == 0) return now;
    return add(now, mul(e->A_e, mean_rate_correction(p, c, e->q_Do, &u->ref)));
}

static vec3 corrected_law(const Parameters *p, const Input *u, const Configuration *c,
                          const Error *e)
{
    vec3 feedback = mul(c->J, add(scale(p->k1, e->domega), scale(p->k2, e->eps)));
    return add(feed_forward(p, u, c, e), feedback);
}

/* E.5-4 */
static vec3 printed_law(const Parameters *p, const Input *u, const Configuration *c, const Error *e)
{
    vec3 rate = sub(u->omega_SN_S, orbital_rate_o(&p->assembly));
    vec3 attitude = sub(vector_part(e->q_So), vector_part(e->q_Do));
    return add(scale(p->k1, mul(c->J, rate)), scale(p->k2_printed, attitude));
}

static void control(const Parameters *p, const Input *u, Output *y)
{
    Error e = error_of(u);
    Configuration c = configuration(&p->assembly, u->arm);
    y->hdot_cmd_S = (p->law != 0 ? corrected_law : printed_law)(p, u, &c, &e);
    y->eps_e = e.eps;
    y->domega_S = e.domega;
    y->dh_S = sub(u->h_cmg_S, mul(e.A_e, u->ref.h));
    y->attitude_error = rotation_of(e.eps);
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    (void)x;
    (void)t;
    control(p, u, y);
}

/* E.5-5 */
static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    (void)x;
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        control(p, u, y);
}

FMU_MODEL("assembly_controller",
          "Attitude tracking of a docked assembly with feed-forward of its momentum");
