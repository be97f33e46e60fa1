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


@pytest.fixture(params=range(5))
def rng(request):
    return random.Random(request.param)


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


def test_any_selection_is_read_as_one_by_one(flying, rng):
    chosen = selection(rng, flying.fmu.about.variables)
    assert list(flying.values(chosen)) == [flying.get(v.name) for v in chosen]


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
        assert together.fly(3) == single.fly(3)


@pytest.mark.parametrize("function", ["fmi2SetReal", "fmi2GetReal"])
def test_an_unknown_reference_is_found_wherever_it_stands(flying, rng, function):
    known = [
        v.reference
        for v in (flying.fmu.inputs if function == "fmi2SetReal" else flying.fmu.outputs)
    ]
    if not known:
        pytest.skip(f"{flying.fmu.name} has no inputs")
    references = known[: rng.randrange(1, 20)]
    beyond_a_row = next(r + 1 for r in known if r + 1 not in known)
    for place in range(len(references) + 1):
        spoiled = [*references[:place], beyond_a_row, *references[place:]]
        values = api.reals([1.0] * len(spoiled))
        flying.host.messages.clear()
        assert flying.call(function, api.references(spoiled), len(spoiled), values) is Status.ERROR
        assert str(beyond_a_row) in flying.host.errors[0]


def test_nothing_is_written_beyond_the_values_asked_for(flying):
    guard = 1.5e300
    for v in flying.fmu.outputs[::3]:
        buffer = api.reals([guard] * 3)
        flying.ok("fmi2GetReal", api.references([v.reference]), 1, buffer)
        assert list(buffer[1:]) == [guard, guard]
