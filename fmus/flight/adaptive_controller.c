/* adaptive_controller.c - adaptive control of position (unknown mass) and attitude (unknown inertia
 * of body and wheels).
 *
 * Translation, Hill components:   e1 = rho - rho*,  e2 = drho - drho*,  Psi = f_rel - ddrho*
 *   (12) F = -m_hat (K e1 + P e2 + Psi),     dm_hat/dt = Gamma e2 . (Psi + K e1)
 * Attitude, servicer components:  epsilon = MRP of S relative to D,  dw = omega - wd,
 *   wd = C_SD omega_d,  wdd = C_SD alpha_d
 *   (19) A_hat dOmega = G^T(epsilon) K epsilon/4 + P dw - J_hat wdd - wd x (A_hat Omega + J_hat wd)
 *   deta_hat/dt  = Gamma W^T dw,   W = -[ X(wd,wd) + Y(wdd),  X(wd,Omega) + Y(dOmega) ]
 *   eta = [J11 J12 J13 J22 J23 J33 A11 A12 A13 A22 A23 A33],   Y(b) s = S b,   X(a,b) s = a x (S b)
 *
 * f_rel: relative acceleration of free motion; rho*, drho*, ddrho*: reference; m_hat, J_hat,
 * A_hat: estimates of mass and inertias of body and wheels; Omega, dOmega: wheel speeds and
 * commanded wheel acceleration; G: d epsilon/dt = G(epsilon) dw/4; omega_d, alpha_d: rate and
 * acceleration of D; K, P, Gamma: gains, separate for translation and attitude; s: elements of a
 * symmetric matrix S in the order of eta. Without wheels (use_wheels = 0) the right-hand side of
 * (19) with opposite sign is the commanded torque. Sampled: the command uses the estimates before
 * their explicit Euler update; the published estimates are the updated ones.
 * Source: Zhu & Yang 2009, equations (8) to (21); corrections and options: docs/models.md A.4.4,
 * A.5, A.7. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "adaptive_attitude.h"
#include "body_rows.h"
#include "earth.h"
#include "orbit.h"
#include "time_grid.h"

typedef struct {
    double mu;
    vec3 K_rho, P_rho;
    double Gamma_m, m_hat_0;
    vec3 K_att, P_att;
    Eta Gamma_eta, eta_hat_0;
    double Gamma_scale, use_wheels, t_att, projection, m_hat_range, eta_hat_range, J_offdiag_max,
        A_offdiag_max;
    double damping_in_regressor, wheel_rest, sample_period;
} Parameters;
typedef struct {
    Body T, S;
    vec3 wheel_speed;
    Reference ref;
    double active;
} Input;
typedef struct {
    double m_hat;
    Eta eta_hat;
} State;
typedef struct {
    vec3 F_cmd_S, M_cmd_S, wheel_accel_cmd;
    double m_hat;
    Eta eta_hat;
    vec3 e1_H, e2_H, epsilon, domega_S, F_cmd_H;
} Output;
MODEL_STRUCT;

static const Model start = {
    .p = {.mu = MU_JGM3,
          .K_rho = {2e-3, 2e-3, 2e-3},
          .P_rho = {5e-2, 5e-2, 5e-2},
          .Gamma_m = 10,
          .m_hat_0 = 95,
          .K_att = {2, 2, 2},
          .P_att = {10, 10, 10},
          .Gamma_eta = {{{80000, 4000, 4000, 80000, 4000, 80000}},
                        {{4000, 2000, 2000, 4000, 1600, 1600}}},
          .eta_hat_0 = {{{180, 0, 0, 240, 0, 160}}, {{14, 0, 0, 16, 0, 12}}},
          .Gamma_scale = 1,
          .use_wheels = 1,
          .m_hat_range = 0.3,
          .eta_hat_range = 0.3,
          .J_offdiag_max = 20,
          .A_offdiag_max = 2},
    .u = {.T = {.r = {7158140, 0, 0}, .v = {0, 7462.286, 0}, .q = {1, 0, 0, 0}},
          .S = {.r = {7158140, 20, 0}, .v = {-0.0208, 7462.286, 0}, .q = {1, 0, 0, 0}},
          .ref = {.rho = {0, 20, 0}, .q = {1, 0, 0, 0}},
          .active = 1},
};

static const Variable variables[] = {
    NONNEGATIVE(mu, "m3/s2", "gravitational parameter of the planet; 0 = deep space"),
    NONNEGATIVE(K_rho, "1/s2", "position gain, per Hill axis"),
    NONNEGATIVE(P_rho, "1/s", "velocity gain, per Hill axis"),
    NONNEGATIVE(Gamma_m, "kg.s2/m2", "adaptation gain of the mass estimate"),
    POSITIVE(m_hat_0, "kg", "start value of the mass estimate"),
    NONNEGATIVE(K_att, "N.m",
                "attitude gain per body axis, torque -K_att epsilon/4 for small errors; equal on "
                "all axes: no jump of the Lyapunov function at MRP switches"),
    NONNEGATIVE(P_att, "N.m.s", "rate gain, per body axis"),
    NONNEGATIVE(Gamma_eta, "kg.m2.s2",
                "adaptation gains of the inertia estimates, order of eta_hat"),
    PARAMETER(eta_hat_0, "kg.m2", "start value of eta_hat, elements in the same order"),
    NONNEGATIVE(Gamma_scale, "1", "factor on Gamma_eta"),
    SWITCH(use_wheels, "1: torque by wheels (wheel_accel_cmd), 0: by thrusters (M_cmd_S)"),
    PARAMETER(t_att, "s", "attitude control and its adaptation start at this time"),
    SWITCH(projection, "1: m_hat_range, eta_hat_range, J_offdiag_max, A_offdiag_max apply"),
    NONNEGATIVE(m_hat_range, "1",
                "projection: largest relative change of the mass estimate from its start value"),
    NONNEGATIVE(eta_hat_range, "1",
                "projection: largest relative change of the diagonal inertia estimates"),
    NONNEGATIVE(J_offdiag_max, "kg.m2",
                "projection: largest change of the off-diagonal body inertia estimates"),
    NONNEGATIVE(A_offdiag_max, "kg.m2",
                "projection: largest change of the off-diagonal wheel inertia estimates"),
    SWITCH(damping_in_regressor, "1: P_rho e2_H is part of the regressor of the mass estimate"),
    NONNEGATIVE(wheel_rest, "rad/s",
                "the inertia estimates are constant while a wheel is at least this fast; 0: never"),
    SAMPLE_PERIOD,

    BODY_INPUTS("T", T, "target"),
    BODY_INPUTS("S", S, "servicer"),
    INPUT(wheel_speed, "rad/s", "wheel speeds relative to the body"),
    REFERENCE_ROWS(INPUT_ROW, u, ref),
    OPTIONAL_SWITCH(active, ACTIVE_TEXT),

    OUTPUT(F_cmd_S, "N", "commanded force, servicer axes"),
    OUTPUT(M_cmd_S, "N.m", "commanded torque, servicer axes (0 with use_wheels)"),
    OUTPUT(wheel_accel_cmd, "rad/s2",
           "commanded wheel acceleration relative to the body (0 without use_wheels)"),
    OUTPUT(m_hat, "kg", "estimated mass"),
    OUTPUT(eta_hat, "kg.m2",
           "estimated inertia J of the servicer, wheels locked, and A of the wheels (momentum "
           "A wheel_speed): J11 J12 J13 J22 J23 J33 A11 A12 A13 A22 A23 A33"),
    OUTPUT(e1_H, "m", "position error rho - rho_ref, Hill axes"),
    OUTPUT(e2_H, "m/s", "velocity error, derivative of e1_H as seen in the Hill frame"),
    OUTPUT(epsilon, "1", "attitude error, modified Rodrigues parameters of S relative to D"),
    OUTPUT(domega_S, "rad/s", "angular velocity minus reference angular velocity, servicer axes"),
    OUTPUT(F_cmd_H, "N", "commanded force, Hill axes"),
};

/* A.5-7 */
static void check(const Parameters *p, Problems *problems)
{
    if (determinant(full_matrix(p->eta_hat_0.A)) <= 0 && p->use_wheels)
        reject(problems, "eta_hat_0", determinant(full_matrix(p->eta_hat_0.A)),
               "the wheel inertia estimate must have a positive determinant (use_wheels = 1)");
}

/* ---- translation ---- */

/* (8), A.4.4: relative acceleration of free motion in the Hill frame; r_t: orbit radius of the
 * target */
static vec3 relative_acceleration(double mu, double r_t, const HillFrame *H, vec3 rho, vec3 drho)
{
    vec3 chaser = add(vec(r_t, 0, 0), rho);
    double r_c = norm(chaser), k = mu > 0 ? mu / (r_c * r_c * r_c) : 0,
           k_t = mu > 0 ? mu / (r_t * r_t) : 0;
    return sub(sub(vec(k_t, 0, 0), scale(k, chaser)), transport(H, rho, drho));
}

/* (12), A.5.1 */
/* A.5-1 */
static void control_translation(const Parameters *p, const Input *u, State *x, Output *y,
                                double period)
{
    HillFrame H = hill_frame(p->mu, u->T.r, u->T.v);
    vec3 rho = mul(H.C_HN, sub(u->S.r, u->T.r)),
         drho = rate_in_frame(&H, rho, mul(H.C_HN, sub(u->S.v, u->T.v)));
    vec3 ref = mul(H.C_HN, u->ref.rho), dref = rate_in_frame(&H, ref, mul(H.C_HN, u->ref.drho));
    vec3 ddref = sub(mul(H.C_HN, u->ref.ddrho), transport(&H, ref, dref));

    vec3 e1 = sub(rho, ref), e2 = sub(drho, dref);
    vec3 Psi = sub(relative_acceleration(p->mu, norm(u->T.r), &H, rho, drho), ddref);
    vec3 stiffness = times(p->K_rho, e1), damping = times(p->P_rho, e2);
    vec3 regressor = sum3(Psi, stiffness, p->damping_in_regressor ? damping : vec(0, 0, 0));

    y->e1_H = e1;
    y->e2_H = e2;
    y->F_cmd_H = scale(-x->m_hat, sum3(stiffness, damping, Psi));
    y->F_cmd_S = mul(dcm_of_quat(canonical(u->S.q)), tmul(H.C_HN, y->F_cmd_H));
    x->m_hat += period * p->Gamma_m * dot(e2, regressor);
}

/* ---- attitude ---- */

/* Y(b)^T d and X(a,b)^T d: derivatives of d.(S b) and d.(a x S b) with respect to the elements of
 * the symmetric matrix S */
static Symmetric Y_transposed(vec3 b, vec3 d)
{
    return (Symmetric){{b.x * d.x, b.y * d.x + b.x * d.y, b.z * d.x + b.x * d.z, b.y * d.y,
                        b.z * d.y + b.y * d.z, b.z * d.z}};
}
static Symmetric X_transposed(vec3 a, vec3 b, vec3 d)
{
    return Y_transposed(b, cross(d, a));
} /* d.(a x v) = (d x a).v */

/* -(a + b) */
static Symmetric minus_sum(Symmetric a, Symmetric b)
{
    for (int i = 0; i < 6; i++) a.v[i] = -(a.v[i] + b.v[i]);
    return a;
}

/* eta_hat += period Gamma W^T dw */
static void adapt(const Parameters *p, Symmetric *estimate, const Symmetric *gain, Symmetric Wt_dw,
                  double period)
{
    for (int i = 0; i < 6; i++) estimate->v[i] += period * p->Gamma_scale * gain->v[i] * Wt_dw.v[i];
}

/* true if the speed of a wheel has reached wheel_rest, which is set near the speed limit of the
 * wheels. A wheel at its limit may not follow its command, so that the attitude error carries no
 * information about the inertias. */
/* A.5-4 */
static int is_at_limit(const Parameters *p, vec3 wheel_speed)
{
    return p->wheel_rest > 0 && largest_size(wheel_speed) >= p->wheel_rest;
}

/* (19), A.5.2 */
/* A.5-3 */
static void control_attitude(const Parameters *p, const Input *u, State *x, Output *y,
                             double period)
{
    AttitudeError e = attitude_error(u->S.q, u->S.omega, &u->ref);
    mat3 J_hat = full_matrix(x->eta_hat.J), A_hat = full_matrix(x->eta_hat.A);
    vec3 wd = e.wd, wdd = e.wdd, dw = e.dw, Omega = u->wheel_speed;
    vec3 torque = wheel_torque(p->K_att, p->P_att, J_hat, A_hat, &e, Omega);

    y->epsilon = e.epsilon;
    y->domega_S = dw;
    y->wheel_accel_cmd = p->use_wheels ? solve(A_hat, torque) : vec(0, 0, 0);
    y->M_cmd_S = p->use_wheels ? vec(0, 0, 0) : neg(torque);

    /* W^T dw, W = -[X(wd,wd) + Y(wdd), X(wd,Omega) + Y(dOmega)] */
    vec3 dOmega = y->wheel_accel_cmd;
    Eta Wt_dw = {.J = minus_sum(X_transposed(wd, wd, dw), Y_transposed(wdd, dw)),
                 .A = minus_sum(X_transposed(wd, Omega, dw), Y_transposed(dOmega, dw))};
    if (is_at_limit(p, Omega)) return;
    adapt(p, &x->eta_hat.J, &p->Gamma_eta.J, Wt_dw.J, period);
    adapt(p, &x->eta_hat.A, &p->Gamma_eta.A, Wt_dw.A, period);
}

/* ---- projection, an option that is not in the paper ---- */
static double limited_about(double value, double centre, double range)
{
    return clamp(value, centre - range, centre + range);
}

static void project_symmetric(Symmetric *s, const Symmetric *s_0, double range, double off_diagonal)
{
    for (int i = 0; i < 6; i++) {
        int on_diagonal = i == 0 || i == 3 || i == 5;
        s->v[i] =
            limited_about(s->v[i], s_0->v[i], on_diagonal ? range * fabs(s_0->v[i]) : off_diagonal);
    }
}

/* A.5-5 */
static void project(const Parameters *p, State *x)
{
    x->m_hat = limited_about(x->m_hat, p->m_hat_0, p->m_hat_range * p->m_hat_0);
    project_symmetric(&x->eta_hat.J, &p->eta_hat_0.J, p->eta_hat_range, p->J_offdiag_max);
    project_symmetric(&x->eta_hat.A, &p->eta_hat_0.A, p->eta_hat_range, p->A_offdiag_max);
}

/* ---- one sample ---- */
/* A.5-2 */
static void control(const Parameters *p, const Input *u, State *x, Output *y, double t,
                    double period)
{
    State unchanged = *x; /* before t_att the adaptation changes this copy, not x */
    control_translation(p, u, x, y, period);
    control_attitude(p, u, reached(t, p->t_att) ? x : &unchanged, y, period);
    if (!reached(t, p->t_att)) y->wheel_accel_cmd = y->M_cmd_S = vec(0, 0, 0);
    if (p->projection) project(p, x);
}

/* A.5-6 */
static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    *x = (State){p->m_hat_0, p->eta_hat_0};
    control(p, u, x, y, t, 0);
    if (!u->active) y->F_cmd_S = y->F_cmd_H = y->M_cmd_S = y->wheel_accel_cmd = vec(0, 0, 0);
    y->m_hat = x->m_hat;
    y->eta_hat = x->eta_hat;
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s)) {
        if (u->active) control(p, u, x, y, s.t, s.period);
        else initialize(p, u, x, y, s.t);
    }
    y->m_hat = x->m_hat;
    y->eta_hat = x->eta_hat;
}

FMU_MODEL("adaptive_controller",
          "Adaptive control of position with unknown mass and attitude with unknown inertia");
