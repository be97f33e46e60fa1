# SPDX-License-Identifier: BSD-2-Clause
"""assembly_controller.fmu: feed-forward against point masses, error dynamics, the law as
printed.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from .assembly_cases import C_HO, N_ORBIT, Q_FLIGHT, Assembly, C_SO_of, q_SH_of
from .rejections import rejection

K1, K2 = 0.036, 8e-4


class Path:
    """A motion of base and arm: turning about fixed axes at changing rates; derivatives by
    differences.
    """

    def __init__(self, rng):
        self.axis = rng.normal(size=(2, 3)) * 0.1
        self.arm = (0.8, 4e-4, 3e-7)
        self.h = rng.normal(size=3) * 500

    def angle(self, t):
        a, da, dda = self.arm
        return a + da * t + dda * t * t / 2, da + dda * t

    def C_SO(self, t):
        turn = Rotation.from_rotvec(self.axis[0]) * Rotation.from_rotvec(
            self.axis[1] * (0.02 * t + 1e-5 * t * t)
        )
        return turn.as_matrix().T

    def C_SN(self, t):
        orbital = expm(t * N_ORBIT * np.array([[0, -1, 0], [1, 0, 0], [0, 0, 0]])) @ C_HO
        return self.C_SO(t) @ orbital.T

    def omega(self, t, d=1e-2):
        spin = (self.C_SN(t + d) - self.C_SN(t - d)) / (2 * d) @ self.C_SN(t).T
        return -np.array([spin[2, 1], spin[0, 2], spin[1, 0]])

    def q_SH(self):
        return np.roll(Rotation.from_matrix((self.C_SO(0) @ C_HO.T).T).as_quat(), 1)

    def inputs(self, d=1e-1):
        w = self.omega(0)
        alpha = (self.omega(d) - self.omega(-d)) / (2 * d)
        return {
            "q_SH": self.q_SH(), "q_DH": self.q_SH(), "omega_SN_S": w, "omega_DN_D": w,
            "alpha_DN_D": alpha, "h_cmg_S": self.h, "h_ref_D": self.h,
            "arm_angle": self.arm[0], "arm_rate": self.arm[1], "arm_accel": self.arm[2],
        }  # fmt: skip

    def feed_forward(self, model=None, d=1.0):
        """h' = tau - dH/dt - omega x (H + h), H of the point masses, its derivative in body axes by
        differences.
        """
        model = model or Assembly()

        def carried(t):
            return model.momentum(self.omega(t), *self.angle(t))

        rate = (carried(d) - carried(-d)) / (2 * d)
        torque = model.torque(self.C_SO(0), self.arm[0])
        return torque - rate - np.cross(self.omega(0), carried(0) + self.h)


# ---- feed-forward


def test_without_errors_the_command_is_the_inverse_dynamics_of_point_masses(fmu, rng):
    path = Path(rng)
    unit = fmu("assembly_controller", {"use_plan_rate": 0}, path.inputs())
    expected = path.feed_forward()
    assert unit.get("hdot_cmd_S") == pytest.approx(expected, abs=2e-5 * np.linalg.norm(expected))


def test_terms_as_printed_miss_the_inverse_dynamics(fmu, rng):
    """2 m_r R x (dR/dt x omega), and the velocity of the module as seen in N."""
    path = Path(rng)
    unit = fmu("assembly_controller", {"use_plan_rate": 0}, path.inputs())
    a = Assembly()
    m_r = a.m0 * a.m1 / (a.m0 + a.m1)
    d = Rotation.from_rotvec((0, 0, path.arm[0])).apply(a.module)
    R, V = np.array(a.hinge) + d, path.arm[1] * np.cross((0, 0, 1), d)
    w, right = path.omega(0), path.feed_forward()
    V_dot = path.arm[2] * np.cross((0, 0, 1), d) - path.arm[1] ** 2 * d * (1, 1, 0)
    for wrong in (
        right + m_r * np.cross(R, V_dot) - 2 * m_r * np.cross(R, np.cross(V, w)),
        right - np.cross(w, m_r * np.cross(R, np.cross(w, R))),
        right - a.aero_torque(path.C_SO(0), path.arm[0]) * (1 - 3 * N_ORBIT**2),
    ):
        gap = np.linalg.norm(unit.get("hdot_cmd_S") - wrong)
        assert gap > 10 * 2e-5 * np.linalg.norm(right)


@pytest.mark.verifies("E.5-1")
def test_on_the_plan_the_command_is_the_mean_rate_of_the_plan(fmu, rng):
    path, rate = Path(rng), rng.normal(size=3)
    unit = fmu("assembly_controller", {}, path.inputs() | {"dh_ref_D": rate})
    assert unit.get("hdot_cmd_S") == pytest.approx(rate, abs=1e-9)


@pytest.mark.verifies("E.5-2")
def test_off_the_plan_the_model_adds_what_differs(fmu, rng):
    """Mean rate of the plan instead of the model's rate on the plan, nothing else."""
    path, rate = Path(rng), rng.normal(size=3)
    off = {"h_cmg_S": path.h + np.array((5, -8, 3)), "arm_rate": 5e-4}
    at_plan = fmu("assembly_controller", {"use_plan_rate": 0}, path.inputs() | {"arm_rate": 5e-4})
    model = fmu("assembly_controller", {"use_plan_rate": 0}, path.inputs() | off)
    unit = fmu("assembly_controller", {}, path.inputs() | off | {"dh_ref_D": rate})
    expected = model.get("hdot_cmd_S") + rate - at_plan.get("hdot_cmd_S")
    assert unit.get("hdot_cmd_S") == pytest.approx(expected, abs=1e-9)


# ---- feedback


def test_errors_are_turned_back_in_proportion_to_the_inertia(fmu, rng):
    """Small rotation and rate from the reference: what changes is J_A (k1 w + k2 theta/2), beside
    the dynamics, which are two orders smaller here.
    """
    theta, w = rng.normal(size=3) * 1e-5, rng.normal(size=3) * 1e-6
    eps = np.zeros(3)
    base = {"q_DH": q_SH_of(eps), "omega_DN_D": (0, -N_ORBIT, 0), "arm_angle": 0.5}
    still = base | {"q_SH": q_SH_of(eps), "omega_SN_S": (0, -N_ORBIT, 0)}
    turn = Rotation.from_rotvec(theta).as_matrix().T
    moved = base | {
        "q_SH": q_SH_of(theta / 2),
        "omega_SN_S": turn @ (0, -N_ORBIT, 0) + w,
    }
    change = [
        fmu("assembly_controller", {"use_plan_rate": 0}, u).get("hdot_cmd_S")
        for u in (moved, still)
    ]
    expected = Assembly().inertia(0.5) @ (K1 * w + K2 * theta / 2)
    scale = np.linalg.norm(expected)
    assert change[0] - change[1] == pytest.approx(expected, abs=0.15 * scale)
    unit = fmu("assembly_controller", {}, moved)
    assert unit.get("attitude_error") == pytest.approx(np.linalg.norm(theta), rel=1e-6)
    assert unit.get("domega_S") == pytest.approx(w, abs=1e-12)


def test_closed_loop_error_obeys_its_equation(fmu):
    """Deep space, arm at rest: 0.01 rad about an axis decays as theta'' + k1 theta' + k2/2 theta =
    0, sampled every 0.1 s.
    """
    deep = {"mu": 0, "max_step": 0.1}
    plant = fmu("assembly", deep | {"eps_0": (0, 0, 0.005), "H_sat": 1e5})
    controller = fmu("assembly_controller", {"mu": 0, "use_plan_rate": 0})
    state = ("q_SH", "omega_SN_S", "h_cmg_S", "arm_angle", "arm_rate", "arm_accel")
    for _ in range(1000):
        controller.step(0.1, {name: plant.get(name) for name in state})
        plant.step(0.1, {"hdot_cmd_S": controller.get("hdot_cmd_S")})
    zeta, wc, t = 0.9, 0.02, 100.0
    wd = wc * np.sqrt(1 - zeta**2)
    decay = np.exp(-zeta * wc * t) * (np.cos(wd * t) + zeta * wc / wd * np.sin(wd * t))
    assert 2 * plant.get("eps")[2] == pytest.approx(0.01 * decay, abs=2e-5)


@pytest.mark.verifies("E.5-3")
def test_a_quaternion_and_its_negative_are_the_same(fmu, rng):
    path = Path(rng)
    turned = path.inputs() | {"q_SH": -q_SH_of((0.1, 0.2, -0.1))}
    again = turned | {"q_SH": -turned["q_SH"], "q_DH": -turned["q_DH"]}
    a, b = (fmu("assembly_controller", {}, u).get("hdot_cmd_S") for u in (turned, again))
    assert a == pytest.approx(b, rel=1e-12)


@pytest.mark.verifies("E.5-4")
def test_law_as_printed(fmu, rng):
    eps, eps_b, w = rng.uniform(-0.2, 0.2, 3), rng.uniform(-0.2, 0.2, 3), rng.normal(size=3) * 1e-3
    unit = fmu(
        "assembly_controller",
        {"law": 0, "k2_printed": 700},
        {"q_SH": q_SH_of(eps), "q_DH": q_SH_of(eps_b), "omega_SN_S": w, "arm_angle": 0.3},
    )
    expected = K1 * Assembly().inertia(0.3) @ (w - (0, -N_ORBIT, 0)) + 700 * (eps - eps_b)
    assert unit.get("hdot_cmd_S") == pytest.approx(expected, rel=1e-9)


@pytest.mark.verifies("E.5-5")
def test_between_samples_the_command_is_held(fmu):
    unit = fmu("assembly_controller", {"sample_period": 1.0}, {"omega_SN_S": (0, -N_ORBIT, 0)})
    unit.step(0.5)
    held = unit.get("hdot_cmd_S")
    unit.step(0.5, {"omega_SN_S": (1e-3, 0, 0)})
    assert np.array_equal(unit.get("hdot_cmd_S"), held)
    unit.step(0.5)
    assert not np.array_equal(unit.get("hdot_cmd_S"), held)
    assert C_SO_of(Q_FLIGHT) == pytest.approx(np.eye(3), abs=1e-15)


@pytest.mark.verifies("E.5-6")
@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"k1": -1}, "k1 = -1: must be >= 0"),
        ({"m0": 0}, "m0 = 0: must be > 0"),
        ({"J1": np.diag((1, 1, 3))}, "J1 = 3: must satisfy the triangle inequality"),
        ({"law": 2}, "law = 2: must be 0 or 1"),
    ],
)
def test_rejected(tmp_path, parameters, message):
    assert message in rejection("assembly_controller", parameters, tmp_path)
