# SPDX-License-Identifier: BSD-2-Clause
"""The safety filter in the systems: it leaves good controllers alone, `filter = 0` has the bits of
the system without it, a controller that thrusts at the target is held off, and reports say when.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from harness import build, run
from harness.claims.report import rule_findings
from harness.mission.library import of_result
from ssp.shared import filtering
from ssp.shared.relative_motion import range_
from tests.each import each

RECKLESS = Path(__file__).resolve().parents[2] / "examples/reckless_controller.c"
PAIRS = {
    "sync_approach_thrusters": 200.0,
    "ppc_tracking": 20.0,
    "servicing_mission": 5.0,
}
"""Systems with a filtered variant, and the seconds that are compared."""


@pytest.fixture(scope="module")
def reckless(tmp_path_factory):
    return build(RECKLESS, tmp_path_factory.mktemp("fmu") / "reckless_controller.fmu")


@pytest.fixture(scope="module")
def sync():
    return run("sync_approach_thrusters_filtered")


@pytest.fixture(scope="module")
def held(reckless):
    return run("sync_approach_thrusters_filtered", swap={"controller": reckless})


@each("system", PAIRS)
def test_filter_0_has_the_bits_of_the_system_without_it(system):
    plain = run(system, stop=PAIRS[system], every=10)
    off = run(f"{system}_filtered", stop=PAIRS[system], every=10, set=["filter.filter=0"])
    assert not off["filter.intervention"].any()
    for name in plain.vectors:
        assert np.array_equal(plain[name], off[name], equal_nan=True), name


# ---- good controllers ----
def test_the_synchronised_approach_is_left_alone(sync):
    assert len(sync.time) == 18001
    assert not sync["filter.intervention"].any() and not sync["filter.mode"].any()
    least = sync["filter.least_barrier"][-1]
    assert 0.05 < least[0] < 0.1 and 0 < least[2] < 0.04
    assert sync["filter.barrier"].max() == 1e9


def test_ppc_tracking_meets_the_box_only():
    result = run("ppc_tracking_filtered")
    changed = result["filter.intervention"] > 0
    assert 60 < np.count_nonzero(changed) < 90 and len(changed) == 2401
    assert set(result["filter.active"][changed]) == {6}
    assert 200 < result["filter.intervention"].max() < 300
    assert result["filter.least_barrier"][-1, 0] > 2


@pytest.mark.long
@pytest.mark.parametrize("params", ["default", "guarded"])
def test_the_mission_is_left_alone_but_for_the_box(params):
    """The commanded force exceeds the box for some seconds when the reference starts to turn with
    the target.
    """
    result = run("servicing_mission_filtered", params=params)
    changed = result["filter.intervention"] > 0
    assert set(result["filter.active"][changed]) <= {6}
    command, most = result["selector.F_cmd_S"], np.asarray(result.parameter("filter.F_max"))
    assert np.array_equal(result["filter.F_safe_S"], np.clip(command, -most, most))
    assert 0 < np.count_nonzero(changed) < 100
    assert result["manager.phase"][-1] == 10 and result["filter.feasible"].all()


# ---- a controller that thrusts at the target for half an hour ----
def test_a_reckless_controller_never_enters_the_sphere(held):
    assert held.time[-1] == 1800
    assert 3.9 < range_(held).min() < 3.95
    assert held["filter.least_barrier"][-1, 2] > 0
    assert np.mean(held["filter.intervention"] > 0) > 0.99


def test_without_the_filter_it_does(reckless):
    fallen = run(
        "sync_approach_thrusters_filtered",
        swap={"controller": reckless},
        set=["filter.filter=0"],
        stop=120,
    )
    assert range_(fallen).min() < 1


@each("law", (1, 2))
def test_the_switching_filters_hold_it_off_too(reckless, law):
    result = run(
        "sync_approach_thrusters_filtered",
        swap={"controller": reckless},
        set=[f"filter.filter={law}"],
        stop=600,
    )
    assert range_(result).min() > 3.9
    assert 2 in result["filter.mode"]


# ---- reports ----
def test_the_notes_say_when_how_much_and_which_rule(held):
    lines = list(filtering.notes(held))
    assert lines[0].startswith("filter: force changed in 18001 of 18001 rows")
    assert any("speed: change of up to" in line for line in lines)
    assert any("to 1800.0 s, keep-out: change of up to 2.5" in line for line in lines)


def test_episodes_add_up_to_the_whole_impulse(held):
    found = filtering.episodes(held)
    whole = filtering.impulses(held).sum()
    assert sum(e.impulse for e in found) == pytest.approx(whole, rel=1e-12)
    assert all(a.end == b.begin for a, b in zip(found[:-1], found[1:], strict=True))


def test_the_barriers_are_rules_of_the_report(sync):
    names = {f.name: f for f in rule_findings(of_result(sync), sync)}
    assert names["keep-out (filter)"].margin == sync["filter.least_barrier"][-1, 0]
    assert "corridor (filter)" not in names
    assert np.isnan(names["keep-out (filter)"].violated)


def test_a_requirement_limits_the_intervention(held, sync):
    assert sync["filter.intervention"].max() <= 1 < held["filter.intervention"].max()


def test_a_corridor_that_three_rules_cannot_share_is_a_note(caplog):
    run("sync_approach_thrusters_filtered", stop=0.1, set=["filter.use_corridor=1"])
    assert "force for sphere, speed and corridor" in caplog.text


# ---- systems of users ----
OBSERVED = """
extends = "relay_approach"
name = "relay_approach_observed"
[components]
filter = "safety_filter"
[connections]
"filter.F_cmd_S" = "propulsion.F_S"
[open]
"filter.approaching" = 1
"filter.relative_valid" = 1
[parameters.filter]
mass = 1000
F_max = [2, 1, 1]
keep_out_radius = 10
brake_keep_out = 4e-4
"""
BEFORE_IDEAL = """
extends = "sync_approach"
name = "sync_approach_filtered"
[components]
guidance = "sync_guidance"
controller = "adaptive_controller"
filter = "safety_filter"
monitor = "safety_monitor"
propulsion = "ideal_propulsion"
servicer = "servicer"
target = "target"
[connections]
"filter.F_cmd_S" = "controller.F_cmd_S"
"monitor.F_cmd_S" = "filter.F_safe_S"
"propulsion.F_cmd_S" = "filter.F_safe_S"
[open]
"filter.approaching" = 1
"filter.relative_valid" = 1
[parameters.filter]
keep_out_radius = 3.9
"""


def test_it_observes_the_relay_approach(tmp_path):
    (tmp_path / "observed.toml").write_text(OBSERVED)
    plain = run("relay_approach", stop=300, every=10)
    seen = run(tmp_path / "observed.toml", stop=300, every=10)
    assert all(np.array_equal(plain[name], seen[name]) for name in plain.vectors)
    assert 400 < seen["filter.least_barrier"][-1, 0] < 510


def test_an_approach_takes_it_in_a_few_lines(tmp_path):
    (tmp_path / "filtered.toml").write_text(BEFORE_IDEAL)
    plain, filtered = (run(s, stop=100) for s in ("sync_approach", tmp_path / "filtered.toml"))
    assert not filtered["filter.mode"].any()
    assert all(np.array_equal(plain[name], filtered[name]) for name in plain.vectors)
