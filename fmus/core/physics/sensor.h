/* sensor.h - what takes a sensor its measurement: outages, drop-outs, the Sun in the field of view.
 *
 * Sensors sample at n sample_period; an input is what the plant had at the call that contains the
 * sample. Equations: docs/models.md F.2. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SENSOR_H
#define SENSOR_H

#include "directions.h"
#include "random.h"
#include "time_grid.h"

#define SENSOR_PERIOD_ROW \
    GRID(sample_period, "period of the measurements, a multiple of the macro step")

/* defines  name(p, u, x, y, t, h):  measure(p, u, x, y, s) at every sample instant in [t, t+h) */
#define SAMPLED(name, measure)                                                                     \
    static void name(const Parameters *p, const Input *u, State *x, Output *y, double t, double h) \
    {                                                                                              \
        for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))      \
            measure(p, u, x, y, s);                                                                \
    }

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

/* u: draw of the sample, uniform in [0, 1) */
static inline int dropped(const Outage *o, double u) { return u < o->p_drop; }

/* boresight is +X of the sensor, q its attitude relative to N */
static inline int dazzled(const Sun *sun, quat q)
{
    return angle(dcm_of_quat(q).row[0], sun->direction) < sun->cone;
}

static inline void check_probability(Problems *problems, const char *name, double p)
{
    if (p > 1) refuse(problems, name, p, "must be in [0, 1]");
}

#endif
