/* mounting.h - mounting of a sensor on the servicer. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef MOUNTING_H
#define MOUNTING_H

#include "directions.h"

/* mounting of the camera K that measures the pose of the target; boresight: +X of K */
typedef struct {
    vec3 p_KS_S;
    quat q_KS;
} Camera;

#define CAMERA_START {.p_KS_S = {0.5, 0, 0.3}, .q_KS = {1, 0, 0, 0}}
#define CAMERA_ROWS(member)                                                    \
    PARAMETER_AS("p_KS_S", member.p_KS_S, "m",                                 \
                 "camera from the centre of mass of the servicer, body axes"), \
        PARAMETER_AS("q_KS", member.q_KS, "1",                                 \
                     "attitude of the camera relative to the servicer, "       \
                     "scalar first; boresight +X")

#endif
