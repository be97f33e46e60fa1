# SPDX-License-Identifier: BSD-2-Clause
"""sync_approach with the fuel-optimal controller: propellant, and every constraint satisfied."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness import run
from harness.figures.choice import figures_of
from harness.report.arrays import Arrays
from harness.report.timeline import replay
from tests.close import close

SWAP = {"controller": "optimal_controller"}
PLAN, FIRST_PLAN = 0, 3
BOUND = 140.2
"""Impulse of the optimum with the attitude of the run [N s], sum of axes: docs/models.md N.5."""


def impulse(result):
    """N s, sum of the axes."""
    return np.abs(result["propulsion.F_S"]).sum() * 0.1


@pytest.fixture(scope="module")
def limited():
    return run("sync_approach", params="limited", swap=SWAP)


def test_the_impulse_is_within_twelve_percent_of_the_optimum(limited):
    assert 0.99 * BOUND < impulse(limited) <= 1.12 * BOUND


def test_every_requirement_of_the_paper_is_met(limited):
    after = lambda t, name: limited[name][limited.time >= t]  # noqa: E731
    error = limited["guidance.rho_H"] - limited["guidance.rho_ref_H"]
    assert limited["guidance.range"].min() >= 4
    assert np.degrees(after(600, "guidance.beta_t").max()) <= 1
    assert np.linalg.norm(error, axis=1)[limited.time >= 1200].max() <= 0.05
    assert limited["monitor.least_margin"][-1, :3].min() >= 0  # zone, corridor, speed


def test_a_plan_is_in_force_from_the_second_second_on(limited):
    mode = limited["controller.mode"]
    assert set(mode[limited.time <= 1.0]) == {FIRST_PLAN}
    assert set(mode[limited.time >= 1.2]) == {PLAN}
    assert np.all(limited["controller.feasible"][20:] == 1)


def test_the_plan_points_ahead_along_the_path_that_is_then_run(limited):
    """Position at node 10 of a plan against the position at that time, while most of the way is
    left: the plan changes by what it learns later.
    """
    t = limited.time
    rho = limited["servicer.r_SN_N"] - limited["target.r_TN_N"]
    for k in np.searchsorted(t, (30.05, 100.05, 200.05)):
        then = limited["controller.plan_time"][k] + 10 * limited["controller.plan_step"][k]
        planned = limited["controller.plan_rho_N"][k, 0]
        assert np.linalg.norm(planned - rho[np.searchsorted(t, then)]) < 0.5


def test_the_replay_has_the_points_of_the_plan_and_the_origin_of_the_force(limited):
    arrays = Arrays()
    scene = replay(limited, arrays)
    (plan,) = scene["plans"]
    assert plan["body"] == "servicer"
    rows = np.searchsorted(limited.time, arrays.take(scene["time"]) - 1e-3)
    assert np.array_equal(arrays.take(plan["mode"]), limited["controller.mode"][rows])
    points = arrays.take(plan["points"])
    close(points, limited["controller.plan_rho_N"][rows].reshape(len(rows), 18), rel=1e-6)
    assert arrays.samples[plan["points"]].over == "row"  # a live page computes them again


def test_residuals_and_active_constraints_have_a_figure_where_a_plan_was_in_force(limited):
    assert "plan" in [figure.name for figure in figures_of(limited)]
    before = replace(limited, time=limited.time[:5], values=limited.values[:5])
    assert "plan" not in [figure.name for figure in figures_of(before)]


@pytest.mark.long
def test_on_estimates_the_corridor_holds_after_a_minute():
    """In the first minute the filter settles."""
    result = run("sync_approach_navigated", swap=SWAP)
    margin = result["monitor.corridor_margin"][result.time >= 60]
    assert impulse(result) <= 165
    assert result["guidance.range"].min() >= 3.995
    assert margin.min() >= 0
    assert result["controller.braking"].max() == 0
