# SPDX-License-Identifier: BSD-2-Clause
"""Kinematics and plan of the arm: against the plant, against shapes that are known by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from scipy.spatial.transform import Rotation

from harness import run
from harness.cli.app import main
from harness.errors import UsageError
from harness.studies.show import plan
from ssp.arm_capture.kinematics import arm_of, jacobian, pose
from ssp.arm_capture.plan import LINE, limits_of
from ssp.arm_capture.reach import between, clearance, reach

TOOL = {"servicer.p_EA_A": [0.3, 0.1, -0.2], "servicer.q_EA": [0.6, 0, 0, 0.8]}


@pytest.fixture(scope="module")
def simulated():
    """Deployment with a tool that is off the axis; seven joints move."""
    return run("arm_capture", stop=60.0, every=20, set=TOOL)


def attitude(result, name):
    return Rotation.from_quat(result[name][:, [1, 2, 3, 0]])


def test_end_effector_is_where_the_plant_has_it(simulated):
    at = pose(arm_of(simulated), simulated["servicer.joint_angle"])
    S, E = attitude(simulated, "servicer.q_SN"), attitude(simulated, "servicer.q_EN")
    place = S.inv().apply(simulated["servicer.r_EN_N"] - simulated["servicer.r_SN_N"])
    np.testing.assert_allclose(at.tip, place, atol=1e-8)  # positions in orbit: 7e6 m
    np.testing.assert_allclose(at.frame, (S.inv() * E).as_matrix(), atol=1e-12)


def test_jacobian_gives_the_velocities_of_the_plant(simulated):
    """v_E - v_S - w x p_E and w_E - w in base axes are J_m dq."""
    at = pose(arm_of(simulated), simulated["servicer.joint_angle"])
    found = np.einsum("kij,kj->ki", jacobian(at), simulated["servicer.joint_rate"])
    S, E = attitude(simulated, "servicer.q_SN"), attitude(simulated, "servicer.q_EN")
    w = simulated["servicer.omega_SN_S"]
    v = S.inv().apply(simulated["servicer.v_EN_N"] - simulated["servicer.v_SN_N"]) - np.cross(
        w, at.tip
    )
    turning = (S.inv() * E).apply(simulated["servicer.omega_EN_E"].copy()) - w
    assert np.abs(found).max() > 0.01
    np.testing.assert_allclose(found, np.hstack([v, turning]), atol=1e-11)


# ---- reach

SHOULDER, ELBOW_TO_WRIST = np.array([0.6, 0, -0.3]), 1.6
FARTHEST = SHOULDER[0] + np.sqrt(ELBOW_TO_WRIST**2 - SHOULDER[2] ** 2) + 0.4
"""Tip on the x axis, last 0.4 m along x, all between joint 2 and joint 6 stretched."""
FAR = {"guidance.rho_M": 3.6, "guidance.rho_0": 3.6}


@pytest.fixture(scope="module")
def nominal():
    return plan("arm_capture")


def test_stand_and_seat_are_reached_from_the_reference(nominal):
    """Base 2.6 m from T, fixture 0.6 m before it: 2 m; all the time, for both turn alike."""
    for name, x in (("stand", 1.7), ("seat", 2.05)):
        r = nominal.histories[name]
        assert len(r.time) == 60
        assert (r.time[0], r.time[-1]) == pytest.approx((90, 199.9))
        np.testing.assert_allclose(r["plan.place"], np.tile([x, 0, 0], (60, 1)), atol=1e-8)
        assert r["plan.reached"].all()
    assert nominal.good
    assert nominal.text().endswith("planned: the arm always reaches standoff point and seat")


def test_the_arm_ends_where_it_is_stretched(nominal):
    """Of the places on the axis the farthest one that is reached is the last before FARTHEST."""
    places = 2.05 + LINE[LINE >= 0]
    np.testing.assert_array_equal(nominal.line[LINE >= 0], places <= FARTHEST)


def test_from_a_metre_farther_off_nothing_is_planned(tmp_path, capsys):
    given = [part for name, value in FAR.items() for part in ("--set", f"{name}={value}")]
    assert main(["plan", "arm_capture", *given, "-o", str(tmp_path)]) == 1
    reported = capsys.readouterr().out
    assert (
        "not planned: the arm does not reach the point at arm_guidance.standoff at every instant"
        in reported
    )
    assert (
        "not planned: the arm does not reach the seat in the fixture at every instant" in reported
    )
    least = np.ceil((3.05 - FARTHEST) / 0.05) * 0.05
    assert f"reach the seat from a base {least:.2f} m nearer to the target" in reported
    assert {p.name for p in tmp_path.iterdir()} == {"planned_reach.png", "planned_joints.png"}


def test_a_fixture_off_the_axis_is_where_the_bodies_have_it():
    """From the ports of the mechanism in a run whose base starts on the reference."""
    ports = {"mechanism.p_QT_T": [0.5, 0.2, -0.1], "mechanism.q_QT": [0.8, 0, 0.6, 0]}
    ports |= {"arm_guidance.p_QT_T": [0.5, 0.2, -0.1], "arm_guidance.q_QT": [0.8, 0, 0.6, 0]}
    clean = run("arm_capture", params="clean", stop=0.01, set=ports)
    T, S = attitude(clean, "target.q_TN")[0], attitude(clean, "servicer.q_SN")[0]
    seen = clean["target.r_TN_N"][0] + T.apply([0.5, 0.2, -0.1]) - clean["servicer.r_SN_N"][0]
    X_Q = T.apply(Rotation.from_quat([0, 0.6, 0, 0.8]).apply([1, 0, 0]))
    expected = S.inv().apply(seen - 0.05 * X_Q)
    found = plan("arm_capture", set=ports, stop=1.0).seat["plan.place"][0]
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_places_of_known_poses_are_found_again(nominal):
    known = nominal.seat
    arm, limits = arm_of(known), limits_of(known)
    angles = limits.posture + np.random.default_rng(1).uniform(-0.3, 0.3, (20, 7))
    at = pose(arm, angles)
    found = reach(arm, limits, at.tip, at.frame[:, :, 0])
    assert found.reached.all()
    again = pose(arm, found.angle)
    np.testing.assert_allclose(again.tip, at.tip, atol=1e-9)
    np.testing.assert_allclose(again.frame[:, :, 0], at.frame[:, :, 0], atol=1e-9)
    J = jacobian(again)
    squares = np.linalg.eigvalsh(J @ J.transpose(0, 2, 1))[:, ::-1]
    np.testing.assert_allclose(found.singular**2, squares, atol=1e-12)
    narrow = limits._replace(high=limits.posture + 0.01, low=limits.posture - 0.01)
    assert not reach(arm, narrow, at.tip, at.frame[:, :, 0]).reached.any()


# ---- clearance


def test_distance_of_two_lines_is_the_least_of_their_points():
    random = np.random.default_rng(2)
    for _ in range(50):
        a, b, c, d = random.normal(size=(4, 3))
        best = lsq_linear(np.column_stack([b - a, c - d]), c - a, (0, 1), tol=1e-14)
        assert between(a, b, c, d) == pytest.approx(np.sqrt(2 * best.cost), abs=1e-6)


def test_a_stretched_arm_is_clear_of_itself_and_a_folded_one_is_not(nominal):
    """Stretched: 0.75 m between links 4 and 7, less their radii sqrt(2 I_xx/m)."""
    arm = arm_of(nominal.seat)
    radii = np.sqrt(2 * 0.012 / 3.5) + np.sqrt(2 * 0.008 / 3)
    distance, links = clearance(arm, np.zeros(7))
    assert (distance, links) == (pytest.approx(0.75 - radii), (4, 7))
    assert clearance(arm, np.array([0, 0, 0, np.pi, 0, 0, 0]))[0] < 0
    folded = replace(nominal, touches=(-0.01, (3, 6)))
    assert not folded.good
    assert folded.text().endswith("not planned: the stowed arm touches itself")


def test_a_system_without_an_arm_is_wrong_use():
    with pytest.raises(UsageError, match="there is no arm to plan for"):
        plan("arm_capture", set={"servicer.joints": 0})
