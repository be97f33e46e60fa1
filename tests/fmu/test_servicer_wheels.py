# SPDX-License-Identifier: BSD-2-Clause
"""servicer.fmu: momentum wheels against theory: exchange of momentum and energy with the body,
limits.
"""

from __future__ import annotations

import numpy as np
import pytest

from .cases import DEEP_SPACE, spinning_servicer
from .motion import deviation, stencil
from .theory import dcm_of_mrp


def attitude(unit):
    return dcm_of_mrp(unit.get("sigma_SN"))


@pytest.mark.parametrize("limits", [{}, {"wheel_accel_max": 0.02, "wheel_speed_max": 1.5}])
def test_total_momentum_is_conserved_under_arbitrary_wheel_commands(fmu, rng, limits):
    p = spinning_servicer(rng) | limits
    unit = fmu("servicer", p)

    def momentum():
        return attitude(unit).T @ (
            p["J_S"] @ unit.get("omega_SN_S") + p["A_w"] @ unit.get("wheel_speed")
        )

    H = momentum()
    for _ in range(300):
        unit.step(1, {"wheel_accel_cmd": rng.uniform(-0.04, 0.04, 3)})
        assert deviation(momentum(), H, np.linalg.norm(H)) < 1e-10


@pytest.mark.parametrize("axis", range(3))
def test_single_wheel_turns_the_body_back_by_its_share_of_inertia(fmu, axis):
    """From rest: omega = -A Omega/J and angle = -A/J x (wheel angle), about a fixed axis."""
    J, A, accel, t = (200.0, 250.0, 150.0), (12.0, 15.0, 10.0), 0.01, 50.0
    e = np.eye(3)[axis]
    unit = fmu("servicer", DEEP_SPACE | {"J_S": np.diag(J), "A_w": np.diag(A)})
    unit.step(t, {"wheel_accel_cmd": accel * e})
    share = A[axis] / J[axis]
    assert deviation(unit.get("wheel_speed"), accel * t * e) < 1e-12
    assert deviation(unit.get("omega_SN_S"), -share * accel * t * e) < 1e-12
    assert deviation(unit.get("sigma_SN"), np.tan(-share * accel * t**2 / 8) * e) < 1e-12


def test_running_wheel_stiffens_the_nutation_of_an_axisymmetric_body(fmu):
    """Dual spin: rates turn at ((I3 - It) w3 + A Omega)/It about the common axis."""
    It, I3, A3, Omega, w1, w3 = 180.0, 150.0, 10.0, 0.8, 0.01, 0.03
    body = {
        "J_S": np.diag([It, It, I3]),
        "A_w": np.diag([A3, A3, A3]),
        "wheel_speed_0": (0, 0, Omega),
    }
    unit = fmu("servicer", DEEP_SPACE | body | {"omega_SN_S_0": (w1, 0, w3)})
    nutation = ((I3 - It) * w3 + A3 * Omega) / It
    for _ in range(10):
        unit.step(30)
        angle = nutation * unit.time
        assert (
            deviation(unit.get("omega_SN_S"), (w1 * np.cos(angle), w1 * np.sin(angle), w3), w1)
            < 1e-9
        )


def test_kinetic_energy_changes_by_motor_power_and_external_power(fmu, rng):
    """dT/dt = u.Omega + M.w with motor torque u = A (dw/dt + dOmega/dt); five-point stencil, error
    (w h)^4 = 1e-12.
    """
    p, h = spinning_servicer(rng, rate=0.05), 0.05
    J, A, M, accel = p["J_S"], p["A_w"], 0.2 * rng.normal(size=3), 0.02 * rng.normal(size=3)
    unit = fmu("servicer", p, {"M_S": M, "wheel_accel_cmd": accel})
    _, w, Omega = unit.history(h, 200, "omega_SN_S", "wheel_speed")
    T = [x @ J @ x / 2 + x @ A @ y + y @ A @ y / 2 for x, y in zip(w, Omega, strict=True)]
    for k in range(2, 199, 7):
        motor = A @ (stencil(w[k - 2 : k + 3], h) + accel)
        power = motor @ Omega[k] + M @ w[k]
        scale = np.abs(motor) @ np.abs(Omega[k]) + np.abs(M) @ np.abs(w[k])
        assert deviation(stencil(T[k - 2 : k + 3], h), power, scale) < 1e-8


def test_wheel_acceleration_is_limited_per_wheel(fmu):
    unit = fmu("servicer", DEEP_SPACE | {"wheel_accel_max": 0.02})
    unit.step(10, {"wheel_accel_cmd": (0.05, -0.03, 0.01)})
    assert deviation(unit.get("wheel_speed"), (0.2, -0.2, 0.1)) < 1e-14


def test_wheel_runs_up_to_its_speed_limit_stays_there_and_comes_back_at_once(fmu):
    """The limit is met inside an internal step, at 21.74 s."""
    top, accel = 0.5, (0.023, -0.04, 0.001)
    unit = fmu("servicer", DEEP_SPACE | {"wheel_speed_max": top}, {"wheel_accel_cmd": accel})
    t, speed = unit.history(0.1, 400, "wheel_speed")
    assert deviation(speed, np.clip(np.outer(t, accel), -top, top)) < 1e-14
    assert np.abs(speed).max() <= top
    unit.step(10, {"wheel_accel_cmd": (-0.01, 0.02, 0)})
    assert deviation(unit.get("wheel_speed"), (top - 0.1, -top + 0.2, 0.04)) < 1e-14


def test_wheel_beyond_its_speed_limit_may_only_slow_down(fmu):
    unit = fmu("servicer", DEEP_SPACE | {"wheel_speed_max": 0.5, "wheel_speed_0": (0.7, -0.7, 0.7)})
    unit.step(5, {"wheel_accel_cmd": (0.02, -0.02, -0.02)})
    assert deviation(unit.get("wheel_speed"), (0.7, -0.7, 0.6)) < 1e-14
