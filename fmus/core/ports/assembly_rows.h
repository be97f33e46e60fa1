/* assembly_rows.h - parameters of a docked assembly, which is a base and a module on a hinge, with
 * their checks, and the attitude reference of the assembly as ports. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef ASSEMBLY_ROWS_H
#define ASSEMBLY_ROWS_H

#include "assembly.h"
#include "directions.h"
#include "earth.h"
#include "fmu.h"

/* default values: the scenario of docs/models.md E.3 */
#define ASSEMBLY_START                                                                         \
    {.m0 = 24000,                                                                              \
     .m1 = 20000,                                                                              \
     .J0 = {{{9.0e4, 2.0e3, -6.0e3}, {2.0e3, 5.4e5, 1.0e3}, {-6.0e3, 1.0e3, 5.8e5}}},          \
     .J1 = {{{6.0e4, -1.0e3, 2.0e3}, {-1.0e3, 3.6e5, 0}, {2.0e3, 0, 3.8e5}}},                  \
     .hinge = {9.5, 0, 0.10},                                                                  \
     .module = {8.5, 0, 0.05},                                                                 \
     .surfaces = {.box_0 = {16, 4, 4},                                                         \
                  .box_1 = {14, 4, 4},                                                         \
                  .panel_area = {60, 60, 50, 0},                                               \
                  .panel_body = {0, 0, 1, 0},                                                  \
                  .panel_position = {{{-2, 12, 0}, {-2, -12, 0}, {-4, 0, -6}, {0, 0, 0}}},     \
                  .panel_normal = {{{0.6, 0, 0.8}, {0.6, 0, 0.8}, {0, 0.6, 0.8}, {0, 0, 1}}}}, \
     .mu = MU_ROUNDED,                                                                         \
     .R_C = 6768137,                                                                           \
     .rho = 3.0e-12,                                                                           \
     .C_D = 2.2}

#define ASSEMBLY_MATRIX(name, member, columns, unit, text) \
    ROW_AS(PARAMETER_ROW, p, name, member, columns, unit, text, ANY_VALUE)

#define ASSEMBLY_ROWS(member)                                                                    \
    POSITIVE_AS("m0", member.m0, "kg", "mass of the base"),                                      \
        POSITIVE_AS("m1", member.m1, "kg", "mass of the module"),                                \
        ASSEMBLY_MATRIX("J0", member.J0, 3, "kg.m2",                                             \
                        "inertia of the base about its centre of mass, base axes"),              \
        ASSEMBLY_MATRIX("J1", member.J1, 3, "kg.m2",                                             \
                        "inertia of the module about its centre of mass, module axes"),          \
        PARAMETER_AS(                                                                            \
            "hinge", member.hinge, "m",                                                          \
            "from the centre of mass of the base to the hinge, base axes; the hinge axis is z"), \
        PARAMETER_AS("module", member.module, "m",                                               \
                     "from the hinge to the centre of mass of the module, module axes (base "    \
                     "axes at angle 0)"),                                                        \
        NONNEGATIVE_AS("box_0", member.surfaces.box_0, "m",                                      \
                       "x, y, z edge lengths of the drag box around the centre of mass of the "  \
                       "base; 0 = none"),                                                        \
        NONNEGATIVE_AS("box_1", member.surfaces.box_1, "m",                                      \
                       "x, y, z edge lengths of the drag box around the centre of mass of the "  \
                       "module; 0 = none"),                                                      \
        NONNEGATIVE_AS("panel_area", member.surfaces.panel_area, "m2",                           \
                       "area of one side of each two-sided panel; 0 = none"),                    \
        ROW_AS(PARAMETER_ROW, p, "panel_body", member.surfaces.panel_body, 1, "1",               \
               "body that carries the panel, per panel: 0 base, 1 module", SWITCH_VALUE),        \
        ASSEMBLY_MATRIX(                                                                         \
            "panel_position", member.surfaces.panel_position, 3, "m",                            \
            "centres of the panels from the centre of mass of their body, axes of that body"),   \
        ASSEMBLY_MATRIX("panel_normal", member.surfaces.panel_normal, 3, "1",                    \
                        "unit normals of the panels, axes of their body"),                       \
        NONNEGATIVE_AS("mu", member.mu, "m3/s2",                                                 \
                       "gravitational parameter of the planet; 0 = deep space"),                 \
        POSITIVE_AS("R_C", member.R_C, "m", "radius of the circular orbit"),                     \
        NONNEGATIVE_AS("rho", member.rho, "kg/m3", "density of the atmosphere"),                 \
        NONNEGATIVE_AS("C_D", member.C_D, "1", "drag coefficient of all surfaces")

static inline void check_assembly(Problems *problems, const Assembly *a)
{
    char name[24];
    check_inertia(problems, "J0", a->J0);
    check_inertia(problems, "J1", a->J1);
    for (int k = 0; k < PANELS; k++) {
        snprintf(name, sizeof name, "panel_normal[%d]", k + 1);
        check_unit_vector(problems, name, a->surfaces.panel_normal.of[k]);
    }
}

/* ---- attitude reference of the assembly: output of the guidance, input of the controller ---- */
typedef struct {
    quat q;
    vec3 omega, alpha, h, dh;
} AttitudeReference;

#define ATTITUDE_REFERENCE_ROW(causality, part, name, member, unit, text) \
    ROW_AS(causality, part, name, member, 1, unit, text, ANY_VALUE)

#define ATTITUDE_REFERENCE_ROWS(causality, part, member)                                         \
    ATTITUDE_REFERENCE_ROW(causality, part, "q_DH", member.q, "1",                               \
                           "reference attitude relative to H, scalar first; (1,-1,-1,1)/2: "     \
                           "X along track, Z to Earth"),                                         \
        ATTITUDE_REFERENCE_ROW(causality, part, "omega_DN_D", member.omega, "rad/s",             \
                               "reference angular velocity relative to N, reference body axes"), \
        ATTITUDE_REFERENCE_ROW(causality, part, "alpha_DN_D", member.alpha, "rad/s2",            \
                               "reference angular acceleration, derivative of omega_DN_D"),      \
        ATTITUDE_REFERENCE_ROW(                                                                  \
            causality, part, "h_ref_D", member.h, "N.m.s",                                       \
            "momentum of the gyros predicted by the guidance, reference body axes"),             \
        ATTITUDE_REFERENCE_ROW(                                                                  \
            causality, part, "dh_ref_D", member.dh, "N.m",                                       \
            "mean rate of change of h_ref_D over the next sample of the guidance, "              \
            "reference body axes")

#endif
