/* sensor.h - what takes a sensor its measurement: outages, drop-outs, the Sun in the field of view.
 *
 * Sensors sample at n sample_period; an input is what the plant had at the call that contains the
 * sample. Equations: docs/models.md F.2. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SENSOR_H
#define SENSOR_H

#include "attitude.h"
#include "fmu.h"
#include "random.h"
#include "time_grid.h"

#define SENSOR_PERIOD_ROW \
    POSITIVE(sample_period, "s", "period of the measurements, a multiple of the macro step")

typedef struct { double start, duration, p_drop; } Outage;

#define OUTAGE_ROWS(member)                                                                \
    PARAMETER_AS("outage_start", member.start, "s", "no measurement from this time on"),   \
        NONNEGATIVE_AS("outage_duration", member.duration, "s", "duration of the outage"), \
        NONNEGATIVE_AS("p_drop", member.p_drop, "1", "probability that a measurement is lost")

typedef struct {
    vec3 direction; /* to the Sun, N axes */
    double cone;    /* rad */
} Sun;

#define SUN_ROWS(member)                                                            \
    PARAMETER_AS("sun_N", member.direction, "1", "unit vector to the Sun, N axes"), \
        NONNEGATIVE_AS("sun_cone", member.cone, "rad",                              \
                       "blind where the Sun is closer to the boresight; 0 = never")

static inline int in_outage(const Outage *o, double t)
{
    return reached(t, o->start) && !reached(t, o->start + o->duration);
}

/* boresight is +X of the sensor, q its attitude relative to N */
static inline int dazzled(const Sun *sun, quat q)
{
    return angle(dcm_of_quat(q).row[0], sun->direction) < sun->cone;
}

static inline void check_probability(Problems *problems, const char *name, double p)
{
    if (p > 1) refuse(problems, name, p, "must be in [0, 1]");
}
static inline void check_unit_vector(Problems *problems, const char *name, vec3 a)
{
    if (!(fabs(norm(a) - 1) <= 1e-9)) refuse(problems, name, norm(a), "must be a unit vector");
}

#endif
