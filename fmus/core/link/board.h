/* board.h - the board's end of the protocol: FMUs on one byte stream, with one instance of each.
 *
 * The processor runs the unchanged FMU; the board calls it by FMI 2.0 as any master does. A board
 * needs a driver: two functions that read and write bytes. */
/* SPDX-License-Identifier: BSD-2-Clause */
#ifndef BOARD_H
#define BOARD_H

#include "fmi2FunctionTypes.h"
#include "protocol.h"

typedef struct {
    const char *name, *guid;
    uint32_t variables; /* number of scalar variables in the model description of the FMU */
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
    fmi2GetFMUstateTYPE *get_state; /* this and all following: NULL if the FMU has no FMU states */
    fmi2SetFMUstateTYPE *set_state;
    fmi2FreeFMUstateTYPE *free_state;
    fmi2SerializedFMUstateSizeTYPE *state_size;
    fmi2SerializeFMUstateTYPE *serialize;
    fmi2DeSerializeFMUstateTYPE *deserialize;
} Software;

/* number of steps; instructions of all steps and of the most expensive one, by counter() */
typedef struct {
    uint64_t steps, total, largest;
    double when; /* s; communication point of the most expensive step */
} Cost;

typedef struct {
    fmi2Component instance;
    uint32_t first, last; /* sequence numbers of the first and the latest request of this session */
    bool described;
    uint32_t memory; /* bytes that the instance has allocated */
    Cost cost;
} Slot;

typedef struct {
    const char *target; /* name of the processor, for example "cortex-m7" */
    const Software *software;
    Slot *slot; /* instance and session of each FMU of `software` */
    size_t count;
    size_t (*read)(void *port, void *bytes,
                   size_t most); /* returns the bytes read, at least 1; 0: end of the stream */
    bool (*write)(void *port, const void *bytes, size_t count);
    void *port;
    uint64_t (*counter)(void);       /* number of instructions so far; NULL: not counted */
    void (*paint_stack)(void);       /* begins to measure the stack; NULL: not measured */
    uint32_t (*measure_stack)(void); /* bytes of stack used since paint_stack() */
} Board;

/* answers requests until the stream ends */
void serve(const Board *board);

#endif
