/* held_spring.c - a spring between servicer and target along one axis, whose force is held over the
 * step: taken at its start, or at its middle as position and velocity extrapolate it.
 *
 *   F = -k (x - rest),   x = (r_S - r_T).e + extrapolate (v_S - v_T).e h/2,   e: X axis of N
 *
 * Compared with docking_mechanism in stiff_contact.py. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "body_rows.h"

typedef struct { double k, rest, extrapolate; } Parameters;
typedef struct { Body T, S; } Input;
typedef struct { double unused; } State;
typedef struct { vec3 F_contact_S, F_T; } Output;
MODEL_STRUCT;

static const Model start = {.p = {.k = 20000, .rest = -1.58}, .u = {.T.q = {1}, .S.q = {1}}};

static const Variable variables[] = {
    POSITIVE(k, "N/m", "stiffness"),
    PARAMETER(rest, "m", "distance without force, along X of N"),
    SWITCH(extrapolate, "1: force at the extrapolated middle of the step, 0: at its start"),
    BODY_INPUTS("T", T, "target"),
    BODY_INPUTS("S", S, "servicer"),
    OUTPUT(F_contact_S, "N", "force on the servicer, its axes"),
    OUTPUT(F_T, "N", "force on the target, its axes"),
};

static void check(const Parameters *p, Problems *problems) { (void)p, (void)problems; }

static void initialize(const Parameters *p, const Input *u, State *x, Output *y, double t)
{
    (void)p, (void)u, (void)x, (void)y, (void)t;
}

static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h)
{
    (void)x, (void)t;
    double ahead = p->extrapolate ? h / 2 : 0;
    double stretch = u->S.r.x - u->T.r.x + ahead * (u->S.v.x - u->T.v.x) - p->rest;
    vec3 F_N = vec(-p->k * stretch, 0, 0);
    y->F_contact_S = mul(dcm_of_quat(canonical(u->S.q)), F_N);
    y->F_T = neg(mul(dcm_of_quat(canonical(u->T.q)), F_N));
}

FMU_MODEL("held_spring", "Spring between servicer and target with a force held over the step");
