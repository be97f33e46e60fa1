/* directions.h - the rules for unit vectors and unit quaternions among parameters. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef DIRECTIONS_H
#define DIRECTIONS_H

#include "attitude.h"
#include "fmu.h"

#define UNIT_TOLERANCE 1e-9 /* permits the rounding errors of vectors typed in or rotated */

static inline int is_unit_length(double length) { return fabs(length - 1) <= UNIT_TOLERANCE; }

static inline void check_unit_vector(Problems *problems, const char *name, vec3 a)
{
    if (!is_unit_length(norm(a))) reject(problems, name, norm(a), "must be a unit vector");
}

static inline void check_unit_quaternion(Problems *problems, const char *name, quat q)
{
    double n = sqrt(q.w * q.w + dot(vector_part(q), vector_part(q)));
    if (!is_unit_length(n)) reject(problems, name, n, "must be a unit quaternion");
}

#endif
