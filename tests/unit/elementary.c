/* elementary.c - the functions of portable_math.h over arrays, for the unit tests. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "portable_math.h"

#include <stddef.h>

typedef const double *From;
typedef double *To;

#define OVER(name, function)                                      \
    void over_##name(From x, To y, size_t count);                 \
    void over_##name(From x, To y, size_t count)                  \
    {                                                             \
        for (size_t i = 0; i < count; i++) y[i] = function(x[i]); \
    }
#define OVER_TWO(name, function)                                        \
    void over_##name(From a, From b, To y, size_t count);               \
    void over_##name(From a, From b, To y, size_t count)                \
    {                                                                   \
        for (size_t i = 0; i < count; i++) y[i] = function(a[i], b[i]); \
    }

static double joint_sine(double x) { return sine_and_cosine(x).s; }
static double joint_cosine(double x) { return sine_and_cosine(x).c; }

OVER(sine, sine)
OVER(cosine, cosine)
OVER(joint_sine, joint_sine)
OVER(joint_cosine, joint_cosine)
OVER(exponential, exponential)
OVER(exponential_less_1, exponential_less_1)
OVER(logarithm, logarithm)
OVER(nearest_whole, nearest_whole)
OVER(floor_of, floor_of)
OVER(ceiling_of, ceiling_of)
OVER_TWO(arc_tangent, arc_tangent)
OVER_TWO(smaller, smaller)
OVER_TWO(larger, larger)
