# SPDX-License-Identifier: BSD-2-Clause
"""The order of actions, and the numbers it leads to on a chain of counters and gains."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from harness import run
from harness.errors import StructureError
from harness.system.model import Experiment
from harness.system.schedule import gauss_seidel, jacobi, macro_steps, schedule

pytestmark = pytest.mark.usefixtures("trusted")


def unit(name, every=1, latency=0):
    return SimpleNamespace(name=name, every=every, latency=latency)


def words(plan):
    return [
        f"{a.verb.value} {a.instance.name}" + (f" @{a.phase}/{a.every}" if a.every > 1 else "")
        for a in plan
    ]


def test_gauss_seidel_lets_each_unit_read_step_and_publish_before_the_next():
    plan = gauss_seidel([unit("a"), unit("b")])
    assert words(plan) == ["set a", "step a", "get a", "set b", "step b", "get b"]


def test_jacobi_lets_all_read_then_all_step_then_all_publish():
    plan = jacobi([unit("a"), unit("b")])
    assert words(plan) == ["set a", "set b", "step a", "step b", "get a", "get b"]


def test_a_slow_unit_publishes_at_once_under_gauss_seidel_and_at_the_end_of_its_step_under_jacobi():
    assert words(gauss_seidel([unit("a", 3)])) == ["set a @0/3", "step a @0/3", "get a @0/3"]
    assert words(jacobi([unit("a", 3)])) == ["set a @0/3", "step a @0/3", "get a @2/3"]


def test_delayed_publishing_is_first_in_the_macro_step():
    plan = gauss_seidel([unit("a"), unit("b", 4, 3), unit("c", 2, 2)])
    assert words(plan)[:2] == ["get b @3/4", "get c @0/2"]
    assert words(plan)[2:5] == ["set a", "step a", "get a"]


def test_jacobi_with_latency_publishes_after_the_others_have_read_and_before_the_next_step():
    assert words(jacobi([unit("a"), unit("b", 2, 1)])) == [
        "set a",
        "set b @0/2",
        "get b @0/2",
        "step a",
        "step b @0/2",
        "get a",
    ]


@pytest.mark.parametrize(
    ("algorithm", "every", "latency", "problem"),
    [
        ("gauss-seidel", 2, 3, "latency must lie in 0..2"),
        ("gauss-seidel", 2, -1, "latency must lie in 0..2"),
        ("jacobi", 3, 2, "latency must lie in 0..1"),
        ("jacobi", 0, 0, "`every` must lie in 1.."),
        ("newton", 1, 0, "there is no newton"),
    ],
)
def test_an_inexpressible_schedule_is_rejected(algorithm, every, latency, problem):
    with pytest.raises(StructureError, match=problem):
        schedule(algorithm, [unit("a", every, latency)])


CHAIN = {"counter": "counter", "gain": "gain"}
WIRE = ["counter.n > gain.u"]


@pytest.mark.parametrize(
    ("algorithm", "components", "expected"),
    [
        (
            "gauss-seidel",
            ["counter", "gain"],
            [0, 2, 4, 6, 8, 10, 12],
        ),  # the gain sees the count of the same macro step
        ("gauss-seidel", ["gain", "counter"], [0, 0, 2, 4, 6, 8, 10]),  # ... of the one before
        ("jacobi", ["counter", "gain"], [0, 0, 2, 4, 6, 8, 10]),
        ("jacobi", ["gain", "counter"], [0, 0, 2, 4, 6, 8, 10]),
    ],
)
def test_order_decides_whether_a_gain_sees_the_new_count(make, algorithm, components, expected):
    system = make({name: CHAIN[name] for name in components}, WIRE, algorithm=algorithm)
    assert run(system)["gain.y"].tolist() == expected


@pytest.mark.parametrize(
    ("algorithm", "every", "latency", "count", "twice"),
    [
        # every: a step of 3 macro steps is visible to the next unit at once, or at its end under
        # Jacobi
        ("gauss-seidel", 3, 0, [0, 1, 1, 1, 2, 2, 2], [0, 2, 2, 2, 4, 4, 4]),
        ("jacobi", 3, 0, [0, 0, 0, 1, 1, 1, 2], [0, 0, 0, 0, 2, 2, 2]),
        # latency: published 1, 2 or 3 macro steps after the step began
        ("gauss-seidel", 3, 1, [0, 0, 1, 1, 1, 2, 2], [0, 0, 2, 2, 2, 4, 4]),
        ("gauss-seidel", 3, 2, [0, 0, 0, 1, 1, 1, 2], [0, 0, 0, 2, 2, 2, 4]),
        ("gauss-seidel", 3, 3, [0, 0, 0, 0, 1, 1, 1], [0, 0, 0, 0, 2, 2, 2]),
        ("gauss-seidel", 1, 1, [0, 0, 1, 2, 3, 4, 5], [0, 0, 2, 4, 6, 8, 10]),
        ("jacobi", 3, 1, [0, 0, 0, 0, 1, 1, 1], [0, 0, 0, 0, 0, 2, 2]),
        ("jacobi", 1, 1, [0, 0, 1, 2, 3, 4, 5], [0, 0, 0, 2, 4, 6, 8]),
    ],
)
@pytest.mark.parametrize("executor", ["c", "python"])
def test_period_and_latency_are_exact(make, executor, algorithm, every, latency, count, twice):
    system = make(CHAIN, WIRE, timing={"counter": (every, latency)}, algorithm=algorithm)
    result = run(system, executor=executor)
    assert result["counter.n"].tolist() == count
    assert result["gain.y"].tolist() == twice


def test_a_slow_unit_steps_by_whole_periods_at_products_of_the_macro_step(make):
    system = make({"counter": "counter"}, timing={"counter": (3, 0)}, start=1.0, stop=3.1, step=0.1)
    result = run(system)
    assert result["counter.h_last"][-1] == 3 * 0.1
    assert result["counter.t_last"].tolist()[1:] == [1.0 + (k // 3) * 3 * 0.1 for k in range(21)]
    assert result.time.tolist() == [1.0 + k * 0.1 for k in range(22)]


@pytest.mark.parametrize(
    ("experiment", "periods", "problem"),
    [
        (
            {"stop": 1.05, "step": 0.1},
            (1,),
            r"1\.05 s is not a multiple of the macro step 0\.1 s; nearest: 1 s and 1\.1 s",
        ),
        ({"stop": 0.04, "step": 0.1}, (1,), r"nearest: 0\.1 s"),
        (
            {"stop": 1.0, "step": 0.1},
            (4, 6),
            r"12 macro steps of 0\.1 s \(common period of all components\); nearest: 1\.2 s",
        ),
        ({"stop": 0.0, "step": 0.1}, (1,), "must lie after the start time"),
        ({"stop": None, "step": 0.1}, (1,), "give one with --stop"),
        ({"stop": 1.0, "step": None}, (1,), "give one with --step"),
        ({"stop": 1.0, "step": -0.1}, (1,), "positive number of seconds"),
        ({"stop": 1.0, "step": float("nan")}, (1,), "positive number of seconds"),
        ({"stop": float("inf"), "step": 0.1}, (1,), "must lie after the start time"),
    ],
)
def test_a_time_span_that_is_no_whole_number_of_steps_is_rejected(experiment, periods, problem):
    with pytest.raises(StructureError, match=problem):
        macro_steps(Experiment(**experiment), periods)


def test_rounding_of_the_step_does_not_matter_for_the_number_of_steps():
    assert macro_steps(Experiment(stop=1800.0, step=0.1)) == 18000
    assert macro_steps(Experiment(start=0.3, stop=0.9, step=0.1), (2, 3)) == 6
