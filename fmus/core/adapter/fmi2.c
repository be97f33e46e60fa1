/* fmi2.c - the FMI 2.0 co-simulation interface over a model table: life cycle, values, step.
 *
 * Every function checks the call state first (FMI 2.0, section 4.2.4) and answers a refused call
 * with fmi2Error and a message; the instance stays as it was and usable. Only a step that fails
 * ends in the error state. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "finite.h"
#include "instance.h"
#include "time_grid.h"

enum {
    LONGEST_STEP = 100000
}; /* s; a longer communication step is taken for a mistake of the master */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

/* ---- life cycle ---- */
static bool can_instantiate(const Instance *caller, fmi2Type type, fmi2String guid)
{
    char buffer[GUID_SIZE], text[200];
    const char *expected = guid_of(&fmu_model, buffer);
    if (!caller->name || !*caller->name)
        return failure(caller, "fmi2Instantiate", "the instance name is empty"), false;
    if (type != fmi2CoSimulation)
        return failure(caller, "fmi2Instantiate", "this FMU is for co-simulation only"), false;
    if (guid && strcmp(guid, expected) == 0) return true;
    snprintf(text, sizeof text, "wrong guid '%.60s', expected '%s'", guid ? guid : "", expected);
    return failure(caller, "fmi2Instantiate", text), false;
}

static void make_new(Instance *instance)
{
    memcpy(instance->model, fmu_model.start, fmu_model.size);
    instance->now = (Progress){.phase = INSTANTIATED, .stale = fmi2True, .stop = INFINITY};
}

static Instance *new_instance(const Instance *caller)
{
    size_t name_size = strlen(caller->name) + 1;
    Instance *instance = allocate(caller, sizeof *instance);
    if (!instance) return NULL;
    *instance = *caller;
    instance->name = allocate(caller, name_size);
    instance->model = allocate(caller, memory_of(&fmu_model));
    instance->good = allocate(caller, tail_size());
    instance->guarded = allocate(caller, fmu_model.variable_count * sizeof *instance->guarded);
    if (!instance->name || !instance->model || !instance->good || !instance->guarded) {
        fmi2FreeInstance(instance);
        return NULL;
    }
    list_guarded(instance);
    memcpy(instance->name, caller->name, name_size);
    make_new(instance);
    return instance;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible,
                              fmi2Boolean logging)
{
    Instance caller = {.categories = logging ? LOG_ERRORS | LOG_WARNINGS | LOG_EVENTS : 0};
    (void)resources, (void)visible;
    if (functions) caller.call = *functions;
    union {
        fmi2String read;
        char *own;
    } text = {name}; /* the copy in new_instance is the one that stays */
    caller.name = text.own;
    if (!can_instantiate(&caller, type, guid)) return NULL;
    Instance *instance = new_instance(&caller);
    if (!instance) failure(&caller, "fmi2Instantiate", "out of memory");
    else log_message(instance, fmi2OK, LOG_EVENTS, "instantiated");
    return instance;
}

void fmi2FreeInstance(fmi2Component c)
{
    Instance *instance = c;
    if (!instance) return;
    release(instance, instance->name);
    release(instance, instance->model);
    release(instance, instance->good);
    release(instance, instance->guarded);
    release(instance, instance);
}

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
    if (!isfinite(start))
        return failure(instance, "fmi2SetupExperiment", "the start time must be finite");
    if (stop_defined && !(stop > start))
        return failure(instance, "fmi2SetupExperiment",
                       "the stop time must be after the start time");
    instance->now.start = instance->now.time = start;
    instance->now.stop = stop_defined ? stop : INFINITY;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi2EnterInitializationMode", INSTANTIATED)) return fmi2Error;
    instance->now.phase = INITIALIZING;
    return fmi2OK;
}

/* outputs for the values set so far; evaluated when they are read, so that masters can propagate
 * start values */
static bool refresh(Instance *instance, const char *function)
{
    if (!instance->now.stale) return true;
    keep_good(instance);
    if (!initialize_checked(instance, function, instance->model)) return put_back(instance), false;
    instance->now.stale = fmi2False;
    return true;
}

/* the shortest internal step or sample period; 0: there is none */
static double finest_grid(const void *model)
{
    double finest = INFINITY;
    for (size_t i = 0; i < fmu_model.variable_count; i++) {
        const Variable *v = &fmu_model.variables[i];
        double value = value_of(model, (Scalar){v, 0});
        if (v->kind == GRID_ROW && value > 0) finest = smaller(finest, value);
    }
    return isfinite(finest) ? finest : 0;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    Instance *instance = c;
    if (!allowed(instance, "fmi2ExitInitializationMode", INITIALIZING)) return fmi2Error;
    if (!refresh(instance, "fmi2ExitInitializationMode")) return fmi2Error;
    instance->now.grid = finest_grid(instance->model);
    instance->now.phase = STEPPING;
    memcpy(instance->good, tail_const(fmu_model.start), tail_size()); /* no alarm stood before */
    report_alarms(instance, instance->now.start);
    log_message(instance, fmi2OK, LOG_EVENTS, "initialized");
    return fmi2OK;
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
    else instance->now.stale = fmi2True;
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
static bool too_late(const Progress *now, double t)
{
    return now->grid > 0 && fabs(t) / now->grid > most_grid_steps;
}

static const char *why_no_step(const Progress *now, double t, double h)
{
    if (!isfinite(t) || !isfinite(h)) return "time and step size must be finite";
    if (h <= 0) return "the step size must be > 0";
    if (h > LONGEST_STEP) return "the step size must be <= 100000 s";
    if (too_many_substeps(now, h))
        return "the step would take more than 1e7 internal steps (max_step, sample_period, T0)";
    if (t + h == t) return "the step is lost in the rounding of the time";
    if (too_late(now, t + h))
        return "the time is beyond 2^53 internal steps or samples (max_step, sample_period, T0), "
               "which cannot be counted";
    if (fabs(t - now->time) > time_tolerance(now->time, 1e-2 * h))
        return "the communication point is not the end of the last step";
    if (t + h > now->stop + time_tolerance(now->stop, 1e-2 * h))
        return "the step goes beyond the stop time";
    return NULL;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real t, fmi2Real h, fmi2Boolean no_set_state_prior)
{
    Instance *instance = c;
    char text[240];
    (void)no_set_state_prior;
    if (!allowed(instance, "fmi2DoStep", STEPPING)) return fmi2Error;
    const char *rule = why_no_step(&instance->now, t, h);
    if (rule) {
        snprintf(text, sizeof text, "t = %.17g s, step = %.17g s, expected t = %.17g s: %s",
                 readable(t), readable(h), readable(instance->now.time), rule);
        return failure(instance, "fmi2DoStep", text);
    }
    keep_good(instance);
    if (!step_checked(instance, "fmi2DoStep", instance->model, instance->now.time, h)) {
        put_back(instance);
        instance->now.phase = FAILED;
        return fmi2Error;
    }
    report_alarms(instance, instance->now.time + h);
    instance->now.time = t + h;
    instance->now.step = h;
    return fmi2OK;
}
