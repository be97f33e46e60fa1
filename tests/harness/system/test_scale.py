# SPDX-License-Identifier: BSD-2-Clause
"""Cost of large systems before the first step: twice as many mistakes, signals or components take
about twice the work, counted in lines of Python that are executed.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from harness import spelling
from harness.system import graph
from harness.system.interface import Interface
from harness.system.model import Component, Connection, Experiment, Port, System
from harness.system.problems import problems
from harness.system.values import Variable
from harness.system.wiring import wire

MOST = 2.5
"""Work of a system of twice the size; what goes with the square of the size has 4."""


def variable(name, causality, number, start=None):
    settable = causality in ("input", "parameter")
    return Variable(name, number, "Real", causality, "1", "", settable, start=start)


def interface(inputs=(), outputs=(), parameters=()):
    kinds = {"input": inputs, "output": outputs, "parameter": parameters}
    named = [(name, kind) for kind, names in kinds.items() for name in names]
    found = {name: variable(name, kind, k, 1.0) for k, (name, kind) in enumerate(named)}
    return Interface(Path("x.fmu"), found, {}, None)


def two(size):
    """A component with many outputs, and one with as many inputs, of other names."""
    signals = [f"signal_{i}[{k}]" for i in range(size) for k in (1, 2)]
    inputs = [f"input_{i}[{k}]" for i in range(size) for k in (1, 2)]
    return {"a": interface(outputs=signals), "b": interface(inputs=inputs)}


def misspelt_connections(size):
    ends = [(f"signl_{i}[1]", f"input_{i}[1]") for i in range(size)]
    wires = tuple(Connection(Port("a", source), Port("b", target)) for source, target in ends)
    parts = tuple(Component(name, Path("x.fmu")) for name in "ab")
    found = list(problems(System("s", parts, wires, Experiment()), two(size)))
    assert len(found) == size
    assert "a.signl_7[1]: there is no such output (close: signal_7[1]" in found[7]


def misspelt_inputs(size):
    known = {"a": two(size)["a"], "b": interface(inputs=[f"signl_{i}" for i in range(size)])}
    parts = tuple(Component(name, Path("x.fmu")) for name in "ab")
    system = System("s", parts, (), Experiment(), strict=True)
    found = list(problems(system, known))
    assert len(found) == size
    assert "b.signl_7: no output of this name (close: signal_7" in found[7]


def misspelt_sources(size):
    pairs = {f"b.input_{i}": f"a.signl_{i}" for i in range(size)}
    found = wire(two(size), pairs, [Port("b", name) for name in two(size)["b"].variables])
    assert len(found.problems) == size
    assert "a.signl_7: there is no such output (close: signal_7" in found.problems[7]


def connected_vectors(size):
    pairs = {f"b.input_{i}": f"a.signal_{i}" for i in range(size)}
    found = wire(two(size), pairs)
    assert (len(found.connections), found.problems) == (2 * size, [])


def inputs_by_name(size):
    """Many components, each of which drives the next one."""
    known = {
        f"c{i}": interface(inputs=[f"s{i}"], outputs=[f"s{i + 1}"]) for i in range(1, 10 * size)
    } | {"c0": interface(outputs=["s1"])}
    assert len(wire(known).connections) == 10 * size - 1


def components(size):
    parts = tuple(Component(f"c{i}", Path("x.fmu")) for i in range(10 * size))
    system = System("s", parts, (), Experiment(stop=1.0, step=0.25))
    assert len(graph.checked(system).graph.nodes) == 10 * size
    assert all(system.component(c.name) is c for c in parts[::10])


@pytest.mark.parametrize(
    "work",
    [
        misspelt_connections,
        misspelt_inputs,
        misspelt_sources,
        connected_vectors,
        inputs_by_name,
        components,
    ],
)
def test_twice_the_size_is_about_twice_the_work(work, monkeypatch):
    unit = interface(outputs=["y"], parameters=["sample_period"])
    monkeypatch.setattr(graph, "read_interface", lambda _: unit)
    monkeypatch.setattr(spelling, "CANDIDATES", 1)  # what they cost does not depend on the size
    work(40)  # caches and imports
    few, many = lines(work, 80), lines(work, 160)
    assert many < MOST * few


def lines(work, size):
    """Lines of Python that are executed."""
    count = 0

    def trace(_frame, _event, _argument):
        nonlocal count
        count += 1
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        work(size)
    finally:
        sys.settrace(before)
    return count
