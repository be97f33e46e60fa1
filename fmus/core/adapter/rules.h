/* rules.h - rules of the rows of a model: bounds, texts of messages, and checks whether inputs
 * and results satisfy the rules.
 *
 * The adapter of FMI, a fused system and the C interface without FMI apply the rules by these
 * functions only. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef RULES_H
#define RULES_H

#include "finite.h"
#include "fmu.h"

#include <float.h>
#include <stdbool.h>

/* lowest and highest value that a rule permits; the adapter also rejects 0 for POSITIVE_VALUE,
 * and all values except 0 and 1 for a switch */
static inline double lowest(Rule rule) { return rule == ANY_VALUE ? -DBL_MAX : 0; }
static inline int is_flag(Rule rule) { return rule == SWITCH_VALUE || rule == ALARM_VALUE; }
static inline double highest(Rule rule)
{
    return is_flag(rule) ? 1 : rule == ANGLE_VALUE ? PI : DBL_MAX;
}
static inline const char *violated_rule(Rule rule, double value) /* NULL: the value is valid */
{
    if (!isfinite(value)) return "must be finite";
    if (rule == POSITIVE_VALUE && value <= 0) return "must be > 0";
    if (is_flag(rule) && value != 0 && value != 1) return "must be 0 or 1";
    if (value < lowest(rule)) return "must be >= 0";
    return value > highest(rule) ? "must be <= pi" : NULL;
}
/* true if all of several finite values satisfy a rule; unlike violated_rule(), this function and
 * the next three give no reason */
static inline bool all_flags(const double value[], size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (!(value[i] == 0 || value[i] == 1)) return false;
    return true;
}
static inline bool all_positive(const double value[], size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (value[i] <= 0) return false;
    return true;
}
static inline bool all_within(const double value[], size_t count, double low, double high)
{
    for (size_t i = 0; i < count; i++)
        if (value[i] < low || value[i] > high) return false;
    return true;
}
static inline bool satisfy_rule(Rule rule, const double value[], size_t count)
{
    if (rule == ANY_VALUE) return true;
    if (is_flag(rule)) return all_flags(value, count);
    if (rule == POSITIVE_VALUE) return all_positive(value, count);
    return all_within(value, count, lowest(rule), highest(rule));
}

/* true if all rows of a causality satisfy their rules; values: doubles of the model from index
 * `first` on, all finite */
static inline bool satisfy_rows(const ModelInterface *m, Causality causality, const double values[],
                                size_t first)
{
    for (const Variable *v = m->variables; v < m->variables + m->variable_count; v++)
        if (v->causality == causality &&
            !satisfy_rule(v->rule, values + (v->offset / sizeof *values - first), v->size))
            return false;
    return true;
}

#endif
