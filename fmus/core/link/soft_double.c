/* soft_double.c - sums of doubles for processors without them, correctly rounded.
 *
 * The libgcc of gcc 12 for Arm rounds some ties of sums the wrong way: -0x1.f644e8p-5 + 0x1p28 ends
 * in 9bb1 in place of 9bb2. The linker puts these in the place of its functions (--wrap). */
/* SPDX-License-Identifier: BSD-2-Clause */
#include <stdint.h>

#define SIGN     ((uint64_t)1 << 63)
#define INFINITE ((uint64_t)0x7ff << 52)
#define QUIET    ((uint64_t)1 << 51)

enum {
    EXTRA = 10,
    HALF = 1 << (EXTRA - 1)
}; /* bits kept beyond the last place; the last: sticky */

uint64_t sum_of_bits(uint64_t a, uint64_t b);

/* of a finite number: 1 for the smallest normal and all subnormal ones */
static int exponent(uint64_t size)
{
    int e = (int)(size >> 52);
    return e ? e : 1;
}

static uint64_t mantissa(uint64_t size)
{
    uint64_t fraction = size & (((uint64_t)1 << 52) - 1);
    return (size >> 52 ? fraction | (uint64_t)1 << 52 : fraction) << EXTRA;
}

static uint64_t shifted(uint64_t m, int places)
{
    if (places > 62) return m != 0;
    uint64_t lost = m & (((uint64_t)1 << places) - 1);
    return m >> places | (lost != 0);
}

/* to the nearest, ties to even; what carries out of the fraction goes to the exponent */
static uint64_t rounded(uint64_t m, int e)
{
    uint64_t rest = m & (2 * HALF - 1), kept = m >> EXTRA;
    kept += rest > HALF || (rest == HALF && (kept & 1));
    uint64_t bits = ((uint64_t)(e - 1) << 52) + kept;
    return bits < INFINITE ? bits : INFINITE;
}

static int smaller_of(int a, int b) { return a < b ? a : b; }

/* leading one at bit 52 + EXTRA, or exponent 1 */
static uint64_t normalised(uint64_t m, int e)
{
    if (m >> (53 + EXTRA)) return rounded(shifted(m, 1), e + 1);
    int places = smaller_of(__builtin_clzll(m | 1) - (11 - EXTRA), e - 1);
    return rounded(m << places, e - places);
}

static uint64_t special(uint64_t a, uint64_t b, uint64_t size_a, uint64_t size_b)
{
    if (size_a > INFINITE) return a | QUIET;
    if (size_b > INFINITE) return b | QUIET;
    if (size_a == size_b && a != b) return INFINITE | QUIET;
    return size_a == INFINITE ? a : b;
}

/* finite numbers, the larger one first */
static uint64_t sum(uint64_t a, uint64_t b)
{
    uint64_t size_a = a & ~SIGN, size_b = b & ~SIGN;
    int e = exponent(size_a);
    uint64_t m = mantissa(size_a), n = shifted(mantissa(size_b), e - exponent(size_b));
    if ((a ^ b) & SIGN) return m == n ? 0 : (a & SIGN) | normalised(m - n, e);
    return (a & SIGN) | normalised(m + n, e);
}

uint64_t sum_of_bits(uint64_t a, uint64_t b)
{
    uint64_t size_a = a & ~SIGN, size_b = b & ~SIGN;
    if (size_a >= INFINITE || size_b >= INFINITE) return special(a, b, size_a, size_b);
    return size_a < size_b ? sum(b, a) : sum(a, b);
}

/* the calls of the Arm EABI: doubles travel in core registers, as 64-bit numbers do */
uint64_t __wrap___aeabi_dadd(uint64_t a, uint64_t b);
uint64_t __wrap___aeabi_dsub(uint64_t a, uint64_t b);
uint64_t __wrap___aeabi_drsub(uint64_t a, uint64_t b);

uint64_t __wrap___aeabi_dadd(uint64_t a, uint64_t b) { return sum_of_bits(a, b); }
uint64_t __wrap___aeabi_dsub(uint64_t a, uint64_t b) { return sum_of_bits(a, b ^ SIGN); }
uint64_t __wrap___aeabi_drsub(uint64_t a, uint64_t b) { return sum_of_bits(b, a ^ SIGN); }
