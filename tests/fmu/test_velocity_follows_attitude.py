# SPDX-License-Identifier: BSD-2-Clause
"""servicer.fmu with velocity_follows_attitude: the kinematics of Kozlova & Fomichev, u' = F/m in
body components.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from .cases import DEEP_SPACE
from .driver import bits
from .theory import MU, dcm_of_quaternion

SLAVED = DEEP_SPACE | {
    "velocity_follows_attitude": 1,
    "mass_0": 70.0,
    "J_S": np.diag([100, 100, 120]),
}
F = np.array([3.0, -2.0, 1.0])
SPIN = (0.03, -0.02, 0.05)


def body_velocity(unit):
    return dcm_of_quaternion(unit.get("q_SN")) @ unit.get("v_SN_N")


def test_body_components_of_the_velocity_are_the_integral_of_force_over_mass(fmu):
    """While the vehicle turns by more than a revolution: RK4 at 0.1 s and 0.06 rad/s errs by 1e-11
    per step.
    """
    start = {"v_0_N": (0.4, 0.1, -0.2), "omega_SN_S_0": SPIN}
    unit = fmu("servicer", SLAVED | start)
    unit.step(120, {"F_S": F})
    assert body_velocity(unit) == pytest.approx(np.array(start["v_0_N"]) + F / 70 * 120, abs=1e-8)


def test_position_is_the_integral_of_the_turned_velocity(fmu):
    """Spin about z: r' = C^T u with C known in closed form, integrated to a tight tolerance."""
    unit = fmu("servicer", SLAVED | {"v_0_N": (0.4, 0.1, -0.2), "omega_SN_S_0": (0, 0, 0.05)})
    unit.step(60, {"F_S": F})

    def rate(t, _):
        c, s, u = np.cos(0.05 * t), np.sin(0.05 * t), np.array([0.4, 0.1, -0.2]) + F / 70 * t
        return [c * u[0] - s * u[1], s * u[0] + c * u[1], u[2]]

    truth = solve_ivp(rate, (0, 60), [0, 0, 0], method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    assert unit.get("r_SN_N") == pytest.approx(truth, abs=1e-7)


def test_without_turning_it_is_the_law_of_newton(fmu):
    slaved, newton = (fmu("servicer", SLAVED | {"velocity_follows_attitude": on}) for on in (1, 0))
    for unit in (slaved, newton):
        unit.step(30, {"F_S": F})
    assert bits(slaved) == bits(newton)


def test_by_default_the_velocity_does_not_turn(fmu):
    unit = fmu("servicer", DEEP_SPACE | {"v_0_N": (1, 0, 0), "omega_SN_S_0": SPIN})
    unit.step(60)
    assert unit.get("v_SN_N").tolist() == [1, 0, 0]


def test_frozen_attitude_does_not_turn_the_velocity(fmu):
    """Before t_att the rate is only a start value: nothing turns."""
    unit = fmu("servicer", SLAVED | {"v_0_N": (1, 0, 0), "omega_SN_S_0": SPIN, "t_att": 50})
    unit.step(50)
    assert unit.get("v_SN_N").tolist() == [1, 0, 0]
    unit.step(10)
    assert np.linalg.norm(unit.get("v_SN_N") - (1, 0, 0)) > 0.1
    assert np.linalg.norm(unit.get("v_SN_N")) == pytest.approx(1, abs=1e-10)


def test_gravity_acts_on_the_turning_velocity_too(fmu):
    """u' = C g: over one second the velocity changes by g besides the turn."""
    r = np.array([7e6, 0, 0])
    orbit = {
        "a": 0,
        "mu": MU,
        "use_J2": 0,
        "r_0_N": r,
        "v_0_N": (0, 0, 0),
        "omega_SN_S_0": (0, 0, 1e-6),
    }
    unit = fmu("servicer", SLAVED | orbit)
    unit.step(1)
    assert unit.get("v_SN_N") == pytest.approx(-MU * r / 7e6**3, abs=1e-4)
