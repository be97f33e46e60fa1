# SPDX-License-Identifier: BSD-2-Clause
"""The C interface of FMI 2.0 for co-simulation, as ctypes sees it: statuses, callbacks,
signatures.
"""

from __future__ import annotations

import ctypes
from ctypes import CFUNCTYPE, POINTER, c_char, c_char_p, c_double, c_int, c_size_t, c_uint, c_void_p
from enum import IntEnum
from pathlib import Path


class Status(IntEnum):
    OK = 0
    WARNING = 1
    DISCARD = 2
    ERROR = 3
    FATAL = 4
    PENDING = 5


MODEL_EXCHANGE, CO_SIMULATION = 0, 1
DO_STEP_STATUS, PENDING_STATUS, LAST_SUCCESSFUL_TIME, TERMINATED = range(4)

LOGGER = CFUNCTYPE(None, c_void_p, c_char_p, c_int, c_char_p, c_char_p)
"""The real one is variadic; the FMUs here pass finished texts and no further arguments."""
ALLOCATE = CFUNCTYPE(c_void_p, c_size_t, c_size_t)
FREE = CFUNCTYPE(None, c_void_p)
STEP_FINISHED = CFUNCTYPE(None, c_void_p, c_int)


class Callbacks(ctypes.Structure):
    _fields_ = (
        ("logger", LOGGER),
        ("allocate", ALLOCATE),
        ("free", FREE),
        ("step_finished", STEP_FINISHED),
        ("environment", c_void_p),
    )


REFERENCES, REALS, INTEGERS, TEXTS = (
    POINTER(c_uint),
    POINTER(c_double),
    POINTER(c_int),
    POINTER(c_char_p),
)
STATE, STATES, BYTES = c_void_p, POINTER(c_void_p), POINTER(c_char)

ARGUMENTS = {
    "fmi2SetDebugLogging": (c_int, c_size_t, TEXTS),
    "fmi2SetupExperiment": (c_int, c_double, c_double, c_int, c_double),
    "fmi2EnterInitializationMode": (),
    "fmi2ExitInitializationMode": (),
    "fmi2Terminate": (),
    "fmi2Reset": (),
    "fmi2GetReal": (REFERENCES, c_size_t, REALS),
    "fmi2GetInteger": (REFERENCES, c_size_t, INTEGERS),
    "fmi2GetBoolean": (REFERENCES, c_size_t, INTEGERS),
    "fmi2GetString": (REFERENCES, c_size_t, TEXTS),
    "fmi2SetReal": (REFERENCES, c_size_t, REALS),
    "fmi2SetInteger": (REFERENCES, c_size_t, INTEGERS),
    "fmi2SetBoolean": (REFERENCES, c_size_t, INTEGERS),
    "fmi2SetString": (REFERENCES, c_size_t, TEXTS),
    "fmi2GetFMUstate": (STATES,),
    "fmi2SetFMUstate": (STATE,),
    "fmi2FreeFMUstate": (STATES,),
    "fmi2SerializedFMUstateSize": (STATE, POINTER(c_size_t)),
    "fmi2SerializeFMUstate": (STATE, BYTES, c_size_t),
    "fmi2DeSerializeFMUstate": (BYTES, c_size_t, STATES),
    "fmi2GetDirectionalDerivative": (REFERENCES, c_size_t, REFERENCES, c_size_t, REALS, REALS),
    "fmi2SetRealInputDerivatives": (REFERENCES, c_size_t, INTEGERS, REALS),
    "fmi2GetRealOutputDerivatives": (REFERENCES, c_size_t, INTEGERS, REALS),
    "fmi2DoStep": (c_double, c_double, c_int),
    "fmi2CancelStep": (),
    "fmi2GetStatus": (c_int, INTEGERS),
    "fmi2GetRealStatus": (c_int, REALS),
    "fmi2GetIntegerStatus": (c_int, INTEGERS),
    "fmi2GetBooleanStatus": (c_int, INTEGERS),
    "fmi2GetStringStatus": (c_int, TEXTS),
}
"""Functions that take a component and return a status: their arguments after the component."""

EXCHANGE = {
    "fmi2EnterEventMode": (),
    "fmi2NewDiscreteStates": (c_void_p,),
    "fmi2EnterContinuousTimeMode": (),
    "fmi2CompletedIntegratorStep": (c_int, INTEGERS, INTEGERS),
    "fmi2SetTime": (c_double,),
    "fmi2SetContinuousStates": (REALS, c_size_t),
    "fmi2GetDerivatives": (REALS, c_size_t),
    "fmi2GetEventIndicators": (REALS, c_size_t),
    "fmi2GetContinuousStates": (REALS, c_size_t),
    "fmi2GetNominalsOfContinuousStates": (REALS, c_size_t),
}
"""Functions of model exchange, which some tools bind before they load any library."""

OTHERS = {
    "fmi2GetTypesPlatform": (c_char_p,),
    "fmi2GetVersion": (c_char_p,),
    "fmi2Instantiate": (
        c_void_p,
        c_char_p,
        c_int,
        c_char_p,
        c_char_p,
        POINTER(Callbacks),
        c_int,
        c_int,
    ),
    "fmi2FreeInstance": (None, c_void_p),
}
"""The rest: result, then arguments."""

FUNCTIONS = (*ARGUMENTS, *EXCHANGE, *OTHERS)


def load(path: Path) -> ctypes.CDLL:
    """The library of an FMU with every function of the interface declared."""
    library = ctypes.CDLL(str(path))
    for name, arguments in (ARGUMENTS | EXCHANGE).items():
        function = getattr(library, name)
        function.restype, function.argtypes = c_int, (c_void_p, *arguments)
    for name, (result, *arguments) in OTHERS.items():
        function = getattr(library, name)
        function.restype, function.argtypes = result, arguments
    return library


def references(values) -> ctypes.Array:
    return (c_uint * len(values))(*values)


def reals(values) -> ctypes.Array:
    return (c_double * len(values))(*values)
