# SPDX-License-Identifier: BSD-2-Clause
"""servicing_mission_by_arm: the mission mated by the arm, every parameter set to the end that its
name states. Whole runs are marked long.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from harness import load, run
from harness.mission.library import of_result
from harness.report.arrays import Arrays
from harness.results.requirements import findings
from harness.results.verdict import Verdict
from ssp.arm_capture.claims import APPROACH, INDEPENDENT
from ssp.arm_capture.metrics import ALIGN, CLOSE, DEPLOY, REST, first
from ssp.servicing_mission.claims import PAPER
from ssp.servicing_mission.events import collided, outcome, stays
from tests.reference import arm as reference

from .test_servicing_mission import NOMINAL, drift_of_a_day

SYSTEM = "servicing_mission_by_arm"
STOWED, FOLD = 0, 5
AGAIN = ["back-off", "hold 3", "mating"]
ENDS = {
    "no_go": (NOMINAL[:4], "time-out", [STOWED]),
    "thruster_stuck": (NOMINAL[:6], "axis or pointing error", [STOWED]),
    "manoeuvre": (NOMINAL[:6], "axis or pointing error", [STOWED]),
    "ground_retreat": (NOMINAL[:7], "ground", [STOWED, DEPLOY, FOLD, STOWED]),
    "momentum": (NOMINAL[:4], "too much momentum", [STOWED]),
    "dropout": (NOMINAL[:8], "navigation", [STOWED, DEPLOY, ALIGN, FOLD, STOWED]),
    "bounce": (
        NOMINAL[:8] + AGAIN,
        "attempts",
        [STOWED, *[DEPLOY, ALIGN, CLOSE] * 2, FOLD, STOWED],
    ),
}
"""Phases before the retreat, its reason, modes of the arm."""


def modes(result):
    mode = result["arm_guidance.arm_mode"]
    return list(mode[np.flatnonzero(np.diff(mode, prepend=-1))])


def test_the_first_second_is_the_same_in_both_executors():
    one, other = (run(SYSTEM, stop=1.0, executor=e) for e in ("c", "python"))
    for name in one.vectors:
        assert np.array_equal(one[name], other[name]), name
    assert one["arm_controller.joint_lock"].all()
    assert not one["arm_guidance.arm_mode"].any()


def test_the_software_knows_the_vehicle_with_its_arm():
    """Mass, centre of the stowed arm, inertia of the arm in reach."""
    stowed = reference.Vehicle(reference.DEFAULT, reference.STOWED)
    ready = reference.Vehicle(reference.DEFAULT, reference.READY)
    result = run(SYSTEM, stop=0.1)
    known = result.parameter
    assert known("allocation.centre_of_mass") == pytest.approx(stowed.c, abs=1e-4)
    assert known("manager.J_S") == pytest.approx(stowed.H()[3:6, 3:6], abs=0.6)
    upper = ready.H()[3:6, 3:6][np.triu_indices(3)]
    assert known("controller.eta_hat_0")[:6] == pytest.approx(upper, abs=1e-3)
    for name in ("controller.m_hat_0", "monitor.mass", "close_controller.force_scale"):
        assert known(name) == pytest.approx(stowed.m.sum()), name
    assert result["servicer.mass"][0] == pytest.approx(125)


def test_the_arm_is_in_the_path_of_every_command():
    """And the mechanism sees the end effector, whose gripper arms the latch."""
    with load(SYSTEM) as system:
        wires = {(c.target, c.source.component) for c in system.connections}
    of = {}
    for (to, name), source in wires:
        of.setdefault((to, name.split("[")[0]), set()).add(source)
    for port in (("allocation", "F_cmd_S"), ("allocation", "M_cmd_S")):
        assert of[port] == {"arm_controller"}, port
    assert of["servicer", "wheel_accel_cmd"] == {"arm_controller"}
    assert of["arm_guidance", "arm_mode_cmd"] == {"manager"}
    assert of["mechanism", "latch_enable"] == {"arm_guidance"}
    assert ("servicer", "F_contact_S") not in of


@pytest.fixture(scope="module")
def nominal():
    return run(SYSTEM)


@pytest.mark.long
def test_the_mission_comes_to_a_stack_at_rest_with_its_phases_in_order(nominal):
    assert [s.phase for s in stays(nominal)] == NOMINAL
    assert outcome(nominal) == "captured"
    assert modes(nominal) == [STOWED, DEPLOY, ALIGN, CLOSE, REST]
    assert not nominal["monitor.abort"].any()
    assert not collided(nominal)
    rate = np.linalg.norm(nominal["servicer.omega_SN_S"], axis=1)
    assert rate[-1] < 2e-6
    assert np.linalg.norm(nominal["target.omega_TN_T"][-1]) < 2e-6
    assert np.abs(nominal["servicer.wheel_speed"]).max() <= 0.3
    verdicts = {found.text.split(" ")[0]: found.verdict for found in findings(nominal)}
    assert set(verdicts.values()) == {Verdict.MET}, verdicts


@pytest.mark.long
def test_arm_and_latch_work_as_in_arm_capture(nominal):
    """Deployed before the go counts; grip, brakes, hard capture at the intervals of the table."""
    begin = {s.phase: s.begin for s in stays(nominal)}
    mode = nominal["arm_guidance.arm_mode"]
    assert nominal.time[mode == DEPLOY][0] == pytest.approx(begin["hold 3"], abs=0.2)
    assert nominal.time[mode == ALIGN][0] == pytest.approx(begin["mating"], abs=0.2)
    assert 55 < first(nominal, "arm_guidance.grip", 1) - begin["mating"] < 60
    assert first(nominal, "mechanism.hard", 1) - begin["rigidise"] == pytest.approx(15, abs=0.3)
    tip = nominal["arm_guidance.position_error"]
    assert tip[np.isin(mode, (ALIGN, CLOSE))].max() < 0.1e-3
    assert not PAPER.belongs_to(nominal)  # its table is the probe's
    for paper in (APPROACH, INDEPENDENT):
        assert paper.belongs_to(nominal)
        claims = [claim for claim in paper.claims if claim.name != "rate of the stack"]
        verdicts = {claim.evaluate(nominal).verdict for claim in claims}
        assert verdicts <= {Verdict.MET, Verdict.NOT_EXERCISED}


@pytest.mark.long
def test_wheels_alone_would_not_hold_the_stack(nominal):
    """What thrusters take and what the wheels hold at the end is more than they can about z."""
    phase, A_w = nominal["manager.phase"], np.diag((12.0, 15, 10))
    assert nominal["manager.momentum"][phase == 7][-1] == pytest.approx(8.0, rel=0.03)
    assert nominal["stack_guidance.unloading"][phase == 9].any()
    impulse = np.sum(nominal["selector.M_cmd_S"][phase >= 9], axis=0) * 0.1
    at_end = A_w @ nominal["servicer.wheel_speed"][-1]
    assert np.linalg.norm(at_end) < 1
    assert (np.abs(at_end - impulse) > 0.3 * np.diag(A_w)).tolist() == [False, False, True]


@pytest.mark.long
@pytest.mark.parametrize("name", ENDS)
def test_every_set_retreats_for_the_reason_in_its_name_and_folds_the_arm(name):
    """A day of drift beyond 150 m; nothing is touched, and E that is out goes away at once."""
    before, reason, moved = ENDS[name]
    result = run(SYSTEM, params=name, every=50)
    simulated = stays(result)
    assert [s.phase for s in simulated] == [*before, "retreat", "safe"]
    assert simulated[-2].reason == reason
    assert modes(result) == moved
    assert not result["mechanism.phase"].any()
    leaving = result["manager.phase"] == 12
    tip = np.linalg.norm((result["servicer.r_EN_N"] - result["target.r_TN_N"])[leaving], axis=1)
    assert tip.argmin() == 0 if DEPLOY in moved else tip.min() > 3.5
    assert (result["monitor.least_margin"][-1, :3] > 0).all()
    assert drift_of_a_day(result) > 150


@pytest.mark.long
def test_the_arm_of_set_limited_ends_at_rest_too():
    result = run(SYSTEM, params="limited", every=50)
    assert [s.phase for s in stays(result)] == NOMINAL
    torque = np.abs(result["arm_controller.joint_torque"]).max(axis=0)
    assert (torque <= (10, 10, 5, 5, 2, 2, 2)).all()
    tip = result["arm_guidance.position_error"]
    assert 0.5e-3 < tip.max() < 5e-3  # friction that the software does not know


def test_replay_has_the_arm_the_phase_and_the_events_of_both():
    result = run(SYSTEM, stop=20.0, every=100)
    arrays = Arrays()
    [scene] = of_result(result).scene
    data = scene.build(result, arrays)
    texts = json.dumps(data, default=str)
    assert "far" in texts
    assert "arm stowed" in texts
    assert "end effector" in texts
