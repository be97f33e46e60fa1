/* types.h - table of variables of a specimen. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include <stdbool.h>
#include <stddef.h>
#include "fmi3Functions.h"

typedef enum { FLOAT64, INT32, CLOCK } Type;
typedef enum { AN_OUTPUT, AN_INPUT, A_PARAMETER } Causality;

typedef struct {
    fmi3ValueReference reference;
    Type type;
    size_t place, size; /* offset in Model, number of elements */
    Causality causality;
} Variable;

#define OUTPUT(reference, type, member)    ROW(reference, type, member, AN_OUTPUT)
#define INPUT(reference, type, member)     ROW(reference, type, member, AN_INPUT)
#define PARAMETER(reference, type, member) ROW(reference, type, member, A_PARAMETER)
#define ROW(reference, type, member, causality)                            \
    {reference, type, offsetof(Model, member),                             \
     sizeof(((Model *)0)->member) / (type == FLOAT64 ? sizeof(fmi3Float64) \
                                     : type == INT32 ? sizeof(fmi3Int32)   \
                                                     : sizeof(fmi3Clock)), \
     causality}
