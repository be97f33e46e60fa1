/* orbit_rows.h - parameters of the planet and of the elements of a start orbit, and their rules,
 * also with a Cartesian start. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef ORBIT_ROWS_H
#define ORBIT_ROWS_H

#include "earth.h"
#include "fmu.h"
#include "orbit.h"

/* rows of mu and of all orbital elements except the semi-major axis */
#define ELLIPSE_ROWS(orbit)                                                               \
    NONNEGATIVE_AS("e", orbit.e, "1", "eccentricity, below 1"),                           \
        PARAMETER_AS("inc", orbit.inc, "rad", "inclination"),                             \
        PARAMETER_AS("argp", orbit.argp, "rad", "argument of perigee"),                   \
        PARAMETER_AS("raan", orbit.raan, "rad", "right ascension of the ascending node"), \
        PARAMETER_AS("nu", orbit.nu, "rad", "true anomaly at the start"),                 \
        NONNEGATIVE_AS("mu", orbit.mu, "m3/s2",                                           \
                       "gravitational parameter of the planet; 0 = deep space")

#define ORBIT_ROWS(orbit)                                                                    \
    NONNEGATIVE_AS("a", orbit.a, "m",                                                        \
                   "semi-major axis of the target orbit; 0 = Cartesian start r_0_N, v_0_N"), \
        ELLIPSE_ROWS(orbit),                                                                 \
        NONNEGATIVE_AS("R_E", orbit.R_E, "m", "equatorial radius of the planet"),            \
        NONNEGATIVE_AS("J2", orbit.J2, "1", "second zonal harmonic of the planet")

static inline void check_ellipse(Problems *problems, const Orbit *o)
{
    if (o->e >= 1) reject(problems, "e", o->e, "must be in [0, 1)");
}

static inline void check_orbit(Problems *problems, const Orbit *o, vec3 r_0_N)
{
    check_ellipse(problems, o);
    if (o->a > 0 && o->mu == 0)
        reject(problems, "mu", o->mu, "must be > 0 when the start is given by elements (a > 0)");
    if (o->a == 0 && o->mu > 0 && norm(r_0_N) == 0)
        reject(problems, "r_0_N", 0, "must not be the centre of the planet when mu > 0 and a = 0");
}

#endif
