/* clock.c - specimen of clocks: a sampler with a periodic input clock and a triggered output clock.
 *
 *   ramp' = 1
 *   clock `sample`, every 0.5 s from the start on:  held = ramp,  ticks = ticks + 1
 *   clock `third`, at every third tick:             sum  = held now and at both ticks before
 *
 * At an instant of `sample` the tool enters Event Mode, sets the clock, reads `held` and `third`,
 * if that is active `sum`, and then calls fmi3UpdateDiscreteStates, which counts the tick and
 * deactivates the clocks. The first tick is in the Event Mode that follows initialization. Without
 * Event Mode nothing is sampled.
 *
 * All numbers of the trace are exact in binary. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "types.h"

#define TOKEN "{5e0c1f5a-0002-4e6b-9d10-73a0b1c2d301}"

typedef struct {
    fmi3Clock sample, third;
    double ramp, held, sum;
    double before[2]; /* values held at the last two ticks */
    fmi3Int32 ticks;
} Model;

static const Model start = {.ramp = 0};

static const Variable variables[] = {
    INPUT(1, CLOCK, sample),  OUTPUT(2, CLOCK, third), OUTPUT(3, FLOAT64, ramp),
    OUTPUT(4, FLOAT64, held), OUTPUT(5, INT32, ticks), OUTPUT(6, FLOAT64, sum),
};

#include "specimen.h"

static void evaluate(Instance *c)
{
    Model *m = &c->m;
    if (!m->sample) return;
    m->held = m->ramp;
    m->third = m->ticks % 3 == 2;
    if (m->third) m->sum = m->before[0] + m->before[1] + m->held;
}

static void update(Instance *c)
{
    Model *m = &c->m;
    if (!m->sample) return;
    m->before[0] = m->before[1];
    m->before[1] = m->held;
    m->ticks += 1;
    m->sample = m->third = fmi3ClockInactive;
}

static double step(Instance *c, double t, double h)
{
    c->m.ramp += h;
    return t + h;
}
