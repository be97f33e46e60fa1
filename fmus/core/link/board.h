/* board.h - the board's end of the protocol: FMUs on one byte stream, one instance of each.
 *
 * What runs on the processor is the FMU as it is; the board calls it by FMI 2.0 as any master does.
 * A board needs a driver: two functions that read and write bytes. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef BOARD_H
#define BOARD_H

#include "fmi2FunctionTypes.h"
#include "protocol.h"

typedef struct {
    const char *name, *guid;
    uint32_t variables; /* scalar variables of its model description */
    fmi2InstantiateTYPE *instantiate;
    fmi2FreeInstanceTYPE *free_instance;
    fmi2ResetTYPE *reset;
    fmi2SetupExperimentTYPE *setup_experiment;
    fmi2EnterInitializationModeTYPE *enter_initialization;
    fmi2ExitInitializationModeTYPE *exit_initialization;
    fmi2TerminateTYPE *terminate;
    fmi2SetRealTYPE *set_real;
    fmi2GetRealTYPE *get_real;
    fmi2SetIntegerTYPE *set_integer;
    fmi2GetIntegerTYPE *get_integer;
    fmi2SetBooleanTYPE *set_boolean;
    fmi2GetBooleanTYPE *get_boolean;
    fmi2DoStepTYPE *do_step;
    fmi2GetFMUstateTYPE *get_state; /* this and the rest: NULL if it cannot save its state */
    fmi2SetFMUstateTYPE *set_state;
    fmi2FreeFMUstateTYPE *free_state;
    fmi2SerializedFMUstateSizeTYPE *state_size;
    fmi2SerializeFMUstateTYPE *serialize;
    fmi2DeSerializeFMUstateTYPE *deserialize;
} Software;

/* what steps have cost, by the counter of the board */
typedef struct {
    uint64_t steps, total, largest;
    double when; /* s; communication point of the largest */
} Cost;

typedef struct {
    fmi2Component instance;
    uint32_t first, last; /* sequence numbers of the session */
    bool described;
    uint32_t memory; /* bytes that the instance has allocated */
    Cost cost;
} Slot;

typedef struct {
    const char *target; /* "cortex-m7" */
    const Software *software;
    Slot *slot; /* as many */
    size_t count;
    size_t (*read)(void *port, void *bytes, size_t most); /* at least one byte; 0: the end */
    bool (*write)(void *port, const void *bytes, size_t count);
    void *port;
    uint64_t (*counter)(void);       /* instructions; NULL: nobody counts */
    void (*paint_stack)(void);       /* NULL: nobody measures it */
    uint32_t (*measure_stack)(void); /* bytes used since it was painted */
} Board;

/* answers until the stream ends */
void serve(const Board *board);

#endif
