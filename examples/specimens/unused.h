/* unused.h - functions of FMI 3.0 that a specimen does not have. Tools that bind every function of
 * the standard when they load a library find them; each returns fmi3Error or, to instantiate,
 * NULL. */
/* SPDX-License-Identifier: BSD-2-Clause */
#define NONE(function, ...)                          \
    fmi3Status function(fmi3Instance c, __VA_ARGS__) \
    {                                                \
        return failure(c, #function, "unsupported"); \
    }
#define NONE_PLAIN(function) \
    fmi3Status function(fmi3Instance c) { return failure(c, #function, "unsupported"); }
#define REFERENCES const fmi3ValueReference r[], size_t n
#define NO_TYPE(Kind)                                             \
    NONE(fmi3Get##Kind, REFERENCES, fmi3##Kind value[], size_t m) \
    NONE(fmi3Set##Kind, REFERENCES, const fmi3##Kind value[], size_t m)

NO_TYPE(Float32)
NO_TYPE(Int8)
NO_TYPE(UInt8)
NO_TYPE(Int16)
NO_TYPE(UInt16)
NO_TYPE(UInt32)
NO_TYPE(Int64)
NO_TYPE(UInt64)
NO_TYPE(Boolean)
NO_TYPE(String)
#ifndef HAS_BINARY
NONE(fmi3GetBinary, REFERENCES, size_t size[], fmi3Binary value[], size_t m)
NONE(fmi3SetBinary, REFERENCES, const size_t size[], const fmi3Binary value[], size_t m)
#endif

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log)
{
    return NULL;
}

fmi3Instance
fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                  fmi3Boolean visible, fmi3Boolean logging,
                                  fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                                  fmi3ClockUpdateCallback tick, fmi3LockPreemptionCallback lock,
                                  fmi3UnlockPreemptionCallback unlock)
{
    return NULL;
}

NONE_PLAIN(fmi3EnterConfigurationMode)
NONE_PLAIN(fmi3ExitConfigurationMode)
NONE_PLAIN(fmi3EvaluateDiscreteStates)
NONE_PLAIN(fmi3EnterContinuousTimeMode)
NONE(fmi3GetNumberOfVariableDependencies, fmi3ValueReference r, size_t *n)
NONE(fmi3GetVariableDependencies, fmi3ValueReference r, size_t a[], fmi3ValueReference of[],
     size_t b[], fmi3DependencyKind kinds[], size_t n)
NONE(fmi3SerializedFMUStateSize, fmi3FMUState state, size_t *size)
NONE(fmi3SerializeFMUState, fmi3FMUState state, fmi3Byte bytes[], size_t size)
NONE(fmi3DeserializeFMUState, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
NONE(fmi3GetDirectionalDerivative, REFERENCES, const fmi3ValueReference known[], size_t m,
     const fmi3Float64 seed[], size_t seeds, fmi3Float64 value[], size_t values)
NONE(fmi3GetAdjointDerivative, REFERENCES, const fmi3ValueReference known[], size_t m,
     const fmi3Float64 seed[], size_t seeds, fmi3Float64 value[], size_t values)
NONE(fmi3GetIntervalDecimal, REFERENCES, fmi3Float64 value[], fmi3IntervalQualifier kind[])
NONE(fmi3GetIntervalFraction, REFERENCES, fmi3UInt64 count[], fmi3UInt64 parts[],
     fmi3IntervalQualifier kind[])
NONE(fmi3GetShiftDecimal, REFERENCES, fmi3Float64 value[])
NONE(fmi3GetShiftFraction, REFERENCES, fmi3UInt64 count[], fmi3UInt64 parts[])
NONE(fmi3SetIntervalDecimal, REFERENCES, const fmi3Float64 value[])
NONE(fmi3SetIntervalFraction, REFERENCES, const fmi3UInt64 count[], const fmi3UInt64 parts[])
NONE(fmi3SetShiftDecimal, REFERENCES, const fmi3Float64 value[])
NONE(fmi3SetShiftFraction, REFERENCES, const fmi3UInt64 count[], const fmi3UInt64 parts[])
NONE(fmi3CompletedIntegratorStep, fmi3Boolean last, fmi3Boolean *event, fmi3Boolean *end)
NONE(fmi3SetTime, fmi3Float64 time)
NONE(fmi3SetContinuousStates, const fmi3Float64 value[], size_t n)
NONE(fmi3GetContinuousStateDerivatives, fmi3Float64 value[], size_t n)
NONE(fmi3GetEventIndicators, fmi3Float64 value[], size_t n)
NONE(fmi3GetContinuousStates, fmi3Float64 value[], size_t n)
NONE(fmi3GetNominalsOfContinuousStates, fmi3Float64 value[], size_t n)
NONE(fmi3GetNumberOfEventIndicators, size_t *n)
NONE(fmi3GetNumberOfContinuousStates, size_t *n)
NONE(fmi3GetOutputDerivatives, REFERENCES, const fmi3Int32 order[], fmi3Float64 value[], size_t m)
NONE(fmi3ActivateModelPartition, fmi3ValueReference clock, fmi3Float64 time)
