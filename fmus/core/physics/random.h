/* random.h - random numbers as a pure function of (seed, stream, sample index n, draw j).
 *
 * The generator has no state, so that step sizes, order of calls, saved states and platforms do not
 * change a draw. Block b = 0, 1, .. of Philox4x32-10 (Salmon et al. 2011) gives the uniform draws j
 * = 2b and 2b + 1. The key is (seed, stream), the counter (n mod 2^32, n / 2^32 rounded down, b,
 * s), with s = 0 for draws of a sample and s = 1 for draws made once per run. A normal draw is z =
 * PPND16(u) of a uniform draw u (Wichura 1988, AS 241), computed with sums, products, quotients,
 * roots and logarithm() of portable_math.h; |z| is at most 8.21. Equations: docs/models.md F.1. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef RANDOM_H
#define RANDOM_H

#include "fmu.h"
#include "vec3.h"

#include <stdint.h>

typedef struct { double seed, stream; } RandomStream;

#define RANDOM_ROWS(member)                                                                        \
    NONNEGATIVE_AS("seed", member.seed, "1",                                                       \
                   "seed of the noise, whole number below 2^32, the same for all sensors"),        \
        NONNEGATIVE_AS("stream", member.stream, "1",                                               \
                       "stream of the noise, whole number below 2^32, different for every sensor " \
                       "of a system")

static inline void check_random(Problems *problems, const RandomStream *r)
{
    const double value[] = {r->seed, r->stream};
    const char *const name[] = {"seed", "stream"};
    for (int i = 0; i < 2; i++)
        if (value[i] != floor_of(value[i]) || value[i] >= 4294967296.0)
            reject(problems, name[i], value[i], "must be a whole number in [0, 2^32)");
}

/* ---- Philox4x32-10 ---- */
typedef struct { uint32_t word[4]; } RandomBlock;

static inline RandomBlock philox_round(RandomBlock c, uint32_t k0, uint32_t k1)
{
    uint64_t p = UINT64_C(0xD2511F53) * c.word[0], q = UINT64_C(0xCD9E8D57) * c.word[2];
    return (RandomBlock){{(uint32_t)(q >> 32) ^ c.word[1] ^ k0, (uint32_t)q,
                          (uint32_t)(p >> 32) ^ c.word[3] ^ k1, (uint32_t)p}};
}

static inline RandomBlock philox(RandomBlock counter, uint32_t k0, uint32_t k1)
{
    for (int i = 0; i < 10; i++) {
        counter = philox_round(counter, k0, k1);
        k0 += UINT32_C(0x9E3779B9);
        k1 += UINT32_C(0xBB67AE85);
    }
    return counter;
}

/* ---- normal distribution ---- */
static inline double polynomial(const double *p, int degree, double r) /* Horner */
{
    double sum = p[degree];
    while (degree-- > 0) sum = sum * r + p[degree];
    return sum;
}

/* coefficients of AS 241: numerators A, C, E, denominators B, D, F */
static const double quantile_A[] = {
    3.3871328727963666080, 133.14166789178437745, 1971.5909503065514427, 13731.693765509461125,
    45921.953931549871457, 67265.770927008700853, 33430.575583588128105, 2509.0809287301226727};
static const double quantile_B[] = {1.0,
                                    42.313330701600911252,
                                    687.18700749205790830,
                                    5394.1960214247511077,
                                    21213.794301586595867,
                                    39307.895800092710610,
                                    28729.085735721942674,
                                    5226.4952788528545610};
static const double quantile_C[] = {1.42343711074968357734,   4.63033784615654529590,
                                    5.76949722146069140550,   3.64784832476320460504,
                                    1.27045825245236838258,   0.241780725177450611770,
                                    0.0227238449892691845833, 7.74545014278341407640e-4};
static const double quantile_D[] = {1.0,
                                    2.05319162663775882187,
                                    1.67638483018380384940,
                                    0.689767334985100004550,
                                    0.148103976427480074590,
                                    0.0151986665636164571966,
                                    5.47593808499534494600e-4,
                                    1.05075007164441684324e-9};
static const double quantile_E[] = {6.65790464350110377720,    5.46378491116411436990,
                                    1.78482653991729133580,    0.296560571828504891230,
                                    0.0265321895265761230930,  1.24266094738807843860e-3,
                                    2.71155556874348757815e-5, 2.01033439929228813265e-7};
static const double quantile_F[] = {1.0,
                                    0.599832206555887937690,
                                    0.136929880922735805310,
                                    0.0148753612908506148525,
                                    7.86869131145613259100e-4,
                                    1.84631831751005468180e-5,
                                    1.42151175831644588870e-7,
                                    2.04426310338993978564e-15};

/* quantile z of the normal distribution at the probability u, 0 < u < 1 */
static inline double normal_quantile(double u)
{
    double q = u - 0.5;
    if (fabs(q) <= 0.425) {
        double r = 0.180625 - q * q;
        return q * polynomial(quantile_A, 7, r) / polynomial(quantile_B, 7, r);
    }
    double r = sqrt(-logarithm(smaller(u, 1 - u)));
    double z = r <= 5 ? polynomial(quantile_C, 7, r - 1.6) / polynomial(quantile_D, 7, r - 1.6)
                      : polynomial(quantile_E, 7, r - 5) / polynomial(quantile_F, 7, r - 5);
    return q < 0 ? -z : z;
}

/* ---- draws ---- */
typedef struct {
    uint32_t key[2], low, high, once;
} Draws; /* key and counter of the draws of a sample (once = 0) or of the run (once = 1) */

static inline double remainder_of(double x, double divisor) /* result in [0, divisor) */
{
    return x - divisor * floor_of(x / divisor);
}

static inline Draws draws_of_sample(const RandomStream *r, double n)
{
    const double word = 4294967296.0;
    return (Draws){{(uint32_t)r->seed, (uint32_t)r->stream},
                   (uint32_t)remainder_of(n, word),
                   (uint32_t)remainder_of(floor_of(n / word), word),
                   0};
}
static inline Draws draws_of_run(const RandomStream *r)
{
    return (Draws){{(uint32_t)r->seed, (uint32_t)r->stream}, 0, 0, 1};
}

/* uniform number in (0, 1), symmetric about 1/2: the upper 26 bits of both words as a fraction of
 * 52 bits, plus half a unit in its last place; the result is not rounded */
static inline double uniform_of_words(uint32_t a, uint32_t b)
{
    return ((a >> 6) * 67108864.0 + (b >> 6) + 0.5) / 4503599627370496.0;
}

static inline double uniform(const Draws *d, unsigned j)
{
    RandomBlock w = philox((RandomBlock){{d->low, d->high, j / 2, d->once}}, d->key[0], d->key[1]);
    return j % 2 ? uniform_of_words(w.word[2], w.word[3]) : uniform_of_words(w.word[0], w.word[1]);
}
static inline double normal(const Draws *d, unsigned j) { return normal_quantile(uniform(d, j)); }

/* draws j, j + 1 and j + 2 as standard normal numbers */
static inline vec3 normals(const Draws *d, unsigned j)
{
    return vec(normal(d, j), normal(d, j + 1), normal(d, j + 2));
}
/* draws j, j + 1 and j + 2 as uniform numbers in (-1, 1) */
static inline vec3 symmetric_uniforms(const Draws *d, unsigned j)
{
    return vec(2 * uniform(d, j) - 1, 2 * uniform(d, j + 1) - 1, 2 * uniform(d, j + 2) - 1);
}

#endif
