# SPDX-License-Identifier: BSD-2-Clause
"""Reading and writing values: any selection in any order is what reading and writing one by one
is.
"""

from __future__ import annotations

import random

import pytest

from tests.compliance import api
from tests.compliance.api import Status
from tests.compliance.probe import Instance, excitation
from tests.compliance.rejections import rejected
from tests.each import Each


@pytest.fixture
def rng():
    return Each(range(5)).map(random.Random)


def selection(rng, variables):
    """Pieces of the list, some backwards, with gaps and repetitions, across the borders of
    vectors.
    """
    pieces = []
    for _ in range(6):
        begin = rng.randrange(len(variables))
        piece = variables[begin : begin + rng.randrange(1, 12)]
        pieces += piece[:: rng.choice((1, 1, -1, 2))]
    return pieces


def test_any_selection_is_read_as_one_by_one(running, rng):
    chosen = selection(rng, running.fmu.about.variables)
    assert list(running.values(chosen)) == [running.get(v.name) for v in chosen]


def test_any_selection_is_written_as_one_by_one(fmu, rng):
    """Also with a variable given twice: the last value counts."""
    if not fmu.inputs:
        pytest.skip(f"{fmu.name} has no inputs")
    chosen = selection(rng, fmu.inputs)
    values = [excitation(fmu.inputs, k)[v.name] for k, v in enumerate(chosen)]
    with Instance(fmu) as together, Instance(fmu) as single:
        together.start()
        single.start()
        references = api.references([v.reference for v in chosen])
        together.ok("fmi2SetReal", references, len(chosen), api.reals(values))
        for v, value in zip(chosen, values, strict=True):
            single.set({v.name: value})
        assert bytes(together.values(fmu.inputs)) == bytes(single.values(fmu.inputs))
        assert together.simulate(3) == single.simulate(3)


def test_calls_that_are_repeated_read_and_write_as_one_by_one(fmu, rng):
    """The adapter remembers the variables of the last calls of a running instance, if the calls are
    neither too long nor too scattered; here there are three in turn, then each again and again.
    """
    if not fmu.inputs:
        pytest.skip(f"{fmu.name} has no inputs")
    calls = [selection(rng, fmu.inputs) for _ in range(3)]
    seen = [selection(rng, fmu.outputs) for _ in range(3)]
    with Instance(fmu) as together, Instance(fmu) as single:
        together.start()
        single.start()
        for k, number in enumerate((0, 1, 2, 0, 1, 2, 2, 2, 1, 1, 0, 0)):
            values = [excitation(fmu.inputs, k + i)[v.name] for i, v in enumerate(calls[number])]
            references = api.references([v.reference for v in calls[number]])
            together.ok("fmi2SetReal", references, len(references), api.reals(values))
            for v, value in zip(calls[number], values, strict=True):
                single.set({v.name: value})
            assert bytes(together.values(fmu.inputs)) == bytes(single.values(fmu.inputs))
            for one in (together, single):
                one.step(0.1 * k, 0.1)
            assert list(together.values(seen[number])) == [single.get(v.name) for v in seen[number]]


def test_bounds_hold_in_calls_that_are_repeated(fmu, rng):
    """Wherever the bounded input is, and however the others lie about it."""
    bounded = [v for v in fmu.inputs if beyond(v)]
    if not bounded:
        pytest.skip(f"{fmu.name} has no input with a bound")
    chosen = selection(rng, fmu.inputs) + bounded + selection(rng, fmu.inputs)
    references = api.references([v.reference for v in chosen])
    good = [excitation(fmu.inputs, 7)[v.name] for v in chosen]
    with Instance(fmu) as instance:
        instance.start()
        for _ in range(3):
            instance.ok("fmi2SetReal", references, len(chosen), api.reals(good))
        for place, v in enumerate(chosen):
            for value in beyond(v):
                spoiled = api.reals([*good[:place], value, *good[place + 1 :]])
                with rejected(instance, "fmi2SetReal", v.name) as answer:
                    answer.append(instance.call("fmi2SetReal", references, len(chosen), spoiled))


def beyond(v):
    """Finite values that the bounds of a variable exclude."""
    values = [-1e-9] if v.low == 0 else []
    return [*values, 0.5, 1.0000001] if v.high == 1 else values


@pytest.mark.parametrize("function", ["fmi2SetReal", "fmi2GetReal"])
def test_an_unknown_reference_is_found_in_any_position(running, rng, function):
    known = [
        v.reference
        for v in (running.fmu.inputs if function == "fmi2SetReal" else running.fmu.outputs)
    ]
    if not known:
        pytest.skip(f"{running.fmu.name} has no inputs")
    references = known[: rng.randrange(1, 20)]
    beyond_a_row = next(r + 1 for r in known if r + 1 not in known)
    for place in range(len(references) + 1):
        spoiled = [*references[:place], beyond_a_row, *references[place:]]
        values = api.reals([1.0] * len(spoiled))
        running.host.messages.clear()
        assert running.call(function, api.references(spoiled), len(spoiled), values) is Status.ERROR
        assert str(beyond_a_row) in running.host.errors[0]


def test_nothing_is_written_beyond_the_requested_values(running):
    guard = 1.5e300
    for v in running.fmu.outputs[::3]:
        buffer = api.reals([guard] * 3)
        running.ok("fmi2GetReal", api.references([v.reference]), 1, buffer)
        assert list(buffer[1:]) == [guard, guard]
