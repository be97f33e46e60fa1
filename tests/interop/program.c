/* program.c - a system of the project as one program without FMI: prints the bits of its last outputs
 * and a hash of the outputs of all macro steps (FNV-1a).
 *
 * The test writes program.inc: models, values, copies, outputs, and the experiment. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "interface.h"

#include <inttypes.h>
#include <stdlib.h>

typedef struct { unsigned part, reference; } Place;
typedef struct {
    Place place;
    double value;
} Setting;
typedef struct { Place from, to; } Wire;

#include "program.inc"

#define PARTS COUNT(parts)
static void *memory[PARTS];

static double *at(Place p)
{
    return pointer_to(memory[p.part], scalar_of(parts[p.part], p.reference));
}

static void receive(unsigned part)
{
    for (size_t i = 0; i < COUNT(wires); i++)
        if (wires[i].to.part == part) *at(wires[i].to) = *at(wires[i].from);
}

/* as many rounds as there are parts, as in harness/bench/monolith.py */
static void initialize_all(void)
{
    for (unsigned i = 0; i < PARTS; i++) {
        memory[i] = malloc(memory_of(parts[i]));
        if (!memory[i]) abort();
        memcpy(memory[i], parts[i]->start, parts[i]->size);
    }
    for (size_t i = 0; i < COUNT(settings); i++) *at(settings[i].place) = settings[i].value;
    for (unsigned round = 0; round < PARTS; round++)
        for (unsigned i = 0; i < PARTS; i++) receive(i), parts[i]->initialize(memory[i], START);
}

int main(void)
{
    uint64_t hash = UINT64_C(0xcbf29ce484222325);
    initialize_all();
    for (long k = 0; k < STEPS; k++) {
        for (unsigned i = 0; i < PARTS; i++)
            receive(i), parts[i]->step(memory[i], START + (double)k * STEP, STEP);
        for (size_t i = 0; i < COUNT(outputs); i++)
            hash = (hash ^ bits_of(*at(outputs[i]))) * UINT64_C(0x100000001b3);
    }
    printf("%016" PRIx64 "\n", hash);
    for (size_t i = 0; i < COUNT(outputs); i++)
        printf("%016" PRIx64 "\n", bits_of(*at(outputs[i])));
    return 0;
}
