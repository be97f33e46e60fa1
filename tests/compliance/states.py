# SPDX-License-Identifier: BSD-2-Clause
"""Which calls FMI 2.0 allows in which state of a co-simulation slave (section 4.2.4), and how to
get there.

Our slaves never return fmi2Pending or fmi2Discard from fmi2DoStep, so the states stepInProgress,
stepFailed and stepCanceled do not occur.
"""

from __future__ import annotations

import sys
from ctypes import byref, c_int, c_void_p

from tests.compliance import api
from tests.compliance.api import Status
from tests.compliance.probe import Instance

STATES = ("instantiated", "initialization mode", "step complete", "terminated", "error")

TABLE = """
                              instantiated  initialization mode  step complete  terminated  error
fmi2SetDebugLogging                x                 x                 x            x         x
fmi2SetupExperiment                x                 .                 .            .         .
fmi2EnterInitializationMode        x                 .                 .            .         .
fmi2ExitInitializationMode         .                 x                 .            .         .
fmi2Terminate                      .                 .                 x            .         .
fmi2Reset                          x                 x                 x            x         x
fmi2GetReal                        .                 x                 x            x         x
fmi2GetInteger                     .                 x                 x            x         x
fmi2GetBoolean                     .                 x                 x            x         x
fmi2GetString                      .                 x                 x            x         x
fmi2SetReal                        x                 x                 x            .         .
fmi2SetInteger                     x                 x                 x            .         .
fmi2SetBoolean                     x                 x                 x            .         .
fmi2SetString                      x                 x                 x            .         .
fmi2GetFMUstate                    x                 x                 x            x         x
fmi2SetFMUstate                    x                 x                 x            x         x
fmi2FreeFMUstate                   x                 x                 x            x         x
fmi2SerializedFMUstateSize         x                 x                 x            x         x
fmi2SerializeFMUstate              x                 x                 x            x         x
fmi2DeSerializeFMUstate            x                 x                 x            x         x
fmi2GetDirectionalDerivative       .                 x                 x            x         x
fmi2SetRealInputDerivatives        x                 x                 x            .         .
fmi2GetRealOutputDerivatives       .                 .                 x            x         x
fmi2DoStep                         .                 .                 x            .         .
fmi2CancelStep                     .                 .                 .            .         .
fmi2GetStatus                      .                 .                 x            x         o
fmi2GetRealStatus                  .                 .                 x            x         o
fmi2GetIntegerStatus               .                 .                 x            x         o
fmi2GetBooleanStatus               .                 .                 x            x         o
fmi2GetStringStatus                .                 .                 x            x         o
"""
"""x: allowed, .: forbidden, o: forbidden by the standard and answered nevertheless, because a
master that meets a failed step requests fmi2LastSuccessfulTime, and the answer does no harm.
"""

RULES = {
    line.split()[0]: dict(zip(STATES, line.split()[1:], strict=True))
    for line in TABLE.splitlines()[2:]
}


def allowed(function: str, state: str) -> bool:
    return RULES[function][state] != "."


# ---- how to get there


def overflow(instance: Instance) -> Status:
    """A step with the largest finite inputs: of most models it overflows."""
    largest = sys.float_info.max
    instance.set({v.name: min(v.high, largest) for v in instance.fmu.inputs})
    return instance.call("fmi2DoStep", 0.0, 10.0, 0)


def bring(instance: Instance, state: str) -> bool:
    """A fresh instance to the state; False where no input can make a step fail."""
    if state == "initialization mode":
        instance.enter()
    elif state != "instantiated":
        instance.start()
    if state == "terminated":
        instance.ok("fmi2Terminate")
    return state != "error" or overflow(instance) is Status.ERROR


# ---- a call of every function that is right but for the state


def _serialize(instance: Instance, state: c_void_p) -> Status:
    size = len(instance.serialize(state))
    return instance.call("fmi2SerializeFMUstate", state, (api.c_char * size)(), size)


def _deserialize(instance: Instance, state: c_void_p) -> Status:
    copy = c_void_p()
    status = instance.try_deserialize(instance.serialize(state), copy)
    instance.drop(copy)
    return status


STATE_CALLS = {
    "fmi2GetFMUstate": lambda instance, state: instance.call("fmi2GetFMUstate", byref(state)),
    "fmi2SetFMUstate": lambda instance, state: instance.call("fmi2SetFMUstate", state),
    "fmi2FreeFMUstate": lambda instance, _: instance.call(
        "fmi2FreeFMUstate", byref(instance.save())
    ),
    "fmi2SerializedFMUstateSize": lambda instance, state: instance.call(
        "fmi2SerializedFMUstateSize", state, byref(api.c_size_t())
    ),
    "fmi2SerializeFMUstate": _serialize,
    "fmi2DeSerializeFMUstate": _deserialize,
}


def _read(instance: Instance) -> Status:
    outputs = api.references([v.reference for v in instance.fmu.outputs])
    return instance.call("fmi2GetReal", outputs, len(outputs), api.reals([0.0] * len(outputs)))


ARGUMENTS = {
    "fmi2SetDebugLogging": (1, 0, None),
    "fmi2SetupExperiment": (0, 0.0, 0.0, 0, 0.0),
    **{
        f"fmi2{verb}{kind}": (None, 0, None)
        for verb in ("Get", "Set")
        for kind in ("Integer", "Boolean", "String")
    },
    "fmi2SetRealInputDerivatives": (None, 0, None, None),
    "fmi2GetRealOutputDerivatives": (None, 0, None, None),
    "fmi2DoStep": (0.0, 0.1, 0),
    "fmi2GetStatus": (api.DO_STEP_STATUS, byref(c_int())),
    "fmi2GetRealStatus": (api.LAST_SUCCESSFUL_TIME, byref(api.c_double())),
    "fmi2GetIntegerStatus": (api.DO_STEP_STATUS, byref(c_int())),
    "fmi2GetBooleanStatus": (api.TERMINATED, byref(c_int())),
    "fmi2GetStringStatus": (api.PENDING_STATUS, byref(api.c_char_p())),
}

UNKNOWN_STATUS = {"fmi2GetStatus", "fmi2GetIntegerStatus", "fmi2GetStringStatus"}
"""Answered with fmi2Discard, as FMI 2.0 requires for a status that the slave does not have."""


def attempt(instance: Instance, function: str) -> Status:
    """Make the call with good arguments for t = 0."""
    if function in STATE_CALLS:
        state = instance.save()
        status = STATE_CALLS[function](instance, state)
        instance.drop(state)
        return status
    if function == "fmi2SetReal":
        return instance.try_set({v.name: v.start for v in instance.fmu.inputs})
    if function == "fmi2GetReal":
        return _read(instance)
    if function == "fmi2GetDirectionalDerivative":
        return instance.derivative(instance.fmu.inputs, [0.0] * len(instance.fmu.inputs))[0]
    return instance.call(function, *ARGUMENTS.get(function, ()))


def right_answer(function: str) -> Status:
    return Status.DISCARD if function in UNKNOWN_STATUS else Status.OK
