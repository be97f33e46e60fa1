/* describe.c - host tool: prints the modelDescription.xml of the model it is linked with.
 *
 *     describe FMI VERSION DATE SOURCE...
 *                 FMI: 2 or 3; DATE as 2026-01-31T00:00:00Z; SOURCE: the .c files in sources/
 *     describe trace
 *                 the outputs over the default experiment as CSV, with start values of all inputs;
 *                  nothing if a result violates a rule
 *
 * It exits with 1 after a message for each fault. Both forms check that the model accepts the start
 * values of its parameters. The first form also checks the table of variables (descriptions, order
 * and size of rows, unique names, units), and that start values and first outputs satisfy their
 * rules. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "describe_fmi2.h"
#include "describe_fmi3.h"
#include "trace.h"

/* ---- checks of the interface ---- */
static void check_row(size_t row)
{
    const Variable *v = &fmu_model.variables[row];
    if (!*v->text && !v->names) report_fault(v->name, "the description is missing");
    if (row > 0 && v->causality < fmu_model.variables[row - 1].causality)
        report_fault(v->name, "rows must be in the order parameters, inputs, outputs");
    if (strcmp(v->name, "time") == 0)
        report_fault(v->name, "this name is reserved for the independent variable of FMI 3.0");
    if (v->kind == OPTIONAL_ROW && v->causality != INPUT_ROW)
        report_fault(v->name, "only an input can be optional");
    if (v->kind == GRID_ROW && (v->causality != PARAMETER_ROW || v->size != 1))
        report_fault(v->name,
                     "only a parameter of one element can be an internal step or a sample period");
    if (v->size == 0 || v->size > VR_STRIDE || v->size % v->columns) {
        char text[80];
        snprintf(text, sizeof text,
                 "it must have 1 to %d elements, a whole multiple of its columns", VR_STRIDE);
        report_fault(v->name, text);
    }
    for (size_t i = 0; i < row; i++)
        if (strcmp(fmu_model.variables[i].name, v->name) == 0)
            report_fault(v->name, "the name is used twice");
}

static void check_values(const void *model)
{
    char name[NAME_SIZE];
    for (size_t i = 0; i < fmu_model.variable_count; i++)
        for (size_t k = 0; k < fmu_model.variables[i].size; k++) {
            Scalar s = {&fmu_model.variables[i], k};
            const char *rule = violated_rule(s.row->rule, value_of(model, s));
            if (rule) report_fault(element_name(name, s), rule);
        }
}

static void *initialized_model(void)
{
    Problems problems = {{0}, 0, ""};
    void *model = calloc(1, memory_of(&fmu_model));
    if (!model) exit(1);
    memcpy(model, fmu_model.start, fmu_model.size);
    fmu_model.check(model, &problems);
    if (problems.count) report_fault("start values", problems.text);
    fmu_model.initialize(model, 0);
    return model;
}

int main(int count, char *argument[])
{
    if (count == 2 && strcmp(argument[1], "trace") == 0) {
        print_trace(initialized_model());
        return faults ? 1 : 0;
    }
    if (count < 5 || !strchr("23", argument[1][0])) {
        fprintf(stderr, "usage: describe 2|3 VERSION DATE SOURCE..., describe trace\n");
        return 2;
    }
    const bool fmi3 = argument[1][0] == '3';
    const Build build = {argument[2], argument[3], fmi3 ? "documentation/" : "", count - 4,
                         argument + 4};
    void *model = initialized_model();
    for (size_t i = 0; i < fmu_model.variable_count; i++) check_row(i);
    check_values(model);
    (fmi3 ? print_fmi3 : print_fmi2)(&build, model);
    free(model);
    return faults ? 1 : 0;
}
