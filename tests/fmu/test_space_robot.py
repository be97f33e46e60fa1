# SPDX-License-Identifier: BSD-2-Clause
"""space_robot.fmu: against point masses, the pitch equation, closed forms, and what must stay
constant.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from scipy.special import ellipk

from tests.reference.space_robot import Orbit, Robot, simulate

from .rejections import rejection
from .robot_cases import PAPER, Q, pitch_constants, same_sign
from .theory import dcm_of_quaternion

ODD = Robot(
    mass=(900, 120, 60),
    Ixx=(300, 2, 1),
    Iyy=(420, 40, 9),
    Izz=(380, 41, 9.5),
    l=(0.3, 0.7, 0.6),
    r=(0.8, 1.1, 0.5),
)
MOVING = {
    "euler_0": (0.1, -0.2, 0.3),
    "deuler_0": (1e-3, -2e-3, 1.5e-3),
    "joint_angle_0": Q,
    "joint_rate_0": (5e-3, -1e-2),
    "max_step": 0.05,
}
SPACE = {"mu": 0, "max_step": 0.01}
MU = 3.986004418e14


def parameters(robot):
    return {name: getattr(robot, name) for name in ("mass", "Ixx", "Iyy", "Izz", "l", "r")}


def state(unit):
    return np.concatenate(
        [unit.get(n) for n in ("q_SN", "omega_SN_S", "joint_angle", "joint_rate")]
    )


def simulated(unit, seconds, h=1.0, inputs=lambda t: {}):
    """States at 0, h, 2 h, ..., with inputs held over every step."""
    rows = [state(unit)]
    for k in range(round(seconds / h)):
        unit.step(h, inputs(k * h))
        rows.append(state(unit))
    return np.array(rows)


# ---- against point masses


@pytest.mark.parametrize("robot", [PAPER, ODD], ids=["paper", "odd"])
@pytest.mark.parametrize("locked", [False, True], ids=["free", "locked"])
def test_motion_matches_point_masses_on_an_eccentric_orbit(fmu, robot, locked):
    unit = fmu(
        "space_robot", parameters(robot) | MOVING | {"e": 0.1, "nu": 0.7}, {"joint_lock": locked}
    )
    orbit, rows = Orbit(e=0.1, nu=0.7), simulated(unit, 200, 10)
    expected = simulate(robot, orbit, rows[0], np.arange(0, 201, 10.0), locked=locked)
    assert rows[:, 4:] == pytest.approx(expected[:, 4:], abs=1e-10)
    assert same_sign(rows[:, :4], expected[:, :4]) == pytest.approx(expected[:, :4], abs=1e-10)


def test_motion_under_loads_and_torques_matches_point_masses(fmu):
    """In deep space, held inputs: force and torque on the base, torques at the joints."""
    F, M, tau = np.array([3.0, -2.0, 1.0]), np.array([0.5, -0.3, 0.4]), np.array([0.4, -0.2])
    unit = fmu(
        "space_robot", parameters(ODD) | MOVING | SPACE, {"F_S": F, "M_S": M, "joint_torque": tau}
    )
    rows = simulated(unit, 30)
    expected = simulate(
        ODD,
        Orbit(),
        rows[0],
        np.arange(0, 31.0),
        loads=lambda t: np.concatenate((F, M)),
        tau=lambda t, q, dq: tau,
        gravity=False,
    )
    assert rows[:, 4:] == pytest.approx(expected[:, 4:], abs=1e-9)
    assert same_sign(rows[:, :4], expected[:, :4]) == pytest.approx(expected[:, :4], abs=1e-9)


def test_true_anomaly_is_keplers_and_counts_turns(fmu):
    unit, orbit = (
        fmu("space_robot", {"e": 0.3, "nu": -2.0, "max_step": 5}, {"joint_lock": 1}),
        Orbit(e=0.3, nu=-2.0),
    )
    for k in range(1, 25):
        unit.step(500.0)
        assert unit.get("true_anomaly") == pytest.approx(orbit.anomaly(500.0 * k), abs=1e-7)
    assert unit.get("true_anomaly") > 2 * np.pi


# ---- constants of motion


def test_angular_momentum_is_constant_under_any_joint_torques(fmu, rng):
    unit = fmu("space_robot", MOVING | SPACE)
    before = unit.get("h_N")
    for _ in range(50):
        unit.step(0.5, {"joint_torque": rng.normal(size=2)})
    assert unit.get("h_N") == pytest.approx(before, abs=1e-10 * np.linalg.norm(before))


def test_joint_torques_do_the_work_that_the_kinetic_energy_gains(fmu, rng):
    """Constant torques: their work is torque times angle."""
    tau = rng.normal(size=2)
    unit = fmu("space_robot", MOVING | SPACE, {"joint_torque": tau})
    T, q = unit.get("kinetic_energy"), unit.get("joint_angle")
    unit.step(30.0)
    assert unit.get("kinetic_energy") - T == pytest.approx(
        tau @ (unit.get("joint_angle") - q), rel=1e-8
    )


@pytest.mark.parametrize("locked", [0, 1])
def test_jacobi_integral_is_constant_on_a_circular_orbit(fmu, locked):
    """T + V - n h_z; it fails if any part of the differential force is missing."""
    unit, n = (
        fmu("space_robot", parameters(ODD) | MOVING, {"joint_lock": locked}),
        np.sqrt(MU / 7e6**3),
    )
    J = []
    for _ in range(40):
        J.append(unit.get("kinetic_energy") + unit.get("potential_energy") - n * unit.get("h_N")[2])
        unit.step(20.0)
    assert np.ptp(J) < 1e-9 * abs(J[0])


def test_energies_match_the_point_masses(fmu, rng):
    """T = sum m v^2 / 2 and V = sum m g (s^2 - 3 (a.s)^2) / 2, on an eccentric orbit."""
    start = MOVING | {
        "euler_0": rng.uniform(-1, 1, 3),
        "joint_rate_0": 0.1 * rng.normal(size=2),
        "e": 0.3,
        "nu": 1.0,
    }
    unit, orbit = fmu("space_robot", parameters(ODD) | start), Orbit(e=0.3, nu=1.0)
    mass, rho = ODD.points(unit.get("joint_angle"))
    moved = sum(
        ODD.derivative(unit.get("joint_angle"), e) * rate
        for e, rate in zip(np.eye(2), unit.get("joint_rate"), strict=True)
    )
    v = np.cross(unit.get("omega_SN_S"), rho) + moved
    a = dcm_of_quaternion(unit.get("q_SN")) @ [np.cos(1.0), np.sin(1.0), 0]
    assert unit.get("kinetic_energy") == pytest.approx(mass @ (v**2).sum(axis=1) / 2, rel=1e-12)
    potential = orbit.strength(1.0) * mass @ ((rho**2).sum(axis=1) - 3 * (rho @ a) ** 2) / 2
    assert unit.get("potential_energy") == pytest.approx(potential, rel=1e-12)


def test_gravity_gradient_can_be_switched_off(fmu):
    unit = fmu("space_robot", MOVING | {"use_gravity_gradient": 0})
    before = unit.get("h_N")
    unit.step(300.0)
    assert unit.get("h_N") == pytest.approx(before, rel=1e-10)
    assert unit.get("potential_energy") == 0


def test_angular_momentum_changes_by_torque_and_moment_of_the_force(fmu):
    """About the centre of mass of the whole, which is not the base's."""
    F, M = np.array([2.0, 1.0, -1.0]), np.array([0.1, 0.2, -0.3])
    unit = fmu(
        "space_robot",
        parameters(ODD) | {"mu": 0, "max_step": 1e-3},
        {"F_S": F, "M_S": M, "joint_lock": 1},
    )
    _, rho = ODD.points(np.array(Q))
    before, C = unit.get("h_N"), dcm_of_quaternion(unit.get("q_SN"))
    unit.step(1e-3)
    arm = rho[:6].mean(axis=0)
    assert (unit.get("h_N") - before) / 1e-3 == pytest.approx(
        C.T @ (M + np.cross(arm, F)), rel=1e-6
    )


# ---- planar motion with locked joints


@pytest.mark.parametrize(
    ("robot", "e", "theta", "rate"),
    [(PAPER, 0.05, -0.3, 0.0), (ODD, 0.2, 0.4, 3e-4), (PAPER, 0.0, 1.2, 2e-3)],
)
def test_locked_planar_motion_is_the_pitch_equation(fmu, robot, e, theta, rate):
    """(1 + e cos nu) delta'' - 2 e sin nu delta' + kappa/2 sin 2 delta = 2 e sin nu, over one
    orbit; tumbling too.
    """
    kappa, theta_hat = pitch_constants(robot, Q)
    orbit, start = (
        Orbit(e=e),
        {"euler_0": (0, 0, theta), "deuler_0": (0, 0, rate), "joint_angle_0": Q, "max_step": 2},
    )
    unit = fmu("space_robot", parameters(robot) | start | {"e": e}, {"joint_lock": 1})

    def pitch(nu, x):
        forcing = 2 * e * np.sin(nu) * (1 + x[1]) - kappa / 2 * np.sin(2 * x[0])
        return x[1], forcing / (1 + e * np.cos(nu))

    times = np.arange(0, 6001, 500.0)
    nus = [orbit.anomaly(t) for t in times]
    x0 = (theta - theta_hat, rate / orbit.rate(0.0))
    expected = solve_ivp(pitch, (0, nus[-1]), x0, "DOP853", nus, rtol=1e-12, atol=1e-13).y
    for k, t in enumerate(times):
        assert unit.get("pitch") - theta_hat == pytest.approx(expected[0, k], abs=1e-8), t
        assert unit.get("pitch_rate") / orbit.rate(nus[k]) == pytest.approx(
            expected[1, k], abs=1e-8
        ), t
        unit.step(500.0)


def test_libration_on_a_circular_orbit_has_the_period_of_the_elliptic_integral(fmu):
    """4 K(sin A) / sqrt(kappa) in true anomaly, A = 60 deg: at a whole period the motion
    repeats.
    """
    kappa, theta_hat = pitch_constants(PAPER, Q)
    A = np.radians(60)
    start = {"euler_0": (0, 0, theta_hat + A), "joint_angle_0": Q, "max_step": 1}
    unit = fmu("space_robot", start, {"joint_lock": 1})
    n = np.sqrt(MU / 7e6**3)
    unit.step(4 * ellipk(np.sin(A) ** 2) / np.sqrt(kappa) / n)
    assert unit.get("pitch") == pytest.approx(theta_hat + A, abs=1e-8)
    assert unit.get("pitch_rate") == pytest.approx(0, abs=1e-10)


def test_the_equilibrium_of_the_circular_orbit_stays(fmu):
    _, theta_hat = pitch_constants(PAPER, Q)
    unit = fmu("space_robot", {"euler_0": (0, 0, theta_hat), "joint_angle_0": Q}, {"joint_lock": 1})
    unit.step(6000.0)
    assert unit.get("pitch") == pytest.approx(theta_hat, abs=1e-9)


def test_pitch_counts_full_turns_and_passes_the_singularity_of_the_angles(fmu):
    unit = fmu("space_robot", {"deuler_0": (0, 0, 0.01), "mu": 0}, {"joint_lock": 1})
    for k in range(1, 20):
        unit.step(100.0)
        assert unit.get("pitch") == pytest.approx(k, abs=1e-9)
        assert np.isfinite(unit.get("deuler")).all()


# ---- the lock


def test_locking_moving_joints_retains_the_angular_momentum(fmu):
    unit = fmu("space_robot", MOVING | SPACE | {"joint_rate_0": (0.05, -0.1)})
    unit.step(5.0)
    before, angles = unit.get("h_N"), unit.get("joint_angle")
    unit.step(1.0, {"joint_lock": 1})
    assert unit.get("h_N") == pytest.approx(before, rel=1e-9)
    assert unit.get("joint_rate").tolist() == [0, 0]
    assert unit.get("joint_angle").tolist() == angles.tolist()


@pytest.mark.parametrize("rates", [(0.05, 0), (0, -0.1)])
def test_locking_stops_a_single_moving_joint_too(fmu, rates):
    unit = fmu("space_robot", MOVING | SPACE | {"joint_rate_0": rates})
    before, angles = unit.get("h_N"), unit.get("joint_angle")
    unit.step(1.0, {"joint_lock": 1})
    assert unit.get("h_N") == pytest.approx(before, rel=1e-9)
    assert unit.get("joint_rate").tolist() == [0, 0]
    assert unit.get("joint_angle").tolist() == angles.tolist()


def test_the_lock_torque_is_what_would_hold_free_joints(fmu):
    still = MOVING | {"joint_rate_0": (0, 0), "e": 0.2}
    locked = fmu("space_robot", still, {"joint_lock": 1})
    free = fmu("space_robot", still, {"joint_torque": locked.get("lock_torque")})
    assert free.get("joint_accel") == pytest.approx([0, 0], abs=1e-17)
    assert np.all(locked.get("lock_torque") != 0)
    assert free.get("lock_torque").tolist() == [0, 0]


def test_unlocked_joints_start_from_rest(fmu):
    unit = fmu("space_robot", MOVING, {"joint_lock": 1})
    unit.step(10.0)
    unit.step(1.0, {"joint_lock": 0, "joint_torque": (0.1, 0)})
    assert unit.get("joint_rate")[0] > 0


# ---- attitude and place


def test_start_attitude_and_rates_are_published_as_given(fmu, rng):
    angles, rates = rng.uniform(-1, 1, 3), rng.uniform(-0.01, 0.01, 3)
    orbit = {"e": 0.2, "nu": 1.0, "inc": 0.7, "argp": 0.3, "raan": 2.0}
    unit = fmu("space_robot", orbit | {"euler_0": angles, "deuler_0": rates}, {"joint_lock": 1})
    assert unit.get("euler") == pytest.approx(angles, abs=1e-13)
    assert unit.get("deuler") == pytest.approx(rates, abs=1e-15)


def test_without_gravity_the_normal_of_the_orbit_matches_its_elements(fmu, rng):
    """q_SN for angles 0: x outward, z = Rz(raan) Rx(inc) (0, 0, 1), y = z x x."""
    inc, raan, start = rng.uniform(0.2, 1.2), rng.uniform(-3, 3), {"euler_0": (0, 0, 0)}
    unit = fmu("space_robot", start | {"mu": 0, "inc": inc, "raan": raan, "argp": 0.4, "nu": -0.9})
    frame = Rotation.from_euler("ZXZ", [raan, inc, 0.4 - 0.9]).as_matrix().T
    assert dcm_of_quaternion(unit.get("q_SN")) == pytest.approx(frame, abs=1e-12)


def test_rates_of_the_angles_are_their_derivatives(fmu):
    unit = fmu("space_robot", MOVING | {"e": 0.2}, {"joint_lock": 0})
    seen = []
    for _ in range(3):
        seen.append((unit.get("euler"), unit.get("deuler")))
        unit.step(0.1)
    (a, _), (_, rate), (b, _) = seen
    assert (b - a) / 0.2 == pytest.approx(rate, abs=1e-8)


def test_the_velocity_of_the_base_is_the_derivative_of_its_place(fmu):
    """In deep space, where nothing but the arm moves it."""
    unit = fmu("space_robot", parameters(ODD) | MOVING | SPACE | {"joint_rate_0": (0.2, -0.3)})
    seen = []
    for _ in range(3):
        seen.append((unit.get("r_SN_N"), unit.get("v_SN_N")))
        unit.step(0.01)
    assert (seen[2][0] - seen[0][0]) / 0.02 == pytest.approx(seen[1][1], abs=1e-6)
    assert np.linalg.norm(seen[1][1]) > 1e-3


def test_the_base_moves_about_the_centre_of_mass_of_the_whole(fmu):
    """In deep space that rests: what the base does is -rho of the others in the point masses."""
    unit = fmu("space_robot", parameters(ODD) | MOVING | SPACE)
    for _ in range(5):
        _, rho = ODD.points(unit.get("joint_angle"))
        base = dcm_of_quaternion(unit.get("q_SN")).T @ rho[:6].mean(axis=0)
        centre = unit.get("r_SN_N") - base
        assert centre == pytest.approx([7e6, 0, 0], abs=1e-8)
        unit.step(5.0)


def test_the_integrator_is_of_fourth_order(fmu):
    """The error falls by 16 when the step is halved; against 0.05 s."""
    loads = {"joint_torque": (0.5, -0.2)}

    def end(step):
        unit = fmu("space_robot", MOVING | {"mu": 0, "max_step": step}, loads)
        unit.step(64.0)
        return state(unit)

    exact = end(0.0625)
    coarse, fine = (np.linalg.norm(end(step) - exact) for step in (2.0, 1.0))
    assert coarse / fine == pytest.approx(16, rel=0.2)


# ---- rejections


@pytest.mark.parametrize(
    ("values", "rule"),
    [
        ({"e": 1.0}, "e = 1: must be in [0, 1)"),
        ({"mass": (1, 0, 1)}, "mass[2] = 0: must be > 0"),
        (
            {"Izz": (4124.83, 30, 22.84)},
            "Izz[2] = 30: Ixx, Iyy, Izz must satisfy the triangle inequality",
        ),
        ({"l": (1, -1, 1)}, "l[2] = -1: must be >= 0"),
        ({"a": 0}, "a = 0: must be > 0"),
        ({"max_step": 0}, "max_step = 0: must be > 0"),
    ],
)
def test_bad_parameters_are_rejected_with_the_rule(tmp_path, values, rule):
    assert rule in rejection("space_robot", values, tmp_path)
