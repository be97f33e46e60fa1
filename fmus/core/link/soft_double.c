/* soft_double.c - sums of doubles for processors of 32 bits without them, correctly rounded.
 *
 * The libgcc of gcc 12 for Arm rounds some ties of sums the wrong way: -0x1.f644e8p-5 + 0x1p28 ends
 * in 9bb1 in place of 9bb2. The linker puts these in the place of its functions (--wrap).
 *
 * A head is the upper word of a number without its fraction: sign and exponent e. With a significand
 * m in units of the last place the number is m 2^(e - 1075); the leading one of m, at bit 52, makes
 * the exponent that is written e, and without it (e = 1) the number is subnormal. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include <stdbool.h>
#include <stdint.h>

#define SIGN     ((uint64_t)1 << 63)
#define INFINITE ((uint64_t)0x7ff << 52)
#define QUIET    ((uint64_t)1 << 51)
#define LEADING  ((uint64_t)1 << 52)
#define HEAD     0xfff00000u
#define ONE      0x00100000u /* one more in the exponent of a head */
#define HALF     0x80000000u

/* rest: below the last place of the whole, in units of 2^-32 of it; the last bit is sticky */
typedef struct {
    uint64_t whole;
    uint32_t rest;
} Significand;

uint64_t sum_of_bits(uint64_t a, uint64_t b);

static inline uint32_t upper(uint64_t a) { return (uint32_t)(a >> 32); }
static inline uint64_t words(uint32_t high, uint32_t low) { return (uint64_t)high << 32 | low; }
static inline unsigned exponent(uint64_t a) { return upper(a) >> 20 & 0x7ff; }
static inline uint64_t fraction(uint64_t a) { return a & (LEADING - 1); }

/* what a shift to the right by so many places, below 32, pushes out, at the top of the next word */
static inline uint32_t pushed_out(uint32_t word, unsigned places)
{
    return word << 1 << (31 - places);
}

/* to the right by so many places, below 64 */
static inline Significand shifted(uint64_t m, unsigned places)
{
    uint32_t high = upper(m), low = (uint32_t)m;
    if (places < 32)
        return (Significand){words(high >> places, low >> places | pushed_out(high, places)),
                             pushed_out(low, places)};
    places -= 32;
    uint32_t rest = low >> places | pushed_out(high, places);
    return (Significand){high >> places, rest | (pushed_out(low, places) != 0)};
}

/* to the nearest, ties to even; what carries out of the fraction goes to the exponent */
static inline uint64_t rounded(uint32_t head, uint64_t m, uint32_t rest)
{
    uint64_t bits = m + words(head - ONE, 0);
    if (rest < HALF) return bits;
    bits++;
    return rest == HALF ? bits & ~(uint64_t)1 : bits;
}

static inline uint64_t sum(uint32_t head, uint64_t m, Significand n)
{
    m += n.whole;
    if (m < 2 * LEADING) return rounded(head, m, n.rest);
    head += ONE;
    if ((head | HALF) >= HEAD) return words(head, 0);
    return rounded(head, m >> 1, (uint32_t)m << 31 | n.rest >> 1 | (n.rest & 1));
}

/* the leading one to bit 52, or e = 1 */
static uint64_t normalised(uint32_t head, uint64_t m)
{
    if (m == 0) return 0;
    unsigned e = head >> 20 & 0x7ff, places = (unsigned)__builtin_clzll(m) - 11;
    if (places >= e) places = e - 1;
    return rounded(head - places * ONE, m << places, 0);
}

/* m > n; with two places or more between them one place is lost at most, with fewer the rest is a
 * bit at most */
static inline uint64_t difference(uint32_t head, uint64_t m, Significand n)
{
    m -= n.whole + (n.rest != 0);
    uint32_t rest = -n.rest;
    if (m >= LEADING) return rounded(head, m, rest);
    if ((head & ~HALF) == ONE) return normalised(head, m);
    m = m << 1 | rest >> 31;
    if (m >= LEADING) return rounded(head - ONE, m, rest << 1);
    return normalised(head - ONE, m);
}

/* not a number or infinite, or the smaller one is zero */
static __attribute__((noinline)) uint64_t special(uint64_t a, uint64_t b)
{
    uint64_t size_a = a & ~SIGN, size_b = b & ~SIGN;
    if (size_a > INFINITE) return a | QUIET;
    if (size_a == INFINITE) return size_b == INFINITE && a != b ? INFINITE | QUIET : a;
    return size_a ? a : a & b;
}

/* the larger one first */
static uint64_t ordered(uint64_t a, uint64_t b)
{
    if (exponent(a) == 0x7ff || (b & ~SIGN) == 0) return special(a, b);
    uint32_t head = upper(a) & HEAD;
    unsigned places = exponent(a) - exponent(b);
    uint64_t m = fraction(a) | LEADING, n = fraction(b) | LEADING;
    if (exponent(b) == 0) {
        n -= LEADING;
        if (exponent(a) == 0) m -= LEADING, head += ONE;
        else places--;
    }
    if (places > 54) return a;
    Significand small = shifted(n, places);
    return (a ^ b) & SIGN ? difference(head, m, small) : sum(head, m, small);
}

uint64_t sum_of_bits(uint64_t a, uint64_t b)
{
    if ((a & ~SIGN) < (b & ~SIGN)) return ordered(b, a);
    return ordered(a, b);
}

/* the calls of the Arm EABI: doubles travel in core registers, as 64-bit numbers do */
uint64_t __wrap___aeabi_dadd(uint64_t a, uint64_t b);
uint64_t __wrap___aeabi_dsub(uint64_t a, uint64_t b);
uint64_t __wrap___aeabi_drsub(uint64_t a, uint64_t b);

uint64_t __wrap___aeabi_dadd(uint64_t a, uint64_t b) { return sum_of_bits(a, b); }
uint64_t __wrap___aeabi_dsub(uint64_t a, uint64_t b) { return sum_of_bits(a, b ^ SIGN); }
uint64_t __wrap___aeabi_drsub(uint64_t a, uint64_t b) { return sum_of_bits(b, a ^ SIGN); }
