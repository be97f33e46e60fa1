/* earth.h - constants of the Earth in the published works, and the start orbit of target and
 * servicer.
 *
 * There are three values of the gravitational parameter, because every system uses the value of its
 * paper. Their relative differences are below 5e-9, which affects no result visibly. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef EARTH_H
#define EARTH_H

#include "exact.h"

#define MU_JGM3    3.986004415e14 /* m3/s2, Zhu & Yang 2009: JGM-3 (Tapley et al. 1996) */
#define MU_WGS84   3.986004418e14 /* m3/s2, IERS Conventions 2010, WGS 84 */
#define MU_ROUNDED 3.9860044e14   /* m3/s2, patent CN106020225A */

#define EARTH .mu = MU_JGM3, .R_E = 6378136.3, .J2 = 1.0826360229829945e-3 /* JGM-3 */

/* start orbit of Zhu & Yang 2009, with J2: elements of the target; the servicer starts at an
 * offset from the target */
#define START_ORBIT                                                  \
    {EARTH,          .a = 7158140,       .e = 0.01,   .inc = PI / 6, \
     .argp = PI / 3, .raan = 2 * PI / 3, .nu = PI / 6}

#endif
