/* trace.h - outputs of a model with unconnected inputs as CSV: a reference for users who import the
 * FMU. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef TRACE_H
#define TRACE_H

#include "interface.h"

#include <stdlib.h>

#define TRACE_STEP 0.1                         /* s; step of the default experiment */
enum { TRACE_STEPS = 1000, TRACE_EVERY = 50 }; /* number of steps; steps between rows */

static bool is_output(size_t row) { return fmu_model.variables[row].causality == OUTPUT_ROW; }

static bool satisfies_rules(const void *model)
{
    for (size_t i = 0; i < fmu_model.variable_count; i++)
        for (size_t k = 0; is_output(i) && k < fmu_model.variables[i].size; k++) {
            const Scalar s = {&fmu_model.variables[i], k};
            if (violated_rule(s.row->rule, value_of(model, s))) return false;
        }
    return true;
}

static void print_names(void)
{
    char name[NAME_SIZE];
    printf("\"time\"");
    for (size_t i = 0; i < fmu_model.variable_count; i++)
        for (size_t k = 0; is_output(i) && k < fmu_model.variables[i].size; k++)
            printf(",\"%s\"", element_name(name, (Scalar){&fmu_model.variables[i], k}));
    printf("\n");
}

static void print_outputs(const void *model, double t)
{
    printf("%.17g", t);
    for (size_t i = 0; i < fmu_model.variable_count; i++)
        for (size_t k = 0; is_output(i) && k < fmu_model.variables[i].size; k++)
            printf(",%.17g", value_of(model, (Scalar){&fmu_model.variables[i], k}));
    printf("\n");
}

/* runs the model and prints rows if `print` is set; false: a result violates a rule. Step k
 * ends at k h + h, where the next step begins, as with a master that counts its steps instead of
 * adding up the time. */
static bool run(void *model, bool print)
{
    if (print) print_outputs(model, 0);
    double t = 0;
    for (int k = 0; k < TRACE_STEPS; k++) {
        fmu_model.step(model, t, TRACE_STEP);
        t = k * TRACE_STEP + TRACE_STEP;
        if (!satisfies_rules(model)) return false;
        if (print && (k + 1) % TRACE_EVERY == 0) print_outputs(model, (k + 1) * TRACE_STEP);
    }
    return true;
}

/* prints the trace of an initialized model, or nothing if an output violates a rule in the run;
 * frees the model */
static void print_trace(void *model)
{
    void *first = malloc(memory_of(&fmu_model));
    if (!first) exit(1);
    memcpy(first, model, memory_of(&fmu_model));
    if (satisfies_rules(first) && run(first, false)) {
        print_names();
        run(model, true);
    }
    free(first);
    free(model);
}

#endif
