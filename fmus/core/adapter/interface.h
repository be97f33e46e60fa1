/* interface.h - access to the interface table of a model: scalars by value reference, names of
 * elements, checks of parameters, guid. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef INTERFACE_H
#define INTERFACE_H

#include "rules.h"

#include <stdint.h>

enum { VR_STRIDE = 1000, NAME_SIZE = 128, GUID_SIZE = 40 };

typedef struct {
    const Variable *row;
    size_t element;
} Scalar; /* row NULL: the variable does not exist */

static inline Scalar scalar_of(const ModelInterface *m, unsigned vr) /* vr = 1000 * row + element */
{
    size_t row = vr / VR_STRIDE, element = vr % VR_STRIDE;
    if (row >= m->variable_count || element >= m->variables[row].size) return (Scalar){NULL, 0};
    return (Scalar){&m->variables[row], element};
}

static inline double *pointer_to(void *model, Scalar s)
{
    return (double *)(void *)((char *)model + s.row->offset) + s.element;
}
static inline const double *values_from(const void *model, Scalar s)
{
    return (const double *)(const void *)((const char *)model + s.row->offset) + s.element;
}
static inline double value_of(const void *model, Scalar s) { return *values_from(model, s); }

/* size in bytes of a model with its workspace */
static inline size_t memory_of(const ModelInterface *m) { return m->size + m->scratch; }

/* writes the name of an element to buffer: v, v[3] or v[2,3] (one-based, row major) */
static inline const char *element_name(char buffer[NAME_SIZE], Scalar s)
{
    unsigned i = (unsigned)(s.element + 1), columns = (unsigned)s.row->columns;
    if (s.row->size == 1) snprintf(buffer, NAME_SIZE, "%s", s.row->name);
    else if (columns == 1) snprintf(buffer, NAME_SIZE, "%s[%u]", s.row->name, i);
    else
        snprintf(buffer, NAME_SIZE, "%s[%u,%u]", s.row->name, (i - 1) / columns + 1,
                 (i - 1) % columns + 1);
    return buffer;
}

/* rule that a value must satisfy when it is set; parameters are checked before the first outputs
 * are evaluated instead */
static inline Rule rule_when_set(Scalar s)
{
    return s.row->causality == INPUT_ROW ? s.row->rule : ANY_VALUE;
}

/* rejects every parameter that violates the rule of its row, then the parameters that check() of
 * the model rejects; parameters: memory of the model, of which only the parameters are read */
static inline void check_parameters(const ModelInterface *m, void *parameters, Problems *problems)
{
    char name[NAME_SIZE];
    for (size_t i = 0; i < m->variable_count; i++)
        for (size_t k = 0; k < m->variables[i].size; k++) {
            const Scalar s = {&m->variables[i], k};
            if (s.row->causality != PARAMETER_ROW) continue;
            const double value = value_of(parameters, s);
            const char *rule = violated_rule(s.row->rule, value);
            if (rule) reject(problems, element_name(name, s), value, rule);
        }
    m->check(parameters, problems);
}

/* adds bytes to a 64-bit FNV-1a hash. The guid is the hash of the name of the model; of the names,
 * units, causalities, shapes and rules of all variables; of the start values of parameters and
 * inputs; and, for a fused system, of its connections and schedule (`structure`). */
static inline uint64_t fold(uint64_t hash, const void *bytes, size_t count)
{
    for (const unsigned char *b = bytes; count-- > 0; b++)
        hash = (hash ^ *b) * UINT64_C(1099511628211);
    return hash;
}
static inline uint64_t fold_text(uint64_t hash, const char *text)
{
    return fold(hash, text, strlen(text) + 1);
}

static inline uint64_t fingerprint(const ModelInterface *m, uint64_t hash)
{
    hash = fold_text(hash, m->name);
    if (m->structure) hash = fold_text(hash, m->structure);
    for (size_t i = 0; i < m->variable_count; i++) {
        const Variable *v = &m->variables[i];
        unsigned char shape[] = {(unsigned char)v->causality, (unsigned char)v->size,
                                 (unsigned char)v->columns, (unsigned char)v->rule};
        hash = fold(fold_text(fold_text(hash, v->name), v->unit), shape, sizeof shape);
        if (v->causality != OUTPUT_ROW)
            hash = fold(hash, values_from(m->start, (Scalar){v, 0}), v->size * sizeof(double));
    }
    return hash;
}

static inline const char *guid_of(const ModelInterface *m, char buffer[GUID_SIZE])
{
    uint64_t a = fingerprint(m, UINT64_C(14695981039346656037)), b = fingerprint(m, a);
    snprintf(buffer, GUID_SIZE, "{%08x-%04x-%04x-%04x-%04x%08x}", (unsigned)(a >> 32),
             (unsigned)(a >> 16 & 0xffff), (unsigned)(a & 0xffff), (unsigned)(b >> 48),
             (unsigned)(b >> 32 & 0xffff), (unsigned)(b & 0xffffffff));
    return buffer;
}

#endif
