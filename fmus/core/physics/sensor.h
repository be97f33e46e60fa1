/* sensor.h - what takes a sensor its measurement: outages, drop-outs, the Sun in the field of view;
 * latency.
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

/* ---- latency: samples wait in a ring ---- */
enum { RING = 8 };

#define LATENCY_ROW NONNEGATIVE(latency, "s", "from the measurement to the output, up to 7 periods")

/* defines Slot and State */
#define LATE_STATE           \
    typedef struct {         \
        double taken, index; \
        Output y;            \
    } Slot;                  \
    typedef struct { Slot ring[RING]; } State

/* defines step(): seen(p, u, s) is the output of a sample; at the end of a step to t the newest
 * sample n with n P + latency < t is published */
#define LATE_STEP(seen)                                                                            \
    static Slot *slot(State *x, double n) { return &x->ring[(int)remainder_of(n, RING)]; }         \
    static void keep(const Parameters *p, const Input *u, State *x, Output *y, Sample s)           \
    {                                                                                              \
        (void)y;                                                                                   \
        *slot(x, s.index) = (Slot){1, s.index, seen(p, u, s)};                                     \
    }                                                                                              \
    SAMPLED(measure, keep)                                                                         \
    static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h) \
    {                                                                                              \
        measure(p, u, x, y, t, h);                                                                 \
        double n = sample_index(t + h - p->latency, p->sample_period) - 1;                         \
        const Slot *s = slot(x, n);                                                                \
        if (s->taken > 0 && s->index == n) *y = s->y;                                              \
    }

static inline void check_latency(Problems *problems, double latency, double period)
{
    if (latency > 7 * period * (1 + ROUNDED_OFF))
        refuse(problems, "latency", latency, "must be at most 7 sample periods");
}

static inline void check_range(Problems *problems, double range_min, double range_max)
{
    if (range_max <= range_min) refuse(problems, "range_max", range_max, "must be above range_min");
}

/* ---- no measurement ---- */
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
