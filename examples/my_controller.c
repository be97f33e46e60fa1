/* my_controller.c - proportional and derivative control of position and attitude.
 *
 *   F = -K (rho - rho_ref) - D (drho - drho_ref)                  rho = r_S - r_T, all in N axes
 *   M = -K_att e - D_att (omega_S - C_SD omega_D)                 e: vector part of q_SD, S axes */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "body_rows.h"
#include "reference_rows.h"
#include "time_grid.h"

typedef struct { double K, D, K_att, D_att, sample_period; } Parameters;
typedef struct {
    Body T, S;
    Reference ref;
} Input;
typedef struct { double unused; } State;
typedef struct { vec3 F_cmd_S, M_cmd_S, wheel_accel_cmd; } Output;
MODEL_STRUCT;

static const Model start = {.p = {.K = 10, .D = 60, .K_att = 5, .D_att = 45},
                            .u = {.T.q = {1}, .S.q = {1}, .ref.q = {1}}};

static const Variable variables[] = {
    NONNEGATIVE(K, "N/m", "stiffness"),
    NONNEGATIVE(D, "N.s/m", "damping"),
    NONNEGATIVE(K_att, "N.m", "stiffness of the attitude"),
    NONNEGATIVE(D_att, "N.m.s", "damping of the attitude"),
    SAMPLE_PERIOD,
    BODY_INPUTS("T", T, "target"),
    BODY_INPUTS("S", S, "servicer"),
    REFERENCE_ROWS(INPUT_ROW, u, ref),
    OUTPUT(F_cmd_S, "N", "commanded force, servicer axes"),
    OUTPUT(M_cmd_S, "N.m", "commanded torque, servicer axes"),
    OUTPUT(wheel_accel_cmd, "rad/s2", "commanded wheel acceleration"),
};

static void check(const Parameters *p, Problems *problems) { (void)p, (void)problems; }

static void control(const Parameters *p, const Input *u, Output *y)
{
    vec3 e = sub(sub(u->S.r, u->T.r), u->ref.rho), de = sub(sub(u->S.v, u->T.v), u->ref.drho);
    vec3 F_N = neg(add(scale(p->K, e), scale(p->D, de)));
    y->F_cmd_S = mul(dcm_of_quat(canonical(u->S.q)), F_N);

    quat q_SD = canonical(product(conjugate(u->ref.q), u->S.q));
    vec3 rate = sub(u->S.omega, mul(dcm_of_quat(q_SD), u->ref.omega));
    y->M_cmd_S = neg(add(scale(p->K_att, vector_part(q_SD)), scale(p->D_att, rate)));
}

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    (void)x, (void)t;
    control(p, u, y);
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    (void)x;
    for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))
        control(p, u, y);
}

FMU_MODEL("my_controller", "Proportional and derivative control of position and attitude");
