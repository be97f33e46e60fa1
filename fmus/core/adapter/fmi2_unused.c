/* fmi2_unused.c - functions of FMI 2.0 that these FMUs do not support, and the status functions.
 *
 * The reasons: all variables are Real; inputs are held over a step (no input derivatives); a step
 * is complete when fmi2DoStep returns; there is no model exchange. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "fmi2_layer.h"

static fmi2Status reject_unless_empty(fmi2Component c, const char *function, unsigned phases,
                                      size_t count, const char *text)
{
    if (!allowed(c, function, phases)) return fmi2Error;
    return count == 0 ? fmi2OK : failure(c, function, text);
}

enum {
    MAY_SET = INSTANTIATED | INITIALIZING | STEPPING,
    MAY_GET = INITIALIZING | STEPPING | TERMINATED | FAILED
};
static const char *const only_real = "this FMU has Real variables only";

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          fmi2Integer value[])
{
    (void)vr, (void)value;
    return reject_unless_empty(c, "fmi2GetInteger", MAY_GET, count, only_real);
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          fmi2Boolean value[])
{
    (void)vr, (void)value;
    return reject_unless_empty(c, "fmi2GetBoolean", MAY_GET, count, only_real);
}
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                         fmi2String value[])
{
    (void)vr, (void)value;
    return reject_unless_empty(c, "fmi2GetString", MAY_GET, count, only_real);
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          const fmi2Integer value[])
{
    (void)vr, (void)value;
    return reject_unless_empty(c, "fmi2SetInteger", MAY_SET, count, only_real);
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          const fmi2Boolean value[])
{
    (void)vr, (void)value;
    return reject_unless_empty(c, "fmi2SetBoolean", MAY_SET, count, only_real);
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                         const fmi2String value[])
{
    (void)vr, (void)value;
    return reject_unless_empty(c, "fmi2SetString", MAY_SET, count, only_real);
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr, (void)order, (void)value;
    return reject_unless_empty(
        c, "fmi2SetRealInputDerivatives", MAY_SET, count,
        "inputs are constant over a step; input derivatives are not supported");
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[],
                                        size_t count, const fmi2Integer order[], fmi2Real value[])
{
    (void)vr, (void)order, (void)value;
    return reject_unless_empty(c, "fmi2GetRealOutputDerivatives", STEPPING | TERMINATED | FAILED,
                               count, "output derivatives are not provided");
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    return reject_unless_empty(c, "fmi2CancelStep", 0, 1, "");
}

/* The status functions are meant for slaves whose fmi2DoStep returns fmi2Pending or fmi2Discard.
 * Here only fmi2LastSuccessfulTime and fmi2Terminated have a value. */
static fmi2Status no_status(fmi2Component c, const char *function, const void *value)
{
    const Instance *instance = c;
    char text[120];
    if (!allowed(instance, function, STEPPING | TERMINATED | FAILED)) return fmi2Error;
    if (!value) return failure(instance, function, "a pointer argument is NULL");
    snprintf(text, sizeof text,
             "%s: this status does not exist, because a step is complete when fmi2DoStep returns",
             function);
    log_message(instance, STATUS_DISCARD, LOG_WARNINGS, text);
    return fmi2Discard;
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)kind;
    return no_status(c, "fmi2GetStatus", value);
}
fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    (void)kind;
    return no_status(c, "fmi2GetIntegerStatus", value);
}
fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    (void)kind;
    return no_status(c, "fmi2GetStringStatus", value);
}
fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    const Instance *instance = c;
    if (kind != fmi2LastSuccessfulTime || !value) return no_status(c, "fmi2GetRealStatus", value);
    if (!allowed(instance, "fmi2GetRealStatus", STEPPING | TERMINATED | FAILED)) return fmi2Error;
    *value = instance->now.time;
    return fmi2OK;
}
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    if (kind != fmi2Terminated || !value) return no_status(c, "fmi2GetBooleanStatus", value);
    if (!allowed(c, "fmi2GetBooleanStatus", STEPPING | TERMINATED | FAILED)) return fmi2Error;
    *value = fmi2False;
    return fmi2OK;
}

/* ---- model exchange ----
 * Some tools load only a library that has all functions of FMI 2.0, even those they never call. */
static fmi2Status reject_exchange(fmi2Component c, const char *function)
{
    return reject_unless_empty(c, function, ANY_PHASE, 1, "this FMU supports co-simulation only");
}

fmi2Status fmi2EnterEventMode(fmi2Component c) { return reject_exchange(c, "fmi2EnterEventMode"); }
fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info)
{
    (void)info;
    return reject_exchange(c, "fmi2NewDiscreteStates");
}
fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c)
{
    return reject_exchange(c, "fmi2EnterContinuousTimeMode");
}
fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean no_set_state_prior,
                                       fmi2Boolean *enter_event_mode, fmi2Boolean *terminate)
{
    (void)no_set_state_prior, (void)enter_event_mode, (void)terminate;
    return reject_exchange(c, "fmi2CompletedIntegratorStep");
}
fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time)
{
    (void)time;
    return reject_exchange(c, "fmi2SetTime");
}
fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real state[], size_t count)
{
    (void)state, (void)count;
    return reject_exchange(c, "fmi2SetContinuousStates");
}
fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real derivative[], size_t count)
{
    (void)derivative, (void)count;
    return reject_exchange(c, "fmi2GetDerivatives");
}
fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real indicator[], size_t count)
{
    (void)indicator, (void)count;
    return reject_exchange(c, "fmi2GetEventIndicators");
}
fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real state[], size_t count)
{
    (void)state, (void)count;
    return reject_exchange(c, "fmi2GetContinuousStates");
}
fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominal[], size_t count)
{
    (void)nominal, (void)count;
    return reject_exchange(c, "fmi2GetNominalsOfContinuousStates");
}
