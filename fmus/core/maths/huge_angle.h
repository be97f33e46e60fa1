/* huge_angle.h - x mod pi/2 for finite doubles with |x| >= 1, with a relative error of 2^-60.
 *
 * Payne & Hanek 1983: x 2/pi mod 4 with x = m 2^e needs only seven words of 32 bits of 2/pi. The
 * digits of 2/pi before these words give multiples of 4, the digits behind them are below the
 * precision of the remainder. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef HUGE_ANGLE_H
#define HUGE_ANGLE_H

#include "elementary_numbers.h"
#include "exact.h"

typedef struct {
    double hi, lo; /* |hi + lo| <= pi/4, |lo| < 2 units in the last place of hi */
    int quarter;   /* x = hi + lo + quarter pi/2 plus a multiple of 2 pi */
} Angle;

#define DIGIT_WORDS 7
typedef struct { uint32_t word[DIGIT_WORDS]; } Digits; /* the first word is the highest */

/* m 2^(e - 52) 2/pi mod 4, in units of 4/2^224, for 0 <= e <= 1023 */
static inline Digits quarter_turns(uint64_t m, int e)
{
    int first = (e + 42) / 32, shift = (e + 42) % 32;
    const uint32_t low = (uint32_t)m, high = (uint32_t)(m >> 32);
    Digits p;
    uint64_t carry = 0;
    for (int i = DIGIT_WORDS; i-- > 0; carry >>= 32)
        p.word[i] = (uint32_t)(carry += (uint64_t)two_over_pi[first + i] * low);
    carry = 0;
    for (int i = DIGIT_WORDS - 1; i-- > 0; carry >>= 32)
        p.word[i] = (uint32_t)(carry += (uint64_t)two_over_pi[first + i + 1] * high + p.word[i]);
    for (int i = 0; shift > 0 && i < DIGIT_WORDS; i++)
        p.word[i] = p.word[i] << shift | (i + 1 < DIGIT_WORDS ? p.word[i + 1] >> (32 - shift) : 0);
    return p;
}

/* 64 bits of p from bit `at` on, counted from the highest bit; at <= 160 */
static inline uint64_t window(const Digits *p, int at)
{
    const uint32_t *w = p->word + at / 32;
    const int shift = at % 32;
    uint64_t two = (uint64_t)w[0] << 32 | w[1];
    return shift ? two << shift | w[2] >> (32 - shift) : two;
}

static inline uint64_t upper_product(uint64_t a, uint64_t b) /* a b / 2^64 */
{
    uint64_t a0 = (uint32_t)a, a1 = a >> 32, b0 = (uint32_t)b, b1 = b >> 32;
    uint64_t middle = a1 * b0 + (a0 * b0 >> 32), other = a0 * b1 + (uint32_t)middle;
    return a1 * b1 + (middle >> 32) + (other >> 32);
}

/* x mod pi/2 from the digits of 2/pi. The two highest bits of the product are the number of
 * quarter turns, the others the fraction of a quarter turn; a fraction of 1/2 or more is
 * replaced by the next quarter turn minus the complement. The remainder is computed from the 64
 * bits behind the leading zeros of the fraction; there are at most 62 such zeros. */
static inline Angle reduced_by_digits(double x)
{
    uint64_t bits = bits_of(x), m = (bits & UINT64_C(0xFFFFFFFFFFFFF)) | UINT64_C(1) << 52;
    Digits p = quarter_turns(m, (int)(((bits >> 52) + 1) & 0x3FF)); /* |x| >= 1: no borrow */
    int above_half = p.word[0] >> 29 & 1, quarter = (int)(p.word[0] >> 30) + above_half, at = 2;
    for (int i = 0; above_half && i < DIGIT_WORDS; i++) p.word[i] = ~p.word[i];
    while (at < 100 && !(p.word[at / 32] >> (31 - at % 32) & 1)) at++;
    uint64_t r = upper_product(window(&p, at), HALF_PI_BITS); /* in units of 2^-(61 + at) */
    double unit = (above_half != (x < 0) ? -1 : 1) * power_of_2(-61 - at);
    double hi = (double)(r >> 11) * 2048, lo = (double)(r & 0x7FF);
    return (Angle){unit * hi, unit * lo, x < 0 ? -quarter : quarter};
}

#endif
