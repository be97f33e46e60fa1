/* docking_port.h - probe and drogue: relative motion of the ports, contact of the tip of the probe
 * with the drogue (a cone with a flat floor), latch (spring and damper in six degrees of freedom),
 * separation spring.
 *
 * P: probe port on S, Q: drogue port on T, e: tip of the probe in Q. Forces and couples act on S
 * and are in Q axes; the force acts at the tip. The contact force is by Hunt & Crossley 1975, with
 * regularised Coulomb friction. Equations: docs/models.md I.1 to I.3 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef DOCKING_PORT_H
#define DOCKING_PORT_H

#include "pairs.h"

enum { FREE, CONTACT, SOFT, HARD, RELEASED, BROKEN };

typedef struct { double k, c, k_rot, c_rot; } Latch;
typedef struct {
    double mouth_radius, floor_radius, cone_depth, face_radius, depth_max;
    double k_contact, n_contact, damping_contact, friction, friction_speed;
    Latch soft, hard;
    double draw_delay, draw_time, k_sep, stroke_sep;
} Port;

/* relative motion of the ports. d: vectors from the centres of mass of the two bodies to the tip of
 * the probe, N axes. e, u: position and velocity of the tip, w: angular velocity of the probe, all
 * three relative to Q and in Q axes */
typedef struct {
    vec3_pair d;
    vec3 e, u, w;
    mat3 C_QN;
    quat q_PQ;
} PortState;

/* present phase; t_phase: time of the last change of phase, changes between FREE and CONTACT
 * excluded; e_c: position e of the tip at the last soft capture or release; q_R: rest attitude, set
 * at soft capture */
typedef struct {
    double phase, t_phase;
    vec3 e_c;
    quat q_R;
} PhaseEntry;

typedef struct {
    vec3 F, M;
    double U, P_diss, P_drive;
    double normal; /* sum of the normal forces of contact [N] */
    double touches, too_deep;
} PortLoad;

/* ---- contact ---- */
/* fifth-order step S(x) = 10 x^3 - 15 x^4 + 6 x^5; S is 0 for x < 0 and 1 for x > 1 */
static inline double smooth(double x)
{
    double s = clamp(x, 0, 1);
    return s * s * s * (10 + s * (-15 + 6 * s));
}
static inline double smooth_rate(double x)
{
    double s = clamp(x, 0, 1);
    return 30 * s * s * (1 - s) * (1 - s);
}

static inline double power_of(double x, double exponent)
{
    return x > 0 ? exponential(exponent * logarithm(x)) : 0;
}

/* adds the load of one contact with depth d > 0 and normal n; u: velocity of the tip */
static inline void add_contact(const Port *p, double d, vec3 n, vec3 u, PortLoad *y)
{
    double rate = -dot(n, u), elastic = p->k_contact * power_of(d, p->n_contact);
    double F_n = larger(0, elastic * (1 + p->damping_contact * rate));
    vec3 slip = add(u, scale(rate, n));
    double speed = sqrt(dot(slip, slip) + p->friction_speed * p->friction_speed);
    double friction = speed > 0 ? p->friction * F_n / speed : 0;

    y->F = sum3(y->F, scale(F_n, n), scale(-friction, slip));
    y->U += elastic * d / (p->n_contact + 1);
    y->P_diss += (F_n - elastic) * rate + friction * dot(slip, slip);
    y->normal += F_n;
    y->touches = 1;
}

/* load of all contacts of the tip at e = (x, y, z), r^2 = y^2 + z^2. The material of the drogue
 * fills r < face_radius, x < 0, except for the cone; the tip has at most one contact with the wall
 * of the cone or its rim, and one with the floor. */
static inline PortLoad contact_load(const Port *p, vec3 e, vec3 u)
{
    PortLoad y = {.U = 0};
    double r = sqrt(e.y * e.y + e.z * e.z);
    if (e.x >= 0 || r >= p->face_radius) return y;
    double slope = (p->mouth_radius - p->floor_radius) / p->cone_depth;
    double cos_a = 1 / sqrt(1 + slope * slope), sin_a = slope * cos_a;
    double wall = (r - p->floor_radius - (e.x + p->cone_depth) * slope) * cos_a;
    double face = -e.x, floor = -p->cone_depth - e.x;
    vec3 X = vec(1, 0, 0), out = r < 1e-12 ? vec(0, 1, 0) : vec(0, e.y / r, e.z / r);
    int rim = face < wall;
    double depth = rim ? face : wall;

    y.too_deep = depth > p->depth_max || floor > p->depth_max;
    if (y.too_deep) return y;
    if (depth > 0) add_contact(p, depth, rim ? X : add(scale(sin_a, X), scale(-cos_a, out)), u, &y);
    if (floor > 0) add_contact(p, floor, X, u, &y);
    return y;
}

/* ---- latch ---- */
static inline vec3 seated_tip(const Port *p) { return vec(-p->cone_depth, 0, 0); }

static inline vec3 rotation_from_rest(const PhaseEntry *c, const PortState *s)
{
    return mrp_of_quat(product(s->q_PQ, conjugate(c->q_R)));
}

static inline PortLoad latch_load(const Port *p, const PhaseEntry *c, const PortState *s, double t)
{
    const Latch *k = c->phase == SOFT ? &p->soft : &p->hard;
    double x = c->phase == SOFT ? (t - c->t_phase - p->draw_delay) / p->draw_time : 1;
    vec3 path = sub(seated_tip(p), c->e_c);
    vec3 e_r = x < 1 ? add(c->e_c, scale(smooth(x), path)) : seated_tip(p),
         de_r = scale(smooth_rate(x) / p->draw_time, path);
    vec3 stretch = sub(s->e, e_r), rate = sub(s->u, de_r), sigma = rotation_from_rest(c, s);
    double ss = dot(sigma, sigma);

    PortLoad y = {.F = add(scale(-k->k, stretch), scale(-k->c, rate)),
                  .M = add(scale(-4 * k->k_rot * (1 + ss), sigma), scale(-k->c_rot, s->w)),
                  .U = k->k * dot(stretch, stretch) / 2 + 8 * k->k_rot * ss,
                  .P_diss = k->c * dot(rate, rate) + k->c_rot * dot(s->w, s->w)};
    y.P_drive = dot(y.F, de_r);
    return y;
}

/* ---- load by phase ---- */
static inline void add_separation_spring(const Port *p, const PhaseEntry *c, vec3 e, PortLoad *y)
{
    double compression = p->stroke_sep - (e.x - c->e_c.x);
    if (compression <= 0) return;
    y->F.x += p->k_sep * compression;
    y->U += p->k_sep * compression * compression / 2;
}

static inline PortLoad port_load(const Port *p, const PhaseEntry *c, const PortState *s, double t)
{
    if (c->phase == SOFT || c->phase == HARD) return latch_load(p, c, s, t);
    PortLoad y = contact_load(p, s->e, s->u);
    if (c->phase == RELEASED) add_separation_spring(p, c, s->e, &y);
    return y;
}

/* rest attitude q_R of P: q_PQ rotated along the shortest arc until X_P = -X_Q; the roll angle
 * at soft capture does not change */
static inline quat rest_attitude(quat q_PQ)
{
    vec3 b = dcm_of_quat(q_PQ).row[0];
    double g = sqrt((1 - b.x) / 2);
    return canonical(product((quat){g, 0, -b.z / (2 * g), b.y / (2 * g)}, q_PQ));
}

#endif
