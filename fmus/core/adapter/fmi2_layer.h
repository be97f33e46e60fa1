/* fmi2_layer.h - declarations shared by the files that implement FMI 2.0, and the status that
 * they return for a rejected call. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef FMI2_LAYER_H
#define FMI2_LAYER_H

#include "fmi2Functions.h"
#include "instance.h"

static inline fmi2Status failure(const Instance *instance, const char *function, const char *text)
{
    reject_call(instance, function, text);
    return fmi2Error;
}

#endif
