# SPDX-License-Identifier: BSD-2-Clause
"""arm_controller.fmu against full matrices on point masses, and a deployment on a free base."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.each import each

from ..reference import arm as reference
from ..reference.arm_software import ALIGN, CLOSE, CONTROL, DEPLOY, REST, STOW, Controller
from .arm_cases import SPACE, random_arm
from .theory import dcm_of_quaternion

COMMANDS = ("F_cmd_S", "M_cmd_S", "wheel_accel_cmd")


def random_inputs(rng, n, mode):
    joints = {
        name: np.append(rng.normal(size=n), np.zeros(7 - n))
        for name in ("joint_angle", "joint_angle_ref")
    }
    joints |= {
        f"joint_{name}": np.append(0.1 * rng.normal(size=n), np.zeros(7 - n))
        for name in ("rate", "rate_ref", "accel_ref")
    }
    base = {"omega_SN_S": 0.1 * rng.normal(size=3), "wheel_speed": rng.normal(size=3)}
    return joints | base | {name: rng.normal(size=3) for name in COMMANDS} | {"arm_mode": mode}


def same(unit, expected):
    for name, value in expected.items():
        assert unit.get(name) == pytest.approx(value, rel=1e-9, abs=1e-10), name


@pytest.mark.verifies("K.4-4")
@each("n", [0, 2, 7])
@each("mode", [STOW, DEPLOY, CLOSE, REST])
def test_torques_and_commands_match_the_reference(fmu, rng, n, mode):
    """Random arm, options and limits; every option in one of its positions."""
    arm = random_arm(rng, n)
    wheels, force, torque, rest = rng.integers(0, 2, 4)
    p = {"use_wheels": wheels, "compensate_force": force, "compensate_torque": torque}
    p |= {"base_rest": rest, "omega_joint": 3.0, "omega_rest": 0.7, "zeta": 0.8}
    p |= {"joint_damping": rng.uniform(0, 1, 7), "joint_friction": rng.uniform(0, 1, 7)}
    p |= {"friction_rate": 0.05, "joint_torque_max": rng.choice((0, 0.3, 2), 7)}
    p |= {"M_ff_max": rng.choice((0, 0.05), 3), "A_w": CONTROL["A_w"] + 0.5}
    u = random_inputs(rng, n, mode)
    unit = fmu("arm_controller", arm.parameters() | p, u)
    same(unit, Controller(arm, **p).sample(0.0, u))
    u = random_inputs(rng, n, mode)
    unit.step(0.1, u)
    same(unit, Controller(arm, **p).sample(0.0, u))


@pytest.mark.verifies("K.4-1")
@pytest.mark.parametrize("option", ["compensate_torque", "compensate_force"])
def test_feed_forward_does_not_follow_the_error_of_the_joints(fmu, rng, option):
    """With friction the joint is at rest; wheels that answered the feedback would turn the base."""
    u = random_inputs(rng, 7, DEPLOY)
    unit = fmu("arm_controller", {option: 1}, u)
    F, M = unit.get("F_ff_S"), unit.get("M_ff_S")
    unit.step(0.1, {"joint_angle_ref": rng.normal(size=7), "joint_rate_ref": rng.normal(size=7)})
    assert np.array_equal(unit.get("F_ff_S"), F)
    assert np.array_equal(unit.get("M_ff_S"), M)
    assert np.linalg.norm(M) > 0 or option == "compensate_force"


@pytest.mark.verifies("K.4-3")
def test_brakes_close_after_T_lock_and_only_below_lock_rate(fmu):
    """Counted from the first sample in REST; once closed they stay, until REST is left."""
    other = Controller(reference.DEFAULT, T_lock=0.5, lock_rate=0.1)
    unit = fmu("arm_controller", {"T_lock": 0.5, "lock_rate": 0.1, "sample_period": 0.1})
    rng, locks = np.random.default_rng(1), []
    u = random_inputs(rng, 7, DEPLOY)
    plan = [DEPLOY] * 2 + [REST] * 9 + [ALIGN] + [REST] * 7 + [STOW]
    for k, mode in enumerate(plan):
        fast = 0.3 if k < 9 or k in (17, 18) else 0.1
        u |= {"arm_mode": mode, "joint_rate": np.where(np.arange(7) == 3, fast, 0.01)}
        unit.step(0.1, u)
        expected = other.sample(0.1 * k, u)
        locks.append(int(unit.get("joint_lock")[0]))
        same(unit, expected)
    assert locks == [0] * 9 + [1, 1] + [0] * 6 + [0, 0, 1]


class Deployment:
    """Guidance, controller and plant in deep space, S = N at the start, by the clock."""

    def __init__(self, fmu, h=0.02, **control):
        self.h = h
        plant = SPACE | {"max_step": h}
        self.plant = fmu("arm_servicer", plant, {"joint_lock": (1,) * 7})
        far = {"r_TN_N": (1000, 0, 0)}
        sampled = {"sample_period": h}
        self.guidance = fmu("arm_guidance", sampled | {"deploy_from": 0, "track_from": 1e3}, far)
        self.controller = fmu("arm_controller", sampled | control)

    def simulate(self, seconds):
        """Largest error of a joint on the way."""
        worst = 0.0
        for _ in range(round(seconds / self.h)):
            joints = {name: self.plant.get(name) for name in ("joint_angle", "joint_rate")}
            body = {name: self.plant.get(name) for name in ("omega_SN_S", "wheel_speed")}
            pose = {name: self.plant.get(name) for name in ("r_SN_N", "v_SN_N", "q_SN")}
            self.guidance.step(self.h, joints | pose | {"omega_SN_S": body["omega_SN_S"]})
            names = ("joint_angle_ref", "joint_rate_ref", "joint_accel_ref", "arm_mode")
            self.controller.step(
                self.h, joints | body | {name: self.guidance.get(name) for name in names}
            )
            worst = max(worst, self.controller.get("joint_error"))
            self.plant.step(
                self.h,
                {name: self.controller.get(name) for name in ("joint_torque", "joint_lock")}
                | {"F_S": self.controller.get("F_sum_S"), "M_S": self.controller.get("M_sum_S")}
                | {"wheel_accel_cmd": self.controller.get("wheel_accel_sum")},
            )
        return worst

    def turned(self):
        """Degrees from the start."""
        C = dcm_of_quaternion(self.plant.get("q_SN"))
        return np.degrees(Rotation.from_matrix(C).magnitude())


def by_momentum_alone(steps=400):
    """v, w = -H_00^-1 H_0m dq along the path: where the base is when the arm is deployed."""
    way = reference.READY - reference.STOWED
    r, R = np.zeros(3), np.eye(3)
    x = (np.arange(steps) + 0.5) / steps
    S, dS = 10 * x**3 - 15 * x**4 + 6 * x**5, 30 * x**2 * (1 - x) ** 2 / steps
    for s, ds in zip(S, dS, strict=True):
        H = reference.Vehicle(reference.DEFAULT, reference.STOWED + s * way).H()
        v, w = np.split(-np.linalg.solve(H[:6, :6], H[:6, 6:] @ (ds * way)), 2)
        r = r + R @ Rotation.from_rotvec(w / 2).as_matrix() @ v
        R = R @ Rotation.from_rotvec(w).as_matrix()
    return np.degrees(Rotation.from_matrix(R).magnitude()), r


def test_deployment_without_compensation_turns_the_base_as_momentum_states(fmu):
    """5.08 deg and (-0.110, 0.059, 0.015) m, and no error of a joint: true parameters."""
    recording = Deployment(fmu, compensate_torque=0)
    assert recording.simulate(60) < 1e-6
    turned, shifted = by_momentum_alone()
    assert turned == pytest.approx(5.08, abs=0.005)
    assert shifted == pytest.approx((-0.110, 0.059, 0.015), abs=5e-4)
    assert recording.turned() == pytest.approx(turned, rel=1e-4)
    assert recording.plant.get("r_SN_N") == pytest.approx(shifted, abs=1e-5)


@pytest.mark.verifies("K.4-2")
def test_deployment_with_compensation_leaves_the_attitude(fmu):
    """Below 1e-3 deg; the base shifts by (-0.112, 0.078, 0.015) m."""
    recording = Deployment(fmu)
    assert recording.simulate(60) < 1e-6
    assert recording.turned() < 1e-3
    assert recording.plant.get("r_SN_N") == pytest.approx((-0.112, 0.078, 0.015), abs=5e-4)


def test_defaults_of_the_reference_match_the_interface(fmu):
    unit = fmu("arm_controller")
    for name, value in CONTROL.items():
        assert unit.get(name) == pytest.approx(np.ravel(value), abs=0), name
