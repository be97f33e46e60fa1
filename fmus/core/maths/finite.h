/* finite.h - is every number of a vector finite? */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef FINITE_H
#define FINITE_H

#include <math.h>
#include <stddef.h>

/* A sum is finite only if every term is, so one test serves them all; where finite terms overflow
 * the sum they are looked at one by one. */
static inline int all_finite(const double x[], size_t count)
{
    double a = 0, b = 0, c = 0, d = 0;
    size_t i = 0;
    for (; i + 8 <= count; i += 8)
        a += x[i] + x[i + 4], b += x[i + 1] + x[i + 5], c += x[i + 2] + x[i + 6],
            d += x[i + 3] + x[i + 7];
    if (i + 4 <= count) a += x[i], b += x[i + 1], c += x[i + 2], d += x[i + 3], i += 4;
    for (; i < count; i++) a += x[i];
    if (isfinite(a + b + c + d)) return 1;
    for (i = 0; i < count; i++)
        if (!isfinite(x[i])) return 0;
    return 1;
}

#endif
