/* soft_double.c - correctly rounded sums, quotients and square roots of doubles for 32-bit
 * processors without a double-precision unit.
 *
 * The linker replaces functions of the libraries by these (--wrap). Sums: the libgcc of gcc 12 for
 * Arm rounds some ties the wrong way (-0x1.f644e8p-5 + 0x1p28 ends in 9bb1 instead of 9bb2).
 * Quotients and roots: the library computes them bit by bit, in 400 and 700 instructions; these
 * functions need 110 and 120. The products of the library are correct and fast.
 *
 * A head is the upper word of a number without its fraction: sign and exponent e. The significand m
 * is a whole number: the number is m 2^(e - 1075). The bits of the number are the sum of m and of
 * head - ONE as upper word: the leading one of m, at bit 52, increases the exponent field from
 * e - 1 to e. If m has no leading one, e is 1 and the number is subnormal. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include <stdbool.h>
#include <stdint.h>

#define SIGN     ((uint64_t)1 << 63)
#define INFINITE ((uint64_t)0x7ff << 52)
#define QUIET    ((uint64_t)1 << 51)
#define LEADING  ((uint64_t)1 << 52)
#define HEAD     0xfff00000u
#define ONE      0x00100000u /* added to a head, increases its exponent field by 1 */
#define HALF     0x80000000u

/* significand after a right shift. rest: part below the last place of `whole`, in units of 2^-32
 * of that place; its last bit is sticky (1 if any lower bit was 1) */
typedef struct {
    uint64_t whole;
    uint32_t rest;
} Significand;

uint64_t sum_of_bits(uint64_t a, uint64_t b);
uint64_t quotient_of_bits(uint64_t a, uint64_t b);
uint64_t root_of_bits(uint64_t a);

static inline uint32_t upper(uint64_t a) { return (uint32_t)(a >> 32); }
static inline uint64_t words(uint32_t high, uint32_t low) { return (uint64_t)high << 32 | low; }
static inline unsigned exponent(uint64_t a) { return upper(a) >> 20 & 0x7ff; }
static inline uint64_t fraction(uint64_t a) { return a & (LEADING - 1); }

/* the bits that a right shift by `places` (below 32) removes from a word, moved to the top of a
 * word */
static inline uint32_t removed_bits(uint32_t word, unsigned places)
{
    return word << 1 << (31 - places);
}

/* m shifted to the right by `places`, which is below 64 */
static inline Significand shifted(uint64_t m, unsigned places)
{
    uint32_t high = upper(m), low = (uint32_t)m;
    if (places < 32)
        return (Significand){words(high >> places, low >> places | removed_bits(high, places)),
                             removed_bits(low, places)};
    places -= 32;
    uint32_t rest = low >> places | removed_bits(high, places);
    return (Significand){high >> places, rest | (removed_bits(low, places) != 0)};
}

/* bits of the double with head, significand m and rest: rounded to nearest, ties to even; a
 * carry out of the fraction increases the exponent */
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

/* bits of the double with head and significand m, after m is shifted to the left until its leading
 * one is at bit 52, or until the exponent e of the head is 1 */
static uint64_t normalised(uint32_t head, uint64_t m)
{
    if (m == 0) return 0;
    unsigned e = head >> 20 & 0x7ff, places = (unsigned)__builtin_clzll(m) - 11;
    if (places >= e) places = e - 1;
    return rounded(head - places * ONE, m << places, 0);
}

/* bits of m - n for m >= n, where n is already shifted to the exponent of m. If the exponents
 * differed by two or more, the difference is shifted to the left by at most one place; otherwise
 * only the highest bit of n.rest can be 1. Therefore normalised() never needs a bit of the rest. */
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

/* bits of a + b with |a| >= |b| if a is NaN or infinite, or if b is zero; not inlined, because its
 * registers would cost time in all other cases */
static __attribute__((noinline)) uint64_t special_sum(uint64_t a, uint64_t b)
{
    uint64_t size_a = a & ~SIGN, size_b = b & ~SIGN;
    if (size_a > INFINITE) return a | QUIET;
    if (size_a == INFINITE) return size_b == INFINITE && a != b ? INFINITE | QUIET : a;
    return size_a ? a : a & b;
}

/* bits of the sum a + b with |a| >= |b| */
static uint64_t sum_ordered(uint64_t a, uint64_t b)
{
    if (exponent(a) == 0x7ff || (b & ~SIGN) == 0) return special_sum(a, b);
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
    if ((a & ~SIGN) < (b & ~SIGN)) return sum_ordered(b, a);
    return sum_ordered(a, b);
}

/* ---- quotients */
static inline uint32_t upper_product(uint32_t a, uint32_t b) { return upper((uint64_t)a * b); }

/* 2^63 / d for d >= 2^31, with a relative error between -2^-29 and 0. A linear approximation
 * with an error below 8 % is improved by three Newton steps r (2 - d r); neither the steps nor
 * truncation make the result too large. */
static inline uint32_t reciprocal(uint32_t d)
{
    uint32_t r = 0x76cf5d0b - d;
    for (int i = 0; i < 3; i++) r = (uint32_t)((uint64_t)r * ~upper_product(r, d) >> 31);
    return r;
}

/* the first 54 bits of m / n for n <= m < 2 n, computed as two digits of 27 bits; *sticky: whether
 * a remainder is left; the leading one of n is bit 52 */
static inline uint64_t digits(uint64_t m, uint64_t n, bool *sticky)
{
    /* - 2, so that r is never too large, although n is truncated */
    uint32_t r = reciprocal((uint32_t)(n >> 21)) - 2;
    uint32_t first = upper_product((uint32_t)(m >> 22), r) >> 4;
    m = (m << 26) - n * first;
    uint32_t second = upper_product((uint32_t)(m >> 22), r) >> 3;
    m = (m << 27) - n * second;
    for (; m >= n; m -= n) second++;
    *sticky = m != 0;
    return ((uint64_t)first << 27) + second;
}

/* bits of the quotient of two significands with leading ones; e: exponent field of the quotient */
static inline uint64_t quotient(uint32_t sign, int e, uint64_t m, uint64_t n)
{
    bool sticky;
    if (m < n) m <<= 1, e--;
    uint64_t q = digits(m, n, &sticky);
    if (e >= 0x7ff) return words(sign, 0) | INFINITE;
    if (e > 0) return rounded(sign | (uint32_t)e << 20, q >> 1, (uint32_t)q << 31 | sticky);
    Significand tiny = shifted(q | sticky, e > -61 ? (unsigned)(2 - e) : 63);
    return rounded(sign | ONE, tiny.whole, tiny.rest);
}

/* significand with its leading one at bit 52, also of a subnormal number; e: its exponent */
static uint64_t with_leading_one(uint64_t size, int *e)
{
    int places = size < LEADING ? __builtin_clzll(size) - 11 : 0;
    *e = places ? 1 - places : (int)exponent(size);
    return places ? size << places : fraction(size) | LEADING;
}

static __attribute__((noinline)) uint64_t special_quotient(uint64_t a, uint64_t b)
{
    uint64_t size_a = a & ~SIGN, size_b = b & ~SIGN, sign = (a ^ b) & SIGN;
    int e, f;
    if (size_a > INFINITE) return a | QUIET;
    if (size_b > INFINITE) return b | QUIET;
    if (size_a == size_b && (size_a == 0 || size_a == INFINITE)) return INFINITE | QUIET;
    if (size_a == 0 || size_b == INFINITE) return sign;
    if (size_a == INFINITE || size_b == 0) return sign | INFINITE;
    uint64_t m = with_leading_one(size_a, &e), n = with_leading_one(size_b, &f);
    return quotient(upper(sign), e - f + 1023, m, n);
}

static inline bool normal(uint64_t a) { return exponent(a) - 1 < 0x7fe; }

uint64_t quotient_of_bits(uint64_t a, uint64_t b)
{
    if (!normal(a) || !normal(b)) return special_quotient(a, b);
    int e = (int)exponent(a) - (int)exponent(b) + 1023;
    return quotient(upper(a ^ b) & HALF, e, fraction(a) | LEADING, fraction(b) | LEADING);
}

/* ---- square roots */

/* 2^47 / sqrt(x) for x >= 2^30, with a relative error between -2^-28 and 0. A linear
 * approximation with an error below 12 % is improved by four Newton steps y (3 - x y^2) / 2;
 * neither the steps nor truncation make the result too large. */
static inline uint32_t reciprocal_root(uint32_t x)
{
    uint32_t y = 0x03886595 - (x >> 1);
    for (int i = 0; i < 4; i++)
        y = upper_product(y, 0xbffffffe - upper_product(upper_product(y, y), x)) << 1;
    return y;
}

/* Integer part (54 bits) of the square root of 2^44 x, x >= 2^62. Its upper bits come from the
 * reciprocal root, the others from one Newton step, whose error is at most one unit of the last
 * place. Therefore 1 is subtracted, so that the result is never too large, and the loop adds
 * the units that are missing. */
static inline uint64_t whole_root(uint64_t x)
{
    uint32_t y = reciprocal_root(upper(x)), first = upper_product(upper(x), y);
    uint64_t rest = x - 4 * ((uint64_t)first * first);
    uint64_t s = ((uint64_t)first << 23) + upper_product((uint32_t)(rest >> 10), y) - 1;
    rest = (x << 44) - s * s;
    for (; rest > 2 * s; s++) rest -= 2 * s + 1;
    return s;
}

/* bits of the square root of the number with significand m (with leading one) and exponent e;
 * ties do not occur */
static inline uint64_t root(int e, uint64_t m)
{
    uint64_t s = whole_root(m << (e & 1 ? 10 : 11));
    return ((uint64_t)((e + 1021) >> 1) << 52) + ((s + 1) >> 1);
}

uint64_t root_of_bits(uint64_t a)
{
    int e;
    if (normal(a) && a < SIGN) return root((int)exponent(a), fraction(a) | LEADING);
    if ((a & ~SIGN) > INFINITE) return a | QUIET;
    if (a == INFINITE || (a & ~SIGN) == 0) return a;
    if (a & SIGN) return INFINITE | QUIET;
    uint64_t m = with_leading_one(a, &e);
    return root(e, m);
}

/* ---- functions of the Arm EABI: doubles are passed in core registers like 64-bit integers */
uint64_t __wrap___aeabi_dadd(uint64_t a, uint64_t b);
uint64_t __wrap___aeabi_dsub(uint64_t a, uint64_t b);
uint64_t __wrap___aeabi_drsub(uint64_t a, uint64_t b);
uint64_t __wrap___aeabi_ddiv(uint64_t a, uint64_t b);
double __wrap_sqrt(double x);

uint64_t __wrap___aeabi_dadd(uint64_t a, uint64_t b) { return sum_of_bits(a, b); }
uint64_t __wrap___aeabi_dsub(uint64_t a, uint64_t b) { return sum_of_bits(a, b ^ SIGN); }
uint64_t __wrap___aeabi_drsub(uint64_t a, uint64_t b) { return sum_of_bits(b, a ^ SIGN); }
uint64_t __wrap___aeabi_ddiv(uint64_t a, uint64_t b) { return quotient_of_bits(a, b); }

double __wrap_sqrt(double x)
{
    union {
        double number;
        uint64_t bits;
    } root = {x};
    root.bits = root_of_bits(root.bits);
    return root.number;
}
