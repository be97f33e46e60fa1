/* fmi2_state.c - functions of FMI 2.0 for FMU states and directional derivatives. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "fmi2_layer.h"
#include "state.h"

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi2GetFMUstate", ANY_PHASE)) return fmi2Error;
    if (!state) return failure(instance, "fmi2GetFMUstate", "a pointer argument is NULL");
    return take_snapshot(instance, state) ? fmi2OK
                                          : failure(instance, "fmi2GetFMUstate", "out of memory");
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi2SetFMUstate", ANY_PHASE)) return fmi2Error;
    if (!state) return failure(instance, "fmi2SetFMUstate", "the state is NULL");
    restore_snapshot(instance, state);
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi2FreeFMUstate", ANY_PHASE)) return fmi2Error;
    if (!state || !*state) return fmi2OK;
    release(instance, *state);
    *state = NULL;
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi2SerializedFMUstateSize", ANY_PHASE)) return fmi2Error;
    if (!state || !size)
        return failure(instance, "fmi2SerializedFMUstateSize",
                       "the state or a pointer argument is NULL");
    *size = snapshot_size();
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi2SerializeFMUstate", ANY_PHASE)) return fmi2Error;
    if (!state || !bytes)
        return failure(instance, "fmi2SerializeFMUstate", "the state or an array argument is NULL");
    if (size < snapshot_size())
        return failure(instance, "fmi2SerializeFMUstate",
                       "the array is smaller than the size from fmi2SerializedFMUstateSize");
    write_snapshot(state, bytes);
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *state)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi2DeSerializeFMUstate", ANY_PHASE)) return fmi2Error;
    if (!bytes || !state)
        return failure(instance, "fmi2DeSerializeFMUstate", "an array or pointer argument is NULL");
    const char *rule = read_snapshot(instance, bytes, size, state);
    return rule ? failure(instance, "fmi2DeSerializeFMUstate", rule) : fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[],
                                        size_t unknowns, const fmi2ValueReference known[],
                                        size_t knowns, const fmi2Real seed[],
                                        fmi2Real sensitivity[])
{
    Instance *instance = c;
    const Direction d = {"fmi2GetDirectionalDerivative", unknown, known, unknowns, knowns, seed};
    if (!allowed(instance, d.function, INITIALIZING | STEPPING | TERMINATED | FAILED))
        return fmi2Error;
    return derive(instance, &d, sensitivity) ? fmi2OK : fmi2Error;
}
