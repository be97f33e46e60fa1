# SPDX-License-Identifier: BSD-2-Clause
"""sync_guidance.fmu against kinematics: published derivatives are derivatives, the frame D is the
frame of (6).

Where a target moves it is the target FMU without what the software does not model (J2, manoeuvre),
so that its orbit frame and attitude move exactly as the software believes.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view
from scipy.spatial.transform import Rotation

from ..reference import guidance as reference
from ..reference.body import Body
from ..reference.sinusoid import Sinusoid
from .cases import (
    DEEP_SPACE,
    ELEMENTS,
    random_bodies,
    random_direction,
    random_inertia,
    random_rotation,
    random_wave,
    turned,
    wave,
)
from .driver import bits
from .motion import deviation
from .rejections import rejection
from .theory import (
    EARTH,
    MU,
    angle_between_attitudes,
    dcm_of_quaternion,
    hill_axes,
    torque_on_point_masses,
    vee,
)

T_PORTS = ("r_TN_N", "v_TN_N", "q_TN", "omega_TN_T")
S_PORTS = ("r_SN_N", "v_SN_N", "q_SN", "omega_SN_S")
H = 0.2  # s, sample distance for numerical derivatives: FIVE errs by (w H)^4 = 1e-9 at 0.03 rad/s
FIVE = np.array((8, -1)) / 12
"""Central difference over two samples on either side: error h^4/30 of the fifth derivative."""
NINE = np.array((672, -168, 32, -3)) / 840
"""Over four samples on either side: error h^8/630 of the ninth derivative."""
GUARD = np.radians(5)


def parameters(rng):
    distances = {"rho_M": 4.0, "rho_0": 20.0, "beta": 0.01}
    return distances | {
        "mu": MU,
        "J_T": random_inertia(rng),
        "p_T": random_direction(rng),
        "guard_angle": GUARD,
    }


def at_once(fmu, p, states, t=0.0):
    """Outputs of the law for one set of inputs at time t."""
    return fmu("sync_guidance", p, states, start=t).outputs()


def simulate(fmu, p, target, steps=200, h=H):
    """Guidance beside moving target and servicer, sampled every h: time, inputs and outputs, one
    row per sample.
    """
    T = fmu("target", target)
    near = {
        "rho_0_H": (3, 20, -5),
        "drho_0_H": (0.02, -0.05, 0.01),
        "omega_SN_S_0": (0.01, 0, 0.02),
        "max_step": h,
    }
    shared = {k: v for k, v in target.items() if k in ("mu", "use_J2") or k in ELEMENTS}
    S = fmu("servicer", shared | near)
    unit, rows = fmu("sync_guidance", p), []
    for _ in range(steps):
        states = {k: T.get(k) for k in T_PORTS} | {k: S.get(k) for k in S_PORTS}
        unit.step(h, states)
        rows.append({"t": T.time} | states | unit.outputs())
        T.step(h)
        S.step(h)
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def derivative(samples, h=H, weights=FIVE):
    """Central difference at every inner sample: one less at each end for every weight."""
    reach, last = len(weights), len(samples)
    differences = [
        samples[reach + k : last - reach + k] - samples[reach - k : last - reach - k]
        for k in range(1, reach + 1)
    ]
    return np.tensordot(weights, differences, axes=1) / h


def rates_of(q, h=H, weights=FIVE):
    """Angular velocity from samples of the attitude: dC/dt = -tilde(omega) C."""
    C, reach = np.array([dcm_of_quaternion(x) for x in q]), len(weights)
    inner = zip(derivative(C, h, weights), C[reach:-reach], strict=True)
    return np.array([vee(-dC @ C_k.T) for dC, C_k in inner])


def tumbling(rng, p):
    """Target parameters that agree with the software: Kepler orbit, known inertia."""
    motion = {"sigma_TN_0": rng.uniform(-0.5, 0.5, 3), "omega_TN_T_0": 0.02 * random_direction(rng)}
    return EARTH | ELEMENTS | {"use_J2": 0, "J_T": p["J_T"], "max_step": H} | motion


def assert_published_derivatives_are_derivatives(f):
    """Scales: 20 m, 0.03 rad/s. The roll rate of D grows as 1/|u| near the orbit normal, its n-th
    derivative as 1/|u|^(n+1): with u = 0.09 at the guard FIVE would err by 1e-5. Where the guard
    begins or ends among the samples of a difference there is no derivative: rate or attitude jumps.
    """
    assert deviation(derivative(f["rho_ref_N"]), f["drho_ref_N"][2:-2]) < 1e-7
    assert deviation(derivative(f["drho_ref_N"]), f["ddrho_ref_N"][2:-2]) < 1e-8
    size, reach = max(1e-2, np.abs(f["omega_DN_D"]).max()), len(NINE)
    rate, accel = (f[name][reach:-reach] for name in ("omega_DN_D", "alpha_DN_D"))
    smooth = np.ptp(sliding_window_view(f["attitude_guard"], 2 * reach + 1), axis=1) == 0
    assert smooth.sum() > 100
    numeric = rates_of(f["q_DN"], weights=NINE)
    assert deviation(numeric[smooth], rate[smooth], size) < 1e-7
    numeric = derivative(f["omega_DN_D"], weights=NINE)
    assert deviation(numeric[smooth], accel[smooth], size**2) < 1e-6


# ---- derivatives ----


@pytest.mark.verifies("A.4-1")
def test_published_rates_and_accelerations_are_derivatives_of_the_published_references(fmu, rng):
    p = parameters(rng)
    assert_published_derivatives_are_derivatives(simulate(fmu, p, tumbling(rng, p)))


def test_with_known_disturbance_torque_they_still_are(fmu, rng):
    p, w = parameters(rng), {"M_dist_T": random_wave(rng, 0.05)}
    assert_published_derivatives_are_derivatives(
        simulate(fmu, p | w | {"know_M_dist": 1}, tumbling(rng, p) | w)
    )


def test_in_deep_space_they_are_derivatives_too_and_the_hill_frame_is_inertial(fmu, rng):
    p = parameters(rng) | {"mu": 0}
    f = simulate(fmu, p, tumbling(rng, p) | DEEP_SPACE | {"r_0_N": (1, 2, 3)})
    assert_published_derivatives_are_derivatives(f)
    assert deviation(f["rho_ref_H"], f["rho_ref_N"]) == 0


def test_relative_velocity_is_the_derivative_of_the_relative_position_in_the_hill_frame(fmu, rng):
    """Positions of 7e6 m have a rounding of 1e-9 m, so 1e-8 m/s in the stencil."""
    p = parameters(rng)
    f = simulate(fmu, p, tumbling(rng, p))
    assert deviation(derivative(f["rho_H"]), f["drho_H"][2:-2]) < 1e-7


def acceleration_by(torque, p, states, out):
    """Contribution of a torque on the target to ddrho_ref_N: alpha x rho_ref."""
    alpha_N = dcm_of_quaternion(states["q_TN"]).T @ np.linalg.solve(p["J_T"], torque)
    return np.cross(alpha_N, out["rho_ref_N"])


def test_knowledge_of_the_disturbance_torque_adds_its_angular_acceleration(fmu, rng):
    p, states, t = (
        parameters(rng) | {"M_dist_T": random_wave(rng, 1.0, start=5.0)},
        random_bodies(rng),
        30.0,
    )
    known, unknown = (at_once(fmu, p | {"know_M_dist": k}, states, t) for k in (1, 0))
    expected = acceleration_by(wave(p["M_dist_T"], t), p, states, known)
    assert deviation(known["ddrho_ref_N"] - unknown["ddrho_ref_N"], expected) < 1e-14
    before = at_once(fmu, p | {"know_M_dist": 1}, states, 4.0)
    assert deviation(before["ddrho_ref_N"], at_once(fmu, p, states, 4.0)["ddrho_ref_N"]) == 0


def test_modelled_gravity_gradient_adds_its_angular_acceleration(fmu, rng):
    """Point masses: 1e-9 of the torque; the difference of the two outputs: rounding of 1e-2
    m/s2.
    """
    p, states = parameters(rng), random_bodies(rng)
    on, off = (at_once(fmu, p | {"use_gravity_gradient": k}, states) for k in (1, 0))
    torque = torque_on_point_masses(dcm_of_quaternion(states["q_TN"]) @ states["r_TN_N"], p["J_T"])
    expected = acceleration_by(torque, p, states, on)
    assert (
        deviation(on["ddrho_ref_N"] - off["ddrho_ref_N"], expected)
        < 1e-6 * np.abs(expected).max() + 1e-16
    )


# ---- reference position ----


def test_body_fixed_station_moves_as_a_point_of_the_target(fmu, rng):
    """v = w x r, a = w x (w x r) + dw/dt x r, with dw/dt from the balance of angular momentum."""
    p, states = parameters(rng) | {"beta": 0.0, "rho_0": 7.0}, random_bodies(rng)
    out, C_TN, J = at_once(fmu, p, states, 40.0), dcm_of_quaternion(states["q_TN"]), p["J_T"]
    torque_N = C_TN.T @ torque_on_point_masses(C_TN @ states["r_TN_N"], J)
    w, J_N = C_TN.T @ states["omega_TN_T"], C_TN.T @ J @ C_TN
    dw = np.linalg.solve(J_N, torque_N - np.cross(w, J_N @ w))
    r = 7.0 * C_TN.T @ p["p_T"]
    assert deviation(out["rho_ref_N"], r) < 1e-14 * 7
    assert deviation(out["drho_ref_N"], np.cross(w, r)) < 1e-14
    assert deviation(out["ddrho_ref_N"], np.cross(w, np.cross(w, r)) + np.cross(dw, r)) < 1e-14


def test_distance_shrinks_exponentially_from_start_to_final_value_along_the_grasp_axis(fmu, rng):
    p, states = parameters(rng), random_bodies(rng)
    axis = dcm_of_quaternion(states["q_TN"]).T @ p["p_T"]
    C_HN = hill_axes(states["r_TN_N"], states["v_TN_N"])
    for t in (0.0, 50.0, 300.0, 3000.0):
        out = at_once(fmu, p, states, t)
        expected = (4 + 16 * np.exp(-0.01 * t)) * axis
        assert deviation(out["rho_ref_N"], expected) < 1e-13
        assert deviation(out["rho_ref_H"], C_HN @ expected) < 1e-13


# ---- relative state and alignment ----


def test_relative_state_matches_the_inputs_in_the_turning_frame(fmu, rng):
    """drho_H by a complex step along the Kepler motion of the target."""
    states = random_bodies(rng)
    out, (r, v) = at_once(fmu, parameters(rng), states), (states["r_TN_N"], states["v_TN_N"])
    rho, drho, h = states["r_SN_N"] - r, states["v_SN_N"] - v, 1e-20
    later = hill_axes(r + 1j * h * v, v - 1j * h * MU * r / np.linalg.norm(r) ** 3) @ (
        rho + 1j * h * drho
    )
    assert deviation(out["rho_H"], later.real) < 1e-12
    assert deviation(out["drho_H"], later.imag / h) < 1e-14
    assert deviation(out["range"], np.linalg.norm(rho)) < 1e-13


def test_alignment_angles_are_those_to_the_grasp_axis_and_of_the_arm_axis(fmu, rng):
    """arccos loses half the digits only near 0 and pi."""
    p, states = parameters(rng), random_bodies(rng)
    out, rho = at_once(fmu, p, states), states["r_SN_N"] - states["r_TN_N"]
    axis, arm = dcm_of_quaternion(states["q_TN"]).T @ p["p_T"], dcm_of_quaternion(states["q_SN"])[0]
    assert deviation(out["beta_t"], np.arccos(rho @ axis / np.linalg.norm(rho))) < 1e-12
    assert deviation(out["beta_p"], np.arccos(-rho @ arm / np.linalg.norm(rho))) < 1e-12


def test_alignment_angles_vanish_for_a_servicer_on_its_references(fmu, rng):
    """Rounding of 7e6 m seen from 20 m: 5e-11 rad."""
    p, states = parameters(rng), random_bodies(rng)
    out = at_once(fmu, p, states)
    states |= {"r_SN_N": states["r_TN_N"] + out["rho_ref_N"], "q_SN": out["q_DN"]}
    aligned = at_once(fmu, p, states)
    assert aligned["beta_t"] < 1e-9
    assert aligned["beta_p"] < 1e-9


# ---- reference attitude ----


def desired_axes(states, p):
    """C_DN: i = -grasp axis, k = i x orbit normal, j = k x i."""
    i = -dcm_of_quaternion(states["q_TN"]).T @ p["p_T"]
    k = np.cross(i, np.cross(states["r_TN_N"], states["v_TN_N"]))
    k /= np.linalg.norm(k)
    return np.array([i, np.cross(k, i), k])


@pytest.mark.verifies("A.4-2")
def test_reference_attitude_looks_back_along_the_grasp_axis_with_its_z_axis_in_the_orbit_plane(
    fmu, rng
):
    p, states = parameters(rng), random_bodies(rng)
    q = at_once(fmu, p, states)["q_DN"]
    assert deviation(np.linalg.norm(q), 1) < 1e-14
    assert angle_between_attitudes(dcm_of_quaternion(q), desired_axes(states, p)) < 1e-13


# ---- guard: grasp axis near the orbit normal ----


def passage(fmu, rng, pole, h=0.1, steps=400):
    """A ball whose grasp axis passes the orbit normal (pole = 1) or its opposite (-1) at 2 deg, at
    20 s.
    """
    rate, closest = 0.02, np.radians(2)
    spin = np.array([np.cos(closest), 0, np.sin(closest)])
    nearest = pole * np.array([-np.sin(closest), 0, np.cos(closest)])
    p_H = np.cos(20 * rate) * nearest - np.sin(20 * rate) * np.cross(spin, nearest)
    body = {"J_T": 100 * np.eye(3), "use_J2": 0, "max_step": h}
    still = fmu("target", EARTH | ELEMENTS)
    C_NH, C_TN = hill_axes(still.get("r_TN_N"), still.get("v_TN_N")).T, random_rotation(rng)
    motion = {
        "sigma_TN_0": Rotation.from_matrix(C_TN.T).as_mrp(),
        "omega_TN_T_0": rate * C_TN @ C_NH @ spin,
    }
    p = parameters(rng) | {"J_T": body["J_T"], "p_T": C_TN @ C_NH @ p_H}
    return simulate(fmu, p, EARTH | ELEMENTS | body | motion, steps, h), p


def states_of(f, k):
    return {name: f[name][k] for name in T_PORTS + S_PORTS}


@pytest.mark.parametrize("pole", [1, -1])
def test_guard_is_on_within_its_angle_of_the_orbit_normal_and_arm_axis_never_leaves_the_grasp_axis(
    fmu, rng, pole
):
    f, p = passage(fmu, rng, pole)
    C_NT = [dcm_of_quaternion(q).T for q in f["q_TN"]]
    axis = np.array([C @ p["p_T"] for C in C_NT])
    normal = np.cross(f["r_TN_N"], f["v_TN_N"])
    across = np.linalg.norm(np.cross(axis, normal), axis=1) / np.linalg.norm(normal, axis=1)
    assert (f["attitude_guard"] == (across < np.sin(GUARD))).all()
    assert 0 < f["attitude_guard"].sum() < 100
    assert deviation(np.array([dcm_of_quaternion(q)[0] for q in f["q_DN"]]), -axis) < 1e-14
    assert deviation(np.linalg.norm(f["q_DN"], axis=1), 1) < 1e-14


@pytest.mark.verifies("A.4-2")
@pytest.mark.parametrize("pole", [1, -1])
def test_reference_attitude_is_continuous_into_the_guard_and_within_it(fmu, rng, pole):
    """It turns by its published rate; only on leaving the guard it goes back to (6) in one step."""
    h = 0.1
    f, p = passage(fmu, rng, pole, h)
    C = [dcm_of_quaternion(q) for q in f["q_DN"]]
    turned_by = np.array([angle_between_attitudes(a, b) for a, b in pairwise(C)])
    rate = np.linalg.norm(f["omega_DN_D"], axis=1)
    within = np.maximum(rate[:-1], rate[1:]) * h * 1.01
    leaving = np.flatnonzero(np.diff(f["attitude_guard"]) < 0)
    assert np.flatnonzero(turned_by > within).tolist() == leaving.tolist()
    after = leaving[0] + 1
    assert angle_between_attitudes(C[after], desired_axes(states_of(f, after), p)) < 1e-13


@pytest.mark.parametrize("pole", [1, -1])
def test_rates_within_the_guard_match_the_published_attitude(fmu, rng, pole):
    """The roll reference is held from sample to sample, so that its rate is right to the first
    order, rate^2 h.
    """
    h = 0.1
    f, _ = passage(fmu, rng, pole, h)
    first, last = np.flatnonzero(f["attitude_guard"])[[0, -1]]
    numeric = rates_of(f["q_DN"], h)[first + 1 : last - 4]
    assert deviation(numeric, f["omega_DN_D"][first + 3 : last - 2]) < 0.02**2 * h
    assert deviation(derivative(f["drho_ref_N"], h), f["ddrho_ref_N"][2:-2]) < 1e-8


def test_first_sample_within_the_guard_turns_the_z_axis_to_the_radial_direction(fmu, rng):
    states = random_bodies(rng)
    H_axes = hill_axes(states["r_TN_N"], states["v_TN_N"])
    axis_H = np.array([0.03, -0.04, np.sqrt(1 - 0.03**2 - 0.04**2)])
    p = parameters(rng) | {"p_T": dcm_of_quaternion(states["q_TN"]) @ H_axes.T @ axis_H}
    out = at_once(fmu, p, states)
    z_H = H_axes @ dcm_of_quaternion(out["q_DN"])[2]
    expected = np.array([1, 0, 0]) - 0.03 * axis_H
    assert out["attitude_guard"] == 1
    assert deviation(z_H, expected / np.linalg.norm(expected)) < 1e-13


# ---- symmetries and sampling ----


def test_turning_everything_given_in_inertial_axes_turns_the_references_with_it(fmu, rng):
    """1e-12 of each output; components of 7e6 m turned with rounding 1e-9 m, which is 1e-10 rad
    seen from 20 m.
    """
    p, states, R = parameters(rng), random_bodies(rng), random_rotation(rng)
    one, other = at_once(fmu, p, states, 30.0), at_once(fmu, p, turned(states, R), 30.0)
    expected = turned(one, R)
    assert (
        angle_between_attitudes(*(dcm_of_quaternion(x.pop("q_DN")) for x in (other, expected)))
        < 1e-12
    )
    for name, value in expected.items():
        seen_from_20_m = name in ("rho_H", "drho_H", "range", "beta_t", "beta_p")
        size = np.abs(value).max() if np.abs(value).max() > 0 else 1
        assert deviation(other[name], value, size) < (1e-9 if seen_from_20_m else 1e-12), name


def test_quaternions_of_either_sign_are_the_same_attitude(fmu, rng):
    p, states = parameters(rng), random_bodies(rng)
    expected = fmu("sync_guidance", p, states)
    for flipped in ({"q_TN": -states["q_TN"]}, {"q_SN": -states["q_SN"]}):
        assert bits(fmu("sync_guidance", p, states | flipped)) == bits(expected)


@pytest.mark.parametrize("h", [0.1, 0.25, 0.5])
def test_samples_are_taken_at_multiples_of_the_period_and_held(fmu, rng, h):
    """Inputs change at every call; only those at 0, 0.5, 1.0, ... s count, for any step of the
    master.
    """
    period, p = 0.5, parameters(rng) | {"sample_period": 0.5}
    states = [random_bodies(np.random.default_rng(k)) for k in range(4)]
    slow, sampled = fmu("sync_guidance", p, states[0]), fmu("sync_guidance", p, states[0])
    for k in range(4):
        slow.step(period, states[k])
        for i in range(round(period / h)):
            sampled.step(h, states[k] if i == 0 else random_bodies(rng))
            assert bits(sampled) == bits(slow)


@pytest.mark.parametrize("h", [0.1, 0.2, 2.5])
def test_a_sample_belongs_to_its_own_time_however_the_steps_lie(fmu, rng, h):
    """Steps across sample times, or over several: the law at the last multiple of the period before
    the end.
    """
    p, states = parameters(rng) | {"beta": 0.05}, random_bodies(rng)
    unit = fmu("sync_guidance", p | {"sample_period": 0.5}, states)
    for _ in range(round(2.5 / h)):
        unit.step(h)
    expected = at_once(fmu, p, states, 2.0)
    for name in ("rho_ref_N", "drho_ref_N", "ddrho_ref_N"):
        assert deviation(unit.get(name), expected[name]) == 0


# ---- reference implementation ----


def test_outputs_match_the_reference_implementation(fmu, rng):
    """Also along a passage of the guard, where each sample depends on the one before."""
    p, states = (
        parameters(rng) | {"know_M_dist": 1, "M_dist_T": random_wave(rng, 0.1)},
        random_bodies(rng),
    )
    assert_equal_outputs(at_once(fmu, p, states, 25.0), by_reference(25.0, states, p)[0])
    f, p = passage(fmu, rng, 1, h=0.5, steps=80)
    held = None
    for k in range(80):
        expected, held = by_reference(0.5 * k, states_of(f, k), p, held)
        assert_equal_outputs({name: f[name][k] for name in expected}, expected)


def by_reference(t, states, p, held=None):
    T, S = (Body(*(states[name] for name in ports)) for ports in (T_PORTS, S_PORTS))
    known = {"M_dist_T": Sinusoid(**p["M_dist_T"])} if "M_dist_T" in p else {}
    expected, held = reference.sample(t, T, S, reference.Parameters(**(p | known)), held)
    del expected["normal_distance"]
    return expected, held


def assert_equal_outputs(found, expected):
    for name, value in expected.items():
        sign = -1 if name == "q_DN" and value @ found[name] < 0 else 1
        assert deviation(found[name], sign * np.asarray(value), np.abs(value).max() or 1) < 1e-9, (
            name
        )


# ---- reference attitude within limits (A.4.6) ----

LIMITS = {"roll_rate_max": 0.05, "roll_accel_max": 1e-3}
AXIS_T = np.array([1.0, 0, 0])


def passing(fmu, limits, miss=0.035, rate=0.01, steps=2400, h=0.1):
    """Outputs while the grasp axis passes the orbit normal at the angle `miss`, turning about a
    fixed axis with a constant rate; in deep space, where H is N and the normal is z.
    """
    begin = Rotation.from_rotvec([0, 0, 0.3]) * Rotation.from_rotvec([miss, 0, 0])
    p = {"mu": 0, "J_T": np.diag([100.0] * 3), "p_T": AXIS_T, "guard_angle": GUARD} | limits
    unit, rows = None, []
    for k in range(steps):
        turn = begin * Rotation.from_rotvec([0, -0.8 - rate * k * h, 0])  # T axes to N axes
        q = turn.inv().as_quat(canonical=True, scalar_first=True)
        q[1:] *= -1
        omega = turn.inv().apply(begin.apply([0, -rate, 0]))
        states = {"r_TN_N": (0, 0, 0), "v_TN_N": (0, 0, 0), "q_TN": q, "omega_TN_T": omega}
        unit = unit or fmu("sync_guidance", p, states | {"r_SN_N": (4, 0, 0)})
        unit.step(h, states)
        rows.append(states | unit.outputs())
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


@pytest.fixture
def simulated(fmu):
    return passing(fmu, LIMITS)


def apart(q, p):
    """Angles [rad] between attitudes, row by row."""
    return 4 * np.arcsin(
        np.minimum(np.linalg.norm(q - p, axis=-1), np.linalg.norm(q + p, axis=-1)) / 2
    )


def turns(q):
    """Angles [rad] between consecutive attitudes."""
    return apart(q[1:], q[:-1])


def test_the_reference_jumps_after_the_guard_without_limits(fmu):
    f = passing(fmu, {})
    assert f["attitude_guard"].any()
    assert not f["roll_limited"].any()
    assert turns(f["q_DN"]).max() > 1.0
    assert f["normal_angle"].min() == pytest.approx(0.035, abs=1e-3)


@pytest.mark.verifies("A.4-3")
def test_with_limits_it_is_continuous_and_retains_them(simulated):
    assert simulated["attitude_guard"].any()
    assert simulated["roll_limited"].any()
    assert turns(simulated["q_DN"]).max() < 0.1 * (0.05 + 0.012)
    assert np.abs(simulated["omega_DN_D"][:, 0]).max() <= 0.05 + 1e-15
    assert np.abs(simulated["alpha_DN_D"][:, 0]).max() <= 1e-3 + 1e-15
    assert np.abs(np.diff(simulated["omega_DN_D"], axis=0)).max() < 0.1 * 2e-3


@pytest.mark.verifies("A.4-1")
def test_its_rates_are_derivatives_of_what_is_published(simulated):
    """The roll acceleration changes at samples, so rates are compared over one sample: the turn of
    D against the mean of the rates at both ends, an error of h^3 |alpha'|/12.
    """
    q, h = simulated["q_DN"], 0.1
    C = np.array([dcm_of_quaternion(x) for x in q])
    turned_by = Rotation.from_matrix(np.einsum("nij,nkj->nik", C[1:], C[:-1])).as_rotvec()
    omega = simulated["omega_DN_D"]
    joined = (simulated["roll_limited"][:-1] == 1) & (simulated["roll_limited"][1:] == 0)
    mean = (omega[1:] + omega[:-1]) / 2
    assert -turned_by[~joined] / h == pytest.approx(mean[~joined], abs=2e-6)
    assert -turned_by[joined] / h == pytest.approx(mean[joined], abs=1e-6 / h)
    alpha, end = simulated["alpha_DN_D"][:-1], omega[1:]
    free = (simulated["roll_limited"][:-1] == 1) & (simulated["roll_limited"][1:] == 1)
    expected = (omega[:-1] + h * alpha)[free]
    assert end[free, 0] == pytest.approx(expected[:, 0], abs=1e-15)
    assert end[free, 1:] == pytest.approx(expected[:, 1:], abs=2e-6)


def test_the_axis_stays_on_the_target_and_rule_and_reference_agree_in_the_end(fmu, simulated):
    C = np.array([dcm_of_quaternion(x) for x in simulated["q_DN"]])
    axis = np.array([dcm_of_quaternion(q).T @ AXIS_T for q in simulated["q_TN"]])
    assert C[:, 0] == pytest.approx(-axis, abs=1e-9)
    rule = passing(fmu, {})
    off = simulated["roll_limited"] == 1
    last = np.flatnonzero(off)[-1]
    assert 0 < np.argmax(off) < last < len(off) - 1
    np.testing.assert_array_equal(simulated["q_DN"][~off], rule["q_DN"][~off])
    np.testing.assert_array_equal(simulated["omega_DN_D"][~off], rule["omega_DN_D"][~off])
    assert apart(simulated["q_DN"][last], rule["q_DN"][last]) < 2e-6


def test_limited_rolls_match_an_independent_derivation(fmu, simulated):
    """D turned by the rotation vector of the shortest turn, then rolled; the law of A.4.6."""
    rule, h, most, a_max = passing(fmu, {}), 0.1, 0.05, 1e-3
    axes = -np.array([dcm_of_quaternion(q).T @ AXIS_T for q in rule["q_TN"]])
    D, rate, acceleration, off = None, 0.0, 0.0, False
    for k, axis in enumerate(axes):
        C, r, dr = (
            dcm_of_quaternion(rule["q_DN"][k]),
            *(rule[n][k, 0] for n in ("omega_DN_D", "alpha_DN_D")),
        )
        if k:
            across = np.cross(axes[k - 1], axis)
            sine = np.linalg.norm(across)
            along = Rotation.from_rotvec(across / sine * np.arctan2(sine, axes[k - 1] @ axis))
            roll = Rotation.from_rotvec(axis * (rate * h + acceleration * h * h / 2))
            D, rate = roll.apply(along.apply(D)), rate + acceleration * h
        guard = rule["attitude_guard"][k] == 1
        psi = 0.0 if D is None else np.arctan2(np.cross(D, C[2]) @ axis, D @ C[2])
        if abs(psi) > 3 and psi * (rate - r) < 0:
            psi += 2 * np.pi * np.sign(rate - r)
        allowed = not guard and abs(r + dr * h) <= most and abs(dr) <= a_max
        if allowed and (not off or (abs(psi) < 1e-6 and abs(rate - r) < 1e-6)):
            D, rate, acceleration, off = C[2], r, dr, False
        else:
            off, a, tau, required = True, a_max / 2, 10 * h, 0.0
            if not guard:
                close = abs(psi) <= a * tau**2
                v = (
                    psi / tau
                    if close
                    else np.sign(psi) * np.sqrt(2 * a * (abs(psi) - a * tau**2 / 2))
                )
                required = r + dr * h + v
            rate = np.clip(rate, -most, most)
            acceleration = np.clip((np.clip(required, -most, most) - rate) / h, -a_max, a_max)
        assert simulated["roll_limited"][k] == off
        assert dcm_of_quaternion(simulated["q_DN"][k])[2] == pytest.approx(D, abs=1e-7)
        assert simulated["omega_DN_D"][k, 0] == pytest.approx(rate, abs=1e-8)


@pytest.mark.verifies("A.4-7")
def test_one_limit_without_the_other_is_rejected(tmp_path):
    text = rejection("sync_guidance", {"roll_rate_max": 0.05}, tmp_path)
    assert "must be above 0 if roll_rate_max is above 0" in text
