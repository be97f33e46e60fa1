# SPDX-License-Identifier: BSD-2-Clause
"""Parameter sets `limited` and `[consistency]` of the missions that capture: actuators of such a
servicer, and notes where the software assumes something else than is simulated.
"""

from __future__ import annotations

import logging
import re
from pathlib import Path

import numpy as np
import pytest

from harness import load, run
from harness.master.changes import apply
from harness.results.requirements import findings, log_inconsistencies
from harness.results.verdict import Verdict
from harness.studies.check import check
from tests.each import some

SYSTEMS = (
    "arm_capture",
    "arm_capture_navigated",
    "servicing_mission",
    "servicing_mission_navigated",
    "servicing_mission_by_arm",
)


@pytest.mark.parametrize("system", SYSTEMS)
def test_a_comparison_takes_the_limited_set(system):
    with load(system) as found:
        assert found.compared == "limited"
        assert "limited" in [s.name for s in found.sets]


def test_the_laws_that_the_readme_compares_run_below_their_limits():
    readme = (Path(__file__).resolve().parents[2] / "README.md").read_text(encoding="utf-8")
    (laws,) = re.findall(r"harness compare sync_approach --swap controller=(\S+)", readme)
    with load("sync_approach") as found:
        compared = found.compared
    for law in laws.split(","):
        swap = {"controller": law}
        result = run("sync_approach", params=compared, swap=swap, executor="fused")
        flags = [result[f"propulsion.{flag}"] for flag in ("F_saturated", "M_saturated")]
        assert np.concatenate(flags, axis=1).any(axis=1).mean() < 0.2, law
        assert result["guidance.range"][-1] == pytest.approx(4, abs=0.1), law


@pytest.mark.parametrize("system", some(SYSTEMS, 2))
def test_no_set_contradicts_itself(system):
    assert not [w for w in check(system).warnings if "expected" in w]


@pytest.mark.parametrize(
    ("system", "given", "rule"),
    [
        ("arm_capture", {"servicer.rho_0_H": [0, 4, 0]}, "start where the guidance begins"),
        ("arm_capture", {"controller.m_hat_0": 20}, "mass estimate near the mass"),
        ("arm_capture", {"target.mass": 300}, "mechanism knows the target"),
        (
            "arm_capture_navigated",
            {"servicer.joint_torque_max": [9.0] * 7},
            "software knows the limits of the joints",
        ),
        ("servicing_mission", {"servicer.mass_0": 300}, "mass estimate near the mass"),
        ("servicing_mission", {"servicer.rho_0_H": [9, 0, 0]}, "start beyond the first hold"),
        ("servicing_mission", {"manager.bias_max": 0.8}, "wheels come within the budget"),
        (
            "servicing_mission_navigated",
            {"monitor.keep_out_half": [30.0] * 3},
            "second hold outside the keep-out zone",
        ),
        (
            "servicing_mission_navigated",
            {"monitor.keep_out_half": [130.0] * 3},
            "first hold outside the keep-out zone",
        ),
        (
            "servicing_mission_by_arm",
            {"propulsion.thrust_nominal": [1.0] * 16},
            "software knows the thrusters",
        ),
        ("servicing_mission_by_arm", {"target.mass": 300}, "mechanism knows the target"),
    ],
)
def test_a_contradiction_is_a_note_that_names_both_values(caplog, system, given, rule):
    with load(system) as found, caplog.at_level(logging.WARNING, logger="harness"):
        log_inconsistencies(apply(found, set=given))
    (note,) = (r.getMessage() for r in caplog.records if r.getMessage().startswith(f"{rule}: "))
    (name,) = given
    assert name in note


def verdicts(result):
    return {found.name: found.verdict for found in findings(result)}


def test_the_arm_captures_with_the_actuators_of_such_a_servicer():
    """Every requirement met; no wheel, thruster or joint at its limit all the time."""
    result = run("arm_capture", params="limited", every=10)
    assert set(verdicts(result).values()) == {Verdict.MET}
    assert 0.05 < abs(result["servicer.wheel_speed"]).max() < 0.5
    assert (abs(result["propulsion.F_S"]) <= [2, 1, 1]).all()


@pytest.mark.long
@pytest.mark.parametrize(
    "system", ["arm_capture_navigated", "servicing_mission", "servicing_mission_navigated"]
)
def test_limited_actuators_meet_every_requirement(system):
    found = verdicts(run(system, params="limited", every=10))
    assert {name for name, verdict in found.items() if verdict is not Verdict.MET} == set()
