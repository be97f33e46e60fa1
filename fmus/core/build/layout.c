/* layout.c - host tool: prints the memory layout and interface of the models that it is linked
 * with, as text that fuse.py and c_api.py read.
 *
 * parts.inc lists the models as MODEL(symbol). A model gives one line "model" with its symbol,
 * number of doubles of its memory and of its workspace, index of the first double of inputs,
 * states, outputs; then one line "start" with the start values of its parameters and inputs, and
 * one line "row" per variable: causality, index of the first double, size, columns, rule, kind,
 * unit, name, description, names of the values of a mode. Causality, rule and kind are numbers of
 * the enumerations in fmu.h. Columns are separated by tabs. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "fmu.h"

#define MODEL(symbol)                   \
    extern const ModelInterface symbol; \
    extern const size_t symbol##_inputs;
#include "parts.inc"
#undef MODEL

static void print_model(const char *symbol, const ModelInterface *m, size_t inputs)
{
    const size_t states = m->state_offset / sizeof(double);
    const double *start = m->start;
    const size_t scratch = (m->scratch + sizeof(double) - 1) / sizeof(double);
    printf("model\t%s\t%zu\t%zu\t%zu\t%zu\t%zu\nstart", symbol, m->size / sizeof(double), scratch,
           inputs, states, states + m->state_count);
    for (size_t i = 0; i < states; i++) printf("\t%a", start[i]);
    printf("\n");
    for (const Variable *v = m->variables; v < m->variables + m->variable_count; v++)
        printf("row\t%d\t%zu\t%zu\t%zu\t%d\t%d\t%s\t%s\t%s\t%s\n", (int)v->causality,
               v->offset / sizeof(double), v->size, v->columns, (int)v->rule, (int)v->kind, v->unit,
               v->name, v->text, v->names ? v->names : "");
}

int main(void)
{
#define MODEL(symbol) print_model(#symbol, &symbol, symbol##_inputs);
#include "parts.inc"
#undef MODEL
    return 0;
}
