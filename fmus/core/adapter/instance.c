/* instance.c - memory and log of one instance; initialization and steps with checked results. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "instance.h"

const char *const log_categories[3] = {"logStatusError", "logStatusWarning", "logEvents"};

enum { LINE_SIZE = sizeof(Problems) + 100 };

static const char *category_name(unsigned category)
{
    return log_categories[category == LOG_ERRORS ? 0 : category == LOG_WARNINGS ? 1 : 2];
}

static void write_log_line(const Instance *instance, Status status, unsigned category, char *line)
{
    instance->call.write_line(instance, status, category_name(category), line);
}

RARE void log_message(const Instance *instance, Status status, unsigned category, const char *text)
{
    char line[LINE_SIZE];
    if (!instance->call.logger || (category != LOG_ERRORS && !(instance->categories & category)))
        return;
    snprintf(line, sizeof line, "%s", text);
    write_log_line(instance, status, category, line);
}

RARE bool reject_call(const Instance *instance, const char *function, const char *text)
{
    char line[LINE_SIZE];
    if (!instance || !instance->call.logger) return false;
    snprintf(line, sizeof line, "%s: %s", function, text);
    write_log_line(instance, STATUS_ERROR, LOG_ERRORS, line);
    return false;
}

static const char *phase_name(Phase phase)
{
    switch (phase) {
    case INSTANTIATED: return "instantiated";
    case INITIALIZING: return "initialization mode";
    case STEPPING: return "step complete";
    case TERMINATED: return "terminated";
    default: return "error";
    }
}

bool reject_phase(const Instance *instance, const char *function)
{
    char text[120];
    if (!instance) return false;
    snprintf(text, sizeof text, "not allowed in the state '%s'", phase_name(instance->now.phase));
    return reject_call(instance, function, text);
}

void *allocate(const Instance *instance, size_t bytes)
{
    bool own = !instance->call.allocate || !instance->call.release;
    return own ? calloc(1, bytes) : instance->call.allocate(1, bytes);
}

void release(const Instance *instance, void *memory)
{
    bool own = !instance->call.allocate || !instance->call.release;
    if (!memory) return;
    if (own) free(memory);
    else instance->call.release(memory);
}

enum { FINDING_SIZE = NAME_SIZE + 400 }; /* text: name, value, rule, description of an output */

/* returns row i of one list: the variables of the model, then, in a fused system, the inputs that it
 * connects inside (`checked`, listed as outputs, so that their rules are checked); NULL if i is
 * beyond the last row */
static const Variable *checked_row(size_t i)
{
    const size_t beyond = i - fmu_model.variable_count;
    if (i < fmu_model.variable_count) return &fmu_model.variables[i];
    return beyond < fmu_model.checked_count ? &fmu_model.checked[beyond] : NULL;
}

static const char *first_invalid_output(const void *model, char text[FINDING_SIZE])
{
    char name[NAME_SIZE];
    const Variable *row;
    for (size_t i = 0; (row = checked_row(i)); i++)
        for (size_t k = 0; k < row->size && row->causality == OUTPUT_ROW; k++) {
            Scalar s = {row, k};
            double value = value_of(model, s);
            const char *rule = violated_rule(row->rule, value);
            if (!rule) continue;
            snprintf(text, FINDING_SIZE, "%s = %.9g: %s (%s)", element_name(name, s),
                     readable(value), rule, row->text);
            return text;
        }
    return NULL;
}

static void list_outputs(Instance *instance, bool alarms)
{
    const Variable *v;
    for (size_t i = 0; (v = checked_row(i)); i++) {
        if (v->causality != OUTPUT_ROW || v->rule == ANY_VALUE) continue;
        for (size_t k = 0; k < v->size && (v->rule == ALARM_VALUE) == alarms; k++)
            add_to_runs(instance->ruled, &instance->ruled_count, (Part){{v, k}, 1}, v->rule);
    }
}

void list_ruled_outputs(Instance *instance)
{
    instance->ruled_count = 0;
    list_outputs(instance, true);
    instance->alarm_count = instance->ruled_count;
    list_outputs(instance, false);
}

static bool outputs_in_bounds(const Instance *instance, const double model[])
{
    const Run *end = instance->ruled + instance->ruled_count;
    for (const Run *r = instance->ruled; r < end; r++)
        if (!satisfy_rule(r->rule, model + r->first, r->count)) return false;
    return true;
}

static bool is_zero(const double value[], size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (value[i] != 0) return false;
    return true;
}

/* true if an input is zero while its start value is not, such as an attitude, position or mass
 * that the master has not passed on yet */
static bool lacks_value(const Variable *v, const void *model)
{
    const Scalar first = {v, 0};
    return v->causality == INPUT_ROW && is_zero(values_from(model, first), v->size) &&
           !is_zero(values_from(fmu_model.start, first), v->size);
}

/* returns the first vector input that lacks a value; if there is none, the first scalar input that
 * lacks a value; NULL if all inputs have values */
static const Variable *first_lacking_input(const void *model)
{
    const Variable *end = fmu_model.variables + fmu_model.variable_count, *scalar = NULL;
    for (const Variable *v = fmu_model.variables; v < end; v++) {
        if (!lacks_value(v, model)) continue;
        if (v->size > 1) return v;
        if (!scalar) scalar = v;
    }
    return scalar;
}

RARE static bool reject_result(const Instance *instance, const char *function, const void *model,
                               double t)
{
    char invalid[FINDING_SIZE], text[FINDING_SIZE + NAME_SIZE + 120];
    const char *what = first_invalid_output(model, invalid);
    const Variable *lacking = first_lacking_input(model);
    snprintf(text, sizeof text, "result at t = %.9g s rejected: %s%s%s%s", t,
             what ? what : "an internal state is not finite", lacking ? "; the input " : "",
             lacking ? lacking->name : "", lacking ? " is zero" : "");
    return reject_call(instance, function, text);
}

static bool result_is_valid(const Instance *instance, const void *model)
{
    return all_finite(tail_const(model), tail_size() / sizeof(double)) &&
           outputs_in_bounds(instance, model);
}

static bool result_is_good(const Instance *instance, const char *function, const void *model,
                           double t)
{
    return result_is_valid(instance, model) || reject_result(instance, function, model, t);
}

RARE static bool parameters_are_good(const Instance *instance, const char *function, void *model)
{
    Problems problems = {{0}, 0, ""};
    check_parameters(&fmu_model, model, &problems);
    return problems.count == 0 || reject_call(instance, function, problems.text);
}

static void evaluate_first_outputs(const Instance *instance, void *model)
{
    memcpy(tail(model), tail_const(fmu_model.start), tail_size());
    fmu_model.initialize(model, instance->now.start);
}

/* computes the first outputs of a model whose inputs the master has set to zero, for models that
 * have no valid outputs with these zeros: each input that lacks a value is replaced by its start
 * value for this computation, then it is zero again, and the master must set it before the first
 * step. False: no input lacks a value, or the outputs are not valid with start values either. */
RARE static bool initialize_without_inputs(const Instance *instance, void *model)
{
    char text[NAME_SIZE + 120];
    const Variable *lacking = first_lacking_input(model);
    double *inputs = lacking ? allocate(instance, fmu_model.state_offset) : NULL;
    if (!inputs) return false;
    memcpy(inputs, model, fmu_model.state_offset);
    for (const Variable *v = fmu_model.variables;
         v < fmu_model.variables + fmu_model.variable_count; v++)
        if (lacks_value(v, model))
            memcpy(pointer_to(model, (Scalar){v, 0}), values_from(fmu_model.start, (Scalar){v, 0}),
                   v->size * sizeof(double));
    evaluate_first_outputs(instance, model);
    memcpy(model, inputs, fmu_model.state_offset);
    release(instance, inputs);
    snprintf(text, sizeof text,
             "the input %s is zero: the first outputs follow from its start value; set it before "
             "the first step",
             lacking->name);
    log_message(instance, STATUS_WARNING, LOG_WARNINGS, text);
    return result_is_valid(instance, model);
}

bool initialize_checked(const Instance *instance, const char *function, void *model)
{
    if (!parameters_are_good(instance, function, model)) return false;
    evaluate_first_outputs(instance, model);
    return result_is_valid(instance, model) || initialize_without_inputs(instance, model) ||
           reject_result(instance, function, model, instance->now.start);
}

bool step_checked(const Instance *instance, const char *function, void *model, double t, double h)
{
    fmu_model.step(model, t, h);
    return result_is_good(instance, function, model, t + h);
}

static Scalar output_at(size_t double_index) /* double_index: index of a double in the model */
{
    size_t i = 0, first = 0;
    for (; i < fmu_model.variable_count; i++) {
        first = fmu_model.variables[i].offset / sizeof(double);
        if (double_index >= first && double_index < first + fmu_model.variables[i].size) break;
    }
    return (Scalar){&fmu_model.variables[i], double_index - first};
}

RARE static void report_alarm(const Instance *instance, Scalar s, double t)
{
    char name[NAME_SIZE], text[FINDING_SIZE];
    snprintf(text, sizeof text, "t = %.9g s: %s (%s)", t, element_name(name, s), s.row->text);
    log_message(instance, STATUS_WARNING, LOG_WARNINGS, text);
}

void report_alarms(const Instance *instance, double t)
{
    const double *now = instance->model, *before = instance->last_good;
    const size_t tail_begins = fmu_model.state_offset / sizeof(double);
    const Run *end = instance->ruled + instance->alarm_count;
    for (const Run *r = instance->ruled; r < end; r++)
        for (size_t k = r->first; k < r->first + r->count; k++)
            if (before[k - tail_begins] == 0 && now[k] != 0)
                report_alarm(instance, output_at(k), t);
}
