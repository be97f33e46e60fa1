/* fmi3_layer.h - what the files of FMI 3.0 share: its functions, and a refused call in its terms. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef FMI3_LAYER_H
#define FMI3_LAYER_H

#include "fmi3Functions.h"
#include "instance.h"

static inline void hand_over(const Instance *instance, Status status, const char *category,
                             char *line)
{
    ((fmi3LogMessageCallback)instance->call.logger)(instance->call.environment, (fmi3Status)status,
                                                    category, line);
}

static inline fmi3Status failure(const Instance *instance, const char *function, const char *text)
{
    refuse_call(instance, function, text);
    return fmi3Error;
}

#endif
