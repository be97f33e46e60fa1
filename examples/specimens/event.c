/* event.c - specimen of Event Mode with early return: a sawtooth.
 *
 *   level' = rate;   when level reaches 0.625: level = 0, count = count + 1
 *
 * A step that meets the edge ends there: fmi3DoStep returns early with eventHandlingNeeded, level
 * is still 0.625. fmi3UpdateDiscreteStates in Event Mode makes level 0 and counts. An edge at the
 * very end of a step needs Event Mode too, without an early return. For a tool that does not use
 * Event Mode, or allows no early return, the specimen handles its edges inside of the step.
 *
 * All numbers of the trace are exact in binary. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "types.h"

#define TOKEN "{5e0c1f5a-0001-4e6b-9d10-73a0b1c2d301}"
#define TOP   0.625

typedef struct {
    double level, rate;
    fmi3Int32 count;
} Model;

static const Model start = {.rate = 1};

static const Variable variables[] = {
    OUTPUT(1, FLOAT64, level),
    OUTPUT(2, INT32, count),
    PARAMETER(3, FLOAT64, rate),
};

#include "specimen.h"

static void evaluate(Instance *c) { (void)c; }

static void update(Instance *c)
{
    if (!c->event) return;
    c->m.level = 0;
    c->m.count += 1;
}

static double step(Instance *c, double t, double h)
{
    double end = t + h;
    while (c->m.level + c->m.rate * (end - t) >= TOP) {
        t += (TOP - c->m.level) / c->m.rate;
        c->m.level = TOP;
        c->event = true;
        if (c->events) return t;
        update(c);
        c->event = false;
    }
    c->m.level += c->m.rate * (end - t);
    return end;
}
