/* link_values.c - setting and getting.
 *
 * Values that the master sets are sent with the next step, or earlier by a call that needs them;
 * before the end of initialization they are sent at once. Variables that the master has read once
 * are part of the answer to every step. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "link.h"

static Entry *find_entry(Link *l, ValueType type, const fmi2ValueReference vr[], size_t i,
                         size_t *at)
{
    Entry *e = find_or_add_entry(l, type, vr[i], *at);
    if (e) *at = (size_t)(e - l->entry) + 1;
    return e;
}

static fmi2Status set_values(Link *l, ValueType type, const fmi2ValueReference vr[], size_t count,
                             const fmi2Real real[], const fmi2Integer integer[])
{
    size_t at = 0;
    for (size_t i = 0; i < count; i++) {
        Entry *e = find_entry(l, type, vr, i, &at);
        if (!e) return failure(l, "fmi2Set", "out of memory");
        if (real) e->real = real[i];
        else e->integer = integer[i];
        e->pending = true;
    }
    return l->stepping ? fmi2OK : send_pending(l);
}

static fmi2Status get_values(Link *l, ValueType type, const fmi2ValueReference vr[], size_t count,
                             fmi2Real real[], fmi2Integer integer[])
{
    size_t at = 0;
    for (size_t i = 0; i < count; i++) {
        Entry *e = find_entry(l, type, vr, i, &at);
        if (!e) return failure(l, "fmi2Get", "out of memory");
        e->read = true;
    }
    fmi2Status status = read_missing(l);
    for (size_t i = at = 0; i < count && status <= fmi2Warning; i++) {
        const Entry *e = find_entry(l, type, vr, i, &at);
        if (real) real[i] = e->real;
        else integer[i] = e->integer;
    }
    return status;
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                       const fmi2Real value[])
{
    return set_values(c, REAL_TYPE, vr, count, value, NULL);
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          const fmi2Integer value[])
{
    return set_values(c, INTEGER_TYPE, vr, count, NULL, value);
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          const fmi2Boolean value[])
{
    return set_values(c, BOOLEAN_TYPE, vr, count, NULL, value);
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                       fmi2Real value[])
{
    return get_values(c, REAL_TYPE, vr, count, value, NULL);
}
fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          fmi2Integer value[])
{
    return get_values(c, INTEGER_TYPE, vr, count, NULL, value);
}
fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t count,
                          fmi2Boolean value[])
{
    return get_values(c, BOOLEAN_TYPE, vr, count, NULL, value);
}
