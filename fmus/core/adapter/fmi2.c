/* fmi2.c - the FMI 2.0 co-simulation interface over a model table: life cycle, values, step.
 *
 * Every function checks the call state first (FMI 2.0, section 4.2.4) and answers a refused call
 * with fmi2Error and a message; the instance stays as it was and usable. Only a step that fails
 * ends in the error state. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "fmi2_layer.h"
#include "finite.h"
#include "life.h"

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

/* ---- life cycle ---- */
/* The callback reads its last argument as a printf format, so a percent sign must not reach it. */
static void hand_over(const Instance *instance, Status status, const char *category, char *line)
{
    for (char *c = line; *c; c++)
        if (*c == '%') *c = ' ';
    ((fmi2CallbackLogger)instance->call.logger)(instance->call.environment,
                                                instance->name ? instance->name : "",
                                                (fmi2Status)status, category, line);
}

static Callbacks callbacks_of(const fmi2CallbackFunctions *functions)
{
    return (Callbacks){hand_over, (void (*)(void))functions->logger,
                       functions->componentEnvironment, functions->allocateMemory,
                       functions->freeMemory};
}

static bool can_instantiate(const Instance *caller, fmi2Type type, fmi2String guid)
{
    char buffer[GUID_SIZE], text[200];
    const char *expected = guid_of(&fmu_model, buffer);
    if (!caller->name || !*caller->name)
        return refuse_call(caller, "fmi2Instantiate", "the instance name is empty");
    if (type != fmi2CoSimulation)
        return refuse_call(caller, "fmi2Instantiate", "this FMU is for co-simulation only");
    if (guid && strcmp(guid, expected) == 0) return true;
    snprintf(text, sizeof text, "wrong guid '%.60s', expected '%s'", guid ? guid : "", expected);
    return refuse_call(caller, "fmi2Instantiate", text);
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                              fmi2Boolean logging)
{
    Instance caller = {.categories = logging ? LOG_ERRORS | LOG_WARNINGS | LOG_EVENTS : 0};
    (void)resources, (void)visible;
    if (functions) caller.call = callbacks_of(functions);
    union {
        fmi2String read;
        char *own;
    } text = {name}; /* the copy in new_instance is the one that stays */
    caller.name = text.own;
    if (!can_instantiate(&caller, type, guid)) return NULL;
    Instance *instance = new_instance(&caller);
    if (!instance) refuse_call(&caller, "fmi2Instantiate", "out of memory");
    else log_message(instance, STATUS_OK, LOG_EVENTS, "instantiated");
    return instance;
}

void fmi2FreeInstance(fmi2Component c) { free_instance(c); }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count,
                               const fmi2String categories[])
{
    Instance *instance = c;
    unsigned wanted = count ? 0 : LOG_ERRORS | LOG_WARNINGS | LOG_EVENTS;
    if (!allowed(instance, "fmi2SetDebugLogging", ANY_PHASE)) return fmi2Error;
    for (size_t i = 0; i < count; i++) {
        unsigned bit = 0;
        for (unsigned k = 0; k < 3; k++)
            if (categories && categories[i] && strcmp(categories[i], log_categories[k]) == 0)
                bit = 1u << k;
        if (!bit) return failure(instance, "fmi2SetDebugLogging", "unknown log category");
        wanted |= bit;
    }
    instance->categories = on ? wanted : 0; /* only the categories named, or none */
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance,
                               fmi2Real start, fmi2Boolean stop_defined, fmi2Real stop)
{
    Instance *instance = c;
    (void)tolerance_defined, (void)tolerance;
    if (!allowed(instance, "fmi2SetupExperiment", INSTANTIATED)) return fmi2Error;
    const char *rule = why_no_span(start, stop_defined, stop);
    if (rule) return failure(instance, "fmi2SetupExperiment", rule);
    set_span(instance, start, stop_defined, stop);
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi2EnterInitializationMode", INSTANTIATED)) return fmi2Error;
    instance->now.phase = INITIALIZING;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi2ExitInitializationMode", INITIALIZING)) return fmi2Error;
    return leave_initialization(instance, "fmi2ExitInitializationMode") ? fmi2OK : fmi2Error;
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi2Terminate", STEPPING)) return fmi2Error;
    instance->now.phase = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi2Reset", ANY_PHASE)) return fmi2Error;
    make_new(instance);
    return fmi2OK;
}

/* ---- values ---- */
static fmi2Status refuse_value(const Instance *instance, const char *function, unsigned vr,
                               const char *rule)
{
    char name[NAME_SIZE], text[NAME_SIZE + 120];
    Scalar s = scalar_of(&fmu_model, vr);
    if (s.row) snprintf(text, sizeof text, "%s: %s", element_name(name, s), rule);
    else snprintf(text, sizeof text, "there is no variable with value reference %u", vr);
    return failure(instance, function, text);
}

static const char *why_not_settable(const Instance *instance, Scalar s)
{
    if (s.row->causality == OUTPUT_ROW) return "is an output and cannot be set";
    if (s.row->causality == PARAMETER_ROW && instance->now.phase == STEPPING)
        return "is a fixed parameter and cannot be set after initialization";
    return NULL;
}

/* all values are judged before the first is set */
static bool acceptable(const Instance *instance, const fmi2ValueReference vr[], size_t count,
                       const fmi2Real value[])
{
    for (size_t i = 0; i < count; i++) {
        Scalar s = scalar_of(&fmu_model, vr[i]);
        const char *rule = s.row ? why_not_settable(instance, s) : "";
        if (!rule) rule = broken_rule(rule_when_set(s), value[i]);
        if (rule) return refuse_value(instance, "fmi2SetReal", vr[i], rule), false;
    }
    return true;
}

/* while stepping only inputs can be set; a call that has been accepted before and keeps the rules
 * again needs no further look */
static bool set_known(Instance *instance, const fmi2ValueReference vr[], size_t count,
                      const fmi2Real value[])
{
    if (instance->now.phase != STEPPING) return false;
    const KnownCall *call = known_call(&instance->written, vr, count);
    if (!call || !all_finite(value, count) || !keep_rules(call, value)) return false;
    write_runs(call, instance->model, value);
    return true;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                       const fmi2Real value[])
{
    Instance *instance = c;
    if (!allowed(instance, "fmi2SetReal", INSTANTIATED | INITIALIZING | STEPPING)) return fmi2Error;
    if (count && (!vr || !value)) return failure(instance, "fmi2SetReal", "missing array");
    if (set_known(instance, vr, count, value)) return fmi2OK;
    if (!acceptable(instance, vr, count, value)) return fmi2Error;
    for (size_t i = 0; i < count; i++)
        *pointer_to(instance->model, scalar_of(&fmu_model, vr[i])) = value[i];
    if (instance->now.phase == STEPPING) remember_call(&instance->written, &fmu_model, vr, count);
    else instance->now.stale = true;
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                       fmi2Real value[])
{
    Instance *instance = c;
    if (!allowed(instance, "fmi2GetReal", INITIALIZING | STEPPING | TERMINATED | FAILED))
        return fmi2Error;
    if (count && (!vr || !value)) return failure(instance, "fmi2GetReal", "missing array");
    const KnownCall *call =
        instance->now.phase == INITIALIZING ? NULL : known_call(&instance->read, vr, count);
    if (call) return read_runs(call, instance->model, value), fmi2OK;
    for (size_t i = 0; i < count; i++) {
        Scalar s = scalar_of(&fmu_model, vr[i]);
        if (!s.row) return refuse_value(instance, "fmi2GetReal", vr[i], "");
        bool evaluate = s.row->causality == OUTPUT_ROW && instance->now.phase == INITIALIZING;
        if (evaluate && !refresh(instance, "fmi2GetReal")) return fmi2Error;
        value[i] = value_of(instance->model, s);
    }
    remember_call(&instance->read, &fmu_model, vr, count);
    return fmi2OK;
}

/* ---- step ---- */
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_set_state_prior)
{
    Instance *instance = c;
    (void)no_set_state_prior;
    if (!allowed(instance, "fmi2DoStep", STEPPING)) return fmi2Error;
    return advance(instance, "fmi2DoStep", t, h) ? fmi2OK : fmi2Error;
}
