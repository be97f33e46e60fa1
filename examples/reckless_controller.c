/* reckless_controller.c - thrusts at the target, without end: for trying a safety filter.
 *
 *   F = -force rho/|rho|                  rho = r_S - r_T; the torque stays zero
 */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "body_rows.h"
#include "reference_rows.h"
#include "time_grid.h"

typedef struct { double force, sample_period; } Parameters;
typedef struct {
    Body T, S;
    Reference ref;
} Input;
typedef struct { double unused; } State;
typedef struct { vec3 F_cmd_S, M_cmd_S, wheel_accel_cmd; } Output;
MODEL_STRUCT;

static const Model start = {.p = {.force = 2}, .u = {.T.q = {1}, .S.q = {1}, .ref.q = {1}}};

static const Variable variables[] = {
    NONNEGATIVE(force, "N", "size of the force"),
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
    vec3 rho = sub(u->S.r, u->T.r);
    double range = norm(rho);
    vec3 F_N = range > 0 ? scale(-p->force / range, rho) : rho;
    y->F_cmd_S = mul(dcm_of_quat(canonical(u->S.q)), F_N);
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

FMU_MODEL("reckless_controller", "Force of constant size towards the target");
