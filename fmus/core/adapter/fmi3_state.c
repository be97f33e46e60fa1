/* fmi3_state.c - functions of FMI 3.0 for FMU states and directional derivatives. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "fmi3_layer.h"
#include "state.h"

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi3GetFMUState", ANY_PHASE)) return fmi3Error;
    if (!state) return failure(instance, "fmi3GetFMUState", "a pointer argument is NULL");
    return take_snapshot(instance, state) ? fmi3OK
                                          : failure(instance, "fmi3GetFMUState", "out of memory");
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi3SetFMUState", ANY_PHASE)) return fmi3Error;
    if (!state) return failure(instance, "fmi3SetFMUState", "the state is NULL");
    restore_snapshot(instance, state);
    return fmi3OK;
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi3FreeFMUState", ANY_PHASE)) return fmi3Error;
    if (!state || !*state) return fmi3OK;
    release(instance, *state);
    *state = NULL;
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi3SerializedFMUStateSize", ANY_PHASE)) return fmi3Error;
    if (!state || !size)
        return failure(instance, "fmi3SerializedFMUStateSize",
                       "the state or a pointer argument is NULL");
    *size = snapshot_size();
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi3SerializeFMUState", ANY_PHASE)) return fmi3Error;
    if (!state || !bytes)
        return failure(instance, "fmi3SerializeFMUState", "the state or an array argument is NULL");
    if (size < snapshot_size())
        return failure(instance, "fmi3SerializeFMUState",
                       "the array is smaller than the size from fmi3SerializedFMUStateSize");
    write_snapshot(state, bytes);
    return fmi3OK;
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *state)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi3DeserializeFMUState", ANY_PHASE)) return fmi3Error;
    if (!bytes || !state)
        return failure(instance, "fmi3DeserializeFMUState", "an array or pointer argument is NULL");
    const char *rule = read_snapshot(instance, bytes, size, state);
    return rule ? failure(instance, "fmi3DeserializeFMUState", rule) : fmi3OK;
}

/* ---- directional derivatives ----
 * A value reference of FMI 3.0 names a variable with all its elements, a row of the table. Seed and
 * sensitivity contain the elements of the knowns and unknowns, one variable after the other. */
enum { NO_ELEMENT = VR_STRIDE - 1 + 1000000 * VR_STRIDE }; /* in no model: derive() rejects it */

static size_t elements_of(const fmi3ValueReference row[], size_t rows)
{
    size_t sum = 0;
    for (size_t i = 0; i < rows; i++) {
        Part p = part_of(&fmu_model, row[i], true);
        sum += p.first.row ? p.size : 1;
    }
    return sum;
}

static void list_elements(const fmi3ValueReference row[], size_t rows, unsigned element[])
{
    for (size_t i = 0; i < rows; i++) {
        Part p = part_of(&fmu_model, row[i], true);
        if (!p.first.row) *element++ = NO_ELEMENT;
        for (size_t k = 0; k < p.size; k++) *element++ = row[i] + (unsigned)k;
    }
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknown[],
                                        size_t unknowns, const fmi3ValueReference known[],
                                        size_t knowns, const fmi3Float64 seed[], size_t seeds,
                                        fmi3Float64 sensitivity[], size_t sensitivities)
{
    static const char function[] = "fmi3GetDirectionalDerivative";
    Instance *instance = c;
    if (!allowed(instance, function, INITIALIZING | STEPPING | TERMINATED | FAILED))
        return fmi3Error;
    if ((unknowns && !unknown) || (knowns && !known))
        return failure(instance, function, "an array argument is NULL");
    if (elements_of(unknown, unknowns) != sensitivities || elements_of(known, knowns) != seeds)
        return failure(
            instance, function,
            "seed must have as many elements as the knowns, sensitivity as the unknowns");
    unsigned *element = allocate(instance, (sensitivities + seeds + 1) * sizeof *element);
    if (!element) return failure(instance, function, "out of memory");
    list_elements(unknown, unknowns, element);
    list_elements(known, knowns, element + sensitivities);
    const Direction d = {function, element, element + sensitivities, sensitivities, seeds, seed};
    const bool last_good = derive(instance, &d, sensitivity);
    release(instance, element);
    return last_good ? fmi3OK : fmi3Error;
}
