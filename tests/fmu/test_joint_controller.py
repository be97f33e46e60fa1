# SPDX-License-Identifier: BSD-2-Clause
"""joint_controller.fmu: the law, its limit, the lock, and sampling."""

from __future__ import annotations

import pytest

from .rejections import rejection


def test_torque_is_proportional_and_derivative(fmu, rng):
    q_ref, Kp, Kd, q, dq = (
        rng.normal(size=2),
        rng.uniform(0, 5, 2),
        rng.uniform(0, 90, 2),
        rng.normal(size=2),
        rng.normal(size=2),
    )
    unit = fmu(
        "joint_controller",
        {"joint_angle_ref": q_ref, "Kp": Kp, "Kd": Kd},
        {"joint_angle": q, "joint_rate": dq},
    )
    assert unit.get("joint_torque") == pytest.approx(Kp * (q_ref - q) - Kd * dq, rel=1e-15)
    assert unit.get("joint_lock") == 0
    assert unit.get("saturated").tolist() == [0, 0]


@pytest.mark.verifies("D.5-1")
def test_torque_is_cut_to_its_limit_per_joint(fmu):
    unit = fmu(
        "joint_controller", {"joint_angle_ref": (1, -1), "Kp": (10, 10), "torque_max": (4, 0)}
    )
    assert unit.get("joint_torque").tolist() == [4, -10]
    assert unit.get("saturated").tolist() == [1, 0]


def test_no_gains_leave_the_joints_free(fmu):
    unit = fmu(
        "joint_controller",
        {"Kp": (0, 0), "Kd": (0, 0)},
        {"joint_angle": (1, 2), "joint_rate": (3, 4)},
    )
    assert unit.get("joint_torque").tolist() == [0, 0]


@pytest.mark.verifies("D.5-2")
def test_the_lock_closes_at_its_time_and_takes_the_torque_away(fmu):
    unit = fmu("joint_controller", {"use_lock": 1, "lock_from": 0.3}, {"joint_angle": (0, 0)})
    seen = []
    for _ in range(5):
        unit.step(0.1)
        seen.append((unit.get("joint_lock"), unit.get("joint_torque").any()))
    assert seen == [(0, True)] * 3 + [(1, False)] * 2


@pytest.mark.verifies("D.5-3")
def test_between_samples_torque_and_lock_are_held(fmu):
    unit = fmu("joint_controller", {"sample_period": 1.0, "use_lock": 1, "lock_from": 0.5})
    first = unit.get("joint_torque")
    for _ in range(10):
        unit.step(0.1, {"joint_angle": (0.3, 0.3)})
    assert (
        unit.get("joint_torque").tolist() != first.tolist()
    )  # the sample at t = 0 has read the new angles
    assert unit.get("joint_lock") == 0
    unit.step(0.1)
    assert unit.get("joint_lock") == 1


@pytest.mark.parametrize("name", ["Kp", "Kd", "torque_max"])
def test_negative_gains_and_limits_are_rejected(tmp_path, name):
    assert f"{name}[2] = -1: must be >= 0" in rejection(
        "joint_controller", {name: (1, -1)}, tmp_path
    )
