/* portable_math.h - atan2 and exp from sums, products, quotients and roots alone.
 *
 * Those operations are exact to the last bit on every platform; the C libraries' atan2 and exp are
 * not, and their last bits would travel through a whole simulation. Both are accurate to 2e-15
 * relative. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef PORTABLE_MATH_H
#define PORTABLE_MATH_H

#include <math.h>

/* atan2(y, x) for y >= 0, in 0 .. pi; 0 if both vanish. The angle is halved four times, then the
 * series of atan is summed. */
static inline double arc(double y, double x)
{
    double r = sqrt(x * x + y * y), t = y / (r + fabs(x)), series = 0;
    if (r == 0) return 0;
    for (int i = 0; i < 3; i++) t = t / (1 + sqrt(1 + t * t));
    for (int n = 15; n > 0; n -= 2) series = 1.0 / n - t * t * series;
    double angle = 16 * t * series;
    return x < 0 ? 3.14159265358979323846 - angle : angle;
}

/* exp(x) = 2^n exp(r), r = x - n ln 2 in two parts, |r| <= 0.35, series of 18 terms; 0 below the
 * range of doubles */
static inline double exponential(double x)
{
    if (!(fabs(x) < 700)) return x < 0 ? 0 : x > 0 ? INFINITY : x;
    double n = floor(x * 1.4426950408889634 + 0.5), sum = 1;
    double r = (x - n * 0.693147180369123816490) - n * 1.90821492927058770002e-10;
    for (int k = 18; k > 0; k--) sum = 1 + r / k * sum;
    return ldexp(sum, (int)n);
}

#endif
