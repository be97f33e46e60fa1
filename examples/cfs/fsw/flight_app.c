/* flight_app.c - adaptive_controller as an app of cFS: inputs in, one step per wakeup, outputs out.
 *
 * Parameters are a cFE table, which is checked before it becomes active. Rejected inputs and results
 * are events; after a rejected step states and outputs return to the step before. */
/* SPDX-License-Identifier: BSD-2-Clause */
#include "cfe.h"

#include "adaptive_controller_parameters.h"

enum { INPUT_MID = 0x1950, WAKEUP_MID = 0x1951, OUTPUT_MID = 0x0950 }; /* of the mission */
enum { PARAMETERS_EID = 1, INPUTS_EID, RESULT_EID };
#define PERIOD 0.1 /* s, of the wakeups */

typedef struct {
    CFE_MSG_CommandHeader_t header;
    adaptive_controller_Input u;
} InputMessage;
typedef struct {
    CFE_MSG_TelemetryHeader_t header;
    adaptive_controller_Output y;
} OutputMessage;

static adaptive_controller_Parameters p;
static adaptive_controller_Input u;
static adaptive_controller_State x;
static OutputMessage out;

static int32 check_table(void *table)
{
    char text[100];
    if (adaptive_controller_check(table, text, sizeof text) == 0) return CFE_SUCCESS;
    CFE_EVS_SendEvent(PARAMETERS_EID, CFE_EVS_EventType_ERROR, "%s", text);
    return CFE_STATUS_VALIDATION_FAILURE;
}

static void step(double k)
{
    const adaptive_controller_State last = x;
    const adaptive_controller_Output before = out.y;
    if (!adaptive_controller_good(&u, NULL, NULL)) {
        CFE_EVS_SendEvent(INPUTS_EID, CFE_EVS_EventType_ERROR, "step %.0f: inputs rejected", k);
        return;
    }
    adaptive_controller_step(&p, &u, &x, &out.y, adaptive_controller_time(0, k, PERIOD), PERIOD);
    if (!adaptive_controller_good(NULL, &x, &out.y)) {
        x = last;
        out.y = before;
        CFE_EVS_SendEvent(RESULT_EID, CFE_EVS_EventType_ERROR, "step %.0f: result rejected", k);
    }
    CFE_SB_TimeStampMsg(CFE_MSG_PTR(out.header));
    CFE_SB_TransmitMsg(CFE_MSG_PTR(out.header), true);
}

static CFE_Status_t start(CFE_SB_PipeId_t *pipe)
{
    CFE_TBL_Handle_t handle;
    void *table;
    CFE_EVS_Register(NULL, 0, CFE_EVS_EventFilter_BINARY);
    CFE_SB_CreatePipe(pipe, 10, "INPUTS_PIPE");
    CFE_SB_Subscribe(CFE_SB_ValueToMsgId(INPUT_MID), *pipe);
    CFE_SB_Subscribe(CFE_SB_ValueToMsgId(WAKEUP_MID), *pipe);
    CFE_MSG_Init(CFE_MSG_PTR(out.header), CFE_SB_ValueToMsgId(OUTPUT_MID), sizeof out);
    CFE_TBL_Register(&handle, "Parameters", sizeof p, CFE_TBL_OPT_DEFAULT, check_table);
    CFE_TBL_Load(handle, CFE_TBL_SRC_ADDRESS, &adaptive_controller_parameters_default);
    if (CFE_TBL_GetAddress(&table, handle) < CFE_SUCCESS) return CFE_STATUS_VALIDATION_FAILURE;
    adaptive_controller_defaults(&p, &u);
    memcpy(&p, table, sizeof p); /* constant after the initialization */
    adaptive_controller_init(&p, &u, &x, &out.y, 0);
    return CFE_TBL_ReleaseAddress(handle);
}

void FLIGHT_APP_Main(void)
{
    uint32 status = CFE_ES_RunStatus_APP_RUN;
    CFE_SB_PipeId_t pipe;
    CFE_SB_Buffer_t *buffer;
    CFE_SB_MsgId_t id;
    double k = 0;
    if (start(&pipe) < CFE_SUCCESS) status = CFE_ES_RunStatus_APP_ERROR;
    while (CFE_ES_RunLoop(&status)) {
        if (CFE_SB_ReceiveBuffer(&buffer, pipe, CFE_SB_PEND_FOREVER) != CFE_SUCCESS) continue;
        CFE_MSG_GetMsgId(&buffer->Msg, &id);
        if (CFE_SB_MsgIdToValue(id) == INPUT_MID)
            u = ((const InputMessage *)(const void *)buffer)->u;
        else step(k++);
    }
    CFE_ES_ExitApp(status);
}
