# SPDX-License-Identifier: BSD-2-Clause
"""servicer.fmu against theory: thrust, relative motion, disturbances, frozen attitude, integration.
Wheels apart.
"""

from __future__ import annotations

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from scipy.spatial.transform import Rotation

from ..reference import servicer as reference
from ..reference import sinusoid as reference_sinusoid
from . import cases
from .cases import DEEP_SPACE, ELEMENTS, random_direction, random_wave, wave
from .driver import bits
from .motion import Vehicle, deviation, order_ratio
from .theory import (
    EARTH,
    MU,
    angle_between_attitudes,
    dcm_of_mrp,
    dcm_of_quaternion,
    elements_of_state,
    hill_axes,
    minus_gradient,
    potential,
    torque_on_point_masses,
)

ORBIT = EARTH | ELEMENTS


def attitude(unit):
    return dcm_of_mrp(unit.get("sigma_SN"))


# ---- thrust ----


def test_constant_force_gives_a_parabola(fmu, rng):
    F, sigma, mass, t = rng.normal(size=3), rng.uniform(-0.4, 0.4, 3), 120.0, 200.0
    unit = fmu("servicer", DEEP_SPACE | {"mass_0": mass, "sigma_SN_0": sigma})
    unit.step(t, {"F_S": F})
    a = dcm_of_mrp(sigma).T @ F / mass
    assert deviation(unit.get("v_SN_N"), a * t, np.linalg.norm(a) * t) < 1e-12
    assert deviation(unit.get("r_SN_N"), a * t**2 / 2, np.linalg.norm(a) * t**2 / 2) < 1e-12


def test_thrust_with_mass_flow_follows_the_rocket_equation(fmu):
    """v = c ln(m0/m), r = c (t - m/mdot ln(m0/m)) with c = F/mdot."""
    F, mdot, m0, t = 40.0, 0.05, 100.0, 1200.0
    unit = fmu("servicer", DEEP_SPACE | {"mass_0": m0})
    unit.step(t, {"F_S": (F, 0, 0), "mdot": mdot})
    m, c = m0 - mdot * t, F / mdot
    speed, path = c * np.log(m0 / m), c * (t - m / mdot * np.log(m0 / m))
    assert deviation(unit.get("mass"), m, m) < 1e-12
    assert deviation(unit.get("v_SN_N"), (speed, 0, 0), speed) < 1e-9
    assert deviation(unit.get("r_SN_N"), (path, 0, 0), path) < 1e-9


def test_step_that_would_use_more_than_the_whole_mass_is_rejected(fmu):
    unit = fmu("servicer", DEEP_SPACE | {"mass_0": 1})
    with pytest.raises(FMICallException):
        unit.step(5, {"mdot": 0.3})


def test_force_turns_with_the_body_and_torque_acts_in_body_axes(fmu):
    """Spin at w about z: the force stays in body axes. Then a torque about z: w grows by M t/J."""
    w, mass, F, sigma_0, t = 0.05, 70.0, np.array([3.0, -2.0, 1.0]), (0.1, -0.2, 0.3), 60.0
    body = {
        "J_S": np.diag([100, 100, 120]),
        "mass_0": mass,
        "omega_SN_S_0": (0, 0, w),
        "sigma_SN_0": sigma_0,
    }
    unit = fmu("servicer", DEEP_SPACE | body)
    unit.step(t, {"F_S": F})
    s, c = np.sin(w * t) / w, (1 - np.cos(w * t)) / w
    velocity = dcm_of_mrp(sigma_0).T @ np.array([[s, -c, 0], [c, s, 0], [0, 0, t]]) @ F / mass
    assert deviation(unit.get("v_SN_N"), velocity) < 1e-9
    unit.step(30, {"F_S": (0, 0, 0), "M_S": (0, 0, 0.12)})
    assert deviation(unit.get("omega_SN_S"), (0, 0, w + 30 * 0.12 / 120)) < 1e-14
    assert deviation(unit.get("v_SN_N"), velocity) < 1e-9


def test_velocity_turns_with_the_body_only_with_the_unphysical_option(fmu, rng):
    """Components in body axes stay; before the attitude is released nothing turns. RK4 at 0.02
    rad/s: 1e-12.
    """
    p = cases.spinning_servicer(rng) | {"v_0_N": rng.normal(size=3), "t_att": 10.0}
    unit, free = fmu("servicer", p | {"velocity_follows_attitude": 1}), fmu("servicer", p)
    v_S = attitude(unit) @ p["v_0_N"]
    for _ in range(8):
        unit.step(5)
        free.step(5)
        assert deviation(attitude(unit) @ unit.get("v_SN_N"), v_S) < 1e-10
        assert deviation(free.get("v_SN_N"), p["v_0_N"]) == 0


def test_loads_of_contact_add_to_loads_of_the_actuators(fmu, rng):
    """Powers of two: the sum is the same however it is parted."""
    F, M = rng.integers(-8, 8, 3) / 4, rng.integers(-8, 8, 3) / 64
    body = cases.spinning_servicer(rng) | {"sigma_SN_0": (0.1, -0.2, 0.3)}
    whole, parted, contact, actuators = (fmu("servicer", body) for _ in range(4))
    whole.step(20, {"F_S": F, "M_S": M})
    rest = {"F_contact_S": 3 * F / 4, "M_contact_S": 3 * M / 4}
    parted.step(20, {"F_S": F / 4, "M_S": M / 4} | rest)
    contact.step(20, {"F_contact_S": F, "M_contact_S": M})
    actuators.step(20)
    assert bits(whole) == bits(parted) == bits(contact) != bits(actuators)


# ---- orbit and relative motion ----


def test_without_offset_the_servicer_starts_on_the_elements_of_the_target(fmu, rng):
    elements = {"a": 7.3e6, "e": 0.1} | dict(
        zip(("inc", "argp", "raan", "nu"), rng.uniform(0.2, 2.8, 4), strict=True)
    )
    unit = fmu("servicer", EARTH | elements | {"rho_0_H": (0, 0, 0)})
    found = elements_of_state(unit.get("r_SN_N"), unit.get("v_SN_N"))
    assert found == pytest.approx(elements, rel=1e-13, abs=1e-13)


def test_start_relative_to_the_target_is_as_seen_in_the_turning_hill_frame(fmu, rng):
    """d/dt of C_HN (r_S - r_T) by a complex step along the Kepler motion of the target. Rounding of
    7e6 m, 7e3 m/s.
    """
    rho, drho = 50 * rng.normal(size=3), 0.1 * rng.normal(size=3)
    at_target = fmu("servicer", ORBIT | {"rho_0_H": (0, 0, 0)})
    unit = fmu("servicer", ORBIT | {"rho_0_H": rho, "drho_0_H": drho})
    r, v = at_target.get("r_SN_N"), at_target.get("v_SN_N")
    dr, dv, h = unit.get("r_SN_N") - r, unit.get("v_SN_N") - v, 1e-20
    later = hill_axes(r + 1j * h * v, v - 1j * h * MU * r / np.linalg.norm(r) ** 3) @ (
        dr + 1j * h * dv
    )
    assert deviation(later.real, rho) < 1e-8
    assert deviation(later.imag / h, drho) < 1e-11


def test_cartesian_start_is_taken_as_given(fmu):
    r, v = np.array([7e6, 1e5, -2e5]), np.array([100.0, 7400.0, 30.0])
    unit = fmu("servicer", EARTH | {"a": 0, "r_0_N": r, "v_0_N": v, "rho_0_H": (0, 20, 0)})
    assert deviation(unit.get("r_SN_N"), r) == 0
    assert deviation(unit.get("v_SN_N"), v) == 0


def test_in_deep_space_the_path_is_straight(fmu):
    r, v = np.array([10.0, -20.0, 30.0]), np.array([1.0, 2.0, -3.0])
    unit = fmu("servicer", DEEP_SPACE | {"r_0_N": r, "v_0_N": v})
    unit.step(1000)
    assert deviation(unit.get("r_SN_N"), r + 1000 * v, 3000) < 1e-12
    assert deviation(unit.get("v_SN_N"), v) == 0


def clohessy_wiltshire(n, t, x):
    """State [rho, drho] in H after time t of linearised motion about a circular orbit."""
    s, c = np.sin(n * t), np.cos(n * t)
    position = [
        [4 - 3 * c, 0, 0, s / n, 2 * (1 - c) / n, 0],
        [6 * (s - n * t), 1, 0, -2 * (1 - c) / n, (4 * s - 3 * n * t) / n, 0],
        [0, 0, c, 0, 0, s / n],
    ]
    return np.array(position) @ x


def test_relative_motion_is_clohessy_wiltshire_up_to_the_second_order(fmu, rng):
    """Bounded relative orbits (dy = -2 n x) over one revolution: difference <= 25 rho^2/a, growing
    as rho^2.
    """
    a, sizes = ELEMENTS["a"], np.array([300.0, 1e3, 3e3, 1e4])
    n = np.sqrt(MU / a**3)
    times = np.linspace(0, 2 * np.pi / n, 9)[1:]
    x = np.append(random_direction(rng), n * random_direction(rng))
    x[4] = -2 * n * x[0]
    linear = np.array([clohessy_wiltshire(n, t, x) for t in times])

    def difference(size):
        start = {
            "a": a,
            "e": 0,
            "rho_0_H": size * x[:3],
            "drho_0_H": size * x[3:],
            "use_J2": 0,
            "max_step": 1,
        }
        unit, rho = (
            fmu("servicer", EARTH | {"inc": 0.5, "argp": 1.0, "raan": 2.0, "nu": 0.6} | start),
            [],
        )
        for t in times:
            unit.step(t - unit.time)
            R_NH = Rotation.from_euler("ZXZ", [2.0, 0.5, 1.6 + n * t]).as_matrix()
            rho.append(R_NH.T @ unit.get("r_SN_N") - [a, 0, 0])
        return deviation(rho, size * linear)

    differences = np.array([difference(size) for size in sizes])
    farthest = sizes * np.linalg.norm(linear, axis=1).max()
    assert np.max(differences / (farthest**2 / a)) <= 25
    assert deviation(np.polyfit(np.log(sizes), np.log(differences), 1)[0], 2) < 0.05


# ---- attitude before its release ----


def test_attitude_is_frozen_before_its_release_while_the_force_acts_in_its_axes(fmu, rng):
    """Torques, wheel commands and disturbances before t_att leave no trace; then motion equals the
    motion after a fresh start.
    """
    p = cases.spinning_servicer(rng) | {"M_dist_S": random_wave(rng, 0.01), "mass_0": 50}
    u = {
        "F_S": rng.normal(size=3),
        "M_S": 0.1 * rng.normal(size=3),
        "wheel_accel_cmd": 0.01 * rng.normal(size=3),
    }
    unit, fresh = fmu("servicer", p | {"t_att": 30.0}, u), fmu("servicer", p, u, start=30.0)
    _, sigma, omega, Omega = unit.history(1, 29, "sigma_SN", "omega_SN_S", "wheel_speed")
    assert deviation(sigma, p["sigma_SN_0"]) == 0
    assert not omega.any()
    assert not Omega.any()
    unit.step(1)
    assert deviation(unit.get("v_SN_N"), dcm_of_mrp(p["sigma_SN_0"]).T @ u["F_S"] * 30 / 50) < 1e-12
    for name in ("sigma_SN", "q_SN", "omega_SN_S", "wheel_speed"):
        assert deviation(unit.get(name), fresh.get(name)) == 0
    for _ in range(20):
        unit.step(1)
        fresh.step(1)
    for name in ("sigma_SN", "q_SN", "omega_SN_S", "wheel_speed"):
        assert deviation(unit.get(name), fresh.get(name)) == 0
    assert (
        deviation(unit.get("wheel_speed"), p["wheel_speed_0"] + 20 * u["wheel_accel_cmd"]) < 1e-12
    )


# ---- disturbances ----


def test_disturbance_torque_acts_on_each_body_axis_by_its_own_wave(fmu, rng):
    """A ball has no gyroscopic coupling in body axes. RK4 is Simpson's rule here: error (f
    h)^4/2880 = 1e-10.
    """
    w = random_wave(rng, 0.01)
    unit = fmu("servicer", DEEP_SPACE | {"J_S": 50 * np.eye(3), "M_dist_S": w})
    unit.step(77.7)
    expected = cases.integral_of_wave(w, unit.time)[0] / 50
    assert deviation(unit.get("omega_SN_S"), expected, np.abs(expected).max()) < 1e-9


def test_disturbance_acceleration_acts_on_each_inertial_axis_by_its_own_wave(fmu, rng):
    w = random_wave(rng, 0.01)
    unit = fmu("servicer", DEEP_SPACE | {"a_dist": w, "omega_SN_S_0": (0.02, 0.03, 0.01)})
    unit.step(77.7)
    velocity, position = cases.integral_of_wave(w, unit.time)
    assert deviation(unit.get("v_SN_N"), velocity, np.abs(velocity).max()) < 1e-9
    assert deviation(unit.get("r_SN_N"), position, np.abs(position).max()) < 1e-9


@pytest.mark.parametrize(("record", "effect"), [("M_dist_S", "omega_SN_S"), ("a_dist", "v_SN_N")])
def test_nothing_acts_before_the_start_time_and_time_is_absolute(fmu, rng, record, effect):
    """Not even in the last stage of the step that ends at the start time."""
    w, h = random_wave(rng, 0.01, start=130.0), 0.001
    body = {"J_S": np.eye(3), "A_w": 0.1 * np.eye(3), "max_step": h}
    unit = fmu("servicer", DEEP_SPACE | body | {record: w}, start=100.0)
    unit.step(30.0)
    assert not unit.get(effect).any()
    unit.step(20.0)
    expected = cases.integral_of_wave(w, 150.0)[0]
    # 20 000 additions of a thousandth each
    assert deviation(unit.get(effect), expected, np.abs(expected).max()) < 1e-10


# ---- everything together ----


def everything(rng):
    """Parameters with all loads on; random inertias, attitude, rate and place near the orbit of the
    target.
    """
    body = cases.spinning_servicer(rng, rate=0.05) | {
        "mass_0": rng.uniform(50, 200),
        "max_step": 0.05,
    }
    place = {
        "nu": rng.uniform(0, 6),
        "rho_0_H": 100 * rng.normal(size=3),
        "drho_0_H": rng.normal(size=3),
    }
    return (
        body
        | ORBIT
        | place
        | {"M_dist_S": random_wave(rng, 0.01), "a_dist": random_wave(rng, 1e-3)}
    )


def commands(rng):
    vectors = {"F_S": 5 * rng.normal(size=3), "M_S": 0.1 * rng.normal(size=3)}
    return vectors | {"wheel_accel_cmd": 0.01 * rng.normal(size=3), "mdot": rng.uniform(0, 0.05)}


def vehicle(p, u):
    """Continuous theory of the servicer with parameters p and inputs u."""
    return Vehicle(
        J=p["J_S"],
        A=p["A_w"],
        F_B=u["F_S"],
        M_B=lambda t: wave(p["M_dist_S"], t) + u["M_S"],
        a_N=lambda t, r, v: (
            (hill_axes(r, v) if p["a_dist_axes"] else np.eye(3)).T @ wave(p["a_dist"], t)
        ),
        gravity=lambda r: minus_gradient(
            lambda x: potential(x, oblateness=p["use_J2"] * EARTH["J2"]), r
        ),
        torque_of_gravity=lambda r_S: (
            p["use_gravity_gradient"] * torque_on_point_masses(r_S, p["J_S"])
        ),
        wheel_accel=u["wheel_accel_cmd"],
        mdot=u["mdot"],
    )


@pytest.mark.parametrize("options", [(0, 0, 1), (1, 1, 0), (1, 0, 1)])
def test_all_loads_together_follow_the_momentum_balance(fmu, rng, options):
    """Orbit: rounding of 7e6 m and 7e3 m/s. Attitude: RK4 with steps of h = 0.01 s. The fastest
    motion is the nutation of body and wheels, n = |J^-1 (tilde(h_S) - tilde(w) J)|: with the
    0.35 rad/s of the lightest bodies (n h)^4 n t / 120 = 2e-11 rad, and 1e-12 rad/s at 0.05 rad/s.
    """
    p = everything(rng) | dict(
        zip(("use_J2", "use_gravity_gradient", "a_dist_axes"), options, strict=True)
    )
    p["max_step"] = 0.01
    u = commands(rng)
    unit, v = fmu("servicer", p, u), vehicle(p, u)
    start = {"wheel_speed": p["wheel_speed_0"], "mass": p["mass_0"]}
    y = v.state(unit.get("r_SN_N"), unit.get("v_SN_N"), attitude(unit), p["omega_SN_S_0"], **start)
    for _ in range(40):
        unit.step(1)
    y = v.propagate(y, 0, 40)
    assert deviation(unit.get("r_SN_N"), y[:3]) < 1e-6
    assert deviation(unit.get("v_SN_N"), y[3:6]) < 1e-9
    assert angle_between_attitudes(attitude(unit), y[6:15].reshape(3, 3).T) < 2e-11
    assert deviation(unit.get("omega_SN_S"), v.rate(y)) < 1e-12
    assert deviation(unit.get("wheel_speed"), y[18:21]) < 1e-12
    assert deviation(unit.get("mass"), y[21]) < 1e-10


def test_quaternion_and_rodrigues_parameters_are_the_same_attitude(fmu, rng):
    unit = fmu("servicer", {"sigma_SN_0": (sigma := rng.uniform(0.1, 3) * random_direction(rng))})
    assert deviation(dcm_of_quaternion(unit.get("q_SN")), dcm_of_mrp(sigma)) < 1e-14
    assert deviation(attitude(unit), dcm_of_mrp(sigma)) < 1e-14
    assert np.linalg.norm(unit.get("sigma_SN")) <= 1


def test_rodrigues_parameters_switch_to_the_shadow_set_at_half_a_turn(fmu):
    body = {"J_S": 100 * np.eye(3), "omega_SN_S_0": (0, rate := 0.1, 0)}
    t, sigma = fmu("servicer", DEEP_SPACE | body).history(0.5, 600, "sigma_SN")
    turned = (rate * t + np.pi) % (2 * np.pi) - np.pi
    assert deviation(sigma, np.outer(np.tan(turned / 4), [0, 1, 0])) < 1e-9


# ---- numerical integration ----


@pytest.mark.parametrize(
    ("names", "h", "duration"),
    [(("omega_SN_S", "q_SN"), 0.1, 40), (("r_SN_N", "v_SN_N"), 2.5, 2000)],
)
def test_integration_error_is_of_fourth_order(fmu, names, h, duration):
    def result(max_step):
        motion = {"omega_SN_S_0": (0.05, 0.08, -0.03), "wheel_speed_0": (0.3, -0.2, 0.1)}
        unit = fmu("servicer", ORBIT | motion | {"max_step": max_step})
        unit.step(duration)
        return np.concatenate([unit.get(name) for name in names])

    assert deviation(order_ratio(result, h), 2**4, 2**4) < 0.05


@pytest.mark.parametrize("h", [0.1, 0.3, 1.0])
def test_result_does_not_depend_on_how_the_step_is_cut(fmu, rng, h):
    limits = {"wheel_accel_max": 0.02, "wheel_speed_max": 1.0, "t_att": 12.0}
    p, u = everything(rng) | limits | {"max_step": 0.1}, commands(rng)
    whole, cut = (fmu("servicer", p, u) for _ in range(2))
    whole.step(30)
    for _ in range(round(30 / h)):
        cut.step(h)
    assert bits(cut) == bits(whole)


# ---- reference implementation ----


def test_result_matches_the_reference_implementation(fmu, rng):
    """The same RK4 on quaternions instead of Rodrigues parameters: attitude differs by truncation,
    (w h)^5 a step.
    """
    p = everything(rng) | {"use_J2": 1, "use_gravity_gradient": 1, "a_dist_axes": 1, "t_att": 4.0}
    u = commands(rng)
    unit = fmu("servicer", p, u)
    q = reference.Parameters(
        **(p | {k: reference_sinusoid.Sinusoid(**p[k]) for k in ("M_dist_S", "a_dist")})
    )
    unit.step(20)
    y = reference.step(q, reference.initial_state(q), 0, 20, reference.Input(**u))
    expected = reference.outputs(20, y, q)
    for name in ("r_SN_N", "v_SN_N", "omega_SN_S", "wheel_speed", "mass"):
        assert deviation(unit.get(name), expected[name], np.abs(expected[name]).max()) < 1e-10, name
    assert angle_between_attitudes(attitude(unit), dcm_of_quaternion(expected["q_SN"])) < 1e-9


@pytest.mark.parametrize("name", ["servicer", "flexible_servicer", "arm_servicer"])
def test_just_below_half_a_turn_in_an_internal_step_a_long_step_is_as_good_as_many(fmu, name):
    start = {"J_S": np.diag((100.0, 100, 100)), "A_w": np.eye(3), "max_step": 0.1}
    one, many = (fmu(name, start | {"omega_SN_S_0": (31.0, 0, 0)}) for _ in range(2))
    one.step(0.4)
    for _ in range(4):
        many.step(0.1)
    assert 0 < one.get("rate_margin") < 1
    assert bits(one) == bits(many)


def test_half_a_turn_in_an_internal_step_is_rejected(fmu):
    """The rate grows by 1 rad/s a second: at 15.7 rad/s, pi over a step of 0.2 s, it is over."""
    p = {"J_S": np.diag((100.0, 100, 100)), "A_w": np.eye(3), "max_step": 0.2, "use_J2": 0}
    unit = fmu("servicer", p, {"M_S": (100.0, 0, 0)})
    for k in range(15):
        unit.step(1.0)
        assert unit.get("rate_margin") == pytest.approx(np.pi / 0.2 - k - 1, abs=1e-9)
    with pytest.raises(FMICallException):
        unit.step(1.0)
