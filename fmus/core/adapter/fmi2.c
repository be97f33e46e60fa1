/* fmi2.c - functions of FMI 2.0 co-simulation for a model with an interface table: life cycle,
 * values, step.
 *
 * Every function checks first whether the state of the instance permits the call (FMI 2.0, section
 * 4.2.4). A rejected call returns fmi2Error with a message; the instance does not change and stays
 * usable. Only a failed step leads to the error state. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "fmi2_layer.h"
#include "life.h"
#include "values.h"

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

/* ---- life cycle ---- */
/* The logger reads its last argument as a printf format, so percent signs are replaced by
 * blanks. */
static void call_fmi2_logger(const Instance *instance, Status status, const char *category,
                             char *line)
{
    for (char *c = line; *c; c++)
        if (*c == '%') *c = ' ';
    ((fmi2CallbackLogger)instance->call.logger)(instance->call.environment,
                                                instance->name ? instance->name : "",
                                                (fmi2Status)status, category, line);
}

static Callbacks callbacks_of(const fmi2CallbackFunctions *functions)
{
    return (Callbacks){call_fmi2_logger, (void (*)(void))functions->logger,
                       functions->componentEnvironment, functions->allocateMemory,
                       functions->freeMemory};
}

static bool can_instantiate(const Instance *caller, fmi2Type type, fmi2String guid)
{
    if (type != fmi2CoSimulation)
        return reject_call(caller, "fmi2Instantiate", "this FMU supports co-simulation only");
    return has_name_and_guid(caller, "fmi2Instantiate", "guid", guid);
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
    } text = {name}; /* not const, but never written: new_instance() copies the name */
    caller.name = text.own;
    if (!can_instantiate(&caller, type, guid)) return NULL;
    Instance *instance = new_instance(&caller);
    if (!instance) reject_call(&caller, "fmi2Instantiate", "out of memory");
    else log_message(instance, STATUS_OK, LOG_EVENTS, "instantiated");
    return instance;
}

void fmi2FreeInstance(fmi2Component c) { free_instance(c); }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t count,
                               const fmi2String categories[])
{
    Instance *instance = c;
    if (!allowed(instance, "fmi2SetDebugLogging", ANY_PHASE)) return fmi2Error;
    if (choose_categories(instance, on, count, categories)) return fmi2OK;
    return failure(instance, "fmi2SetDebugLogging", "unknown log category");
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
    reset_model(instance);
    return fmi2OK;
}

/* ---- values ---- */
static const Access access = {"fmi2SetReal", "fmi2GetReal", false};

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                       const fmi2Real value[])
{
    return set_values(c, &access, vr, count, value, count) ? fmi2OK : fmi2Error;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                       fmi2Real value[])
{
    return get_values(c, &access, vr, count, value, count) ? fmi2OK : fmi2Error;
}

/* ---- step ---- */
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_set_state_prior)
{
    Instance *instance = c;
    (void)no_set_state_prior;
    if (!allowed(instance, "fmi2DoStep", STEPPING)) return fmi2Error;
    return advance(instance, "fmi2DoStep", t, h) ? fmi2OK : fmi2Error;
}
