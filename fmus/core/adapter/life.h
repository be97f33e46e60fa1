/* life.h - life cycle of an instance for all versions of FMI: creation, initialization, steps,
 * release. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef LIFE_H
#define LIFE_H

#include "finite.h"
#include "instance.h"
#include "time_grid.h"

/* longest communication step [s]; a longer step is considered a mistake of the master */
enum { LONGEST_STEP = 100000 };

static inline void reset_model(Instance *instance)
{
    memcpy(instance->model, fmu_model.start, fmu_model.size);
    instance->now = (Progress){.phase = INSTANTIATED, .stale = true, .stop = INFINITY};
}

static inline void free_instance(Instance *instance)
{
    if (!instance) return;
    release(instance, instance->name);
    release(instance, instance->model);
    release(instance, instance->last_good);
    release(instance, instance->ruled);
    release(instance, instance);
}

/* true if the caller gives a name and the guid of this FMU, else false after a message; what:
 * name of the guid in this version of FMI */
static inline bool has_name_and_guid(const Instance *caller, const char *function, const char *what,
                                     const char *guid)
{
    char buffer[GUID_SIZE], text[200];
    const char *expected = guid_of(&fmu_model, buffer);
    if (!caller->name || !*caller->name)
        return reject_call(caller, function, "the instance name is empty");
    if (guid && strcmp(guid, expected) == 0) return true;
    snprintf(text, sizeof text, "wrong %s '%.60s', expected '%s'", what, guid ? guid : "",
             expected);
    return reject_call(caller, function, text);
}

/* returns a new instance with name, callbacks and log categories of the caller; NULL: out of
 * memory */
static inline Instance *new_instance(const Instance *caller)
{
    size_t name_size = strlen(caller->name) + 1;
    size_t rows = fmu_model.variable_count + fmu_model.checked_count;
    Instance *instance = allocate(caller, sizeof *instance);
    if (!instance) return NULL;
    *instance = *caller;
    instance->name = allocate(caller, name_size);
    instance->model = allocate(caller, memory_of(&fmu_model));
    instance->last_good = allocate(caller, tail_size());
    instance->ruled = allocate(caller, rows * sizeof *instance->ruled);
    if (!instance->name || !instance->model || !instance->last_good || !instance->ruled) {
        free_instance(instance);
        return NULL;
    }
    list_ruled_outputs(instance);
    memcpy(instance->name, caller->name, name_size);
    reset_model(instance);
    return instance;
}

static inline unsigned category_of(const char *name) /* 0: unknown */
{
    for (unsigned k = 0; k < COUNT(log_categories); k++)
        if (name && strcmp(name, log_categories[k]) == 0) return 1u << k;
    return 0;
}

/* on: logs the given categories, or all if none is given; not on: logs no category. Errors are
 * logged in every case. False: a category is unknown */
static inline bool choose_categories(Instance *instance, bool on, size_t count,
                                     const char *const categories[])
{
    unsigned mask = count ? 0 : LOG_ERRORS | LOG_WARNINGS | LOG_EVENTS;
    for (size_t i = 0; i < count; i++) {
        unsigned bit = category_of(categories ? categories[i] : NULL);
        if (!bit) return false;
        mask |= bit;
    }
    instance->categories = on ? mask : 0;
    return true;
}

static inline const char *why_no_span(double start, bool stop_defined, double stop)
{
    if (!isfinite(start)) return "the start time must be finite";
    return stop_defined && !(stop > start) ? "the stop time must be after the start time" : NULL;
}

static inline void set_span(Instance *instance, double start, bool stop_defined, double stop)
{
    instance->now.start = instance->now.time = start;
    instance->now.stop = stop_defined ? stop : INFINITY;
}

/* evaluates the outputs for the values set so far in initialization mode; called at the end of this
 * mode, and when outputs are read, so that masters can propagate start values. False: the model
 * rejects these values or their outputs */
static inline bool update_outputs(Instance *instance, const char *function)
{
    if (!instance->now.stale) return true;
    store_good_state(instance);
    if (!initialize_checked(instance, function, instance->model))
        return restore_good_state(instance), false;
    instance->now.stale = false;
    return true;
}

/* shortest internal step or sample period of the model [s], 0 if there is none */
static inline double finest_grid(const void *model)
{
    double finest = INFINITY;
    for (size_t i = 0; i < fmu_model.variable_count; i++) {
        const Variable *v = &fmu_model.variables[i];
        double value = value_of(model, (Scalar){v, 0});
        if (v->kind == GRID_ROW && value > 0) finest = smaller(finest, value);
    }
    return isfinite(finest) ? finest : 0;
}

/* ends initialization mode; false: the parameters or the first outputs are rejected */
static inline bool leave_initialization(Instance *instance, const char *function)
{
    if (!update_outputs(instance, function)) return false;
    instance->now.grid = finest_grid(instance->model);
    instance->now.phase = STEPPING;
    memcpy(instance->last_good, tail_const(fmu_model.start),
           tail_size()); /* alarms are 0 in start values, so each first alarm is reported as new */
    report_alarms(instance, instance->now.start);
    log_message(instance, STATUS_OK, LOG_EVENTS, "initialized");
    return true;
}

/* ---- step ---- */
static inline bool too_late(const Progress *now, double t)
{
    return now->grid > 0 && fabs(t) / now->grid > most_grid_steps;
}

static inline const char *why_no_step(const Progress *now, double t, double h)
{
    if (!isfinite(t) || !isfinite(h)) return "time and step size must be finite";
    if (h <= 0) return "the step size must be > 0";
    if (h > LONGEST_STEP) return "the step size must be <= 100000 s";
    if (too_many_substeps(now, h))
        return "the step would take more than 1e7 internal steps of length max_step, sample_period "
               "or T0";
    if (t + h == t) return "the step size is below the rounding error of the time";
    if (too_late(now, t + h))
        return "the time is beyond 2^53 internal steps or samples of length max_step, "
               "sample_period or T0, which cannot be counted";
    if (fabs(t - now->time) > time_tolerance(now->time, 1e-2 * h))
        return "the communication point is not the end of the last step";
    if (t + h > now->stop + time_tolerance(now->stop, 1e-2 * h))
        return "the step goes beyond the stop time";
    return NULL;
}

/* does one step of length h from the present time, then sets the time to t + h (t may differ from
 * the present time by a rounding error of the master); false: the step has failed, which ends the
 * run */
static inline bool take_step(Instance *instance, const char *function, double t, double h)
{
    store_good_state(instance);
    if (!step_checked(instance, function, instance->model, instance->now.time, h)) {
        restore_good_state(instance);
        instance->now.phase = FAILED;
        return false;
    }
    report_alarms(instance, instance->now.time + h);
    instance->now.time = t + h;
    instance->now.step = h;
    return true;
}

/* does the communication step of a fused system as several macro steps; false: a step has failed */
static inline bool take_macro_steps(Instance *instance, const char *function, double t, double h)
{
    const double macro = fmu_model.macro_step(instance->model), steps = nearest_whole(h / macro);
    if (steps == 1) return take_step(instance, function, t, h);
    for (double k = 0; k < steps; k++)
        if (!take_step(instance, function, t + k * macro, macro)) return false;
    return true;
}

static inline const char *why_not_whole(const void *model, double h)
{
    const double macro = fmu_model.macro_step(model), steps = nearest_whole(h / macro);
    bool whole = steps >= 1 && fabs(h - steps * macro) <= time_tolerance(0, 1e-2 * macro);
    return whole ? NULL : "the step size must be a whole multiple of macro_step";
}

/* does a communication step from the present time to t + h; false: the step is rejected, or has
 * failed, which ends the run */
static inline bool advance(Instance *instance, const char *function, double t, double h)
{
    char text[240];
    const char *rule = why_no_step(&instance->now, t, h);
    if (!rule && fmu_model.macro_step) rule = why_not_whole(instance->model, h);
    if (rule) {
        snprintf(text, sizeof text, "t = %.17g s, step = %.17g s, expected t = %.17g s: %s",
                 readable(t), readable(h), readable(instance->now.time), rule);
        return reject_call(instance, function, text);
    }
    if (fmu_model.macro_step) return take_macro_steps(instance, function, t, h);
    return take_step(instance, function, t, h);
}

#endif
