/* reference_rows.h - ports of the reference from a guidance to a controller. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef REFERENCE_ROWS_H
#define REFERENCE_ROWS_H

#include "attitude.h"
#include "fmu.h"

typedef struct {
    vec3 rho, drho, ddrho;
    quat q;
    vec3 omega, alpha;
} Reference; /* position relative to the target, N axes; attitude relative to N; rates in D axes */

/* text of the optional input `active` of guidances and controllers */
#define ACTIVE_TEXT                                                                          \
    "1: active; 0: outputs of a first sample, commands and flags 0; the next active sample " \
    "is a first one"

#define REFERENCE_ROW(causality, part, name, member, unit, text) \
    ROW_AS(causality, part, name, member, 1, unit, text, ANY_VALUE)

#define REFERENCE_ROWS(causality, part, member)                                              \
    REFERENCE_ROW(causality, part, "rho_ref_N", member.rho, "m",                             \
                  "reference position of the servicer relative to the target, N axes"),      \
        REFERENCE_ROW(causality, part, "drho_ref_N", member.drho, "m/s",                     \
                      "reference velocity relative to the target as seen in N, N axes"),     \
        REFERENCE_ROW(causality, part, "ddrho_ref_N", member.ddrho, "m/s2",                  \
                      "reference acceleration relative to the target as seen in N, N axes"), \
        REFERENCE_ROW(causality, part, "q_DN", member.q, "1",                                \
                      "reference attitude relative to N, scalar first"),                     \
        REFERENCE_ROW(causality, part, "omega_DN_D", member.omega, "rad/s",                  \
                      "reference angular velocity relative to N, reference body axes"),      \
        REFERENCE_ROW(causality, part, "alpha_DN_D", member.alpha, "rad/s2",                 \
                      "reference angular acceleration relative to N, reference body axes")

#endif
