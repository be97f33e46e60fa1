/* line_of_sight.h - relative motion in line-of-sight (LOS) coordinates: range, elevation, azimuth.
 *
 * r points from the servicer to the target; v and a are its derivatives as seen in N; rho = |r|,
 * eps: elevation, bet: azimuth. One inertial axis is "up". If this axis is called y and the two
 * others follow in cyclic order, the axes of frame L are, with ce = cos(elevation), sb =
 * sin(azimuth) and so on,
 *   x_l = [ ce cb,  se, -ce sb] = r/|r|,   y_l = [-se cb,  ce,  se sb],
 *   z_l = x_l x y_l = [ sb,  0,  cb]
 * elevation is counted from the plane normal to y, azimuth in this plane from x, and
 *   rho' = x_l.v,   eps' = y_l.v/rho,   bet' = -z_l.v/(rho ce)
 *   rho'' = x_l.a + rho (eps'^2 + bet'^2 ce^2)
 *   eps'' = (y_l.a - 2 rho' eps')/rho - bet'^2 se ce
 *   bet'' = (-z_l.a - 2 rho' bet' ce + 2 rho eps' bet' se)/(rho ce)
 * Divisors are bounded from below: rho by 0.1 m, ce by 1e-3. Equations: docs/models.md C.1. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef LINE_OF_SIGHT_H
#define LINE_OF_SIGHT_H

#include "fmu.h"
#include "motion.h"

#define SMALLEST_COSINE \
    1e-3                   /* smallest cosine of the elevation used as a divisor, near the poles */
#define SMALLEST_RANGE 0.1 /* m, smallest range used as a divisor */

enum { UP_IS_X = 1, UP_IS_Y = 2, UP_IS_Z = 3 };

#define UP_AXIS_TEXT                                                                       \
    "inertial up axis: 1 = X, 2 = Y, 3 = Z; elevation is positive towards it, azimuth is " \
    "right-handed about it, counted from Z (1), X (2) or Y (3)"

/* three outputs for a vec3 that contains (range, elevation, azimuth) */
#define LOS_OUTPUTS(name, member, range_unit, angle_unit, text)                               \
    ROW_AS(OUTPUT_ROW, y, name ".range", member.x, 1, range_unit, text ", range", ANY_VALUE), \
        ROW_AS(OUTPUT_ROW, y, name ".elevation", member.y, 1, angle_unit, text ", elevation", \
               ANY_VALUE),                                                                    \
        ROW_AS(OUTPUT_ROW, y, name ".azimuth", member.z, 1, angle_unit, text ", azimuth",     \
               ANY_VALUE)

typedef struct {
    Motion q;                         /* range, elevation, azimuth with derivatives; m, rad */
    mat3 C_LN;                        /* rows x_l, y_l, z_l */
    double ce, se, ce_safe, rho_safe; /* cosine, sine of elevation; bounded divisors ce, rho */
} LineOfSight;

static inline void check_up_axis(Problems *problems, double up)
{
    if (up != UP_IS_X && up != UP_IS_Y && up != UP_IS_Z)
        reject(problems, "up_axis", up, "must be 1, 2 or 3");
}

/* components in cyclic order with "up" as the second one (y); with_up_in_place() is the inverse */
static inline vec3 with_up_as_y(vec3 a, double up)
{
    return up == UP_IS_X ? vec(a.z, a.x, a.y) : up == UP_IS_Z ? vec(a.y, a.z, a.x) : a;
}
static inline vec3 with_up_in_place(vec3 a, double up)
{
    return up == UP_IS_X ? vec(a.y, a.z, a.x) : up == UP_IS_Z ? vec(a.z, a.x, a.y) : a;
}

static inline mat3 los_axes(double up, double ce, double se, double cb, double sb)
{
    return rows(with_up_in_place(vec(ce * cb, se, -ce * sb), up),
                with_up_in_place(vec(-se * cb, ce, se * sb), up),
                with_up_in_place(vec(sb, 0, cb), up));
}

static inline vec3 los_rates(const LineOfSight *los, vec3 v_L)
{
    return vec(v_L.x, v_L.y / los->rho_safe, -v_L.z / (los->rho_safe * los->ce_safe));
}

static inline vec3 los_accelerations(const LineOfSight *los, vec3 a_L)
{
    double rho = los->q.x.x, drho = los->q.d.x, deps = los->q.d.y, dbet = los->q.d.z, ce = los->ce,
           se = los->se;
    return vec(a_L.x + rho * (deps * deps + dbet * dbet * ce * ce),
               (a_L.y - 2 * drho * deps) / los->rho_safe - dbet * dbet * se * ce,
               (-a_L.z - 2 * drho * dbet * ce + 2 * rho * deps * dbet * se) /
                   (los->rho_safe * los->ce_safe));
}

/* LOS coordinates of r, from r and its derivatives as seen in N */
static inline LineOfSight line_of_sight(double up, Motion r)
{
    vec3 a = with_up_as_y(r.x, up);
    double elevation = arc_tangent(a.y, sqrt(a.x * a.x + a.z * a.z)),
           azimuth = arc_tangent(-a.z, a.x);
    SineCosine e = sine_and_cosine(elevation), b = sine_and_cosine(azimuth);
    LineOfSight los = {.q.x = vec(norm(r.x), elevation, azimuth),
                       .C_LN = los_axes(up, e.c, e.s, b.c, b.s),
                       .ce = e.c,
                       .se = e.s,
                       .ce_safe = larger(e.c, SMALLEST_COSINE),
                       .rho_safe = larger(norm(r.x), SMALLEST_RANGE)};
    los.q.d = los_rates(&los, mul(los.C_LN, r.d));
    los.q.dd = los_accelerations(&los, mul(los.C_LN, r.dd));
    return los;
}

/* the angle plus full turns, in (-pi, pi] */
static inline double wrapped(double angle)
{
    return angle - 2 * PI * ceiling_of(angle / (2 * PI) - 0.5);
}

/* gravity at r_T + rho minus gravity at r_T, without cancellation (Encke), r = |r_T|:
 * -mu/r^3 (rho + f (r_T + rho)), f = -q (3 + 3q + q^2) / ((1+q)^1.5 (1 + (1+q)^1.5)),
 * q = rho.(rho + 2 r_T)/r^2 */
static inline vec3 differential_gravity(double mu, vec3 r_T, vec3 rho)
{
    double rr = larger(dot(r_T, r_T), 1),
           q = larger(dot(rho, add(rho, scale(2, r_T))) / rr, 1e-12 - 1);
    double p = (1 + q) * sqrt(1 + q), f = -q * (3 + q * (3 + q)) / (p * (1 + p));
    return scale(-mu / (rr * sqrt(rr)), add(rho, scale(f, add(r_T, rho))));
}

#endif
