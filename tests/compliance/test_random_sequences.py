# SPDX-License-Identifier: BSD-2-Clause
"""Random sequences of legal and illegal calls: no crash, no status outside the standard, no call
accepted in a state that forbids it, no rejection without a message. The calls are made in a process
of their own."""

from __future__ import annotations

from math import inf, nan

import pytest
from hypothesis import given, settings
from hypothesis import strategies as some

from tests.compliance import api
from tests.compliance.api import Status
from tests.compliance.states import allowed

STATUS_FUNCTIONS = [name for name in api.ARGUMENTS if name.endswith("Status")]
OTHER_TYPES = [
    f"fmi2{verb}{kind}" for verb in ("Get", "Set") for kind in ("Integer", "Boolean", "String")
]
ORDERS = ["fmi2SetRealInputDerivatives", "fmi2GetRealOutputDerivatives"]
PLAIN = [name for name, arguments in api.ARGUMENTS.items() if not arguments]
STATE_VERBS = {
    "save": "Get",
    "restore": "Set",
    "drop": "Free",
    "serialize": "Serialize",
    "deserialize": "DeSerialize",
}

slots, places, counts = some.sampled_from([0, 0, 0, 1]), some.integers(0, 1), some.integers(0, 2)
numbers = some.sampled_from([0.0, 0.0, 1.0, -1.0, 0.3, -7.5, 1e3, nan, inf, -inf])
times = some.sampled_from([0.0, 0.0, 0.0, 0.0, 1e-12, 0.05, -0.1, 1e6, nan, inf])
lengths = some.sampled_from([0.1, 0.1, 0.1, 0.1, 0.05, 1.0, 7.3, 0.0, -0.1, 1e-9, 1e9, nan, inf])


def calls(about):
    """A strategy for one call: every kind, sensible arguments more often than others."""
    settable = [v.reference for v in about.variables if v.causality == "input"] or [0]
    every, outputs = (
        [v.reference for v in about.variables],
        [v.reference for v in about.of("output")],
    )
    any_references = some.lists(some.sampled_from([*every, 999, 10**9, 2**32 - 1]), max_size=5)
    to_set = some.lists(some.sampled_from(settable), max_size=5) | any_references
    to_get = some.lists(some.sampled_from(outputs), max_size=5) | any_references
    verbs = {
        "step": (times, lengths),
        "call": (some.sampled_from(PLAIN),),
        "set": (to_set, numbers),
        "get": (to_get,),
        "new": (),
        "setup": (numbers, some.none() | numbers),
        "save": (places,),
        "restore": (places,),
        "drop": (places,),
        "serialize": (places, places),
        "deserialize": (places, places, some.none() | some.integers(0, 10**4)),
        "derivative": (to_get, to_set, numbers),
        "other": (some.sampled_from(OTHER_TYPES), counts),
        "order": (some.sampled_from(ORDERS), counts),
        "status": (some.sampled_from(STATUS_FUNCTIONS), some.integers(-1, 4)),
        "log": (counts, some.lists(some.sampled_from(["logEvents", "logAll", ""]), max_size=2)),
    }
    weights = {"step": 4, "save": 3, "restore": 2, "serialize": 2, "deserialize": 2}
    kinds = [some.tuples(slots, some.just(verb), *arguments) for verb, arguments in verbs.items()]
    return some.one_of(
        kind for kind, verb in zip(kinds, verbs, strict=True) for _ in range(weights.get(verb, 1))
    )


BEGIN = [
    [
        (s, "new"),
        (s, "call", "fmi2EnterInitializationMode"),
        (s, "call", "fmi2ExitInitializationMode"),
    ]
    for s in (0, 1)
]
SAVES = [(0, "save", 0), (0, "serialize", 0, 0)]
"""First calls of both instances; sequences start with a part of the list, mostly the whole for the
first instance.
"""


def sequences(about):
    first = some.sampled_from([1, 2, 3, 5, 5, 5]).map(lambda n: (BEGIN[0] + SAVES)[:n])
    second = some.integers(0, 3).map(lambda n: BEGIN[1][:n])
    parts = some.tuples(first, second, some.lists(calls(about), min_size=15, max_size=40))
    return parts.map(lambda lists: [call for part in lists for call in part])


def function_of(verb, arguments):
    plain = {
        "step": "fmi2DoStep",
        "set": "fmi2SetReal",
        "get": "fmi2GetReal",
        "setup": "fmi2SetupExperiment",
    }
    rare = {"derivative": "fmi2GetDirectionalDerivative", "log": "fmi2SetDebugLogging"}
    if verb in STATE_VERBS:
        return f"fmi2{STATE_VERBS[verb]}FMUstate"
    return (plain | rare).get(verb) or arguments[0]


NEXT = {
    "fmi2EnterInitializationMode": "initialization mode",
    "fmi2ExitInitializationMode": "step complete",
    "fmi2Terminate": "terminated",
    "fmi2Reset": "instantiated",
}


class Expectation:
    """Follows the state of both instances by the answers; a step that fails may have been rejected
    or may have failed.
    """

    def __init__(self):
        self.state, self.saved, self.bytes = [None, None], {}, {}

    def follow(self, call, answer):
        slot, verb, *arguments = call
        if verb == "new":
            self.state[slot] = {"instantiated"}
        elif answer is not None:
            status, errors = answer
            function = function_of(verb, arguments)
            assert status in (Status.OK, Status.WARNING, Status.DISCARD, Status.ERROR), (
                call,
                answer,
            )
            assert (status == Status.ERROR) == (errors > 0), (call, answer)
            if not any(allowed(function, state) for state in self.state[slot]):
                assert status == Status.ERROR, (call, answer, self.state[slot])
            self.move(slot, verb, arguments, function, status)

    def move(self, slot, verb, arguments, function, status):
        if status == Status.ERROR:
            if function == "fmi2DoStep" and "step complete" in self.state[slot]:
                self.state[slot] = {"step complete", "error"}
        elif function in NEXT:
            self.state[slot] = {NEXT[function]}
        elif verb == "save":
            self.saved[arguments[0]] = self.state[slot]
        elif verb == "restore":
            self.state[slot] = self.saved[arguments[0]]
        elif verb == "serialize":
            self.bytes[arguments[1]] = self.saved[arguments[0]]
        elif verb == "deserialize":
            self.saved[arguments[1]] = self.bytes[arguments[0]]


@pytest.mark.hypothesis
def test_no_sequence_of_calls_does_harm(elsewhere, archive, about):
    few = settings().max_examples

    @settings(max_examples=6 if few < 100 else 2 * few)
    @given(sequences(about))
    def run(sequence):
        expectation = Expectation()
        for call, answer in zip(sequence, elsewhere.run(archive, sequence), strict=True):
            expectation.follow(call, answer)

    run()
