/* replay.c - Windows program: drives one FMU library with recorded inputs and writes its outputs,
 * all as raw doubles.
 *
 *     replay LIBRARY IN OUT
 * IN: guid (64 bytes), counts of parameters, inputs, outputs, steps (uint32), step size; value
 * references of the three; parameter values; then one row of inputs per step. OUT: one row of
 * outputs after initialization and after every step. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <windows.h>

#include "fmi2FunctionTypes.h"

static void stop(const char *what)
{
    fprintf(stderr, "replay: %s\n", what);
    exit(1);
}

static void *take(FILE *file, size_t size, size_t count)
{
    void *data = calloc(count + 1, size);
    if (!data || fread(data, size, count, file) != count) stop("input too short");
    return data;
}

static void log_line(fmi2ComponentEnvironment env, fmi2String name, fmi2Status status,
                     fmi2String category, fmi2String text, ...)
{
    (void)env, (void)status;
    fprintf(stderr, "%s: %s: %s\n", name, category, text);
}

#define FUNCTION(name) name##TYPE *name = (name##TYPE *)(void *)GetProcAddress(library, #name)
#define CALL(call)                         \
    do {                                   \
        if ((call) != fmi2OK) stop(#call); \
    } while (0)

int main(int argc, char **argv)
{
    if (argc != 4) stop("three arguments");
    HMODULE library = LoadLibraryA(argv[1]);
    FILE *in = fopen(argv[2], "rb"), *out = fopen(argv[3], "wb");
    if (!library || !in || !out) stop("cannot open");
    FUNCTION(fmi2Instantiate);
    FUNCTION(fmi2SetupExperiment);
    FUNCTION(fmi2EnterInitializationMode);
    FUNCTION(fmi2ExitInitializationMode);
    FUNCTION(fmi2SetReal);
    FUNCTION(fmi2DoStep);
    FUNCTION(fmi2GetReal);

    char *guid = take(in, 1, 64);
    uint32_t *n = take(in, sizeof(uint32_t), 4);
    double h = *(double *)take(in, sizeof(double), 1);
    uint32_t *parameters = take(in, 4, n[0]), *inputs = take(in, 4, n[1]),
             *outputs = take(in, 4, n[2]);
    double *values = take(in, 8, n[0]), *row = calloc(n[2] + 1, 8);

    fmi2CallbackFunctions callbacks = {log_line, calloc, free, NULL, NULL};
    fmi2Component c =
        fmi2Instantiate("replay", fmi2CoSimulation, guid, "", &callbacks, fmi2False, fmi2False);
    if (!c) stop("fmi2Instantiate");
    CALL(fmi2SetReal(c, parameters, n[0], values));
    CALL(fmi2SetupExperiment(c, fmi2False, 0, 0, fmi2False, 0));
    CALL(fmi2EnterInitializationMode(c));
    CALL(fmi2ExitInitializationMode(c));
    for (uint32_t k = 0; k <= n[3]; k++) {
        CALL(fmi2GetReal(c, outputs, n[2], row));
        fwrite(row, 8, n[2], out);
        if (k == n[3]) break;
        double *u = take(in, 8, n[1]);
        CALL(fmi2SetReal(c, inputs, n[1], u));
        CALL(fmi2DoStep(c, k * h, h, fmi2True));
        free(u);
    }
    return fclose(out);
}
