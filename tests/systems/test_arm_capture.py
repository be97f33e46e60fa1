# SPDX-License-Identifier: BSD-2-Clause
"""arm_capture: the values of an independent simulation of the same laws, within its bands."""

from __future__ import annotations

import numpy as np
import pytest

from harness import Simulation, load, run
from harness.results.verdict import Verdict
from ssp.arm_capture.claims import APPROACH, INDEPENDENT
from ssp.arm_capture.metrics import (
    ALIGN,
    CLOSE,
    DEPLOY,
    REST,
    during,
    first,
    late,
    off,
    rms,
    turned,
)
from tests.reference import arm as reference
from tests.reference.attitude import dcm

TIP, ANGLE = "arm_guidance.position_error", "arm_guidance.angle_error"


@pytest.fixture(scope="module")
def nominal():
    return run("arm_capture")


def clean(*changes):
    return run("arm_capture", params="clean", set=list(changes))


def test_modes_come_in_order_and_the_target_is_captured(nominal):
    mode, phase = nominal["arm_guidance.arm_mode"], nominal["mechanism.phase"]
    assert list(mode[np.flatnonzero(np.diff(mode, prepend=-1))]) == [0, DEPLOY, ALIGN, CLOSE, REST]
    assert list(phase[np.flatnonzero(np.diff(phase, prepend=-1))]) == [0, 2, 3]


def test_gripper_closes_locks_and_draws_in_when_it_should(nominal):
    """Grip 146.34 s, lock 2 s later, hard capture 161.34 s; rows show what a step has left."""
    grip = first(nominal, "arm_guidance.grip", 1)
    assert grip == pytest.approx(146.34, abs=0.1)
    at = nominal.time == grip
    miss = np.linalg.norm(nominal["arm_guidance.tip_Q"][at] - (-0.05, 0, 0))
    assert miss == pytest.approx(5.2e-3, rel=0.05)
    assert nominal["arm_guidance.tip_speed"][at] == pytest.approx(4.0e-3, rel=0.05)
    braked = (nominal["arm_controller.joint_lock"][:, 0] == 1) & during(nominal, REST)
    assert nominal.time[braked][0] == pytest.approx(148.34, abs=0.1)
    assert first(nominal, "mechanism.hard", 1) == pytest.approx(161.34, abs=0.5)


def test_tip_follows_the_tumbling_fixture(nominal):
    tip, rows = nominal[TIP], late(nominal)
    assert tip[during(nominal, ALIGN, CLOSE)].max() == pytest.approx(0.040e-3, rel=0.05)
    assert rms(tip[rows]) <= 0.05e-3
    assert np.degrees(rms(nominal[ANGLE][rows])) <= 2e-4
    assert rms(off(nominal)[rows]) == pytest.approx(2.54e-3, rel=0.1)
    assert np.degrees(rms(turned(nominal)[rows])) == pytest.approx(0.072, rel=0.1)
    assert nominal["arm_controller.joint_error"][during(nominal, DEPLOY)].max() < 1e-6


def test_pair_turns_as_one_after_hard_capture(nominal):
    """The relative motion after the latch has decayed at the end."""
    held = nominal["mechanism.phase"] == 3
    rates = [
        np.linalg.norm(nominal[name][held][-1])
        for name in ("servicer.omega_SN_S", "target.omega_TN_T")
    ]
    assert rates[0] == pytest.approx(rates[1], rel=0.05)


@pytest.mark.parametrize(
    ("changes", "attitude"),
    [((), 0.039), (("arm_controller.compensate_torque=0",), 0.511)],
)
def test_deployment_turns_the_base_by_what_the_feed_forward_leaves(changes, attitude):
    result = clean(*changes)
    rows = during(result, DEPLOY)
    assert np.degrees(turned(result)[rows].max()) == pytest.approx(attitude, rel=0.05)
    assert off(result)[rows].max() == pytest.approx(14.6e-3, rel=0.05)


def test_compensated_force_retains_the_base_where_it_is():
    result = clean("arm_controller.compensate_force=1")
    assert off(result)[during(result, DEPLOY)].max() == pytest.approx(2.6e-3, rel=0.05)


def test_claims_on_the_arm_have_their_verdicts(nominal):
    """The rate at hard capture is not reproduced: the parts still turn against each other."""
    found = {c.name: c.evaluate(nominal).verdict for p in (APPROACH, INDEPENDENT) for c in p.claims}
    assert found.pop("rate of the stack") is Verdict.NOT_MET
    for name in ("base attitude in deployment", "base position in deployment"):
        assert found.pop(name) is Verdict.NOT_EXERCISED
    assert set(found.values()) == {Verdict.MET}


def test_claims_of_the_deployment_are_evaluated_from_the_reference_on():
    found = {c.name: c.evaluate(clean()).verdict for c in INDEPENDENT.claims[:2]}
    assert set(found.values()) == {Verdict.MET}


def momentum(result, k):
    """Sum of the parts about the common centre of mass without wheels, and the momentum of the
    stack if it turned with the servicer [N m s].
    """
    C, C_T = (dcm(result[name][k]) for name in ("servicer.q_SN", "target.q_TN"))
    arm = reference.Vehicle(reference.DEFAULT, result["servicer.joint_angle"][k])
    m, m_T, J_T, w = arm.m.sum(), 150.0, np.diag((100.0, 150, 90)), result["servicer.omega_SN_S"][k]
    rho = result["target.r_TN_N"][k] - result["servicer.r_SN_N"][k] - C.T @ arm.c
    v = result["target.v_TN_N"][k] - result["servicer.v_CN_N"][k]
    wheels = np.diag((12.0, 15, 10)) @ result["servicer.wheel_speed"][k]
    spins = result["servicer.h_N"][k] - C.T @ wheels + C_T.T @ J_T @ result["target.omega_TN_T"][k]
    parts = spins + m * m_T / (m + m_T) * np.cross(rho, v)
    spread = lambda mass, d: mass * (d @ d * np.eye(3) - np.outer(d, d))  # noqa: E731
    own = arm.H()[3:6, 3:6] - spread(m, arm.c) + C @ C_T.T @ J_T @ C_T @ C.T
    stack = own + spread(m * m_T / (m + m_T), C @ rho)
    return np.linalg.norm(parts), np.linalg.norm(stack @ w)


def test_momentum_of_the_pair_stays_from_the_grip_to_hard_capture(nominal):
    """9.09 N m s of the independent simulation: J w, while the parts still turn against each
    other.
    """
    grip, hard = (
        int(np.flatnonzero(nominal[name] >= 1)[0])
        for name in ("arm_guidance.grip", "mechanism.hard")
    )
    (before, _), (after, stack) = momentum(nominal, grip), momentum(nominal, hard)
    assert after == pytest.approx(before, rel=1e-3)
    assert stack == pytest.approx(9.09, rel=0.02)


def test_both_executors_have_the_same_bits():
    results = [run("arm_capture", stop=1.0, executor=name) for name in ("c", "python")]
    for name in ("servicer.r_EN_N", "arm_controller.joint_torque", "mechanism.phase"):
        assert np.array_equal(results[0][name], results[1][name])


@pytest.mark.parametrize(("name", "most"), [("fast", 0.3e-3), ("friction", 4e-3)])
def test_tip_error_of_the_sets_stays_in_its_band(name, most):
    result = run("arm_capture", params=name)
    assert result[TIP][during(result, ALIGN, CLOSE)].max() <= most
    assert first(result, "mechanism.hard", 1) < 175


def rigid_impulse(result, k):
    """Impulse on T if E and T's point became one body in no time, N axes; energy before and after,
    and the work of the impulse on the slip.
    """
    C, C_T = (dcm(result[name][k]) for name in ("servicer.q_SN", "target.q_TN"))
    v = reference.Vehicle(reference.DEFAULT, result["servicer.joint_angle"][k])
    J, H, J_t, M_t = np.kron(np.eye(2), C.T) @ v.tip_columns(), v.H(), np.eye(6), np.zeros((6, 6))
    J_t[:3, 3:] = np.cross(np.eye(3), result["target.r_TN_N"][k] - result["servicer.r_EN_N"][k])
    M_t[:3, :3], M_t[3:, 3:] = 150 * np.eye(3), C_T.T @ np.diag((100.0, 150, 90)) @ C_T
    apart = C @ (result["servicer.v_SN_N"][k] - result["target.v_TN_N"][k])
    rates = result["servicer.omega_SN_S"][k], result["servicer.joint_rate"][k]
    u, u_t = np.concatenate((apart, *rates)), np.zeros(6)
    u_t[3:] = C_T.T @ result["target.omega_TN_T"][k]
    impulse, after, after_t = reference.rigid_capture(H, J, M_t, J_t, u, u_t)
    energy = [(a @ H @ a + b @ M_t @ b) / 2 for a, b in ((u, u_t), (after, after_t))]
    return impulse, energy, (J @ u - J_t @ u_t) @ impulse / 2


def test_simulated_impulse_begins_as_the_one_of_a_rigid_capture(nominal):
    """0.0377 N s of a rigid grasp, 0.0421 N s simulated in the first 0.3 s by the soft latch. A row
    shows what a step has left: the gripper closed on the row before.
    """
    grip = int(np.flatnonzero(nominal["arm_guidance.grip"] >= 1)[0]) - 1
    impulse, (before, after), work = rigid_impulse(nominal, grip)
    assert np.linalg.norm(impulse[:3]) == pytest.approx(0.0377, rel=0.02)
    assert before - after == pytest.approx(work, rel=1e-9)
    assert work > 0
    soft = int(np.flatnonzero(nominal["mechanism.phase"] == 2)[0])
    simulated = np.sum(nominal["mechanism.F_T"][soft : soft + 30], axis=0) * 0.01
    assert np.linalg.norm(simulated) == pytest.approx(0.0421, rel=0.15)


@pytest.mark.long
def test_saved_and_restored_in_every_mode_it_has_the_same_future(nominal):
    """In the middle of every mode and of both captures: saved, a second on, restored."""
    modes = nominal["arm_guidance.arm_mode"] + 10 * nominal["mechanism.phase"]
    rows = [0, *(np.flatnonzero(np.diff(modes)) + 1), len(modes) - 1]
    with load("arm_capture") as system, Simulation(system) as simulation:
        for begin, end in zip(rows, rows[1:], strict=False):
            there = (begin + end) // 2
            simulation.advance(to=there)
            snapshot = simulation.save()
            simulation.advance(to=min(there + 100, len(modes) - 1))
            simulation.restore(snapshot)
            simulation.recorder.table[there + 1 :] = np.nan
            simulation.free(snapshot)
        simulation.advance()
        assert simulation.result().values.tobytes() == nominal.values.tobytes()
