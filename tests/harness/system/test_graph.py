# SPDX-License-Identifier: BSD-2-Clause
"""Every contradiction between a system and its FMUs is found, all of them at once."""

from __future__ import annotations

from dataclasses import replace

import pytest

from harness import run
from harness.errors import FmuError, StructureError
from harness.system.graph import build_graph, rebuilt
from harness.system.model import Parameter


def problems(system):
    with pytest.raises(StructureError) as caught:
        build_graph(system)
    return caught.value.problems


def test_slots_are_contiguous_per_component_and_inputs_point_at_their_sources(make):
    graph = build_graph(make({"c": "counter", "g": "gain"}, ["c.n > g.u"]))
    assert [slot.name for slot in graph.slots] == ["c.n", "c.t_last", "c.h_last", "g.y"]
    assert [(wire.variable.name, wire.slot) for wire in graph.nodes[1].inputs] == [("u", 0)]
    assert [wire.slot for wire in graph.nodes[1].outputs] == [3]


@pytest.mark.parametrize(
    ("wire", "problem"),
    [
        ("c.n > gian.u", "gian.u: there is no component 'gian' (close: gain)"),
        ("c.n > gain.v", "gain.v: there is no such input"),
        ("c.t_lst > gain.u", "c.t_lst: there is no such output (close: t_last, h_last)"),
        ("gain.u > gain.u", "gain.u: is connected as output, but its causality is input"),
        ("c.n > gain.k", "gain.k: is connected as input, but its causality is parameter"),
        (
            "c.t_last > gain.u",
            "gain.u: expected unit 1, c.t_last has s (s [s] cannot be converted to 1 [1])",
        ),
        (
            "c.n > m.i",
            "m.i: has type Integer, cannot be driven by c.n of type Real; use numbers of one type",
        ),
    ],
)
def test_a_connection_that_cannot_be_is_rejected(make, wire, problem):
    system = make({"c": "counter", "gain": "gain", "m": "mixed"}, [wire])
    assert problems(system) == (problem,)


def test_a_doubly_driven_input_names_both_drivers(make):
    system = make({"a": "counter", "b": "counter", "g": "gain"}, ["a.n > g.u", "b.n > g.u"])
    assert problems(system) == ("g.u: is driven 2 times, by a.n and b.n; connect only one of them",)


def test_an_open_input_is_an_error_in_a_strict_system_only(make):
    system = make({"g": "gain"})
    build_graph(system)
    strict = replace(system, strict=True)
    assert problems(strict) == (
        "g.u: no output of this name: connect it in [connections] or list it in [open]",
    )
    given = replace(make({"g": "gain"}, parameters={"g.u": 1.0}), strict=True)
    graph = build_graph(given)
    removed = tuple(replace(c, parameters={}) for c in given.components)
    with pytest.raises(StructureError, match=r"g\.u: no output of this name"):
        rebuilt(replace(given, components=removed), given, graph)


@pytest.mark.parametrize(
    ("name", "value", "problem"),
    [
        ("gain.kk", 1.0, "gain.kk: there is no such parameter (close: k)"),
        ("gain.y", 1.0, "gain.y: is an output and cannot be set"),
        ("gain.k", float("nan"), "gain.k: must not be NaN"),
        ("gain.k", "wide", "gain.k: 'wide' is not a number"),
        ("m.offset", 1.5, "m.offset: 1.5 is not a whole number"),
        ("m.flip", 2, "m.flip: 2 is not true or false"),
    ],
)
def test_a_parameter_that_cannot_be_set_is_rejected(make, name, value, problem):
    system = make({"gain": "gain", "m": "mixed"}, parameters={name: value})
    assert problems(system) == (problem,)


def test_a_parameter_in_another_unit_is_rejected(make):
    system = make({"bad": "failing"})
    changed = replace(system.components[0], parameters={"t_fail": Parameter(1.0, "m")})
    assert problems(replace(system, components=(changed,))) == (
        "bad.t_fail: is given in m, but its unit is s (m [m] cannot be converted to s [s])",
    )


def test_all_problems_come_at_once(make):
    system = make(
        {"c": "counter", "g": "gain"},
        ["c.x > g.u", "d.n > g.u"],
        {"g.z": 1.0},
        {"c": (0, 0)},
        algorithm="euler",
    )
    found = problems(replace(system, strict=True))
    assert len(found) == 5
    assert [p.split(":")[0] for p in found] == ["c.x", "d.n", "g.u", "algorithm", "g.z"]


def test_an_empty_system_is_rejected(make):
    assert problems(make({})) == ("the system has no components",)


def test_every_unreadable_fmu_is_named(make, tmp_path):
    system = make({"a": "gain", "b": "gain"})
    broken = tmp_path / "broken.fmu"
    broken.write_bytes(b"no zip")
    a, b = system.components
    with pytest.raises(FmuError) as caught:
        build_graph(
            replace(
                system, components=(replace(a, fmu=tmp_path / "gone.fmu"), replace(b, fmu=broken))
            )
        )
    first, second = str(caught.value).splitlines()
    assert first == "a: gone.fmu: no such FMU"
    assert second.startswith("b: broken.fmu: damaged or not a zip archive")


def test_sensors_that_draw_the_same_random_numbers_are_rejected():
    twice = {"gyro.stream": 1}
    with pytest.raises(StructureError) as caught:
        run("sync_approach_navigated", set=twice, stop=1.0)
    (problem,) = caught.value.problems
    assert problem.startswith("star_tracker and gyro: draw the same random numbers (seed 1, str")
