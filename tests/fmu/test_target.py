# SPDX-License-Identifier: BSD-2-Clause
"""target.fmu against theory: free tumbling, orbits, gravity gradient, disturbances, contact loads,
integration.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.special import ellipj

from ..reference import sinusoid as reference_sinusoid
from ..reference import target as reference
from . import cases
from .cases import DEEP_SPACE, ELEMENTS, random_direction, random_inertia, random_wave, wave
from .driver import Unit, bits
from .motion import Vehicle, deviation, order_ratio
from .theory import (
    EARTH,
    J2,
    MU,
    R_E,
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
AT_REST = {"omega_TN_T_0": (0, 0, 0)}


def attitude(unit):
    return dcm_of_mrp(unit.get("sigma_TN"))


def energy(r, v, oblateness):
    return v @ v / 2 + potential(r, oblateness=oblateness)


# ---- attitude: free tumbling ----


@pytest.mark.parametrize(("rate", "tolerance"), [(0.01, 1e-12), (0.3, 1e-6)])
def test_free_tumbling_retains_energy_and_inertial_angular_momentum(fmu, rng, rate, tolerance):
    """Levels of RK4 at 0.1 s: truncation grows with the fifth power of the rate; at 0.01 rad/s it
    is rounding.
    """
    J, omega = random_inertia(rng), rate * random_direction(rng)
    unit = fmu(
        "target",
        DEEP_SPACE | {"J_T": J, "omega_TN_T_0": omega, "sigma_TN_0": rng.uniform(-0.4, 0.4, 3)},
    )
    H, T = attitude(unit).T @ J @ omega, omega @ J @ omega
    for _ in range(10):
        unit.step(100)
        w = unit.get("omega_TN_T")
        assert deviation(w @ J @ w, T, T) < tolerance
        assert deviation(attitude(unit).T @ J @ w, H, np.linalg.norm(H)) < tolerance


def test_axisymmetric_body_nutates_at_its_closed_form(fmu, rng):
    """Rates turn at (I3 - It) w3/It about the symmetry axis, the body precesses at H/It about the
    fixed H.
    """
    It, I3 = rng.uniform(80, 120, 2)
    w1, w3 = 0.03, 0.05
    C_0 = dcm_of_mrp(sigma_0 := rng.uniform(-0.4, 0.4, 3))
    body = {"J_T": np.diag([It, It, I3]), "omega_TN_T_0": (w1, 0, w3), "sigma_TN_0": sigma_0}
    unit = fmu("target", DEEP_SPACE | body)
    precession = C_0.T @ np.array([It * w1, 0, I3 * w3]) / It
    nutation = (I3 - It) * w3 / It
    for _ in range(20):
        unit.step(25)
        t = unit.time
        expected = np.array([w1 * np.cos(nutation * t), w1 * np.sin(nutation * t), w3])
        turned = Rotation.from_rotvec(precession * t).as_matrix() @ C_0.T
        C_NT = turned @ Rotation.from_rotvec([0, 0, -nutation * t]).as_matrix()
        assert deviation(unit.get("omega_TN_T"), expected, w3) < 1e-8
        assert angle_between_attitudes(attitude(unit), C_NT.T) < 1e-8


def test_triaxial_body_follows_jacobi_elliptic_functions(fmu):
    """Landau & Lifshitz, Mechanics, section 37: I1 < I2 < I3 and H^2 > 2 T I2."""
    I1, I2, I3 = J = np.array([80.0, 110.0, 150.0])
    omega = np.array([0.03, 0.0, 0.05])
    T2, HH = J @ omega**2, (J * omega) @ (J * omega)
    slow, fast = T2 * I3 - HH, HH - T2 * I1
    rate, m = np.sqrt((I3 - I2) * fast / J.prod()), (I2 - I1) * slow / ((I3 - I2) * fast)
    size = np.sqrt([slow / (I1 * (I3 - I1)), slow / (I2 * (I3 - I2)), fast / (I3 * (I3 - I1))])
    unit = fmu("target", DEEP_SPACE | {"J_T": np.diag(J), "omega_TN_T_0": omega})
    for _ in range(20):
        unit.step(50)
        sn, cn, dn, _ = ellipj(rate * unit.time, m)
        assert deviation(unit.get("omega_TN_T"), size * (cn, sn, dn), np.linalg.norm(omega)) < 1e-8


def test_rodrigues_parameters_switch_to_the_shadow_set_at_half_a_turn(fmu):
    """Spin about a fixed axis: |sigma| = tan(angle/4) of the rotation by at most 180 degrees, over
    five turns.
    """
    rate, axis = 0.1, np.array([0.6, 0.0, 0.8])
    body = {"J_T": 100 * np.eye(3), "omega_TN_T_0": rate * axis, "sigma_TN_0": (0, 0, 0)}
    t, sigma, q = fmu("target", DEEP_SPACE | body).history(0.5, 600, "sigma_TN", "q_TN")
    turned = (rate * t + np.pi) % (2 * np.pi) - np.pi
    assert deviation(4 * np.arctan(np.linalg.norm(sigma, axis=1)), abs(turned)) < 1e-9
    assert deviation(sigma, np.outer(np.tan(turned / 4), axis)) < 1e-9
    assert (
        deviation(q, np.column_stack([np.cos(turned / 2), np.outer(np.sin(turned / 2), axis)]))
        < 1e-9
    )


def test_quaternion_and_rodrigues_parameters_are_the_same_attitude(fmu, rng):
    sigma = rng.uniform(0.1, 3) * random_direction(rng)  # outside the unit sphere too
    unit = fmu("target", {"sigma_TN_0": sigma})
    q = unit.get("q_TN")
    assert deviation(dcm_of_quaternion(q), dcm_of_mrp(sigma)) < 1e-15 * 10
    assert deviation(attitude(unit), dcm_of_mrp(sigma)) < 1e-15 * 10
    assert deviation(np.linalg.norm(q), 1) < 1e-15
    assert np.linalg.norm(unit.get("sigma_TN")) <= 1


# ---- orbit ----


def test_elements_at_the_start_are_the_parameters(fmu, rng):
    elements = {"a": 7.3e6, "e": 0.1} | dict(
        zip(("inc", "argp", "raan", "nu"), rng.uniform(0.2, 2.8, 4), strict=True)
    )
    unit = fmu("target", EARTH | elements)
    found = elements_of_state(unit.get("r_TN_N"), unit.get("v_TN_N"))
    assert found == pytest.approx(elements, rel=1e-13, abs=1e-13)


def test_cartesian_start_is_taken_as_given_and_moves_as_from_elements(fmu):
    by_elements = fmu("target", ORBIT)
    r, v = by_elements.get("r_TN_N"), by_elements.get("v_TN_N")
    cartesian = fmu("target", EARTH | {"a": 0, "r_0_N": r, "v_0_N": v})
    for unit in (by_elements, cartesian):
        unit.step(100)
    assert bits(cartesian) == bits(by_elements)


def test_in_deep_space_the_path_is_straight(fmu):
    r, v = np.array([10.0, -20.0, 30.0]), np.array([1.0, 2.0, -3.0])
    unit = fmu("target", DEEP_SPACE | {"r_0_N": r, "v_0_N": v})
    unit.step(1000)
    assert deviation(unit.get("r_TN_N"), r + 1000 * v, 3000) < 1e-12
    assert deviation(unit.get("v_TN_N"), v) == 0
    assert not unit.get("M_gg_T").any()


def test_kepler_orbit_closes_and_retains_its_energy(fmu):
    unit = fmu("target", ORBIT | {"use_J2": 0})
    r, v = unit.get("r_TN_N"), unit.get("v_TN_N")
    unit.step(2 * np.pi * np.sqrt(ELEMENTS["a"] ** 3 / MU))
    assert deviation(unit.get("r_TN_N"), r) < 1e-4
    E = energy(r, v, 0)
    assert deviation(energy(unit.get("r_TN_N"), unit.get("v_TN_N"), 0), E, -E) < 1e-12


@pytest.fixture(scope="module")
def day(kind):
    """States of a target over one day around an oblate planet, one a minute."""
    unit = Unit(kind("target"), ORBIT | {"use_J2": 1}, {}, 0.0)
    yield unit.history(60, 1440, "r_TN_N", "v_TN_N")
    unit.close()


def test_oblate_planet_retains_energy_and_polar_angular_momentum_over_a_day(day):
    _, r, v = day
    E = np.array([energy(x, dx, J2) for x, dx in zip(r, v, strict=True)])
    h_z = np.cross(r, v)[:, 2]
    assert deviation(E, E[0], -E[0]) < 1e-12
    assert deviation(h_z, h_z[0], h_z[0]) < 1e-12


def test_node_drifts_at_the_secular_rate(day):
    """-1.5 n J2 (R/p)^2 cos i; 2 %: osculating instead of mean elements, and periodic terms left in
    the fit.
    """
    t, r, v = day
    h = np.cross(r, v)
    node = np.unwrap(np.arctan2(h[:, 0], -h[:, 1]))
    a, p = ELEMENTS["a"], ELEMENTS["a"] * (1 - ELEMENTS["e"] ** 2)
    secular = -1.5 * np.sqrt(MU / a**3) * J2 * (R_E / p) ** 2 * np.cos(ELEMENTS["inc"])
    assert deviation(np.polyfit(t, node, 1)[0], secular, -secular) < 0.02


def test_oblateness_acceleration_is_the_gradient_of_the_potential(fmu, rng):
    """From rest over 0.1 s with and without J2: what the two have in common cancels, error (n h)^2
    = 1e-8.
    """
    r, h = 7.0e6 * random_direction(rng), 0.1

    def speed(use_J2):
        unit = fmu("target", EARTH | {"a": 0, "r_0_N": r, "v_0_N": (0, 0, 0), "use_J2": use_J2})
        unit.step(h)
        return unit.get("v_TN_N")

    expected = minus_gradient(lambda x: potential(x) - potential(x, oblateness=0), r)
    assert deviation((speed(1) - speed(0)) / h, expected, np.linalg.norm(expected)) < 1e-7


# ---- gravity gradient ----


def test_gravity_gradient_torque_is_the_torque_on_point_masses(fmu, rng):
    J, sigma = random_inertia(rng), rng.uniform(-0.5, 0.5, 3)
    unit = fmu("target", ORBIT | {"J_T": J, "sigma_TN_0": sigma})
    expected = torque_on_point_masses(dcm_of_mrp(sigma) @ unit.get("r_TN_N"), J)
    assert deviation(unit.get("M_gg_T"), expected, np.linalg.norm(expected)) < 1e-6


def test_gravity_gradient_accelerates_the_body_by_the_torque_it_publishes(fmu):
    """From rest for 0.1 s; the torque turns with the orbit by 1e-4 of itself meanwhile."""
    J = np.diag([100.0, 150.0, 90.0])
    unit = fmu("target", ORBIT | AT_REST | {"J_T": J, "sigma_TN_0": (0.1, 0.2, -0.3)})
    M = unit.get("M_gg_T")
    unit.step(0.1)
    assert deviation(J @ unit.get("omega_TN_T") / 0.1, M, np.linalg.norm(M)) < 3e-4


def test_gravity_gradient_can_be_switched_off(fmu):
    unit = fmu("target", ORBIT | AT_REST | {"use_gravity_gradient": 0, "sigma_TN_0": (0.1, 0.2, 0)})
    unit.step(10)
    assert not unit.get("M_gg_T").any()
    assert not unit.get("omega_TN_T").any()


def test_libration_in_the_orbit_plane_has_the_linear_frequency(fmu):
    """Pitch about the orbit normal y, z to the nadir: n sqrt(3 (Ix - Iz)/Iy); amplitude 1e-3
    detunes it by 2.5e-7.
    """
    Ix, Iy, Iz = 140.0, 150.0, 90.0
    n, amplitude = np.sqrt(MU / ELEMENTS["a"] ** 3), 1e-3
    local = np.array(
        [[0, 1, 0], [0, 0, -1], [-1, 0, 0]]
    )  # rows: along track, minus normal, nadir at nu = 0
    sigma_0 = Rotation.from_matrix(
        (Rotation.from_euler("y", -amplitude).as_matrix() @ local).T
    ).as_mrp()
    circle = EARTH | dict.fromkeys(ELEMENTS, 0) | {"a": ELEMENTS["a"], "use_J2": 0, "max_step": 1}
    unit = fmu(
        "target",
        circle | {"J_T": np.diag([Ix, Iy, Iz]), "sigma_TN_0": sigma_0, "omega_TN_T_0": (0, -n, 0)},
    )
    t, sigma, r = unit.history(20, 2500, "sigma_TN", "r_TN_N")
    x_N = np.array([dcm_of_mrp(s)[0] for s in sigma])
    pitch = np.arcsin((x_N * r).sum(axis=1) / np.linalg.norm(r, axis=1))
    k = np.flatnonzero(pitch[:-1] * pitch[1:] < 0)
    crossing = t[k] + 20 * pitch[k] / (pitch[k] - pitch[k + 1])
    frequency = np.pi * (len(crossing) - 1) / (crossing[-1] - crossing[0])
    expected = n * np.sqrt(3 * (Ix - Iz) / Iy)
    assert deviation(frequency, expected, expected) < 1e-5


# ---- disturbances, manoeuvre, contact ----


def test_disturbance_torque_acts_on_each_body_axis_by_its_own_wave(fmu, rng):
    """A ball has no gyroscopic coupling in body axes. RK4 is Simpson's rule here: error (f
    h)^4/2880 = 1e-10.
    """
    w = random_wave(rng, 0.01)
    unit = fmu("target", DEEP_SPACE | AT_REST | {"J_T": 50 * np.eye(3), "M_dist_T": w})
    unit.step(77.7)
    expected = cases.integral_of_wave(w, unit.time)[0] / 50
    assert deviation(unit.get("omega_TN_T"), expected, np.abs(expected).max()) < 1e-9


@pytest.mark.parametrize("record", ["a_dist", "a_manoeuvre_N"])
def test_disturbance_acceleration_and_manoeuvre_act_on_each_inertial_axis_by_their_own_wave(
    fmu, rng, record
):
    w = random_wave(rng, 0.01)
    unit = fmu("target", DEEP_SPACE | {record: w, "omega_TN_T_0": (0.02, 0.03, 0.01)})
    unit.step(77.7)
    velocity, position = cases.integral_of_wave(w, unit.time)
    assert deviation(unit.get("v_TN_N"), velocity, np.abs(velocity).max()) < 1e-9
    assert deviation(unit.get("r_TN_N"), position, np.abs(position).max()) < 1e-9


@pytest.mark.parametrize(
    ("record", "effect"),
    [("M_dist_T", "omega_TN_T"), ("a_dist", "v_TN_N"), ("a_manoeuvre_N", "v_TN_N")],
)
def test_nothing_acts_before_the_start_time_and_time_is_absolute(fmu, rng, record, effect):
    """Not even in the last stage of the step that ends at the start time."""
    w, h = random_wave(rng, 0.01, start=130.0), 0.001
    body = AT_REST | {"J_T": np.eye(3), "max_step": h}
    unit = fmu("target", DEEP_SPACE | body | {record: w}, start=100.0)
    unit.step(30.0)
    assert not unit.get(effect).any()
    unit.step(20.0)
    expected = cases.integral_of_wave(w, 150.0)[0]
    # 20 000 additions of a thousandth each
    assert deviation(unit.get(effect), expected, np.abs(expected).max()) < 1e-10


def test_contact_force_turns_with_the_body_and_contact_torque_acts_in_body_axes(fmu):
    """Spin at w about z: the force stays in body axes. Then a torque about z: w grows by M t/J."""
    w, mass, F, sigma_0, t = 0.05, 70.0, np.array([3.0, -2.0, 1.0]), (0.1, -0.2, 0.3), 60.0
    body = {
        "J_T": np.diag([100, 100, 120]),
        "mass": mass,
        "omega_TN_T_0": (0, 0, w),
        "sigma_TN_0": sigma_0,
    }
    unit = fmu("target", DEEP_SPACE | body)
    unit.step(t, {"F_T": F})
    s, c = np.sin(w * t) / w, (1 - np.cos(w * t)) / w
    velocity = dcm_of_mrp(sigma_0).T @ np.array([[s, -c, 0], [c, s, 0], [0, 0, t]]) @ F / mass
    assert deviation(unit.get("v_TN_N"), velocity) < 1e-9
    unit.step(30, {"F_T": (0, 0, 0), "M_T": (0, 0, 0.12)})
    assert deviation(unit.get("omega_TN_T"), (0, 0, w + 30 * 0.12 / 120)) < 1e-14
    assert deviation(unit.get("v_TN_N"), velocity) < 1e-9


# ---- everything together ----


def everything(rng):
    """Parameters with all loads on; random inertia, attitude, rate and place on the orbit."""
    body = {"J_T": random_inertia(rng), "mass": rng.uniform(50, 500), "max_step": 0.05}
    start = {"sigma_TN_0": rng.uniform(-0.5, 0.5, 3), "omega_TN_T_0": 0.05 * random_direction(rng)}
    waves = {
        "M_dist_T": random_wave(rng, 0.01),
        "a_dist": random_wave(rng, 1e-3),
        "a_manoeuvre_N": random_wave(rng, 0.01),
    }
    return ORBIT | {"nu": rng.uniform(0, 6)} | body | start | waves


def vehicle(p, F_T, M_T):
    """Continuous theory of the target with parameters p."""

    def acceleration(t, r, v):
        axes = hill_axes(r, v) if p["a_dist_axes"] else np.eye(3)
        return axes.T @ wave(p["a_dist"], t) + wave(p["a_manoeuvre_N"], t)

    return Vehicle(
        J=p["J_T"],
        F_B=F_T,
        M_B=lambda t: wave(p["M_dist_T"], t) + M_T,
        a_N=acceleration,
        gravity=lambda r: minus_gradient(potential, r),
        torque_of_gravity=lambda r_B: torque_on_point_masses(r_B, p["J_T"]),
    )


@pytest.mark.parametrize("axes", [0, 1])
def test_all_loads_together_follow_the_momentum_balance(fmu, rng, axes):
    """Orbit: rounding of 7e6 m and 7e3 m/s. Attitude: RK4 at 0.05 s, (w h)^4 t = 1e-12 rad."""
    p = everything(rng) | {"a_dist_axes": axes}
    F_T, M_T = rng.normal(size=3), 0.01 * rng.normal(size=3)
    unit, v = fmu("target", p), vehicle(p, F_T, M_T)
    y = v.state(
        unit.get("r_TN_N"), unit.get("v_TN_N"), attitude(unit), p["omega_TN_T_0"], mass=p["mass"]
    )
    for _ in range(60):
        unit.step(1, {"F_T": F_T, "M_T": M_T})
    y = v.propagate(y, 0, 60)
    assert deviation(unit.get("r_TN_N"), y[:3]) < 1e-6
    assert deviation(unit.get("v_TN_N"), y[3:6]) < 1e-9
    assert angle_between_attitudes(attitude(unit), y[6:15].reshape(3, 3).T) < 1e-10
    assert deviation(unit.get("omega_TN_T"), v.rate(y)) < 1e-12


# ---- numerical integration ----


@pytest.mark.parametrize(
    ("names", "h", "duration"),
    [(("omega_TN_T", "q_TN"), 0.25, 40), (("r_TN_N", "v_TN_N"), 2.5, 2000)],
)
def test_integration_error_is_of_fourth_order(fmu, names, h, duration):
    def result(max_step):
        unit = fmu("target", ORBIT | {"max_step": max_step, "omega_TN_T_0": (0.05, 0.08, -0.03)})
        unit.step(duration)
        return np.concatenate([unit.get(name) for name in names])

    assert deviation(order_ratio(result, h), 2**4, 2**4) < 0.05


@pytest.mark.parametrize("h", [0.1, 0.3, 1.0])
def test_result_does_not_depend_on_how_the_step_is_cut(fmu, rng, h):
    p, u = everything(rng) | {"max_step": 0.1}, {"F_T": rng.normal(size=3)}
    whole, cut = fmu("target", p, u), fmu("target", p, u)
    whole.step(30)
    for _ in range(round(30 / h)):
        cut.step(h)
    assert bits(cut) == bits(whole)


def test_steps_off_the_grid_only_add_their_own_truncation_error(fmu, rng):
    """Cutting at 0.07 s shortens internal steps of 0.1 s; both within the error of RK4 at 0.1 s and
    0.1 rad/s.
    """
    p = everything(rng) | {"max_step": 0.1}
    whole, cut = fmu("target", p), fmu("target", p)
    whole.step(21)
    for _ in range(300):
        cut.step(0.07)
    assert deviation(cut.get("r_TN_N"), whole.get("r_TN_N")) < 1e-6
    assert deviation(cut.get("omega_TN_T"), whole.get("omega_TN_T")) < 1e-11


# ---- reference implementation ----


def test_result_matches_the_reference_implementation(fmu, rng):
    """The same RK4 on quaternions instead of Rodrigues parameters: attitude differs by truncation,
    (w h)^5 a step.
    """
    p = everything(rng) | {"a_dist_axes": 1}
    u = {"F_T": rng.normal(size=3), "M_T": 0.01 * rng.normal(size=3)}
    unit = fmu("target", p, u)
    waves = {
        k: reference_sinusoid.Sinusoid(**p[k]) for k in ("M_dist_T", "a_dist", "a_manoeuvre_N")
    }
    q = reference.Parameters(**(p | waves | {"use_J2": 1, "use_gravity_gradient": 1}))
    unit.step(20)
    expected = reference.outputs(
        reference.step(q, reference.initial_state(q), 0, 20, reference.Input(**u)), q
    )
    for name in ("r_TN_N", "v_TN_N", "omega_TN_T", "M_gg_T"):
        assert deviation(unit.get(name), expected[name], np.abs(expected[name]).max()) < 1e-10, name
    assert angle_between_attitudes(attitude(unit), dcm_of_quaternion(expected["q_TN"])) < 1e-9
