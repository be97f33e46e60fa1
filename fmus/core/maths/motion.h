/* motion.h - vectors with first and second time derivative: products, normalisation, frames. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef MOTION_H
#define MOTION_H

#include "vec3.h"

typedef struct { vec3 x, d, dd; } Motion;

static inline Motion neg_motion(Motion a) { return (Motion){neg(a.x), neg(a.d), neg(a.dd)}; }

static inline Motion cross_motion(Motion a, Motion b)
{
    return (Motion){cross(a.x, b.x), add(cross(a.d, b.x), cross(a.x, b.d)),
                    sum3(cross(a.dd, b.x), scale(2, cross(a.d, b.d)), cross(a.x, b.dd))};
}

/* unit vector k = u/|u| with derivatives, n = |u|: n' = k.u', k' = (u' - n' k)/n,
 * n'' = k'.u' + k.u'', k'' = (u'' - n'' k - 2 n' k')/n */
static inline Motion normalised(Motion u)
{
    double n = norm(u.x);
    vec3 k = scale(1 / n, u.x);
    double dn = dot(k, u.d);
    vec3 dk = scale(1 / n, sub(u.d, scale(dn, k)));
    double ddn = dot(dk, u.d) + dot(k, u.dd);
    return (Motion){k, dk, scale(1 / n, sub(u.dd, add(scale(2 * dn, dk), scale(ddn, k))))};
}

/* component of the constant vector `fixed` perpendicular to the unit vector i, with derivatives */
static inline Motion perpendicular_part(vec3 fixed, Motion i)
{
    double s = dot(fixed, i.x), ds = dot(fixed, i.d), dds = dot(fixed, i.dd);
    return (Motion){sub(fixed, scale(s, i.x)), neg(add(scale(ds, i.x), scale(s, i.d))),
                    neg(sum3(scale(dds, i.x), scale(2 * ds, i.d), scale(s, i.dd)))};
}

/* angular velocity w = [j'.k, k'.i, i'.j] of the frame with axes i, j, k, and angular acceleration
 * w', both in components along i, j, k */
static inline vec3 frame_rate(Motion i, Motion j, Motion k)
{
    return vec(dot(j.d, k.x), dot(k.d, i.x), dot(i.d, j.x));
}
static inline vec3 frame_acceleration(Motion i, Motion j, Motion k)
{
    return vec(dot(j.dd, k.x) + dot(j.d, k.d), dot(k.dd, i.x) + dot(k.d, i.d),
               dot(i.dd, j.x) + dot(i.d, j.d));
}

#endif
