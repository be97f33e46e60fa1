/* body_rows.h - the state of a body on the wires: position, velocity, attitude, angular
 * velocity. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef BODY_ROWS_H
#define BODY_ROWS_H

#include "attitude.h"
#include "fmu.h"

typedef struct {
    vec3 r, v;
    quat q;
    vec3 omega;
} Body; /* N, N, body relative to N, body components */

#define BODY_INPUTS(X, member, whose)                                                         \
    ROW_AS(INPUT_ROW, u, "r_" X "N_N", member.r, 1, "m", "position of the " whose ", N axes", \
           ANY_VALUE),                                                                        \
        ROW_AS(INPUT_ROW, u, "v_" X "N_N", member.v, 1, "m/s",                                \
               "velocity of the " whose ", N axes", ANY_VALUE),                               \
        ROW_AS(INPUT_ROW, u, "q_" X "N", member.q, 1, "1",                                    \
               "attitude of the " whose " relative to N, scalar first", ANY_VALUE),           \
        ROW_AS(INPUT_ROW, u, "omega_" X "N_" X, member.omega, 1, "rad/s",                     \
               "angular velocity of the " whose " relative to N, body axes", ANY_VALUE)

#endif
