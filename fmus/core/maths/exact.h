/* exact.h - rounding, minimum, maximum and the bits of a double: exact operations without library
 * calls. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef EXACT_H
#define EXACT_H

#include <math.h>
#include <stdint.h>
#include <string.h>

/* smaller and larger number; if one argument is NaN, the other is returned; NaN only if both are
 * NaN */
static inline double smaller(double a, double b) { return a < b || isnan(b) ? a : b; }
static inline double larger(double a, double b) { return a > b || isnan(b) ? a : b; }

#define PI 3.14159265358979323846

/* INFINITY and NAN of math.h have the type float; these have the type double */
#define INFINITE   ((double)INFINITY)
#define NOT_NUMBER ((double)NAN)

#define ALL_WHOLE 4503599627370496.0 /* 2^52: this double and all larger ones are whole numbers */

/* nearest whole number, ties to even; adding 2^52 rounds off the fraction */
static inline double nearest_whole(double x)
{
    double size = fabs(x);
    return size < ALL_WHOLE ? copysign(size + ALL_WHOLE - ALL_WHOLE, x) : x;
}
static inline double floor_of(double x)
{
    double n = nearest_whole(x);
    return n > x ? n - 1 : n;
}
static inline double ceiling_of(double x) { return -floor_of(-x); }

static inline uint64_t bits_of(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}
static inline double double_of(uint64_t bits)
{
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* 2^n for -1022 <= n <= 1023 */
static inline double power_of_2(int n) { return double_of((uint64_t)(n + 1023) << 52); }
static inline double raised(double x, int n) { return double_of(bits_of(x) + ((uint64_t)n << 52)); }

/* x with only its upper 26 bits: the product of two such numbers is exact */
static inline double upper_bits(double x)
{
    return double_of(bits_of(x) & UINT64_C(0xFFFFFFFFF8000000));
}

#endif
