/* fmi2_unused.c - the parts of the FMI 2.0 co-simulation interface that these FMUs answer and do
 * not use.
 *
 * All variables are Real; inputs are held over a step (no input derivatives); a step is complete
 * when fmi2DoStep returns. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "fmi2_layer.h"

static fmi2Status none(fmi2Component c, const char *function, unsigned phases, size_t count,
                       const char *text)
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
    return none(c, "fmi2GetInteger", MAY_GET, count, only_real);
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          fmi2Boolean value[])
{
    (void)vr, (void)value;
    return none(c, "fmi2GetBoolean", MAY_GET, count, only_real);
}
fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                         fmi2String value[])
{
    (void)vr, (void)value;
    return none(c, "fmi2GetString", MAY_GET, count, only_real);
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          const fmi2Integer value[])
{
    (void)vr, (void)value;
    return none(c, "fmi2SetInteger", MAY_SET, count, only_real);
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          const fmi2Boolean value[])
{
    (void)vr, (void)value;
    return none(c, "fmi2SetBoolean", MAY_SET, count, only_real);
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                         const fmi2String value[])
{
    (void)vr, (void)value;
    return none(c, "fmi2SetString", MAY_SET, count, only_real);
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    (void)vr, (void)order, (void)value;
    return none(c, "fmi2SetRealInputDerivatives", MAY_SET, count,
                "inputs are held, derivatives are not used");
}
fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[],
                                        size_t count, const fmi2Integer order[], fmi2Real value[])
{
    (void)vr, (void)order, (void)value;
    return none(c, "fmi2GetRealOutputDerivatives", STEPPING | TERMINATED | FAILED, count,
                "output derivatives are not provided");
}

fmi2Status fmi2CancelStep(fmi2Component c) { return none(c, "fmi2CancelStep", 0, 1, ""); }

/* The status functions exist for slaves that answer fmi2DoStep with fmi2Pending or fmi2Discard. */
static fmi2Status no_status(fmi2Component c, const char *function, const void *value)
{
    const Instance *instance = c;
    char text[120];
    if (!allowed(instance, function, STEPPING | TERMINATED | FAILED)) return fmi2Error;
    if (!value) return failure(instance, function, "missing pointer");
    snprintf(text, sizeof text, "%s: no such status, steps are complete when fmi2DoStep returns",
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
