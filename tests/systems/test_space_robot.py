# SPDX-License-Identifier: BSD-2-Clause
"""space_robot: a day against the pitch equation, tumbling and libration, joints driven under
sampled control.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from harness import run
from ssp.space_robot.pitch import rotation_number
from tests.each import some

from ..fmu.robot_cases import PAPER, Q, pitch_constants, same_sign
from ..reference.space_robot import Orbit, simulate

SETS = ("default", "circular", "tumbling", "free", "joint_motion")


@cache
def recording(params, stop=None):
    return run("space_robot", params=params, stop=stop)


def pitch(e, theta, times):
    """Unwrapped pitch of the locked robot released at perigee at rest relative to the orbital
    frame, (times,).
    """
    kappa, theta_hat = pitch_constants(PAPER, Q)

    def rate(nu, x):
        return x[1], (2 * e * np.sin(nu) * (1 + x[1]) - kappa / 2 * np.sin(2 * x[0])) / (
            1 + e * np.cos(nu)
        )

    nus = [Orbit(e=e).anomaly(t) for t in times]
    found = solve_ivp(
        rate, (nus[0], nus[-1]), (theta - theta_hat, 0), "DOP853", nus, rtol=1e-12, atol=1e-13
    )
    return theta_hat + found.y[0]


@pytest.mark.parametrize(("params", "e"), [("default", 0.05), ("circular", 0.0)])
def test_a_day_of_locked_planar_motion_is_the_pitch_equation(params, e):
    """15 orbits at 1 s; the tumbling set is chaotic and agrees for some orbits only, see below."""
    result = recording(params)
    rows = slice(0, None, 600)
    assert result["robot.pitch"][rows] == pytest.approx(
        pitch(e, result["robot.pitch"][0], result.time[rows]), abs=2e-8
    )


def test_tumbling_motion_is_the_pitch_equation_as_long_as_chaos_allows():
    result = recording("tumbling")
    rows = slice(0, 20001, 500)
    expected = pitch(0.1, result["robot.pitch"][0], result.time[rows])
    assert result["robot.pitch"][rows] == pytest.approx(expected, abs=1e-6)


def test_the_equilibrium_lies_at_the_angle_of_the_paper():
    """ "about 25 deg": -25.6 deg, kappa = 0.6915."""
    kappa, theta_hat = pitch_constants(PAPER, Q)
    assert np.degrees(theta_hat) == pytest.approx(-25.6, abs=0.01)
    assert kappa == pytest.approx(0.6915, abs=1e-4)
    assert recording("default")["robot.pitch"][0] == pytest.approx(theta_hat, abs=1e-12)


def test_eccentricity_005_librates_and_01_tumbles():
    """More than half a turn from the equilibrium is tumbling; 36 deg at most in a day with 0.05."""
    _, theta_hat = pitch_constants(PAPER, Q)
    swing = {
        params: np.abs(recording(params)["robot.pitch"] - theta_hat).max()
        for params in ("default", "tumbling")
    }
    assert np.degrees(swing["default"]) < 40
    assert swing["tumbling"] > np.pi


@pytest.mark.parametrize(
    ("start", "e", "tumbles"),
    some(
        [
            ({}, 0.074, False),
            ({}, 0.085, True),
            ({"robot.nu": np.pi}, 0.084, False),
            ({"robot.nu": np.pi}, 0.095, True),
            ({"robot.euler_0": [0, 0, 0]}, 0.055, False),
            ({"robot.euler_0": [0, 0, 0]}, 0.075, True),
        ],
        3,
    ),
)
def test_the_eccentricity_at_which_tumbling_begins_depends_on_the_start(start, e, tumbles):
    """The paper: from 0.08595, with a window from 0.06331 to 0.06872, from a start that it does not
    give. Ours within 515 orbits: from 0.080, 0.088 and, with a window before, 0.065. Reproduced in
    kind. Tested at a distance from these: chaos makes the last bit of a C library's sine count."""
    _, theta_hat = pitch_constants(PAPER, Q)
    many = {"robot.e": e, "robot.max_step": 10.0}
    result = run("space_robot", set=many | start, step=60.0, stop=3e6, every=2)
    assert (np.abs(result["robot.pitch"] - theta_hat).max() > np.pi) == tumbles


@pytest.mark.parametrize(("factor", "tumbles"), [(0.99, False), (1.01, True)])
def test_the_criterion_of_tumbling_on_a_circular_orbit(factor, tumbles):
    """No tumbling as long as |dtheta(0)| < sqrt(kappa) n |cos(theta(0) - theta_hat)|, from any
    angle.
    """
    kappa, theta_hat = pitch_constants(PAPER, Q)
    n, off = np.sqrt(3.986004418e14 / 7e6**3), 0.4
    rate = factor * np.sqrt(kappa) * n * np.cos(off)
    start = {"robot.euler_0": [0, 0, theta_hat + off], "robot.deuler_0": [0, 0, rate]}
    result = run("space_robot", params="circular", set=start, stop=20000.0)
    assert (np.abs(result["robot.pitch"] - theta_hat).max() > np.pi) is np.bool_(tumbles)


@pytest.mark.parametrize(("e", "number", "near"), [(0.002, None, 5e-4), (0.036, 4 / 5, 3e-4)])
def test_the_rotation_number_starts_at_the_frequency_of_libration_and_passes_four_fifths(
    e, number, near
):
    """Small motion has the frequency sqrt(kappa) per orbit; the section is dotted near e =
    0.036.
    """
    kappa, _ = pitch_constants(PAPER, Q)
    many = {"robot.e": e, "robot.max_step": 10.0}
    result = run("space_robot", set=many, step=60.0, stop=1.2e6)
    assert rotation_number(result) == pytest.approx(number or np.sqrt(kappa), abs=near)


def test_free_joints_drift_under_the_gravity_gradient_as_the_point_masses_do():
    result = recording("free", 3000.0)
    names = ("robot.q_SN", "robot.omega_SN_S", "robot.joint_angle", "robot.joint_rate")
    rows = np.hstack([result[name] for name in names])[::500]
    expected = simulate(PAPER, Orbit(), rows[0], result.time[::500])
    assert rows[:, 4:] == pytest.approx(expected[:, 4:], abs=1e-8)
    assert same_sign(rows[:, :4], expected[:, :4]) == pytest.approx(expected[:, :4], abs=1e-8)
    assert np.abs(rows[-1, 7:9] - rows[0, 7:9]).max() > 0.01


def test_driven_joints_reach_their_angles_and_the_base_reacts():
    """60 and -40 deg within half an hour; without gravity gradient the angular momentum would be
    constant, with it the base gives way by the momentum of the arm."""
    result = recording("joint_motion")
    assert np.degrees(result["robot.joint_angle"][-1]) == pytest.approx([60, -40], abs=0.1)
    assert np.degrees(np.ptp(result["robot.pitch"])) > 0.5


def test_sampled_control_of_the_joints_matches_the_point_masses():
    """The torque of t_k acts from t_k to t_k + 0.1 s."""
    result = recording("joint_motion", 5.0)
    state = np.hstack(
        [
            result[n][0]
            for n in ("robot.q_SN", "robot.omega_SN_S", "robot.joint_angle", "robot.joint_rate")
        ]
    )
    reference, Kp, Kd = np.radians([60, -40]), np.array([2, 1]), np.array([60, 20])
    for k in range(50):
        tau = Kp * (reference - state[7:9]) - Kd * state[9:11]
        begin = 0.1 * k
        orbit = Orbit(nu=Orbit().anomaly(begin))
        state = simulate(
            PAPER, orbit, state, np.array([0.0, 0.1]), tau=lambda t, q, dq, tau=tau: tau
        )[-1]
        assert result["joints.joint_torque"][k + 1] == pytest.approx(tau, abs=1e-9)
    assert result["robot.joint_angle"][-1] == pytest.approx(state[7:9], abs=1e-9)
    assert result["robot.omega_SN_S"][-1] == pytest.approx(state[4:7], abs=1e-11)


@pytest.mark.parametrize("params", SETS)
def test_every_set_runs_and_both_executors_agree_to_the_bit(params):
    a, b = (
        run("space_robot", params=params, stop=200.0, executor=executor)
        for executor in ("c", "python")
    )
    assert a.values.tobytes() == b.values.tobytes()
