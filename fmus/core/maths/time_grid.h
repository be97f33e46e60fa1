/* time_grid.h - absolute time grids, so that nothing depends on how a master cuts its communication
 * steps.
 *
 * Plants integrate on the grid k * max_step: a communication point off the grid shortens the
 * neighbouring internal steps. Flight software samples at the instants k * sample_period. Times
 * within 1e-9 (relative) of a grid point count as on it, because masters accumulate t += h. */
#ifndef TIME_GRID_H
#define TIME_GRID_H

#include <math.h>

static inline double grid_tolerance(double n) { return 1e-9 * (1 + fabs(n)); }

static inline double on_grid(double t, double grid)
{
    double n = nearbyint(t / grid);
    return fabs(t / grid - n) <= grid_tolerance(n) ? n * grid : t;
}

/* ---- internal steps of a plant ----
 * for (Substep s = first_substep(t, h, grid); s.h > 0; s = next_substep(s)) */
typedef struct { double t, h, next, end, grid; } Substep;

static inline Substep substep_at(double t, double end, double grid)
{
    double n = floor(t / grid + grid_tolerance(t / grid)), next = (n + 1) * grid;
    if (next > end) next = end;
    int whole = t == n * grid && next == (n + 1) * grid;
    return (Substep){t, whole ? grid : next - t, next, end, grid};
}
static inline Substep first_substep(double t, double h, double grid)
{
    return substep_at(on_grid(t, grid), on_grid(t + h, grid), grid);
}
static inline Substep next_substep(Substep s)
{
    return s.next < s.end ? substep_at(s.next, s.end, s.grid)
                          : (Substep){s.end, 0, s.end, s.end, s.grid};
}

/* ---- sample instants in [t, t+h) ----
 * for (Sample s = first_sample(t, h, period); s.left > 0; s = next_sample(s)) */
typedef struct { double t, period, index, left; } Sample; /* period 0: one sample at every call */

static inline double sample_index(double t, double period)
{
    return ceil(t / period - grid_tolerance(t / period));
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

/* true once t has reached `start`, with the tolerance of the grid */
static inline int reached(double t, double start) { return t >= start - 1e-9 * (1 + fabs(start)); }

#endif
