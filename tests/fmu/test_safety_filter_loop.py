# SPDX-License-Identifier: BSD-2-Clause
"""The safety filter in closed loop with hostile policies (tests/reference/filter_loop.c): nothing
is violated where its conditions hold, and much without it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.close import close
from tests.each import Each
from tests.reference import safety_filter as reference
from tests.reference.filter_runs import AT_TARGET, CASES, GENTLE, WEAK, Loop, runs_of, summary

from .filter_cases import inputs, settings

ERRORS = {
    "position_error": 0.02,
    "velocity_error": 0.002,
    "attitude_error": 0.005,
    "rate_error": 1e-4,
}
SMALL = CASES["small_05"]
FEW, MANY = 21, pytest.param(210, marks=pytest.mark.long)


@pytest.fixture(scope="module")
def loop():
    return Loop()


@pytest.mark.parametrize("count", [FEW, MANY])
@pytest.mark.parametrize("name", CASES)
def test_no_policy_violates_a_rule(loop, name, count):
    found = summary(runs_of(loop, CASES[name], count))
    assert found.runs == count and found.violations == (0, 0, 0)
    assert found.changed > 50
    # the set touches its edge by design: a filter that stays far away does too much
    assert found.least[0] < 0.2
    if CASES[name].parameters.get("use_corridor"):
        assert found.relaxed == 0


@pytest.mark.parametrize("law", [1, 2])
def test_the_switching_filters_do_not_either(loop, law):
    found = summary(runs_of(loop, SMALL, FEW, filter=law))
    assert found.violations == (0, 0, 0) and found.changed > 50


def test_without_the_filter_most_runs_do(loop):
    found = summary(runs_of(loop, SMALL, FEW, filter=0))
    assert found.violations[0] >= 5 and min(found.violations[1:]) >= 10
    assert found.changed == 0


@pytest.mark.parametrize("count", [FEW, MANY])
def test_errors_within_their_bounds_violate_nothing(loop, count):
    found = summary(runs_of(loop, SMALL, count, error=1, **ERRORS))
    assert found.violations == (0, 0, 0) and found.relaxed == 0


def test_errors_of_twice_the_bounds_do(loop):
    found = summary(runs_of(loop, SMALL, 42, error=2, **ERRORS))
    assert sum(found.violations) > 0


@pytest.mark.parametrize("count", [FEW, MANY])
def test_a_lag_that_the_filter_knows_violates_nothing(loop, count):
    found = summary(runs_of(loop, SMALL, count, lag=0.3, reaction=0.3))
    assert found.violations == (0, 0, 0)


def test_a_delay_that_it_does_not_know_does(loop):
    found = summary(runs_of(loop, SMALL, FEW, delay=0.5, lag=0.3))
    assert min(found.violations) > 0


def test_a_gentle_controller_is_left_alone(loop):
    found = summary(runs_of(loop, SMALL, 10, policies=[GENTLE]))
    assert found.changed < 1 and found.impulse < 1


def test_half_an_hour_of_thrust_at_the_target(loop):
    """The thrusters of sync_approach_thrusters with their delay and lag, its sphere and its speed
    limit.
    """
    parameters = {
        "keep_out_radius": 3.9, "use_speed_limit": 1, "speed_at_zero": 0.04,
        "speed_slope": 0.0185, "speed_max": 0.24, "sample_period": 0.1, "reaction": 0.4,
    }  # fmt: skip
    case = replace(SMALL, parameters=parameters, duration=1800, rate_T=0.01, farthest=20)
    (found,) = runs_of(loop, case, 1, policies=[AT_TARGET], delay=0.1, lag=0.3)
    assert 0 < found["margin"][0] < 0.1 and found["margin"][2] > 0
    assert found["changed"] / found["samples"] > 0.9


def test_where_the_box_is_too_small_the_sphere_still_holds(loop):
    """(26) does not hold: rows are relaxed, the corridor may be left, the sphere not."""
    outcomes = list(runs_of(loop, WEAK, 140))
    assert summary(outcomes).violations[0] == 0
    assert any(o["relaxed"] for o in outcomes)


def test_runs_repeat(loop):
    first, second = (list(runs_of(loop, SMALL, 7)) for _ in range(2))
    assert all(np.array_equal(a["margin"], b["margin"]) for a, b in zip(first, second, strict=True))


# ---- parts of a sample against the independent implementation ----
def one_state(seed):
    rng = np.random.default_rng([6, seed])
    p = settings(rng, passive_time=600.0, keep_out_radius=4.0, keep_out_opens=0)
    u = inputs(rng, p)
    return p, u, reference.Geometry(p, u, p.sample_period), rng.normal(size=3)


@pytest.fixture
def state():
    return Each(range(40)).map(one_state)


def test_every_row_agrees(loop, state):
    """Also rows whose edge the command does not touch."""
    p, u, g, _ = state
    found, count = loop.part("rows_at", p, u)
    _, rows = reference.rows_of(g)
    assert count == len(rows)
    found = found[: 4 * count].reshape(-1, 4)
    close(found[:, :3], [r.n for r in rows], rel=1e-12)
    sizes = np.abs([r.c for r in rows])
    assert np.all(np.abs(found[:, 3] - [r.c for r in rows]) <= 1e-9 * np.maximum(sizes, 1))


def test_the_drift_under_a_force_agrees(loop, state):
    p, u, g, force = state
    found, count = loop.part("drift_at", p, u, force)
    drift = reference.Drift(g)
    least, chord = drift.worst(force)
    assert found[0] == pytest.approx(least, rel=1e-9, abs=1e-9) and found[1] == chord
    rows = list(drift.rows(1))
    assert count == len(rows)
    for row, ours in zip(rows, found[2 : 2 + 4 * count].reshape(-1, 4), strict=True):
        close(ours[:3], row.n, rel=1e-10)
        assert ours[3] == pytest.approx(row.c, rel=1e-9, abs=1e-9)


def test_the_stop_after_a_force_agrees(loop, state):
    p, u, g, force = state
    found, _ = loop.part("held_at", p, u, force)
    x, v, e, t = reference.after_hold(g, force)
    close(found[:3], x, rel=1e-12)
    close(found[3:6], v, rel=1e-10)
    close(found[6:8], (e, t), rel=1e-12)
