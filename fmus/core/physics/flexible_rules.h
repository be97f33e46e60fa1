/* flexible_rules.h - parameters of a servicer with panels and slosh, the vehicle that these
 * parameters describe, and the rules that they must satisfy for each panel, each slosh mass, and
 * the hub, which is the servicer without panels and slosh masses. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef FLEXIBLE_RULES_H
#define FLEXIBLE_RULES_H

#include "back_substitution.h"
#include "servicer_base.h"

typedef struct {
    BaseParameters base;
    Panels panel;
    Sloshes slosh;
} FlexibleParameters;

static inline void reject_entry(Problems *problems, const char *list, int i, double value,
                                const char *rule)
{
    char name[40];
    snprintf(name, sizeof name, "%s[%d]", list, i + 1);
    reject(problems, name, value, rule);
}

static inline void check_ratio(Problems *problems, const char *list, int i, double value)
{
    if (value < 0 || value > 1) reject_entry(problems, list, i, value, "must be in [0, 1]");
}
static inline void check_nonnegative(Problems *problems, const char *list, int i, double value)
{
    if (value < 0) reject_entry(problems, list, i, value, "must be >= 0");
}
static inline void check_length(Problems *problems, const char *matrix, int i, vec3 row)
{
    if (norm(row) == 0) reject_entry(problems, matrix, i, 0, "must not have zero length");
}

static inline void check_panel(const Panels *p, int i, Problems *problems)
{
    vec3 I = p->inertia[i];
    double least = smaller(I.x, smaller(I.y, I.z)), most = larger(I.x, larger(I.y, I.z));
    double cos_angle = dot(unit(p->axis_S[i]), unit(p->arm_S[i]));
    check_length(problems, "panel_arm_S", i, p->arm_S[i]);
    check_length(problems, "panel_axis_S", i, p->axis_S[i]);
    if (fabs(cos_angle) > 1e-9)
        reject_entry(problems, "panel_axis_S", i, cos_angle,
                     "must be perpendicular to panel_arm_S (the value is the cosine of the angle)");
    if (least <= 0) reject_entry(problems, "panel_inertia", i, least, "must be > 0");
    else if (!satisfies_triangle_inequality(diagonal(I.x, I.y, I.z)))
        reject_entry(
            problems, "panel_inertia", i, most,
            "must satisfy the triangle inequality (no moment above the sum of the other two)");
    check_nonnegative(problems, "panel_frequency", i, p->frequency[i]);
    check_ratio(problems, "panel_damping_ratio", i, p->damping_ratio[i]);
}

static inline void check_slosh(const Sloshes *p, int j, Problems *problems)
{
    check_length(problems, "slosh_axis_S", j, p->axis_S[j]);
    check_nonnegative(problems, "slosh_frequency", j, p->frequency[j]);
    check_ratio(problems, "slosh_damping_ratio", j, p->damping_ratio[j]);
    check_nonnegative(problems, "slosh_travel", j, p->travel[j]);
    check_nonnegative(problems, "slosh_draw", j, p->draw[j]);
}

#define PARTS_OF_J_S \
    "J_S, panel_mass, panel_inertia, panel_hinge_S, panel_arm_S, slosh_mass_0, slosh_position_S"
#define TOO_MUCH_INERTIA                                                                    \
    " (panels and slosh masses have more inertia than J_S permits: enlarge J_S or shorten " \
    "panel_hinge_S, panel_arm_S, slosh_position_S)"

static inline Vehicle vehicle(const FlexibleParameters *p)
{
    return vehicle_of(p->base.mass_0, p->base.J_S, &p->panel, &p->slosh);
}

/* (12) of docs/models.md L: number n of substeps in an internal step, the smallest with
 * (max_step/n) omega_top <= 0.3; omega_top: highest_mode() [rad/s] */
static inline double substeps(const FlexibleParameters *p, const Vehicle *v)
{
    return larger(1, ceiling_of(p->base.max_step * highest_mode(v) / 0.3 * (1 - 1e-12)));
}

/* rejects more than 1000 substeps, and a hub without positive mass or with an impossible inertia
 * about its own centre of mass: I_hc = I_h0 - (h.h 1 - h h^T)/m_h with locked wheels, or I_hc - A_w
 * without the wheels; m_h, h, I_h0: mass of the hub, its first moment and its inertia about point
 * S; A_w: matrix from wheel speeds to wheel momentum */
static inline void check_hub(const FlexibleParameters *p, Problems *problems)
{
    Vehicle v = vehicle(p);
    if (v.mass <= 0) {
        reject(problems, "mass of the hub, from mass_0, panel_mass, slosh_mass_0", v.mass,
               "must be > 0 (panels and slosh masses weigh more than mass_0)");
        return;
    }
    mat3 I_hc = mat_of(sym_sub(v.inertia, point_inertia(1 / v.mass, v.first_moment)));
    vec3 diagonal_I = vec(I_hc.row[0].x, I_hc.row[1].y, I_hc.row[2].z);
    double least = smaller(diagonal_I.x, smaller(diagonal_I.y, diagonal_I.z)),
           most = larger(diagonal_I.x, larger(diagonal_I.y, diagonal_I.z));
    if (!is_positive_definite(I_hc))
        reject(problems, "inertia of the hub, from " PARTS_OF_J_S, least,
               "must be positive definite" TOO_MUCH_INERTIA);
    else if (!satisfies_triangle_inequality(I_hc))
        reject(problems, "inertia of the hub, from " PARTS_OF_J_S, most,
               "must satisfy the triangle inequality" TOO_MUCH_INERTIA);
    else if (!is_positive_definite(minus(I_hc, p->base.A_w)))
        reject(problems, "inertia of the hub - A_w, from " PARTS_OF_J_S, least,
               "must be positive definite (the value is the least moment before A_w is "
               "subtracted)" TOO_MUCH_INERTIA);
    else if (substeps(p, &v) > 1000)
        reject(problems, "substeps, from max_step, panel_frequency, slosh_frequency",
               substeps(p, &v), "must be at most 1000 (shorten max_step)");
}

static inline void check_flexible(Problems *problems, const FlexibleParameters *p)
{
    double draw = 0;
    check_base_body(problems, &p->base);
    for (int i = 0; i < PANELS; i++)
        if (p->panel.mass[i] > 0) check_panel(&p->panel, i, problems);
    for (int j = 0; j < SLOSHES; j++)
        if (p->slosh.mass_0[j] > 0) {
            check_slosh(&p->slosh, j, problems);
            draw += p->slosh.draw[j];
        }
    if (draw > 1)
        reject(problems, "sum of slosh_draw", draw,
               "must be at most 1 (sum over all masses with slosh_mass_0 > 0)");
    if (problems->count == 0) check_hub(p, problems); /* check_hub() needs valid parameters */
}

#endif
