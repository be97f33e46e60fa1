/* filter_rows.h - rows n.u >= c of the safety filter for the held force u, in rank order: box,
 * keep-out, speed, corridor, plume.
 *
 *   n.u >= m beta (1 + mass_error) if beta > 0, else m beta (1 - mass_error),
 *   beta = alpha + D - n.a                                                                      (9)
 * c: right-hand side; n: unit vector away from the edge of the rule; beta: acceleration that the
 * force must give along n; alpha: least total acceleration along n that the rule needs; a: known
 * acceleration; D: bound on the unknown acceleration; m: mass. Equations (9) to (17):
 * docs/models.md M.3 */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef FILTER_ROWS_H
#define FILTER_ROWS_H

#include "filter_geometry.h"

enum { SIDES = 8, FACES = 9 };

static inline void add_row(Rows *rows, int rule, vec3 n, double c)
{
    rows->row[rows->count++] = (Row){n, c, rule, 0};
}

/* force that gives at least the acceleration beta with every possible mass: computed with the
 * largest mass if beta > 0, with the least mass if beta <= 0 (the force may point to the edge) */
static inline double force_of(const FilterParameters *p, double beta)
{
    return beta * p->mass * (beta > 0 ? 1 + p->mass_error : 1 - p->mass_error);
}

static inline double add_gap(const FilterParameters *p, const Geometry *g, Rows *rows, int rule,
                             const Gap *x, vec3 n, double D_less_known)
{
    double alpha = needed_acceleration(x, g->P, p->recover_speed);
    add_row(rows, rule, mul(g->C_SN, n), force_of(p, alpha + D_less_known));
    return barrier_of(x);
}

static inline void add_box(const FilterParameters *p, Rows *rows)
{
    const vec3 axis[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    for (int i = 0; i < 3; i++) {
        double most = dot(axis[i], p->F_max);
        add_row(rows, BOX, axis[i], -most);
        add_row(rows, BOX, neg(axis[i]), -most);
    }
}

/* (10), (11): adds the row of the keep-out sphere, for the plane that touches the sphere at the
 * point nearest to the servicer; returns the barrier */
static inline double add_keep_out(const FilterParameters *p, const Geometry *g, Rows *rows)
{
    double T_r = p->reaction, falling = dot(g->out, g->g), rate = dot(g->out, g->v);
    double ahead = T_r * rate + T_r * T_r / 2 * falling, turned = g->P * g->a_F;
    Gap x = {g->R - p->keep_out_radius + ahead - g->e_p, rate + T_r * falling - g->e_v,
             p->brake_keep_out, g->e_p, g->e_v};
    double bend = turned * turned / (4 * larger(g->R, p->keep_out_radius));
    double D = p->a_dist + g->turn + bend;
    return add_gap(p, g, rows, KEEP_OUT, &x, g->out, D - falling);
}

static inline double speed_limit(const FilterParameters *p, double range)
{
    return smaller(p->speed_at_zero + p->speed_slope * range, p->speed_max);
}

/* (12), (13): speed limit when the hold of the force ends, after `reaction` and one sample period:
 * the limit at the least range predicted for this time, minus terms for the velocity gained
 * sideways in the hold, for the error of the velocity and for unknown accelerations */
static inline double limit_after_hold(const FilterParameters *p, const Geometry *g, double sideways)
{
    double T = p->reaction + g->P, closing = smaller(0, dot(g->out, g->v));
    double range = g->R + T * closing - T * T / 2 * g->a_F - p->position_error;
    double unknown = g->e_v + g->P * (p->a_dist + g->turn);
    return speed_limit(p, larger(range, 0)) - sideways * sideways / p->speed_at_zero - unknown;
}

/* (14): because of velocity errors of at most g->e_v, a servicer below its speed limit may seem to
 * be 2 g->e_v above the limit. For such an excess alone the row requires at most `share`, the
 * smallest element of F_max divided by sqrt(3), so that two other rules can each require as much */
static inline double speed_force(const FilterParameters *p, const Geometry *g, double beta)
{
    double share = smaller(p->F_max.x, smaller(p->F_max.y, p->F_max.z)) / sqrt(3.0);
    double certain = force_of(p, beta - 2 * g->e_v / g->P);
    return larger(certain, smaller(force_of(p, beta), share));
}

/* (12), (14) */
static inline double add_speed(const FilterParameters *p, const Geometry *g, Rows *rows)
{
    vec3 v = add(g->v_H, scale(p->reaction, g->a_H));
    double s = norm(v), sideways = g->P * (g->a_F + norm(g->a_H));
    double L = limit_after_hold(p, g, sideways);
    if (s > 0 && s + sideways > L) {
        vec3 n = scale(-1 / s, v);
        double beta = (s - g->P * dot(n, g->a_H) - L) / g->P;
        add_row(rows, SPEED, mul(g->C_SN, n), speed_force(p, g, beta));
    }
    return speed_limit(p, g->R) - norm(g->v_H) - p->velocity_error;
}

/* ---- corridor: eight faces of a pyramid inscribed in the cone, and the plane at its end ---- */
typedef struct {
    vec3 n; /* unit vector into the corridor, N axes */
    double offset;
} Face;

static inline vec3 least_axis(vec3 a)
{
    double x = fabs(a.x), y = fabs(a.y), z = fabs(a.z);
    if (x <= y && x <= z) return vec(1, 0, 0);
    return y <= z ? vec(0, 1, 0) : vec(0, 0, 1);
}

/* (15): sets the faces of the corridor and returns their number; slope: tangent of the angle
 * between a face of the pyramid and its axis, tan(half angle) cos(pi/8) */
static inline int corridor_faces(const FilterParameters *p, mat3 C_TN, double slope, Face face[])
{
    vec3 axis = p->corridor_axis, e_1 = unit(cross(axis, least_axis(axis)));
    vec3 e_2 = cross(axis, e_1);
    double d = sqrt(0.5), c = 1 / sqrt(1 + slope * slope);
    const double cosines[SIDES] = {1, d, 0, -d, -1, -d, 0, d};
    for (int j = 0; j < SIDES; j++) {
        double along_1 = cosines[j], along_2 = cosines[(j + 6) % SIDES];
        vec3 side = add(scale(along_1, e_1), scale(along_2, e_2));
        face[j] = (Face){tmul(C_TN, scale(c, sub(scale(slope, axis), side))), 0};
    }
    face[SIDES] = (Face){neg(tmul(C_TN, axis)), p->corridor_length};
    return p->corridor_length > 0 ? FACES : SIDES;
}

static inline vec3 from_apex(const FilterParameters *p, const Geometry *g, vec3 rho)
{
    return sub(rho, tmul(g->C_TN, p->corridor_apex));
}

/* (16) */
static inline Gap corridor_gap(const FilterParameters *p, const Geometry *g, const Face *face)
{
    double T_r = p->reaction, known = dot(face->n, g->a_T), rate = dot(face->n, g->v_T);
    double e_p = g->e_p + p->attitude_error * g->R;
    double e_v = g->e_v + p->rate_error * g->R + p->attitude_error * norm(g->v);
    double d = face->offset + dot(face->n, from_apex(p, g, g->rho));
    return (Gap){d + T_r * rate + T_r * T_r / 2 * known - e_p, rate + T_r * known - e_v,
                 p->brake_corridor, e_p, e_v};
}

/* (17): bound D of the unknown acceleration relative to the rotating target */
static inline double corridor_unknown(const FilterParameters *p, const FilterInput *u,
                                      const Geometry *g)
{
    double W = norm(g->W), turn = norm(sub(u->S.omega, mul(g->C_SN, g->W)));
    double change = turn * g->a_F + (2 * W * g->a_F + 3 * W * W * norm(g->v_T));
    return p->a_dist + g->P * change + p->alpha_T_max * g->R;
}

static inline double add_corridor(const FilterParameters *p, const FilterInput *u,
                                  const Geometry *g, double slope, Rows *rows)
{
    Face face[FACES];
    int faces = corridor_faces(p, g->C_TN, slope, face);
    double D = corridor_unknown(p, u, g), least = INFINITY;
    for (int j = 0; j < faces; j++) {
        Gap x = corridor_gap(p, g, &face[j]);
        double known = dot(face[j].n, g->a_T);
        least = smaller(least, add_gap(p, g, rows, CORRIDOR, &x, face[j].n, D - known));
    }
    return least;
}

/* within plume_range, adds the row that limits the force away from the target, because the exhaust
 * of such a force meets the target; returns the barrier, which is negative within plume_range */
static inline double add_plume(const FilterParameters *p, const Geometry *g, Rows *rows)
{
    if (g->R < p->plume_range) add_row(rows, PLUME, neg(mul(g->C_SN, g->out)), -p->plume_force);
    return g->R - p->plume_range;
}

/* rows of all rules except drift; sets barrier[rule - 1] of the rules that apply, and no other
 * element; slope: as in corridor_faces() */
static inline Rows all_rows(const FilterParameters *p, const FilterInput *u, const Geometry *g,
                            double slope, double barrier[])
{
    Rows rows = {.count = 0};
    add_box(p, &rows);
    if (g->sphere) barrier[KEEP_OUT - 1] = add_keep_out(p, g, &rows);
    if (g->speed) barrier[SPEED - 1] = add_speed(p, g, &rows);
    if (g->corridor) barrier[CORRIDOR - 1] = add_corridor(p, u, g, slope, &rows);
    if (p->plume_range > 0) barrier[PLUME - 1] = add_plume(p, g, &rows);
    return rows;
}

#endif
