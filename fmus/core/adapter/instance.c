/* instance.c - memory, log and guarded evaluation of one instance. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "finite.h"
#include "instance.h"

const char *const log_categories[3] = {"logStatusError", "logStatusWarning", "logEvents"};

enum { LINE_SIZE = sizeof(Problems) + 100 };

static const char *category_name(unsigned category)
{
    return log_categories[category == LOG_ERRORS ? 0 : category == LOG_WARNINGS ? 1 : 2];
}

static void hand_over(const Instance *instance, Status status, unsigned category, char *line)
{
    instance->call.hand_over(instance, status, category_name(category), line);
}

RARE void log_message(const Instance *instance, Status status, unsigned category, const char *text)
{
    char line[LINE_SIZE];
    if (!instance->call.logger || (category != LOG_ERRORS && !(instance->categories & category)))
        return;
    snprintf(line, sizeof line, "%s", text);
    hand_over(instance, status, category, line);
}

RARE bool refuse_call(const Instance *instance, const char *function, const char *text)
{
    char line[LINE_SIZE];
    if (!instance || !instance->call.logger) return false;
    snprintf(line, sizeof line, "%s: %s", function, text);
    hand_over(instance, STATUS_ERROR, LOG_ERRORS, line);
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

bool refuse_phase(const Instance *instance, const char *function)
{
    char text[120];
    if (!instance) return false;
    snprintf(text, sizeof text, "not allowed in the state '%s'", phase_name(instance->now.phase));
    return refuse_call(instance, function, text);
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

/* every parameter against the rule of its row, then the rules of the model itself */
static void check_parameters(void *model, Problems *problems)
{
    char name[NAME_SIZE];
    for (size_t i = 0; i < fmu_model.variable_count; i++)
        for (size_t k = 0; k < fmu_model.variables[i].size; k++) {
            Scalar s = {&fmu_model.variables[i], k};
            double value = value_of(model, s);
            const char *rule =
                s.row->causality == PARAMETER_ROW ? broken_rule(s.row->rule, value) : NULL;
            if (rule) refuse(problems, element_name(name, s), value, rule);
        }
    fmu_model.check(model, problems);
}

enum { FINDING_SIZE = NAME_SIZE + 400 }; /* a name, a value, a rule and the text of the row */

/* outputs, and what is judged beside them */
static const Variable *judged_row(size_t i) /* NULL: i is past the last one */
{
    const size_t beyond = i - fmu_model.variable_count;
    if (i < fmu_model.variable_count) return &fmu_model.variables[i];
    return beyond < fmu_model.judged_count ? &fmu_model.judged[beyond] : NULL;
}

static const char *first_broken_output(const void *model, char text[FINDING_SIZE])
{
    char name[NAME_SIZE];
    const Variable *row;
    for (size_t i = 0; (row = judged_row(i)); i++)
        for (size_t k = 0; k < row->size && row->causality == OUTPUT_ROW; k++) {
            Scalar s = {row, k};
            double value = value_of(model, s);
            const char *rule = broken_rule(row->rule, value);
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
    for (size_t i = 0; (v = judged_row(i)); i++) {
        if (v->causality != OUTPUT_ROW || v->rule == ANY_VALUE) continue;
        for (size_t k = 0; k < v->size && (v->rule == ALARM_VALUE) == alarms; k++)
            add_to_runs(instance->guarded, &instance->guarded_count, (Part){{v, k}, 1}, v->rule);
    }
}

void list_guarded(Instance *instance)
{
    instance->guarded_count = 0;
    list_outputs(instance, true);
    instance->alarm_count = instance->guarded_count;
    list_outputs(instance, false);
}

static bool outputs_in_bounds(const Instance *instance, const double model[])
{
    const Run *end = instance->guarded + instance->guarded_count;
    for (const Run *r = instance->guarded; r < end; r++)
        if (!keep_rule(r->rule, model + r->first, r->count)) return false;
    return true;
}

RARE static bool refuse_result(const Instance *instance, const char *function, const void *model,
                               double t)
{
    char broken[FINDING_SIZE], text[FINDING_SIZE + 80];
    const char *what = first_broken_output(model, broken);
    snprintf(text, sizeof text, "result at t = %.9g s refused: %s", t,
             what ? what : "an internal state is not finite");
    return refuse_call(instance, function, text);
}

static bool result_is_good(const Instance *instance, const char *function, const void *model,
                           double t)
{
    if (all_finite(tail_const(model), tail_size() / sizeof(double)) &&
        outputs_in_bounds(instance, model))
        return true;
    return refuse_result(instance, function, model, t);
}

RARE static bool parameters_are_good(const Instance *instance, const char *function, void *model)
{
    Problems problems = {{0}, 0, ""};
    check_parameters(model, &problems);
    return problems.count == 0 || refuse_call(instance, function, problems.text);
}

bool initialize_checked(const Instance *instance, const char *function, void *model)
{
    if (!parameters_are_good(instance, function, model)) return false;
    memcpy(tail(model), tail_const(fmu_model.start), tail_size());
    fmu_model.initialize(model, instance->now.start);
    return result_is_good(instance, function, model, instance->now.start);
}

bool step_checked(const Instance *instance, const char *function, void *model, double t, double h)
{
    fmu_model.step(model, t, h);
    return result_is_good(instance, function, model, t + h);
}

static Scalar output_at(size_t place) /* in doubles of the model */
{
    size_t i = 0, first = 0;
    for (; i < fmu_model.variable_count; i++) {
        first = fmu_model.variables[i].offset / sizeof(double);
        if (place >= first && place < first + fmu_model.variables[i].size) break;
    }
    return (Scalar){&fmu_model.variables[i], place - first};
}

RARE static void report_alarm(const Instance *instance, Scalar s, double t)
{
    char name[NAME_SIZE], text[FINDING_SIZE];
    snprintf(text, sizeof text, "t = %.9g s: %s (%s)", t, element_name(name, s), s.row->text);
    log_message(instance, STATUS_WARNING, LOG_WARNINGS, text);
}

void report_alarms(const Instance *instance, double t)
{
    const double *now = instance->model, *before = instance->good;
    const size_t tail_begins = fmu_model.state_offset / sizeof(double);
    const Run *end = instance->guarded + instance->alarm_count;
    for (const Run *r = instance->guarded; r < end; r++)
        for (size_t k = r->first; k < r->first + r->count; k++)
            if (before[k - tail_begins] == 0 && now[k] != 0)
                report_alarm(instance, output_at(k), t);
}
