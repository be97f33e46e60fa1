/* fmi3.c - functions of FMI 3.0 co-simulation for a model with an interface table: life cycle,
 * values, step.
 *
 * Every function checks first whether the state of the instance permits the call (FMI 3.0). A
 * rejected call returns fmi3Error with a message; the instance does not change and stays usable.
 * Only a failed step leads to the error state. A row of the table has the value reference that its
 * first element has in FMI 2.0. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "fmi3_layer.h"
#include "life.h"
#include "values.h"

const char *fmi3GetVersion(void) { return fmi3Version; }

/* ---- life cycle ---- */
static const char *why_no_instance(fmi3Boolean event_mode, size_t intermediate)
{
    if (event_mode) return "this FMU has no event mode";
    return intermediate ? "this FMU has no intermediate update" : NULL;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                         fmi3Boolean visible, fmi3Boolean logging,
                                         fmi3Boolean event_mode, fmi3Boolean early_return_allowed,
                                         const fmi3ValueReference intermediate[],
                                         size_t intermediates, fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback logger,
                                         fmi3IntermediateUpdateCallback update)
{
    static const char function[] = "fmi3InstantiateCoSimulation";
    Instance caller = {.categories = logging ? LOG_ERRORS | LOG_WARNINGS | LOG_EVENTS : 0};
    (void)resources, (void)visible, (void)early_return_allowed, (void)intermediate, (void)update;
    caller.call = (Callbacks){call_fmi3_logger, (void (*)(void))logger, environment, NULL, NULL};
    union {
        fmi3String read;
        char *own;
    } text = {name}; /* casts const away; new_instance() only copies the name */
    caller.name = text.own;
    if (!has_name_and_guid(&caller, function, "instantiation token", token)) return NULL;
    const char *rule = why_no_instance(event_mode, intermediates);
    if (rule) return reject_call(&caller, function, rule), NULL;
    Instance *instance = new_instance(&caller);
    if (!instance) reject_call(&caller, function, "out of memory");
    else log_message(instance, STATUS_OK, LOG_EVENTS, "instantiated");
    return instance;
}

void fmi3FreeInstance(fmi3Instance c) { free_instance(c); }

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t count,
                               const fmi3String categories[])
{
    Instance *instance = c;
    if (!allowed(instance, "fmi3SetDebugLogging", ANY_PHASE)) return fmi3Error;
    if (choose_categories(instance, on, count, categories)) return fmi3OK;
    return failure(instance, "fmi3SetDebugLogging", "unknown log category");
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerance_defined,
                                       fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean stop_defined, fmi3Float64 stop)
{
    Instance *instance = c;
    (void)tolerance_defined, (void)tolerance;
    if (!allowed(instance, "fmi3EnterInitializationMode", INSTANTIATED)) return fmi3Error;
    const char *rule = why_no_span(start, stop_defined, stop);
    if (rule) return failure(instance, "fmi3EnterInitializationMode", rule);
    set_span(instance, start, stop_defined, stop);
    instance->now.phase = INITIALIZING;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi3ExitInitializationMode", INITIALIZING)) return fmi3Error;
    return leave_initialization(instance, "fmi3ExitInitializationMode") ? fmi3OK : fmi3Error;
}

fmi3Status fmi3Terminate(fmi3Instance c)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi3Terminate", STEPPING)) return fmi3Error;
    instance->now.phase = TERMINATED;
    return fmi3OK;
}

fmi3Status fmi3Reset(fmi3Instance c)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi3Reset", ANY_PHASE)) return fmi3Error;
    reset_model(instance);
    return fmi3OK;
}

/* ---- values ---- */
static const Access access = {"fmi3SetFloat64", "fmi3GetFloat64", true};

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                          const fmi3Float64 value[], size_t values)
{
    return set_values(c, &access, vr, count, value, values) ? fmi3OK : fmi3Error;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t count,
                          fmi3Float64 value[], size_t values)
{
    return get_values(c, &access, vr, count, value, values) ? fmi3OK : fmi3Error;
}

/* ---- step ---- */
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 t, fmi3Float64 h, fmi3Boolean no_set_state_prior,
                      fmi3Boolean *event_needed, fmi3Boolean *terminate, fmi3Boolean *early_return,
                      fmi3Float64 *last_time)
{
    Instance *instance = c;
    (void)no_set_state_prior;
    if (!allowed(instance, "fmi3DoStep", STEPPING)) return fmi3Error;
    if (!event_needed || !terminate || !early_return || !last_time)
        return failure(instance, "fmi3DoStep", "a pointer argument is NULL");
    const bool last_good = advance(instance, "fmi3DoStep", t, h);
    *event_needed = *terminate = *early_return = fmi3False;
    *last_time = instance->now.time;
    return last_good ? fmi3OK : fmi3Error;
}
