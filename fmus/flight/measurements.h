/* measurements.h - measurements of a sensor in a filter: test for new ones, gate, acquisition, age.
 *
 * A measurement is new if it is valid and later than the last new one. Its residuals update a copy
 * of the estimate; if the sum of their normalised squares (nis) exceeds the gate, the copy is
 * dropped. Acquisition sets the measured part of the estimate: at the first measurement if acquire
 * is 1, and after reset_after rejections in a row. Equations: docs/models.md F.3. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef MEASUREMENTS_H
#define MEASUREMENTS_H

#include "fmu.h"
#include "portable_math.h"
#include "time_grid.h"

enum { HISTORY = 16 }; /* a measurement late by this number of samples or more is not used */

typedef struct { double gate, reset_after, age_max, acquire; } GateParameters;

#define GATE_ROWS(member)                                                                          \
    NONNEGATIVE_AS("gate", member.gate, "1",                                                       \
                   "largest accepted normalised innovation squared, summed over all components"),  \
        NONNEGATIVE_AS(                                                                            \
            "reset_after", member.reset_after, "1",                                                \
            "rejections in a row after which the estimate is acquired anew; 0 = never"),           \
        NONNEGATIVE_AS("age_max", member.age_max, "s",                                             \
                       "an estimate is valid while its last used measurement is not older"),       \
        ROW_AS(PARAMETER_ROW, p, "acquire", member.acquire, 1, "1",                                \
               "1: the first measurement sets the measured states; 0: they begin at start values", \
               SWITCH_VALUE)

typedef struct {
    /* last, stamp: times of the last new and of the last used measurement [s]; used: 1 if any
     * measurement has been used */
    double last, stamp, used;
    double nis, rejected, in_row, acquired;
} Track;

static inline Track new_track(const GateParameters *p, double before_first)
{
    return (Track){.last = before_first, .stamp = -1, .acquired = p->acquire == 0};
}

static inline int is_new(const Track *track, double time, double valid)
{
    return valid > 0 && time > track->last;
}

typedef enum { REJECTED, ACCEPTED, ACQUISITION } Decision;

static inline Decision decide(const GateParameters *p, Track *track, double nis)
{
    track->nis = nis;
    if (nis <= p->gate) {
        track->in_row = 0;
        return ACCEPTED;
    }
    track->rejected++;
    track->in_row++;
    return p->reset_after > 0 && track->in_row >= p->reset_after ? ACQUISITION : REJECTED;
}

static inline void note_used(Track *track, double stamp)
{
    track->stamp = stamp;
    track->used = 1;
}
static inline void note_acquired(Track *track)
{
    track->nis = track->in_row = 0;
    track->acquired = 1;
}

static inline double age(const Track *track, double t) { return t - track->stamp; }
static inline int is_valid(const GateParameters *p, const Track *track, double t)
{
    return track->acquired > 0 && track->used > 0 && age(track, t) <= p->age_max;
}

/* place of the sample with the number `index` in a ring buffer of the last HISTORY samples: `index`
 * modulo HISTORY, which is a power of 2; `index` must be a whole number below 2^51 */
static inline int place_of(double index) { return last_bits(index + ROUNDER, HISTORY - 1); }

#endif
