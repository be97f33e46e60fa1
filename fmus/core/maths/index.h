/* index.h - index into an array from a real number. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef INDEX_H
#define INDEX_H

#include "vec3.h"

/* whole part of x, limited to 0 .. last; 0 if x is NaN */
static inline int index_within(double x, int last)
{
    if (x != x) return 0;
    return (int)clamp(x, 0, last);
}

#endif
