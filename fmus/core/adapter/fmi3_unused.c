/* fmi3_unused.c - functions of the FMI 3.0 interface that these FMUs do not support.
 *
 * The functions are not needed: all variables are Float64; there are no clocks, no events, no
 * structural parameters; inputs are held over a step, and a step is complete when fmi3DoStep
 * returns. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "fmi3_layer.h"

static fmi3Status reject_unless_empty(fmi3Instance c, const char *function, unsigned phases,
                                      size_t count, const char *text)
{
    if (!allowed(c, function, phases)) return fmi3Error;
    return count == 0 ? fmi3OK : failure(c, function, text);
}

enum {
    MAY_SET = INSTANTIATED | INITIALIZING | STEPPING,
    MAY_GET = INITIALIZING | STEPPING | TERMINATED | FAILED
};
static const char *const only_float64 = "this FMU has Float64 variables only";

/* ---- variables of types other than Float64 ---- */
#define OTHER_TYPE(Type)                                                                  \
    fmi3Status fmi3Get##Type(fmi3Instance c, const fmi3ValueReference vr[], size_t count, \
                             fmi3##Type value[], size_t values)                           \
    {                                                                                     \
        (void)vr, (void)value, (void)values;                                              \
        return reject_unless_empty(c, "fmi3Get" #Type, MAY_GET, count, only_float64);     \
    }                                                                                     \
    fmi3Status fmi3Set##Type(fmi3Instance c, const fmi3ValueReference vr[], size_t count, \
                             const fmi3##Type value[], size_t values)                     \
    {                                                                                     \
        (void)vr, (void)value, (void)values;                                              \
        return reject_unless_empty(c, "fmi3Set" #Type, MAY_SET, count, only_float64);     \
    }

OTHER_TYPE(Float32)
OTHER_TYPE(Int8)
OTHER_TYPE(UInt8)
OTHER_TYPE(Int16)
OTHER_TYPE(UInt16)
OTHER_TYPE(Int32)
OTHER_TYPE(UInt32)
OTHER_TYPE(Int64)
OTHER_TYPE(UInt64)
OTHER_TYPE(Boolean)
OTHER_TYPE(String)

fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t count, size_t size[],
                         fmi3Binary value[], size_t values)
{
    (void)vr, (void)size, (void)value, (void)values;
    return reject_unless_empty(c, "fmi3GetBinary", MAY_GET, count, only_float64);
}
fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                         const size_t size[], const fmi3Binary value[], size_t values)
{
    (void)vr, (void)size, (void)value, (void)values;
    return reject_unless_empty(c, "fmi3SetBinary", MAY_SET, count, only_float64);
}

/* ---- clocks ---- */
static const char *const no_clocks = "this FMU has no clocks";

fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                        fmi3Clock value[])
{
    (void)vr, (void)value;
    return reject_unless_empty(c, "fmi3GetClock", ANY_PHASE, count, no_clocks);
}
fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                        const fmi3Clock value[])
{
    (void)vr, (void)value;
    return reject_unless_empty(c, "fmi3SetClock", MAY_SET, count, no_clocks);
}
fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                                  fmi3Float64 interval[], fmi3IntervalQualifier qualifier[])
{
    (void)vr, (void)interval, (void)qualifier;
    return reject_unless_empty(c, "fmi3GetIntervalDecimal", ANY_PHASE, count, no_clocks);
}
fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                                   fmi3UInt64 counter[], fmi3UInt64 resolution[],
                                   fmi3IntervalQualifier qualifier[])
{
    (void)vr, (void)counter, (void)resolution, (void)qualifier;
    return reject_unless_empty(c, "fmi3GetIntervalFraction", ANY_PHASE, count, no_clocks);
}
fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                               fmi3Float64 shift[])
{
    (void)vr, (void)shift;
    return reject_unless_empty(c, "fmi3GetShiftDecimal", ANY_PHASE, count, no_clocks);
}
fmi3Status fmi3GetShiftFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                                fmi3UInt64 counter[], fmi3UInt64 resolution[])
{
    (void)vr, (void)counter, (void)resolution;
    return reject_unless_empty(c, "fmi3GetShiftFraction", ANY_PHASE, count, no_clocks);
}
fmi3Status fmi3SetIntervalDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                                  const fmi3Float64 interval[])
{
    (void)vr, (void)interval;
    return reject_unless_empty(c, "fmi3SetIntervalDecimal", MAY_SET, count, no_clocks);
}
fmi3Status fmi3SetIntervalFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                                   const fmi3UInt64 counter[], const fmi3UInt64 resolution[])
{
    (void)vr, (void)counter, (void)resolution;
    return reject_unless_empty(c, "fmi3SetIntervalFraction", MAY_SET, count, no_clocks);
}
fmi3Status fmi3SetShiftDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                               const fmi3Float64 shift[])
{
    (void)vr, (void)shift;
    return reject_unless_empty(c, "fmi3SetShiftDecimal", MAY_SET, count, no_clocks);
}
fmi3Status fmi3SetShiftFraction(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                                const fmi3UInt64 counter[], const fmi3UInt64 resolution[])
{
    (void)vr, (void)counter, (void)resolution;
    return reject_unless_empty(c, "fmi3SetShiftFraction", MAY_SET, count, no_clocks);
}
fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time)
{
    (void)clock, (void)time;
    return reject_unless_empty(c, "fmi3ActivateModelPartition", ANY_PHASE, 1, no_clocks);
}

/* ---- event mode and configuration mode ---- */
static const char *const no_mode = "this FMU has no event mode and no configuration mode";

fmi3Status fmi3EnterConfigurationMode(fmi3Instance c)
{
    return reject_unless_empty(c, "fmi3EnterConfigurationMode", ANY_PHASE, 1, no_mode);
}
fmi3Status fmi3ExitConfigurationMode(fmi3Instance c)
{
    return reject_unless_empty(c, "fmi3ExitConfigurationMode", ANY_PHASE, 1, no_mode);
}
fmi3Status fmi3EnterEventMode(fmi3Instance c)
{
    return reject_unless_empty(c, "fmi3EnterEventMode", ANY_PHASE, 1, no_mode);
}
fmi3Status fmi3EnterStepMode(fmi3Instance c)
{
    return reject_unless_empty(c, "fmi3EnterStepMode", ANY_PHASE, 1, no_mode);
}
fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c)
{
    return reject_unless_empty(c, "fmi3EvaluateDiscreteStates", ANY_PHASE, 1, no_mode);
}
fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *need_update,
                                    fmi3Boolean *terminate, fmi3Boolean *nominals_changed,
                                    fmi3Boolean *values_changed, fmi3Boolean *next_defined,
                                    fmi3Float64 *next)
{
    (void)need_update, (void)terminate, (void)nominals_changed, (void)values_changed,
        (void)next_defined, (void)next;
    return reject_unless_empty(c, "fmi3UpdateDiscreteStates", ANY_PHASE, 1, no_mode);
}

static fmi3Instance reject_instance(const char *function, fmi3InstanceEnvironment environment,
                                    fmi3LogMessageCallback logger)
{
    Instance caller = {.call = {call_fmi3_logger, (void (*)(void))logger, environment, NULL, NULL}};
    reject_call(&caller, function, "this FMU supports co-simulation only");
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback logger)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging;
    return reject_instance("fmi3InstantiateModelExchange", environment, logger);
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging, fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
    fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
    fmi3UnlockPreemptionCallback unlock)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)update,
        (void)lock, (void)unlock;
    return reject_instance("fmi3InstantiateScheduledExecution", environment, logger);
}

/* ---- model exchange ---- */
static const char *const no_exchange = "this FMU supports co-simulation only";

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c)
{
    return reject_unless_empty(c, "fmi3EnterContinuousTimeMode", ANY_PHASE, 1, no_exchange);
}
fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean no_set_state_prior,
                                       fmi3Boolean *enter_event_mode, fmi3Boolean *terminate)
{
    (void)no_set_state_prior, (void)enter_event_mode, (void)terminate;
    return reject_unless_empty(c, "fmi3CompletedIntegratorStep", ANY_PHASE, 1, no_exchange);
}
fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time)
{
    (void)time;
    return reject_unless_empty(c, "fmi3SetTime", ANY_PHASE, 1, no_exchange);
}
fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 state[], size_t count)
{
    (void)state, (void)count;
    return reject_unless_empty(c, "fmi3SetContinuousStates", ANY_PHASE, 1, no_exchange);
}
fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 derivative[], size_t count)
{
    (void)derivative, (void)count;
    return reject_unless_empty(c, "fmi3GetContinuousStateDerivatives", ANY_PHASE, 1, no_exchange);
}
fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 indicator[], size_t count)
{
    (void)indicator, (void)count;
    return reject_unless_empty(c, "fmi3GetEventIndicators", ANY_PHASE, 1, no_exchange);
}
fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 state[], size_t count)
{
    (void)state, (void)count;
    return reject_unless_empty(c, "fmi3GetContinuousStates", ANY_PHASE, 1, no_exchange);
}
fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 nominal[], size_t count)
{
    (void)nominal, (void)count;
    return reject_unless_empty(c, "fmi3GetNominalsOfContinuousStates", ANY_PHASE, 1, no_exchange);
}
fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *count)
{
    (void)count;
    return reject_unless_empty(c, "fmi3GetNumberOfEventIndicators", ANY_PHASE, 1, no_exchange);
}
fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *count)
{
    (void)count;
    return reject_unless_empty(c, "fmi3GetNumberOfContinuousStates", ANY_PHASE, 1, no_exchange);
}

/* ---- derivatives and dependencies that are not provided ---- */
fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                                    const fmi3Int32 order[], fmi3Float64 value[], size_t values)
{
    (void)vr, (void)order, (void)value, (void)values;
    return reject_unless_empty(c, "fmi3GetOutputDerivatives", STEPPING | TERMINATED | FAILED, count,
                               "output derivatives are not provided");
}
fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknown[],
                                    size_t unknowns, const fmi3ValueReference known[],
                                    size_t knowns, const fmi3Float64 seed[], size_t seeds,
                                    fmi3Float64 sensitivity[], size_t sensitivities)
{
    (void)unknown, (void)unknowns, (void)known, (void)knowns, (void)seed, (void)seeds,
        (void)sensitivity, (void)sensitivities;
    return reject_unless_empty(c, "fmi3GetAdjointDerivative", ANY_PHASE, 1,
                               "adjoint derivatives are not provided");
}
fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference vr, size_t *count)
{
    (void)vr, (void)count;
    return reject_unless_empty(c, "fmi3GetNumberOfVariableDependencies", ANY_PHASE, 1,
                               "dependencies of single elements are not provided");
}
fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference dependent,
                                       size_t dependent_element[], fmi3ValueReference independent[],
                                       size_t independent_element[], fmi3DependencyKind kind[],
                                       size_t count)
{
    (void)dependent, (void)dependent_element, (void)independent, (void)independent_element,
        (void)kind, (void)count;
    return reject_unless_empty(c, "fmi3GetVariableDependencies", ANY_PHASE, 1,
                               "dependencies of single elements are not provided");
}
