/* finite.h - test whether all numbers of a vector are finite. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef FINITE_H
#define FINITE_H

#include <math.h>
#include <stddef.h>

/* true if all of x[0 .. count-1] are finite. A sum is finite only if every term is finite, so
 * one test suffices; if the sum overflows, the terms are tested one by one. Two sums are formed,
 * which compilers compute in parallel. */
static inline int all_finite(const double x[], size_t count)
{
    double sum[2] = {0};
    size_t i = 0;
    for (; i + 16 <= count; i += 16)
        for (size_t k = 0; k < 2; k++)
            sum[k] += ((x[i + k] + x[i + k + 2]) + (x[i + k + 4] + x[i + k + 6])) +
                      ((x[i + k + 8] + x[i + k + 10]) + (x[i + k + 12] + x[i + k + 14]));
    for (; i + 4 <= count; i += 4)
        for (size_t k = 0; k < 2; k++) sum[k] += x[i + k] + x[i + k + 2];
    for (; i < count; i++) sum[0] += x[i];
    if (isfinite(sum[0] + sum[1])) return 1;
    for (i = 0; i < count; i++)
        if (!isfinite(x[i])) return 0;
    return 1;
}

#endif
