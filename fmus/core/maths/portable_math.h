/* portable_math.h - sin, cos, atan2, exp, log, expm1 from sums, products, quotients, comparisons
 * and bit operations only.
 *
 * These operations have the same bits on every platform; the functions of the C libraries differ in
 * the last bits, which would change a whole simulation. Errors are below 1 unit in the last place;
 * special values follow Annex F of C99. Some products must be exact, so no operations may be
 * contracted to fused ones (-ffp-contract=off). */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef PORTABLE_MATH_H
#define PORTABLE_MATH_H

#include "elementary_numbers.h"
#include "exact.h"
#include "huge_angle.h"

#define ROUNDER (1.5 * ALL_WHOLE) /* x + ROUNDER - ROUNDER: nearest whole number, |x| < 2^51 */

/* the last bits of a whole number n, given n + ROUNDER: n modulo a power of 2 (mask + 1), also
 * where n is negative or does not fit into an int */
static inline int last_bits(double rounded, uint64_t mask)
{
    return (int)(bits_of(rounded) & mask);
}

/* ---- sin and cos ---- */
/* x - n pi/2 for the nearest whole n. pi/2 is the sum of three parts, and n times the first or
 * second part is exact (Cody & Waite 1980); if the difference cancels more digits than the third
 * part covers, or if |x| >= 1e6, the digits of 2/pi are used. */
static inline Angle reduced(double x)
{
    if (fabs(x) <= PI / 4) return (Angle){x, 0, 0};
    if (fabs(x) < 1e6) {
        double rounded = x * TWO_OVER_PI + ROUNDER, n = rounded - ROUNDER;
        double a = x - n * HALF_PI_1, b = n * HALF_PI_2, c = n * HALF_PI_3;
        double d = a - b, recovered = a - d, rounding = (recovered - b) + (a - (d + recovered)),
               hi = d - c;
        if (fabs(d) > fabs(n) * 0x1p-54)
            return (Angle){hi, (d - hi - c) + rounding, last_bits(rounded, 3)};
    }
    return isfinite(x) ? reduced_by_digits(x) : (Angle){NOT_NUMBER, 0, 0};
}

static inline double sine_of(Angle r)
{
    const double *k = sine_terms, z = r.hi * r.hi, zz = z * z;
    double sum = (k[0] + z * k[1]) + zz * ((k[2] + z * k[3]) + zz * (k[4] + z * k[5]));
    return r.hi + (r.hi * z * sum + (r.lo - r.lo * (0.5 * z)));
}

static inline double cosine_of(Angle r)
{
    const double *k = cosine_terms, z = r.hi * r.hi, zz = z * z, half = 0.5 * z, w = 1 - half;
    double sum = (k[0] + z * k[1]) + zz * ((k[2] + z * k[3]) + zz * (k[4] + z * k[5]));
    return w + ((1 - w - half) + (zz * sum - r.hi * r.lo));
}

static inline double sine(double x)
{
    if (fabs(x) < 0x1p-27) return x;
    Angle r = reduced(x);
    double size = r.quarter & 1 ? cosine_of(r) : sine_of(r);
    return r.quarter & 2 ? -size : size;
}

static inline double cosine(double x)
{
    Angle r = reduced(x);
    double size = r.quarter & 1 ? sine_of(r) : cosine_of(r);
    return (r.quarter + 1) & 2 ? -size : size;
}

typedef struct { double s, c; } SineCosine;
static inline SineCosine sine_and_cosine(double x) /* the same bits as sine(), cosine() */
{
    if (fabs(x) < 0x1p-27) return (SineCosine){x, 1};
    Angle r = reduced(x);
    double s = sine_of(r), c = cosine_of(r), sine = r.quarter & 1 ? c : s;
    double cosine = r.quarter & 1 ? s : c;
    return (SineCosine){r.quarter & 2 ? -sine : sine, (r.quarter + 1) & 2 ? -cosine : cosine};
}

/* ---- atan2 ---- */
/* base + base_rest + sign atan(b/a) for 0 <= b <= a. If q = b/a < 1/8, q is computed in two
 * parts and atan(q) by a series; else atan(q) = atan(c) + atan((b - c a)/(a + c b)), where c = k/64
 * is nearest to q */
static inline double add_arc(double base, double base_rest, double sign, double b, double a)
{
    double q = b / a, a_1 = upper_bits(a), a_2 = a - a_1;
    if (q < 0.125) {
        const double *k = arc_terms, z = q * q, zz = z * z;
        double sum = (k[0] + z * k[1]) + zz * (k[2] + z * k[3]) +
                     zz * zz * ((k[4] + z * k[5]) + zz * (k[6] + z * k[7]));
        double q_1 = upper_bits(q), q_2 = ((b - q_1 * a_1) - q_1 * a_2) / a;
        double tail = q_2 + q * z * sum, whole = base + sign * q_1;
        return whole + (sign * tail + (base - whole + sign * q_1 + base_rest));
    }
    double rounded = q * 64 + ROUNDER, c = (rounded - ROUNDER) * 0.015625;
    double d = ((b - c * a_1) - c * a_2) / (a + c * b), z = d * d;
    const double *k = arc_step_terms, *arc = arc_table[last_bits(rounded, 63)];
    double tail = arc[1] + (d + d * z * (k[0] + z * (k[1] + z * k[2])));
    double whole = base + sign * arc[0];
    return whole + (sign * tail + (base - whole + sign * arc[0] + base_rest));
}

/* |atan2(y, x)| where both are zero or one is not finite: a multiple of 45 degrees, or NaN; a: the
 * larger of |x| and |y| */
static inline double arc_at_edge(double y, double x, double a)
{
    double half = a == 0 ? signbit(x) : x < 0, quarter = a > 0 && fabs(y) == a;
    if (isnan(x) || isnan(y)) return x + y;
    if (quarter && fabs(x) == a) return half ? 0.75 * PI_1 : 0.25 * PI_1;
    return quarter ? 0.5 * PI_1 : half ? PI_1 : 0;
}

/* atan2(y, x). The first octant has b <= a, the other octants follow by reflection; a and b are
 * scaled where products would leave the range of doubles. */
static inline double arc_tangent(double y, double x)
{
    double v = fabs(y), u = fabs(x), a = v > u ? v : u, b = v > u ? u : v, size;
    if (!(a < 0x1p500 && b > 0x1p-400)) {
        if (!(a > 0 && a <= 0x1.fffffffffffffp+1023 && b >= 0))
            return copysign(arc_at_edge(y, x, a), y);
        if (x > 0 && v < 0x1p-60 * u) return y / x;
        double k = a > 1 ? 0x1p-600 : 0x1p540;
        a *= k, b *= k;
    }
    if (v > u) size = add_arc(0.5 * PI_1, 0.5 * PI_2, x < 0 ? 1 : -1, b, a);
    else size = x < 0 ? add_arc(PI_1, PI_2, -1, b, a) : add_arc(0, 0, 1, b, a);
    return copysign(size, y);
}

/* ---- exp and expm1 ---- */
/* parts of exp(x) = 2^n (a + a tail): x = (128 n + j) ln 2/128 + r, a (1 + b) = 2^(j/128) from a
 * table, |r| <= ln 2/256 (Tang 1989) */
typedef struct {
    double a, tail;
    int n; /* modulo 2^12: raised() adds n to the upper 12 bits of a double, sign and exponent */
} Power;

static inline Power power_of_e(double x)
{
    double rounded = x * STEPS_PER_E + ROUNDER, m = rounded - ROUNDER;
    double r = x - m * STEP_1 - m * STEP_2, rr = r * r;
    const double *k = exponential_terms, *row = power_table[last_bits(rounded, 127)];
    double tail = row[1] + (r + rr * ((k[0] + r * k[1]) + rr * (k[2] + r * k[3])));
    return (Power){row[0], tail, last_bits(rounded, 0x7ffff) >> 7};
}

/* exp(x) where 2^n is not a normal double: for large x exp(x)/2 is computed and doubled; for
 * small x 2^1000 exp(x), which is normal, is computed and scaled */
static inline double exponential_at_edge(double x)
{
    if (isnan(x)) return x;
    if (x > 709.782712893384) return INFINITY;
    if (x < -745.13321910194122) return 0;
    Power p = power_of_e(x);
    double half = raised(p.a + p.a * p.tail, x > 0 ? p.n - 1 : p.n + 1000);
    return half * (x > 0 ? 2 : 0x1p-1000);
}

static inline double exponential(double x)
{
    if (!(fabs(x) < 708)) return exponential_at_edge(x);
    Power p = power_of_e(x);
    double a = raised(p.a, p.n);
    return a + a * p.tail;
}

static inline double exponential_less_1(double x) /* exp(x) - 1, accurate also near 0 */
{
    if (fabs(x) < 0.125) {
        if (fabs(x) < 0x1p-54) return x;
        const double *k = expm1_terms, z = x * x, zz = z * z;
        double sum = (k[0] + x * k[1]) + z * (k[2] + x * k[3]) +
                     zz * ((k[4] + x * k[5]) + z * (k[6] + x * k[7]) + zz * k[8]);
        return x + (0.5 * z + x * z * sum);
    }
    if (x < -40) return -1;
    if (!(x < 708)) return exponential_at_edge(x);
    Power p = power_of_e(x);
    double a = raised(p.a, p.n), power_less_1 = a - 1, recovered = a - power_less_1;
    return power_less_1 + ((a - (power_less_1 + recovered)) + (recovered - 1) + a * p.tail);
}

/* ---- log ---- */
static inline double logarithm_at_edge(double x)
{
    return x == 0 ? -INFINITE : x > 0 || isnan(x) ? x : NOT_NUMBER;
}

#define SMALLEST_NORMAL (UINT64_C(1) << 52)     /* bits of 2^-1022 */
#define ALL_NORMAL      (UINT64_C(0x7FE) << 52) /* number of normal doubles above 0 */

/* ln x: x = 2^n z, ln z = ln c + ln(1 + r), r = z/c - 1. A table contains ln c, and 1/c in 20 bits,
 * for a number c near z; so r is exact in two parts (after Tang 1990) */
static inline double logarithm(double x)
{
    int shift = 1022;
    if (bits_of(x) - SMALLEST_NORMAL >= ALL_NORMAL) {
        if (!(x > 0 && x < 1)) return logarithm_at_edge(x);
        x *= 0x1p54, shift += 54;
    }
    uint64_t above = bits_of(x) - (LEAST_Z - (UINT64_C(1022) << 52));
    double n = (int)(above >> 52) - shift;
    double z = double_of((above & UINT64_C(0xFFFFFFFFFFFFF)) + LEAST_Z);
    const double *row = log_table[above >> 45 & 127], *k = log_terms;
    double z_1 = upper_bits(z), r_1 = z_1 * row[0] - 1, r_2 = (z - z_1) * row[0], r = r_1 + r_2;
    double w = n * LN_2_1 + row[1], hi = w + r, rr = r * r;
    double sum = (k[0] + r * k[1]) + rr * ((k[2] + r * k[3]) + rr * (k[4] + r * k[5]));
    return hi + ((w - hi + r) + (n * LN_2_2 + row[2] + (r_1 - r + r_2)) + rr * sum);
}

#endif
