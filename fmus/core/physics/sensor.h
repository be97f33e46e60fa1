/* sensor.h - conditions under which a sensor has no measurement (outage, drop-out, Sun near the
 * boresight), and latency.
 *
 * Sensors sample at the instants n sample_period, n whole; a sample uses the inputs of the macro
 * step that contains it. Equations: docs/models.md F.2. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef SENSOR_H
#define SENSOR_H

#include "directions.h"
#include "random.h"
#include "time_grid.h"

#define SENSOR_PERIOD_ROW \
    GRID(sample_period, "period of the measurements, best a multiple of the communication step")

/* defines the function name(p, u, x, y, t, h), which calls measure(p, u, x, y, s) at every
 * sample instant s in [t, t+h) */
#define SAMPLED(name, measure)                                                                     \
    static void name(const Parameters *p, const Input *u, State *x, Output *y, double t, double h) \
    {                                                                                              \
        for (Sample s = first_sample(t, h, p->sample_period); s.left > 0; s = next_sample(s))      \
            measure(p, u, x, y, s);                                                                \
    }

/* ---- latency: a ring stores samples until they are published ---- */
enum { RING = 8 };

#define LATENCY_ROW NONNEGATIVE(latency, "s", "delay from measurement to output, up to 7 periods")

/* defines the types Slot and State, a ring buffer of samples that are not yet published; filled: 1
 * if the slot contains a sample; index: number of this sample */
#define LATE_STATE            \
    typedef struct {          \
        double filled, index; \
        Output y;             \
    } Slot;                   \
    typedef struct { Slot ring[RING]; } State

/* defines step(), which stores the result of measured(p, u, s) for every sample s and publishes, at
 * the end t + h of the step, the newest sample n with n sample_period + latency < t + h */
#define LATE_STEP(measured)                                                                        \
    static Slot *ring_slot(State *x, double n) { return &x->ring[(int)remainder_of(n, RING)]; }    \
    static void store_sample(const Parameters *p, const Input *u, State *x, Output *y, Sample s)   \
    {                                                                                              \
        (void)y;                                                                                   \
        *ring_slot(x, s.index) = (Slot){1, s.index, measured(p, u, s)};                            \
    }                                                                                              \
    SAMPLED(measure, store_sample)                                                                 \
    static void step(const Parameters *p, const Input *u, State *x, Output *y, double t, double h) \
    {                                                                                              \
        measure(p, u, x, y, t, h);                                                                 \
        double n = sample_index(t + h - p->latency, p->sample_period) - 1;                         \
        const Slot *s = ring_slot(x, n);                                                           \
        if (s->filled > 0 && s->index == n) *y = s->y;                                             \
    }

static inline void check_latency(Problems *problems, double latency, double period)
{
    if (latency > 7 * period * (1 + ROUNDED_OFF))
        reject(problems, "latency", latency, "must be at most 7 sample periods");
}

static inline void check_range(Problems *problems, double range_min, double range_max)
{
    if (range_max <= range_min) reject(problems, "range_max", range_max, "must be above range_min");
}

/* ---- periods and samples without a measurement ---- */
typedef struct { double start, duration, p_drop; } Outage;

#define OUTAGE_ROWS(member)                                                                  \
    PARAMETER_AS("outage_start", member.start, "s", "start of a time without measurements"), \
        NONNEGATIVE_AS("outage_duration", member.duration, "s", "duration of the outage"),   \
        NONNEGATIVE_AS("p_drop", member.p_drop, "1", "probability that a measurement is lost")

typedef struct {
    vec3 direction; /* to the Sun, N axes */
    double cone;    /* half angle [rad] */
} Sun;

#define SUN_ROWS(member)                                                                  \
    PARAMETER_AS("sun_N", member.direction, "1", "unit vector to the Sun, N axes"),       \
        NONNEGATIVE_AS("sun_cone", member.cone, "rad",                                    \
                       "no measurement with the Sun within this angle of the boresight; " \
                       "0 = no limit")

static inline int in_outage(const Outage *o, double t)
{
    return reached(t, o->start) && !reached(t, o->start + o->duration);
}

/* true if the sample has a drop-out; u: its uniform draw in (0, 1) */
static inline int dropped(const Outage *o, double u) { return u < o->p_drop; }

/* true if the Sun is within the cone about the boresight, +X of the sensor; q: attitude of the
 * sensor relative to N */
static inline int sun_in_cone(const Sun *sun, quat q)
{
    return angle(dcm_of_quat(q).row[0], sun->direction) < sun->cone;
}

static inline void check_probability(Problems *problems, const char *name, double p)
{
    if (p > 1) reject(problems, name, p, "must be in [0, 1]");
}

#endif
