/* monolith.c - what the master is measured against: the same models without FMI in one program, and
 * a bare loop over FMUs.
 *
 * Both are plain Gauss-Seidel with one macro step for all, nothing is recorded and no status is
 * handled in passing. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "fmi2FunctionTypes.h"
#include "interface.h"

#include <stdlib.h>

#define MODEL(name) extern const ModelInterface name##_model;
#include "models.inc"
#undef MODEL

#define MODEL(name) &name##_model,
static const ModelInterface *const models[] = {
#include "models.inc"
};
#undef MODEL

const ModelInterface *find_model(const char *name)
{
    for (size_t i = 0; i < COUNT(models); i++)
        if (strcmp(models[i]->name, name) == 0) return models[i];
    return NULL;
}

/* ---- the monolithic program ---- */
void *new_model(const ModelInterface *model)
{
    void *memory = malloc(memory_of(model));
    if (memory) memcpy(memory, model->start, model->size);
    return memory;
}

void free_model(void *memory) { free(memory); }

double *variable(const ModelInterface *model, void *memory, unsigned reference)
{
    Scalar s = scalar_of(model, reference);
    return s.row ? pointer_to(memory, s) : NULL;
}

void initialize_model(const ModelInterface *model, void *memory, double t)
{
    model->initialize(memory, t);
}

typedef struct {
    const double *from;
    double *to;
} Copy;
typedef struct {
    const ModelInterface *model;
    void *memory;
    const Copy *copies;
    size_t copy_count;
} Part;

void run_monolith(const Part *parts, size_t count, double start, double h, long steps)
{
    for (long k = 0; k < steps; k++)
        for (const Part *p = parts; p < parts + count; p++) {
            for (size_t i = 0; i < p->copy_count; i++) *p->copies[i].to = *p->copies[i].from;
            p->model->step(p->memory, start + (double)k * h, h);
        }
}

/* ---- the bare loop over FMUs ---- */
typedef struct {
    fmi2Component component;
    fmi2SetRealTYPE *set;
    fmi2DoStepTYPE *step;
    fmi2GetRealTYPE *get;
    const fmi2ValueReference *inputs, *outputs;
    size_t input_count, output_count;
    const double *const
        *sources; /* where each input comes from: a place in the output buffer of a slave */
    double *input_values, *output_values;
} Slave;

int run_slaves(const Slave *slaves, size_t count, double start, double h, long steps)
{
    int worst = 0;
    for (long k = 0; k < steps; k++)
        for (const Slave *s = slaves; s < slaves + count; s++) {
            for (size_t i = 0; i < s->input_count; i++) s->input_values[i] = *s->sources[i];
            worst |= (int)s->set(s->component, s->inputs, s->input_count, s->input_values);
            worst |= (int)s->step(s->component, start + (double)k * h, h, fmi2True);
            worst |= (int)s->get(s->component, s->outputs, s->output_count, s->output_values);
        }
    return worst;
}
