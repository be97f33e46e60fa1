/* maths.c - what a call of portable_math.h costs beside the same function of the C library.
 *
 *     maths FUNCTION portable|library CALLS
 *
 * prints nanoseconds per call and the sum of the values, so that nothing is optimised away. */
/* SPDX-License-Identifier: BSD-2-Clause */
#define _POSIX_C_SOURCE 199309L
#include "portable_math.h"

#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#define ARGUMENTS 1024

static double sine_plus_cosine(double x)
{
    SineCosine both = sine_and_cosine(x);
    return both.s + both.c;
}
static double sin_plus_cos(double x) { return sin(x) + cos(x); }
static double arc_of_1(double x) { return arc_tangent(x, 1.7); }
static double atan2_of_1(double x) { return atan2(x, 1.7); }

/* sums over arguments in [low, high], CALLS of them */
#define LOOP(name, function)                                                \
    static double sum_##name(const double *x, long calls)                   \
    {                                                                       \
        double sum = 0;                                                     \
        for (long i = 0; i < calls; i++) sum += function(x[i % ARGUMENTS]); \
        return sum;                                                         \
    }
#define FUNCTIONS(DO)                                     \
    DO(sin, sine, sin, -100, 100)                         \
    DO(sin_small, sine, sin, -0.7, 0.7)                   \
    DO(sin_huge, sine, sin, 1e22, 1e30)                   \
    DO(cos, cosine, cos, -100, 100)                       \
    DO(sincos, sine_plus_cosine, sin_plus_cos, -100, 100) \
    DO(atan2, arc_of_1, atan2_of_1, -10, 10)              \
    DO(atan2_small, arc_of_1, atan2_of_1, -0.2, 0.2)      \
    DO(exp, exponential, exp, -20, 20)                    \
    DO(expm1, exponential_less_1, expm1, -20, 20)         \
    DO(expm1_small, exponential_less_1, expm1, -0.1, 0.1) \
    DO(log, logarithm, log, 0.001, 1000)                  \
    DO(log_near_1, logarithm, log, 0.95, 1.05)            \
    DO(floor, floor_of, floor, -1e6, 1e6)

#define BOTH(name, ours, theirs, low, high) LOOP(ours_##name, ours) LOOP(library_##name, theirs)
FUNCTIONS(BOTH)

typedef struct {
    const char *name;
    double (*ours)(const double *x, long calls), (*library)(const double *x, long calls);
    double low, high;
} Case;
#define ROW(name, ours, theirs, low, high) {#name, sum_ours_##name, sum_library_##name, low, high},
static const Case cases[] = {FUNCTIONS(ROW)};

static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void measure(const Case *c, int ours, long calls)
{
    double x[ARGUMENTS], step = (c->high - c->low) / ARGUMENTS;
    for (int i = 0; i < ARGUMENTS; i++) x[i] = c->low + (i * 389 % ARGUMENTS + 0.37) * step;
    double start = seconds(), sum = (ours ? c->ours : c->library)(x, calls);
    printf("%.3f %a\n", (seconds() - start) / (double)calls * 1e9, sum);
}

int main(int count, char **texts)
{
    if (count == 1)
        for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) puts(cases[i].name);
    if (count != 4) return count != 1;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        if (strcmp(cases[i].name, texts[1]) == 0)
            measure(&cases[i], strcmp(texts[2], "portable") == 0, atol(texts[3]));
    return 0;
}
