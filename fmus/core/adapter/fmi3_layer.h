/* fmi3_layer.h - shared by the files that implement FMI 3.0: the function that calls the importer's
 * logger, and the function that rejects a call with the status fmi3Error. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef FMI3_LAYER_H
#define FMI3_LAYER_H

#include "fmi3Functions.h"
#include "instance.h"

static inline void call_fmi3_logger(const Instance *instance, Status status, const char *category,
                                    char *line)
{
    ((fmi3LogMessageCallback)instance->call.logger)(instance->call.environment, (fmi3Status)status,
                                                    category, line);
}

static inline fmi3Status failure(const Instance *instance, const char *function, const char *text)
{
    reject_call(instance, function, text);
    return fmi3Error;
}

#endif
