/* body_rows.h - ports of the state of a body: position, velocity, attitude, angular velocity. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef BODY_ROWS_H
#define BODY_ROWS_H

#include "attitude.h"
#include "fmu.h"

typedef struct {
    vec3 r, v;
    quat q;
    vec3 omega;
} Body; /* r, v: N axes; q: relative to N; omega: relative to N, body axes */

/* rows of the state of a body; X: letter of its frame ("S", "T", "E"); suffix: "_hat" for
 * estimates, else "" */
#define BODY_ROWS(causality, part, X, suffix, member, body)                         \
    ROW_AS(causality, part, "r_" X "N_N" suffix, member.r, 1, "m",                  \
           "position of the " body ", N axes", ANY_VALUE),                          \
        ROW_AS(causality, part, "v_" X "N_N" suffix, member.v, 1, "m/s",            \
               "velocity of the " body ", N axes", ANY_VALUE),                      \
        ROW_AS(causality, part, "q_" X "N" suffix, member.q, 1, "1",                \
               "attitude of the " body " relative to N, scalar first", ANY_VALUE),  \
        ROW_AS(causality, part, "omega_" X "N_" X suffix, member.omega, 1, "rad/s", \
               "angular velocity of the " body " relative to N, body axes", ANY_VALUE)
#define BODY_INPUTS(X, member, body)  BODY_ROWS(INPUT_ROW, u, X, "", member, body)
#define BODY_OUTPUTS(X, member, body) BODY_ROWS(OUTPUT_ROW, y, X, "", member, body)

#endif
