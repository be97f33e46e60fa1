/* link_statistics.h - cost of the steps of a component on its board. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef LINK_STATISTICS_H
#define LINK_STATISTICS_H

#include "fmi2FunctionTypes.h"

#include <inttypes.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

typedef struct {
    uint64_t steps, total, largest; /* number of steps; instructions of all steps and of the
                                     * most expensive one, 0: not counted */
    double when;                    /* s; communication point of the most expensive step */
    uint32_t stack;                 /* bytes used after initialization; 0: unknown */
    uint32_t memory;                /* bytes that the instance has allocated */
    uint64_t late;                  /* number of answers after the deadline */
} LinkStatistics;

/* function for the harness, not part of FMI: gets the statistics; false if the board does not
 * answer */
#if defined __GNUC__
__attribute__((visibility("default")))
#endif
bool slnk_statistics(fmi2Component component, LinkStatistics *result);

static inline const char *describe_cost(const LinkStatistics *s, char *text, size_t size)
{
    int used = snprintf(text, size, "%" PRIu64 " steps", s->steps);
    if (s->total > 0 && s->steps > 0)
        used += snprintf(text + used, size - (size_t)used,
                         ", %" PRIu64 " instructions on average, at most %" PRIu64 " at t = %.9g s",
                         s->total / s->steps, s->largest, s->when);
    if (s->stack > 0)
        used +=
            snprintf(text + used, size - (size_t)used, ", %" PRIu32 " bytes of stack", s->stack);
    if (s->late > 0)
        snprintf(text + used, size - (size_t)used, ", %" PRIu64 " late answers", s->late);
    return text;
}

#endif
