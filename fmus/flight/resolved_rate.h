/* resolved_rate.h - joint rates that give the end effector a wanted motion: generalized Jacobian of
 * a floating base, damping near singular poses, posture, limits of angle and rate.
 *
 *   J = J_m - J_0 H_00^-1 H_0m     (base_floats 0: J_m)          Umetani & Yoshida 1989
 *   dq = z + J^T (J J^T + lambda^2 1)^-1 (y - J z),   z = K_posture (ready - q)
 *   lambda = damping_max (1 - m/manipulability_min) where m < manipulability_min, else 0
 *   m = sqrt(det J J^T), 0 with fewer than six columns
 *
 * A joint may have K_limit (min - q) <= dq <= K_limit (max - q). Those that break it are fixed at
 * their bound, all of a pass at once, and the others solved anew without them; then all are scaled
 * by the one that exceeds its rate most. Equations: docs/models.md K.3. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef RESOLVED_RATE_H
#define RESOLVED_RATE_H

#include "arm.h"

typedef struct {
    double ready[ARM_JOINTS], angle_min[ARM_JOINTS], angle_max[ARM_JOINTS], rate_max[ARM_JOINTS];
    double K_posture, K_limit, damping_max, manipulability_min, base_floats;
} RateLaw;

typedef struct {
    double dq[ARM_JOINTS], limited[ARM_JOINTS];
    double manipulability, damping, rate_scale;
} JointRates;

typedef struct { double at[6]; } Six; /* velocity and rate of E, base axes */
typedef struct {
    int joints;
    Six column[ARM_JOINTS];
} Jacobian;

static inline Six six(vec3 linear, vec3 angular)
{
    return (Six){{linear.x, linear.y, linear.z, angular.x, angular.y, angular.z}};
}
static inline Six tip_motion(Twist t, vec3 p_E) { return six(velocity_at(t, p_E), t.w); }
static inline Six plus_six(Six a, double k, const Six *b) /* a + k b */
{
    for (int i = 0; i < 6; i++) a.at[i] += k * b->at[i];
    return a;
}

static inline double dot_six(const Six *a, const Six *b)
{
    double sum = 0;
    for (int i = 0; i < 6; i++) sum += a->at[i] * b->at[i];
    return sum;
}

/* motion of the base for a unit rate of each joint at constant momentum: -H_00^-1 H_0m */
typedef struct { Twist joint[ARM_JOINTS]; } Reaction;

static inline void set_reaction(Reaction *base, const MassMatrix *H)
{
    Mobility mobility = mobility_of(&H->whole, 1);
    int joints = H->tree->joints;
    for (int j = 0; j < joints; j++) {
        Twist answer = base_answer(&mobility, H->joint[j]);
        base->joint[j] = (Twist){neg(answer.v), neg(answer.w)};
    }
}

/* ---- one pass: the joints that are not fixed ---- */
typedef struct { double at[6][8]; } Gram; /* upper half, y in column 6 */

static inline Gram gram_of(const Jacobian *J, const JointRates *r, const Six *y)
{
    Gram G = {{{0}}};
    int joints = J->joints;
    for (int k = 0; k < joints; k++) {
        const double *c = J->column[k].at;
        if (r->limited[k]) continue;
        for (int i = 0; i < 6; i++)
            for (int j = i; j < 6; j++) G.at[i][j] += c[i] * c[j];
    }
    for (int i = 0; i < 6; i++) G.at[i][6] = y->at[i];
    return G;
}

/* sqrt(det J J^T) from the pivots of its elimination */
static inline double manipulability_of(const Gram *pivots)
{
    double product = 1;
    for (int i = 0; i < 6; i++) product *= pivots->at[i][i];
    return sqrt(product);
}

static inline void solve_pass(const RateLaw *law, const Jacobian *J, const double z[], Six y,
                              JointRates *r)
{
    int joints = J->joints, columns = 0;
    for (int i = 0; i < joints; i++) {
        columns += !r->limited[i];
        if (!r->limited[i]) r->dq[i] = z[i];
        y = plus_six(y, -r->dq[i], &J->column[i]);
    }
    const Gram G = gram_of(J, r, &y);
    Gram left = G;
    int regular = solve_upper(&left.at[0][0], 6, 8, y.at);
    double m = regular && columns >= 6 ? manipulability_of(&left) : 0;
    double least = law->manipulability_min;
    double lambda = m < least ? law->damping_max * (1 - m / least) : 0;
    if (lambda > 0) {
        left = G;
        for (int i = 0; i < 6; i++) left.at[i][i] += lambda * lambda;
        regular = solve_upper(&left.at[0][0], 6, 8, y.at);
    }
    r->manipulability = m;
    r->damping = lambda;
    if (!regular) return; /* singular and undamped: the posture alone */
    for (int i = 0; i < joints; i++)
        if (!r->limited[i]) r->dq[i] += dot_six(&J->column[i], &y);
}

/* fixes the joints that break a limit of angle; how many */
static inline int fix_joints(const RateLaw *law, const double q[], int joints, JointRates *r)
{
    int broken = 0;
    for (int i = 0; i < joints; i++) {
        double bound = clamp(r->dq[i], law->K_limit * (law->angle_min[i] - q[i]),
                             law->K_limit * (law->angle_max[i] - q[i]));
        if (r->limited[i] || bound == r->dq[i]) continue;
        r->dq[i] = bound;
        r->limited[i] = 1;
        broken++;
    }
    return broken;
}

static inline void scale_rates(const RateLaw *law, int joints, JointRates *r)
{
    r->rate_scale = 1;
    for (int i = 0; i < joints; i++)
        if (fabs(r->dq[i]) * r->rate_scale > law->rate_max[i])
            r->rate_scale = law->rate_max[i] / fabs(r->dq[i]);
    for (int i = 0; i < joints; i++) r->dq[i] *= r->rate_scale;
}

/* xd: wanted motion of E relative to the motion of S, base axes; w: rate of the base */
static inline JointRates joint_rates(const RateLaw *law, const MassMatrix *H, const Tree *t, vec3 w,
                                     const double q[], const double dq[], Six xd)
{
    int joints = t->joints;
    Jacobian J = {.joints = joints};
    Twist base = {vec(0, 0, 0), w}; /* v_0: base without arm motion, or with the same momentum */
    Reaction reaction = {{{{0, 0, 0}, {0, 0, 0}}}};
    double z[ARM_JOINTS];
    if (law->base_floats) set_reaction(&reaction, H);
    for (int i = 0; i < joints; i++) {
        Twist r = reaction.joint[i], screw = t->link[i].screw;
        z[i] = law->K_posture * (law->ready[i] - q[i]);
        base.v = sub(base.v, scale(dq[i], r.v));
        base.w = sub(base.w, scale(dq[i], r.w));
        J.column[i] = tip_motion((Twist){add(screw.v, r.v), add(screw.w, r.w)}, t->p_E);
    }
    Six y0 = tip_motion(base, t->p_E), y = plus_six(xd, -1, &y0);

    JointRates found = {.rate_scale = 1};
    solve_pass(law, &J, z, y, &found);
    double m = found.manipulability, lambda = found.damping;
    for (int pass = 0; pass < ARM_JOINTS && fix_joints(law, q, joints, &found); pass++)
        solve_pass(law, &J, z, y, &found);
    found.manipulability = m;
    found.damping = lambda;
    scale_rates(law, joints, &found);
    return found;
}

#endif
