/* flexible_rules.h - parameters of a servicer with panels and slosh, the vehicle they describe, and
 * what they must obey: each part by itself, and what is left of the hub. */
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

static inline void refuse_entry(Problems *problems, const char *list, int i, double value,
                                const char *rule)
{
    char name[40];
    snprintf(name, sizeof name, "%s[%d]", list, i + 1);
    refuse(problems, name, value, rule);
}

static inline void check_ratio(Problems *problems, const char *list, int i, double value)
{
    if (value < 0 || value > 1) refuse_entry(problems, list, i, value, "must be in [0, 1]");
}
static inline void check_nonnegative(Problems *problems, const char *list, int i, double value)
{
    if (value < 0) refuse_entry(problems, list, i, value, "must be >= 0");
}
static inline void check_length(Problems *problems, const char *matrix, int i, vec3 row)
{
    if (norm(row) == 0) refuse_entry(problems, matrix, i, 0, "must not have zero length");
}

static inline void check_panel(const Panels *p, int i, Problems *problems)
{
    vec3 I = p->inertia[i];
    double least = smaller(I.x, smaller(I.y, I.z)), most = larger(I.x, larger(I.y, I.z));
    double across = dot(unit(p->axis_S[i]), unit(p->arm_S[i]));
    check_length(problems, "panel_arm_S", i, p->arm_S[i]);
    check_length(problems, "panel_axis_S", i, p->axis_S[i]);
    if (fabs(across) > 1e-9)
        refuse_entry(problems, "panel_axis_S", i, across,
                     "must be perpendicular to panel_arm_S (cosine of the angle between them)");
    if (least <= 0) refuse_entry(problems, "panel_inertia", i, least, "must be > 0");
    else if (!keeps_triangle_rule(diagonal(I.x, I.y, I.z)))
        refuse_entry(problems, "panel_inertia", i, most,
                     "must keep the triangle rule (no moment above the sum of the other two)");
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
#define TOO_MUCH_INERTIA                                                                  \
    " (the panels take more inertia than J_S has: enlarge J_S or shorten panel_hinge_S, " \
    "panel_arm_S)"

static inline Vehicle vehicle(const FlexibleParameters *p)
{
    return vehicle_of(p->base.mass_0, p->base.J_S, &p->panel, &p->slosh);
}

/* n: the smallest whole number with (max_step/n) omega_top <= 0.3; (12) */
static inline double substeps(const FlexibleParameters *p, const Vehicle *v)
{
    return larger(1, ceiling_of(p->base.max_step * highest_mode(v) / 0.3 * (1 - 1e-12)));
}

/* the hub about its own centre of mass, I_hc = I_h0 - (h.h 1 - h h^T)/m_h, needs mass and inertia,
 * without the wheels too */
static inline void check_hub_left(const FlexibleParameters *p, Problems *problems)
{
    Vehicle v = vehicle(p);
    if (v.mass <= 0) {
        refuse(problems, "m_h of mass_0, panel_mass, slosh_mass_0", v.mass,
               "must be > 0 (the panels and slosh masses are more than mass_0)");
        return;
    }
    mat3 I_hc = mat_of(sym_sub(v.inertia, point_inertia(1 / v.mass, v.first_moment)));
    vec3 diagonal_I = vec(I_hc.row[0].x, I_hc.row[1].y, I_hc.row[2].z);
    double least = smaller(diagonal_I.x, smaller(diagonal_I.y, diagonal_I.z)),
           most = larger(diagonal_I.x, larger(diagonal_I.y, diagonal_I.z));
    if (!is_positive_definite(I_hc))
        refuse(problems, "I_hc of " PARTS_OF_J_S, least,
               "must be positive definite" TOO_MUCH_INERTIA);
    else if (!keeps_triangle_rule(I_hc))
        refuse(problems, "I_hc of " PARTS_OF_J_S, most,
               "must keep the triangle rule" TOO_MUCH_INERTIA);
    else if (!is_positive_definite(minus(I_hc, p->base.A_w)))
        refuse(problems, "I_hc - A_w of A_w, " PARTS_OF_J_S, least,
               "must be positive definite" TOO_MUCH_INERTIA);
    else if (substeps(p, &v) > 1000)
        refuse(problems, "sub-steps of max_step, panel_frequency, slosh_frequency", substeps(p, &v),
               "must be at most 1000 (shorten max_step)");
}

static inline void check_flexible(Problems *problems, const FlexibleParameters *p)
{
    double draw = 0;
    check_whole(problems, &p->base);
    for (int i = 0; i < PANELS; i++)
        if (p->panel.mass[i] > 0) check_panel(&p->panel, i, problems);
    for (int j = 0; j < SLOSHES; j++)
        if (p->slosh.mass_0[j] > 0) {
            check_slosh(&p->slosh, j, problems);
            draw += p->slosh.draw[j];
        }
    if (draw > 1)
        refuse(problems, "sum of slosh_draw", draw, "must be at most 1 over the existing masses");
    if (problems->count == 0) check_hub_left(p, problems); /* it is made of good numbers only */
}

#endif
