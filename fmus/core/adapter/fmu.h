/* fmu.h - header of the C file of a subsystem: rows of its interface table, and the contract with
 * the adapter.
 *
 * A model is plain data. It defines four structs made of doubles only (Parameters, Input, State,
 * Output), gathers them in a Model by the line
 *     MODEL_STRUCT;
 * and provides the start values (Model start), the table of variables (Variable variables[]), and
 *     check(p, problems)         reject parameter values, all problems at once
 *     initialize(p, u, x, y, t)  states and first outputs at start time t
 *     step(p, u, x, y, t, h)     from t to t + h with the inputs held, outputs latched at the end
 * The last line of the file, FMU_MODEL(...), passes all these to the adapter. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef FMU_H
#define FMU_H

#include "exact.h"

#include <stddef.h>
#include <stdio.h>
#include <string.h>

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

typedef enum { PARAMETER_ROW, INPUT_ROW, OUTPUT_ROW } Causality;
typedef enum {
    ANY_VALUE,
    POSITIVE_VALUE,
    NONNEGATIVE_VALUE,
    SWITCH_VALUE,
    ANGLE_VALUE,
    ALARM_VALUE
} Rule;

typedef enum {
    PLAIN_ROW,
    OPTIONAL_ROW, /* input that retains its start value if unconnected */
    GRID_ROW      /* parameter that is an internal step or a sample period */
} Kind;

typedef struct {
    Causality causality;
    const char *name;
    size_t offset;  /* bytes from the start of Model to the first element */
    size_t size;    /* elements */
    size_t columns; /* columns of a matrix, else 1 */
    const char *unit;
    const char *text;
    Rule rule;
    Kind kind;
    const char *names; /* names of the values 0, 1, .. of a mode: "far|hold 1|closing"; else NULL */
} Variable;

#define MODEL_STRUCT  \
    typedef struct {  \
        Parameters p; \
        Input u;      \
        State x;      \
        Output y;     \
    } Model

#define ROW_OF(causality, part, name, member, columns, unit, text, rule, kind, names) \
    {causality,                                                                       \
     name,                                                                            \
     offsetof(Model, part.member),                                                    \
     sizeof(((Model *)0)->part.member) / (sizeof(double)),                            \
     columns,                                                                         \
     unit,                                                                            \
     text,                                                                            \
     rule,                                                                            \
     kind,                                                                            \
     names}
#define ROW(causality, part, name, member, columns, unit, text, rule, kind) \
    ROW_OF(causality, part, name, member, columns, unit, text, rule, kind, NULL)
#define ROW_AS(causality, part, name, member, columns, unit, text, rule) \
    ROW(causality, part, name, member, columns, unit, text, rule, PLAIN_ROW)

#define PARAMETER(member, unit, text) \
    ROW_AS(PARAMETER_ROW, p, #member, member, 1, unit, text, ANY_VALUE)
#define PARAMETER_AS(name, member, unit, text) \
    ROW_AS(PARAMETER_ROW, p, name, member, 1, unit, text, ANY_VALUE)
#define POSITIVE(member, unit, text) \
    ROW_AS(PARAMETER_ROW, p, #member, member, 1, unit, text, POSITIVE_VALUE)
#define POSITIVE_AS(name, member, unit, text) \
    ROW_AS(PARAMETER_ROW, p, name, member, 1, unit, text, POSITIVE_VALUE)
#define NONNEGATIVE(member, unit, text) \
    ROW_AS(PARAMETER_ROW, p, #member, member, 1, unit, text, NONNEGATIVE_VALUE)
#define NONNEGATIVE_AS(name, member, unit, text) \
    ROW_AS(PARAMETER_ROW, p, name, member, 1, unit, text, NONNEGATIVE_VALUE)
#define SWITCH(member, text) ROW_AS(PARAMETER_ROW, p, #member, member, 1, "1", text, SWITCH_VALUE)
#define MATRIX(member, unit, text) \
    ROW_AS(PARAMETER_ROW, p, #member, member, 3, unit, text, ANY_VALUE)
/* row of an internal step or sample period; the adapter uses it to limit the number of internal
 * steps in a communication step */
#define GRID_OF(name, member, text, rule) \
    ROW(PARAMETER_ROW, p, name, member, 1, "s", text, rule, GRID_ROW)
#define GRID_AS(name, member, text) GRID_OF(name, member, text, POSITIVE_VALUE)
#define GRID(member, text)          GRID_AS(#member, member, text)
#define SAMPLE_PERIOD_AS(member, text) \
    GRID_OF("sample_period", member, "sample period of the software; 0 = " text, NONNEGATIVE_VALUE)
#define SAMPLE_PERIOD              SAMPLE_PERIOD_AS(sample_period, "at every communication step")
#define INPUT(member, unit, text)  ROW_AS(INPUT_ROW, u, #member, member, 1, unit, text, ANY_VALUE)
#define SWITCH_INPUT(member, text) ROW_AS(INPUT_ROW, u, #member, member, 1, "1", text, SWITCH_VALUE)
#define NONNEGATIVE_INPUT(member, unit, text) \
    ROW_AS(INPUT_ROW, u, #member, member, 1, unit, text, NONNEGATIVE_VALUE)
/* row of an input that may stay unconnected; the model description states this */
#define OPTIONAL_INPUT_AS(name, member, unit, text) \
    ROW(INPUT_ROW, u, name, member, 1, unit, text, ANY_VALUE, OPTIONAL_ROW)
#define OPTIONAL_INPUT(member, unit, text) OPTIONAL_INPUT_AS(#member, member, unit, text)
#define OPTIONAL_NONNEGATIVE(member, unit, text) \
    ROW(INPUT_ROW, u, #member, member, 1, unit, text, NONNEGATIVE_VALUE, OPTIONAL_ROW)
#define OPTIONAL_SWITCH(member, text) \
    ROW(INPUT_ROW, u, #member, member, 1, "1", text, SWITCH_VALUE, OPTIONAL_ROW)
#define OUTPUT(member, unit, text) ROW_AS(OUTPUT_ROW, y, #member, member, 1, unit, text, ANY_VALUE)
#define NONNEGATIVE_OUTPUT(member, unit, text) \
    ROW_AS(OUTPUT_ROW, y, #member, member, 1, unit, text, NONNEGATIVE_VALUE)
#define FLAG(member, text) ROW_AS(OUTPUT_ROW, y, #member, member, 1, "1", text, SWITCH_VALUE)
/* row of an output 0 or 1 whose change from 0 to 1 is logged as a warning */
#define ALARM(member, text) ROW_AS(OUTPUT_ROW, y, #member, member, 1, "1", text, ALARM_VALUE)
/* row of an output with the number of a mode. In the model description, the build appends numbers
 * and names of the modes to `text`, and writes the smallest and the largest number as min and max.
 * A number that does not occur has an empty name in `names`. */
#define MODE(member, text, names) \
    ROW_OF(OUTPUT_ROW, y, #member, member, 1, "1", text, NONNEGATIVE_VALUE, PLAIN_ROW, names)
#define MODE_INPUT(member, text, names) \
    ROW_OF(INPUT_ROW, u, #member, member, 1, "1", text, ANY_VALUE, PLAIN_ROW, names)
/* row of an input that has the number of a mode and may stay unconnected; `text` states the
 * meaning of -1 if this value is not a mode but has a meaning */
#define OPTIONAL_MODE(member, text, names) \
    ROW_OF(INPUT_ROW, u, #member, member, 1, "1", text, ANY_VALUE, OPTIONAL_ROW, names)
#define ANGLE_OUTPUT(member, text) \
    ROW_AS(OUTPUT_ROW, y, #member, member, 1, "rad", text, ANGLE_VALUE)

/* the value as messages print it: zero and NaN without a sign, because the sign of a NaN depends
 * on the compiler */
static inline double readable(double value) { return isnan(value) ? NOT_NUMBER : value + 0.0; }

/* ---- list of rejected parameter values ---- */
typedef struct {
    char text[4000]; /* space for about fifty problems; further ones are only counted */
    size_t count;
    const char *part; /* prefix of names: "component." if the model is part of a system, else "" */
} Problems;

static inline void reject(Problems *all, const char *name, double value, const char *rule)
{
    size_t used = strlen(all->text);
    snprintf(all->text + used, sizeof all->text - used, "%s%s%s = %.9g: %s", all->count ? "; " : "",
             all->part, name, readable(value), rule);
    all->count++;
}

/* ---- interface of a model to adapter and tools ---- */
typedef struct {
    const char *name, *text;
    size_t size, state_offset, state_count; /* size and offset: bytes; count: doubles */
    size_t scratch; /* bytes of workspace behind the model, for initialize; not part of the state */
    const void *start;
    const Variable *variables;
    size_t variable_count;
    void (*check)(void *model, Problems *problems); /* may use that workspace too */
    void (*initialize)(void *model, double t);
    void (*step)(void *model, double t, double h);
    /* for a system as one model (fused.h), else NULL and 0: */
    double (*macro_step)(const void *model); /* [s]; communication steps are multiples */
    const char *structure;   /* digest of connections and schedule; guid and states depend on it */
    const Variable *checked; /* connected inputs: checked by their rules, as outputs are */
    size_t checked_count;
} ModelInterface;

#ifndef FMU_MODEL_SYMBOL /* for several models in one program: -DFMU_MODEL_SYMBOL=NAME */
#define FMU_MODEL_SYMBOL fmu_model
#endif

extern const ModelInterface FMU_MODEL_SYMBOL;

#define FMU_MODEL_OF(identifier, description, first_outputs, scratch)        \
    static void check_model(void *model, Problems *problems)                 \
    {                                                                        \
        check(&((Model *)model)->p, problems);                               \
    }                                                                        \
    static void initialize_model(void *model, double t)                      \
    {                                                                        \
        Model *m = (Model *)model;                                           \
        first_outputs;                                                       \
    }                                                                        \
    static void step_model(void *model, double t, double h)                  \
    {                                                                        \
        Model *m = (Model *)model;                                           \
        step(&m->p, &m->u, &m->x, &m->y, t, h);                              \
    }                                                                        \
    const ModelInterface FMU_MODEL_SYMBOL = {identifier,                     \
                                             description,                    \
                                             sizeof(Model),                  \
                                             offsetof(Model, x),             \
                                             sizeof(State) / sizeof(double), \
                                             scratch,                        \
                                             &start,                         \
                                             variables,                      \
                                             COUNT(variables),               \
                                             check_model,                    \
                                             initialize_model,               \
                                             step_model,                     \
                                             NULL,                           \
                                             NULL,                           \
                                             NULL,                           \
                                             0}

#define FMU_MODEL(identifier, description) \
    FMU_MODEL_OF(identifier, description, initialize(&m->p, &m->u, &m->x, &m->y, t), 0)
/* as FMU_MODEL, but initialize(p, u, x, y, t, w) gets a workspace w of type Scratch, a struct of
 * doubles */
#define FMU_MODEL_WITH(Scratch, identifier, description)                                \
    FMU_MODEL_OF(identifier, description,                                               \
                 initialize(&m->p, &m->u, &m->x, &m->y, t, (Scratch *)(void *)(m + 1)), \
                 sizeof(Scratch))

#endif
