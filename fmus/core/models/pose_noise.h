/* pose_noise.h - standard deviations of the noise of a camera that measures the pose of a target at
 * range R.
 *
 *   along the boresight   sigma_range_0 + sigma_range_2 R^2
 *   across                sigma_bearing_0 + sigma_bearing_1 R
 *   attitude              sigma_theta_0 + sigma_theta_1 R
 *
 * The sensor draws its noise from this model, the filter takes its covariances from it. Equations:
 * docs/models.md F.2. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef POSE_NOISE_H
#define POSE_NOISE_H

#include "fmu.h"
#include "vec3.h"

typedef struct { double range_0, range_2, bearing_0, bearing_1, theta_0, theta_1; } PoseNoise;

#define POSE_NOISE_START \
    {.range_0 = 0.01,    \
     .range_2 = 1e-4,    \
     .bearing_0 = 0.002, \
     .bearing_1 = 5e-4,  \
     .theta_0 = 0.0087,  \
     .theta_1 = 4.4e-4}
#define POSE_NOISE_ROWS(member)                                                                   \
    NONNEGATIVE_AS("sigma_range_0", member.range_0, "m", "noise along the boresight at range 0"), \
        NONNEGATIVE_AS("sigma_range_2", member.range_2, "1/m",                                    \
                       "noise along the boresight: rise per range squared"),                      \
        NONNEGATIVE_AS("sigma_bearing_0", member.bearing_0, "m",                                  \
                       "noise across the boresight at range 0"),                                  \
        NONNEGATIVE_AS("sigma_bearing_1", member.bearing_1, "1",                                  \
                       "noise across the boresight: rise per range"),                             \
        NONNEGATIVE_AS("sigma_theta_0", member.theta_0, "rad",                                    \
                       "noise of the attitude, per axis, at range 0"),                            \
        NONNEGATIVE_AS("sigma_theta_1", member.theta_1, "rad/m",                                  \
                       "noise of the attitude, per axis: rise per range")

/* standard deviations of a measured position at range R, camera axes with boresight X [m] */
static inline vec3 position_noise(const PoseNoise *n, double R)
{
    double across = n->bearing_0 + n->bearing_1 * R;
    return vec(n->range_0 + n->range_2 * R * R, across, across);
}
static inline double attitude_noise(const PoseNoise *n, double R)
{
    return n->theta_0 + n->theta_1 * R;
}

#endif
