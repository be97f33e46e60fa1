# SPDX-License-Identifier: BSD-2-Clause
"""The safety monitor in the approach systems: it changes no other bit, its margins equal the
margins of the recorded run, and every broken rule is reported by number.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from harness import load, run
from harness.master.isolated import simulate
from ssp.shared import safety
from ssp.shared.relative_motion import range_
from tests.each import some

from ..reference.attitude import dcm

SYSTEMS = (
    "sync_approach",
    "sync_approach_thrusters",
    "sync_approach_navigated",
    "sync_approach_thrusters_navigated",
    "ppc_tracking",
    "ppc_tracking_navigated",
    "relay_approach",
    "relay_approach_navigated",
)
RULES = ("keep_out", "corridor", "speed", "passive", "plume", "navigation", "escape")
"""In the order of monitor.least_margin."""
OFF = 1e9
ACTIVE = {
    "sync_approach": {"keep_out", "corridor", "speed", "passive"},
    "ppc_tracking": {"keep_out", "corridor", "speed"},
    "relay_approach": {"keep_out", "speed", "passive", "plume"},
}
"""Rules that are on by the family of a system; on estimates also the rule for lost navigation."""


def without_monitor(system):
    """The same system as if there had never been one."""
    return replace(
        system,
        components=tuple(c for c in system.components if c.name != "monitor"),
        connections=tuple(c for c in system.connections if c.target.component != "monitor"),
    )


@pytest.mark.parametrize("name", some(SYSTEMS, 3))
def test_the_monitor_changes_no_bit_of_any_other_signal(name):
    with load(name) as system:
        short = replace(system, experiment=replace(system.experiment, stop=15.0))
        watched, alone = simulate(short), simulate(without_monitor(short))
    assert any(column.startswith("monitor.") for column in watched.columns)
    for column in alone.columns:
        assert watched[column].tobytes() == alone[column].tobytes(), column


@pytest.mark.parametrize("name", some(SYSTEMS, 2))
def test_the_rules_that_fit_its_paper_are_on(name):
    result = run(name, stop=5.0)
    margins = zip(RULES, result["monitor.least_margin"][-1], strict=True)
    family = name.removesuffix("_navigated").removesuffix("_thrusters")
    evaluated = {rule for rule, margin in margins if margin < OFF}
    assert evaluated == ACTIVE[family] | ({"navigation"} if "navigated" in name else set())


# ---- whole runs


@cache
def recording(name, params=None, swap=None):
    swaps = [f"controller={swap}"] if swap else []
    return run(name, params=params, swap=swaps, every=10)


def least(result, rule):
    return result["monitor.least_margin"][-1, RULES.index(rule)]


def first(result, rule):
    return result["monitor.t_first"][-1, RULES.index(rule)]


def off_axis(result):
    """Angle between the servicer as seen from the target and the grasp axis p_T = x [rad]."""
    rho = result["servicer.r_SN_N"] - result["target.r_TN_N"]
    along = [dcm(q)[0] @ r for q, r in zip(result["target.q_TN"], rho, strict=True)]
    return np.arccos(np.clip(along / np.linalg.norm(rho, axis=1), -1, 1))


def test_sync_approach_breaks_its_safe_distance_by_millimetres():
    """The paper claims range >= rho_M = 4 m throughout (docs/models.md A.8)."""
    result = recording("sync_approach")
    distance = range_(result)
    assert abs(least(result, "keep_out") - (distance.min() - 4)) < 1e-5
    assert -3e-3 < least(result, "keep_out") < -2e-3
    below = result.time[np.flatnonzero(distance < 4)[0]]
    assert below - 1.0 <= first(result, "keep_out") <= below
    for rule in ("corridor", "speed"):
        assert least(result, rule) > 0
        assert first(result, rule) == -1


def test_corridor_margin_is_never_above_the_one_of_the_recorded_rows():
    result = recording("sync_approach")
    rows = range_(result) * np.sin(np.radians(10) - off_axis(result))
    assert least(result, "corridor") <= rows.min() + 1e-7
    assert least(result, "corridor") > rows.min() - 1e-3


def test_pid_in_ppc_tracking_comes_within_7_m_of_a_hover_at_20_m():
    result = recording("ppc_tracking", swap="pid_controller")
    assert abs(range_(result).min() - 7.43) < 0.01
    assert abs(least(result, "keep_out") - (7.43 - 17)) < 0.01
    rows = range_(result) * np.sin(np.radians(20) - off_axis(result))
    assert rows.min() < -4
    assert least(result, "corridor") <= rows.min() + 1e-6
    assert result["monitor.rule_violated"][-1] == 2
    assert result["monitor.abort"][-1] == 0


@pytest.mark.parametrize("controller", ["ppc_controller", "theta_d_controller"])
def test_the_controllers_that_the_paper_recommends_retain_all_rules(controller):
    for params in ("nominal", "manoeuvre"):
        result = recording("ppc_tracking", params, None if "ppc" in controller else controller)
        assert result["monitor.rule_violated"][-1] == 0
        assert abs(least(result, "keep_out") - (range_(result).min() - 17)) < 1e-3


# ---- the monitor acts


def without(result, component):
    """The columns of all other components, as bytes by name."""
    retained = [c for c in result.columns if not c.startswith(f"{component}.")]
    return {column: result[column].tobytes() for column in retained}


@pytest.mark.parametrize("name", ["ppc_tracking", "sync_approach_thrusters"])
def test_a_guarded_run_that_retains_the_rules_is_the_run_itself_to_the_bit(name):
    guarded = recording(f"{name}_guarded")
    assert guarded.parameter("monitor.act") == 1
    assert not guarded["monitor.abort"].any()
    assert without(guarded, "monitor") == without(recording(name), "monitor")


@pytest.mark.parametrize("params", ["nominal", "manoeuvre"])
def test_guarded_pid_retreats_instead_of_coming_within_its_7_m(params):
    """It leaves the corridor at some 110 m, closing at 20 m/s: 20 m/s outwards take 8 s."""
    result = recording("ppc_tracking_guarded", params, "pid_controller")
    distance, aborted = range_(result), result["monitor.abort"] > 0
    began = result.time[aborted][0]
    assert began - 0.5 <= first(result, "corridor") <= began
    assert distance.min() > 70
    assert np.all(np.diff(distance[result.time > began + 10]) > 0)
    force = result["propulsion.F_S"][(result.time > began + 1) & (result.time < began + 7)]
    assert np.allclose(np.linalg.norm(force, axis=1), 490)
    assert not result["propulsion.F_S"][result.time > began + 12].any()


def test_guarded_approach_to_a_wrong_distance_ends_before_the_zone():
    """The guidance is given 2 m instead of 4 m: unguarded it goes there, guarded the drift is
    foreseen to enter the zone, and the approach ends outside it.
    """
    wrong = {"guidance.rho_M": 2.0}
    free = run("sync_approach_thrusters", set=wrong, stop=600.0, every=10)
    guarded = run("sync_approach_thrusters_guarded", set=wrong, stop=600.0, every=10)
    assert range_(free).min() < 2.5
    assert range_(guarded).min() > 4
    assert guarded["monitor.rule_violated"][-1] == 4
    assert range_(guarded)[-1] > 20


def test_limits_of_the_rules_are_stated_as_they_are_in_force():
    """Tumble in the speed limit, lost navigation by the independent range, two radii of escape."""
    result = run("servicing_mission_navigated", stop=1.0)
    texts = {rule.name: safety.limit(result, rule) for rule in safety.RULES}
    assert texts["speed"] == (
        "at most 0.1 m/s + (0.01 1/s + tumble rate of the target, at most 0.04 rad/s) * range"
    )
    assert texts["navigation"] == (
        "at most 10 s with a state that disagrees with the independent range"
    )
    assert texts["escape"] == (
        "after an abort the servicer stays outside a radius for 3600 s: "
        "12 m before the final approach, 1.5 m while approaching"
    )
