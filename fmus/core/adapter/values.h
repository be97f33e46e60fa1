/* values.h - setting and reading variables for all versions of FMI. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef VALUES_H
#define VALUES_H

#include "life.h"

typedef struct {
    const char *set, *get; /* names of the functions of FMI, for messages */
    bool rows; /* a value reference names a whole row (FMI 3.0), not one element (2.0) */
} Access;

/* value reference of time: FMI 3.0 requires the independent variable among the variables of an FMU,
 * but the tables of the models do not contain it */
static inline unsigned time_reference(void)
{
    return (unsigned)(VR_STRIDE * fmu_model.variable_count);
}
static inline bool is_time(const Access *a, unsigned vr)
{
    return a->rows && vr == time_reference();
}

RARE static bool reject_reference(const Instance *instance, const char *function, unsigned vr)
{
    char text[80];
    snprintf(text, sizeof text, "there is no variable with value reference %u", vr);
    return reject_call(instance, function, text);
}

RARE static bool reject_named(const Instance *instance, const char *function, const char *name,
                              const char *rule)
{
    char text[NAME_SIZE + 120];
    snprintf(text, sizeof text, "%s: %s", name, rule);
    return reject_call(instance, function, text);
}

/* true if all references name variables and the number of values equals the number of their
 * elements, else false after a message */
static inline bool match_references(const Instance *instance, const Access *a, const char *function,
                                    const unsigned vr[], size_t count, size_t values)
{
    char text[80];
    size_t elements = 0;
    for (size_t i = 0; i < count; i++) {
        Part p = part_of(&fmu_model, vr[i], a->rows);
        if (!p.first.row && !is_time(a, vr[i])) return reject_reference(instance, function, vr[i]);
        elements += p.first.row ? p.size : 1;
    }
    if (elements == values) return true;
    snprintf(text, sizeof text, "expected %zu values, got %zu", elements, values);
    return reject_call(instance, function, text);
}

/* ---- setting ---- */
static inline const char *why_not_settable(const Instance *instance, const Variable *row)
{
    if (!row) return "is the independent variable and cannot be set";
    if (row->causality == OUTPUT_ROW) return "is an output and cannot be set";
    if (row->causality == PARAMETER_ROW && instance->now.phase == STEPPING)
        return "is a fixed parameter and cannot be set after initialization";
    return NULL;
}

/* true if the elements of one value reference may be set to these values in the present phase,
 * else false after a message */
static inline bool acceptable_part(const Instance *instance, const Access *a, Part p,
                                   const double value[])
{
    char name[NAME_SIZE];
    Scalar s = p.first;
    const char *rule = why_not_settable(instance, s.row);
    if (rule) {
        const char *row = s.row ? s.row->name : "time";
        return reject_named(instance, a->set, a->rows ? row : element_name(name, s), rule);
    }
    for (size_t k = 0; k < p.size; k++, s.element++) {
        rule = violated_rule(rule_when_set(s), value[k]);
        if (rule) return reject_named(instance, a->set, element_name(name, s), rule);
    }
    return true;
}

/* true if all values may be set; all are checked before the first is set */
static inline bool acceptable(const Instance *instance, const Access *a, const unsigned vr[],
                              size_t count, const double value[])
{
    for (size_t i = 0; i < count; i++) {
        Part p = part_of(&fmu_model, vr[i], a->rows);
        if (!p.first.row && !is_time(a, vr[i])) return reject_reference(instance, a->set, vr[i]);
        if (!acceptable_part(instance, a, p, value)) return false;
        value += p.size;
    }
    return true;
}

/* sets the values, if the instance is stepping, the cache (known_calls.h) contains an earlier call
 * with the same references, and the values satisfy their rules; false: nothing was set. The other
 * checks of acceptable() are not needed, because the cached calls set inputs only */
static inline bool set_known(Instance *instance, const unsigned vr[], size_t count,
                             const double value[], size_t values)
{
    if (instance->now.phase != STEPPING) return false;
    const KnownCall *call = find_known_call(&instance->written, vr, count);
    if (!call || call->values != values || !all_finite(value, values) ||
        !satisfy_rules(call, value))
        return false;
    write_runs(call, instance->model, value);
    return true;
}

static inline bool set_values(Instance *instance, const Access *a, const unsigned vr[],
                              size_t count, const double value[], size_t values)
{
    if (!allowed(instance, a->set, INSTANTIATED | INITIALIZING | STEPPING)) return false;
    if ((count && !vr) || (values && !value))
        return reject_call(instance, a->set, "an array argument is NULL");
    if (set_known(instance, vr, count, value, values)) return true;
    if (a->rows && !match_references(instance, a, a->set, vr, count, values)) return false;
    if (!acceptable(instance, a, vr, count, value)) return false;
    for (size_t i = 0; i < count; i++) {
        Part p = part_of(&fmu_model, vr[i], a->rows);
        memcpy(pointer_to(instance->model, p.first), value, p.size * sizeof *value);
        value += p.size;
    }
    if (instance->now.phase == STEPPING)
        store_known_call(&instance->written, &fmu_model, vr, count, a->rows);
    else instance->now.stale = true;
    return true;
}

/* ---- reading ---- */
/* reads the elements of one value reference; in initialization mode outputs are evaluated first */
static inline bool get_part(Instance *instance, const Access *a, Part p, double value[])
{
    bool output = p.first.row->causality == OUTPUT_ROW;
    if (output && instance->now.phase == INITIALIZING && !update_outputs(instance, a->get))
        return false;
    memcpy(value, values_from(instance->model, p.first), p.size * sizeof *value);
    return true;
}

static inline bool get_values(Instance *instance, const Access *a, const unsigned vr[],
                              size_t count, double value[], size_t values)
{
    if (!allowed(instance, a->get, INITIALIZING | STEPPING | TERMINATED | FAILED)) return false;
    if ((count && !vr) || (values && !value))
        return reject_call(instance, a->get, "an array argument is NULL");
    const KnownCall *call =
        instance->now.phase == INITIALIZING ? NULL : find_known_call(&instance->read, vr, count);
    if (call && call->values == values) return read_runs(call, instance->model, value), true;
    if (a->rows && !match_references(instance, a, a->get, vr, count, values)) return false;
    bool timed = false;
    for (size_t i = 0; i < count; i++) {
        Part p = part_of(&fmu_model, vr[i], a->rows);
        if (is_time(a, vr[i])) {
            *value++ = instance->now.time;
            timed = true;
            continue;
        }
        if (!p.first.row) return reject_reference(instance, a->get, vr[i]);
        if (!get_part(instance, a, p, value)) return false;
        value += p.size;
    }
    if (!timed) store_known_call(&instance->read, &fmu_model, vr, count, a->rows);
    return true;
}

#endif
