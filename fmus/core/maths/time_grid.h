/* time_grid.h - absolute time grids, so that no result depends on the communication steps of the
 * master.
 *
 * Plants integrate on the grid k * max_step: a communication point off the grid shortens the
 * neighbouring internal steps. Flight software samples at the instants k * sample_period. A time
 * close to grid point k counts as the grid point, because masters accumulate t += h. The tolerance
 * is 1e-9 (1 + k) grid steps, but at most a thousandth of a grid step, and at least two rounding
 * errors of the time. Grid steps are counted in doubles, which is exact up to 2^53 steps; beyond,
 * the rounding error of the time is a grid step or more. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef TIME_GRID_H
#define TIME_GRID_H

#include "exact.h"

/* tolerance, against rounding errors, of comparisons of a quotient of times with a whole number;
 * absolute, or relative where the code multiplies it by a quotient or a period */
#define ROUNDED_OFF 1e-9

static const double most_grid_steps = 9007199254740992.0; /* 2^53 */

/* tolerance of x: a number counts as x if it differs from x by at most the tolerance. It is
 * 1e-9 (1 + |x|), but at most `most`, and at least two rounding errors of x. */
static inline double time_tolerance(double x, double most)
{
    double relative = 1e-9 * (1 + fabs(x)), two_roundings = 4.44089209850062616e-16 * fabs(x);
    double bounded = relative < most ? relative : most;
    return bounded > two_roundings ? bounded : two_roundings;
}

/* number n of the grid point n * grid at the time t; NaN if t is between two grid points */
static inline double grid_number(double t, double grid)
{
    double n = nearest_whole(t / grid);
    return fabs(t / grid - n) <= time_tolerance(n, 1e-3) ? n : NOT_NUMBER;
}

/* ---- internal steps of a plant ----
 * for (Substep s = first_substep(t, h, grid); s.h > 0; s = next_substep(s)) */
typedef struct {
    double t, before;
} GridTime; /* time [s]; number of the grid point at or before it */
typedef struct {
    double t, h, before, grid;
    GridTime end;
} Substep;

static inline GridTime grid_time(double t, double grid)
{
    double n = grid_number(t, grid);
    return isnan(n) ? (GridTime){t, floor_of(t / grid)} : (GridTime){n * grid, n};
}

static inline Substep substep_at(GridTime now, GridTime end, double grid)
{
    double h = end.t - now.t; /* the step if no grid point lies between now and end */
    if (now.before < end.before)
        h = now.t == now.before * grid ? grid : (now.before + 1) * grid - now.t;
    return (Substep){now.t, h, now.before, grid, end};
}
static inline Substep first_substep(double t, double h, double grid)
{
    return substep_at(grid_time(t, grid), grid_time(t + h, grid), grid);
}
static inline Substep next_substep(Substep s)
{
    GridTime next = {(s.before + 1) * s.grid, s.before + 1};
    return substep_at(s.before < s.end.before ? next : s.end, s.end, s.grid);
}

/* ---- sample instants in [t, t+h) ----
 * for (Sample s = first_sample(t, h, period); s.left > 0; s = next_sample(s))
 * s.t: time of the sample, s.index: its number, s.left: number of samples from this one on */
typedef struct { double t, period, index, left; } Sample; /* period 0: one sample at every call */

/* index of the first sample at or after t */
static inline double sample_index(double t, double period)
{
    double n = grid_number(t, period);
    return isnan(n) ? ceiling_of(t / period) : n;
}
static inline Sample first_sample(double t, double h, double period)
{
    if (period == 0) return (Sample){t, h, 0, 1};
    double first = sample_index(t, period);
    return (Sample){first * period, period, first, sample_index(t + h, period) - first};
}
static inline Sample next_sample(Sample s)
{
    return (Sample){(s.index + 1) * s.period, s.period, s.index + 1, s.left - 1};
}

/* true if t is at or after `start`, within a tolerance of at most a microsecond */
static inline int reached(double t, double start)
{
    return t >= start - time_tolerance(start, 1e-6);
}

#endif
