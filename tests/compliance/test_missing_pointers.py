# SPDX-License-Identifier: BSD-2-Clause
"""Null pointers where the standard requires an array or a place for a result, and requests that
have no answer.
"""

from __future__ import annotations

from ctypes import byref, c_char, c_double, c_int, c_size_t, c_void_p

import pytest

from tests.compliance import api
from tests.compliance.api import Status
from tests.compliance.rejections import assert_usable, rejected

ONE = api.references([0])
MISSING_POINTERS = [
    ("fmi2SetReal", (None, 1, api.reals([1.0]))),
    ("fmi2SetReal", (ONE, 1, None)),
    ("fmi2GetReal", (None, 1, api.reals([1.0]))),
    ("fmi2GetReal", (ONE, 1, None)),
    ("fmi2SetDebugLogging", (1, 1, None)),
    ("fmi2SetDebugLogging", (1, 1, (api.c_char_p * 1)(None))),
    ("fmi2GetFMUstate", (None,)),
    ("fmi2SetFMUstate", (None,)),
    ("fmi2SerializedFMUstateSize", (None, byref(c_size_t()))),
    ("fmi2SerializeFMUstate", (None, (c_char * 9)(), 9)),
    ("fmi2DeSerializeFMUstate", (None, 9, byref(c_void_p()))),
    ("fmi2DeSerializeFMUstate", ((c_char * 9)(), 9, None)),
    ("fmi2GetDirectionalDerivative", (None, 1, None, 0, None, api.reals([0.0]))),
    ("fmi2GetDirectionalDerivative", (None, 0, None, 1, api.reals([0.0]), None)),
    ("fmi2GetDirectionalDerivative", (None, 0, ONE, 1, None, None)),
    ("fmi2GetRealStatus", (api.LAST_SUCCESSFUL_TIME, None)),
    ("fmi2GetBooleanStatus", (api.TERMINATED, None)),
]


@pytest.mark.parametrize(
    ("function", "arguments"), MISSING_POINTERS, ids=lambda x: x if isinstance(x, str) else ""
)
def test_missing_arrays_and_pointers_are_rejected(running, function, arguments):
    with rejected(running, function) as answer:
        answer.append(running.call(function, *arguments))
    assert_usable(running)


def test_missing_places_of_states_and_derivatives_are_rejected(running):
    state = running.save()
    output = api.references([running.fmu.outputs[0].reference])
    size = len(running.serialize(state))
    for function, arguments in (
        ("fmi2SerializedFMUstateSize", (state, None)),
        ("fmi2SerializeFMUstate", (state, None, size)),
        ("fmi2SerializeFMUstate", (state, (c_char * size)(), size - 1)),
        ("fmi2GetDirectionalDerivative", (output, 1, None, 0, None, None)),
    ):
        with rejected(running, function) as answer:
            answer.append(running.call(function, *arguments))
    running.drop(state)


def test_nothing_at_all_may_be_read_set_and_freed(running):
    for function in ("fmi2SetReal", "fmi2GetReal"):
        running.ok(function, None, 0, None)
    running.ok("fmi2GetDirectionalDerivative", None, 0, None, 0, None, None)
    running.ok("fmi2FreeFMUstate", None)
    running.ok("fmi2FreeFMUstate", byref(c_void_p()))
    assert_usable(running)


# ---- status questions


@pytest.mark.parametrize(
    ("function", "kind", "place"),
    [
        ("fmi2GetStatus", api.DO_STEP_STATUS, c_int()),
        ("fmi2GetIntegerStatus", api.DO_STEP_STATUS, c_int()),
        ("fmi2GetStringStatus", api.PENDING_STATUS, api.c_char_p()),
        ("fmi2GetRealStatus", api.PENDING_STATUS, c_double()),
        ("fmi2GetBooleanStatus", api.DO_STEP_STATUS, c_int()),
        ("fmi2GetStatus", 99, c_int()),
    ],
)
def test_an_unknown_status_is_discarded_with_a_message(running, function, kind, place):
    running.host.messages.clear()
    assert running.call(function, kind, byref(place)) is Status.DISCARD
    (message,) = running.host.messages
    assert message.text.startswith(f"{function}: ")


def test_the_time_of_the_last_success_and_no_termination_are_reported(running):
    time, terminated = c_double(), c_int(7)
    running.ok("fmi2GetRealStatus", api.LAST_SUCCESSFUL_TIME, byref(time))
    running.ok("fmi2GetBooleanStatus", api.TERMINATED, byref(terminated))
    assert (time.value, terminated.value) == (0.5, 0)
