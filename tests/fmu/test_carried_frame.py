# SPDX-License-Identifier: BSD-2-Clause
"""sync_guidance.fmu with frame = 1: a reference that moves around the target at constant range
until it is on the grasp axis, from any direction; and the distance as an input.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.each import some
from tests.reference import carried
from tests.reference.attitude import cross

from .cases import random_direction, random_inertia, random_rotation
from .rejections import rejection
from .theory import MU, angle_between_attitudes, dcm_of_quaternion, quaternion_of_dcm, vee

GEO = 42164e3
RATE = np.sqrt(MU / GEO**3)
CARRIED = {"frame": 1, "range_input": 1}
P = 0.1


class Tumbling:
    """A torque-free target on a circular orbit: states and rates at any time."""

    def __init__(self, rng, seconds, rate=0.01):
        self.J = random_inertia(rng)
        C, w = random_rotation(rng), rate * random_direction(rng)
        self.orbit = random_rotation(rng)

        def field(_, x):
            q, w = x[:4], x[4:]
            dq = np.array((-q[1:] @ w, *(q[0] * w + cross(q[1:], w)))) / 2
            return np.concatenate((dq, np.linalg.solve(self.J, cross(self.J @ w, w))))

        start = np.concatenate((quaternion_of_dcm(C), w))
        self.motion = solve_ivp(
            field, (-1, seconds + 1), start, "DOP853", rtol=1e-13, atol=1e-14, dense_output=True
        ).sol

    def states(self, t):
        u = self.orbit @ (np.cos(RATE * t), np.sin(RATE * t), 0)
        v = self.orbit @ (-np.sin(RATE * t), np.cos(RATE * t), 0)
        x = self.motion(t)
        return {
            "r_TN_N": GEO * u, "v_TN_N": GEO * RATE * v,
            "q_TN": x[:4] / np.linalg.norm(x[:4]), "omega_TN_T": x[4:],
        }  # fmt: skip

    def turnings(self, t):
        """Rows w, dw of H and of T in N axes, and C_TN."""
        x = self.motion(t)
        C, w = dcm_of_quaternion(x[:4]), x[4:]
        dw = np.linalg.solve(self.J, cross(self.J @ w, w))
        return (self.orbit @ (0, 0, RATE), np.zeros(3)), (C.T @ w, C.T @ dw), C


def distance(t):
    """20 m to 3 m, smooth, with derivatives."""
    L = 11.5 + 8.5 * np.cos(0.02 * t)
    return np.array((L, -0.17 * np.sin(0.02 * t), -0.0034 * np.cos(0.02 * t)))


def servicer(T, rho_N, rng):
    return {
        "r_SN_N": T["r_TN_N"] + rho_N, "v_SN_N": T["v_TN_N"],
        "q_SN": quaternion_of_dcm(random_rotation(rng)), "omega_SN_S": (0, 0, 0),
    }  # fmt: skip


NAMES = ("q_DN", "omega_DN_D", "alpha_DN_D", "rho_ref_N", "drho_ref_N", "ddrho_ref_N")


def ratios_of(J):
    """inertia_hat of a target."""
    return {"inertia_hat": np.array((J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2])) / J[0, 0]}


def simulate(
    fmu, rng, seconds, period=P, rate=0.01, L=distance, rho=None, ratios=False, inputs=None,
    **parameters,
):  # fmt: skip
    """Outputs at each sample. The servicer stays where it is: nothing but the start depends on
    it.
    """
    T = Tumbling(rng, seconds, rate)
    p_T = random_direction(rng)
    p = CARRIED | {"J_T": T.J, "p_T": p_T, "use_gravity_gradient": 0, "mu": MU}
    S = servicer(T.states(0), 20 * random_direction(rng) if rho is None else rho(T, p_T), rng)
    more = inputs or {}
    if ratios:
        more |= ratios_of(T.J)
        p |= {"use_inertia_hat": 1, "J_T": np.eye(3)}

    def at(t):
        return T.states(t) | S | dict(zip(("L_ref", "dL_ref", "ddL_ref"), L(t), strict=True)) | more

    unit = fmu("sync_guidance", p | {"sample_period": period} | parameters, at(0.0))
    rows = []
    for k in range(round(seconds / period)):
        unit.step(period, at(k * period))
        rows.append([unit.get(name) for name in NAMES])
    columns = {
        name: np.array(column) for name, column in zip(NAMES, zip(*rows, strict=True), strict=True)
    }
    return columns | {"T": T, "p_T": p_T, "S": S}


def derivative(x, h):
    return (8 * (x[3:-1] - x[1:-3]) - (x[4:] - x[:-4])) / (12 * h)


def test_follows_the_reference_sample_by_sample(fmu, rng):
    """1e-9 over 40 s, from the same start: positions of 4e7 m seen from 20 m to 4e-10."""
    f = simulate(fmu, rng, 40.0, spin_time=20.0)
    T, p, S = f["T"], carried.Steering(20.0), f["S"]
    rho = S["r_SN_N"] - T.states(0)["r_TN_N"]
    C_DN = carried.start(rho, dcm_of_quaternion(S["q_SN"]))
    for k in range(400):
        of_H, of_T, C_TN = T.turnings(k * P)
        W, dW = carried.turning(p, C_DN, k * P, of_H, of_T, C_TN.T @ f["p_T"])
        assert angle_between_attitudes(C_DN, dcm_of_quaternion(f["q_DN"][k])) < 1e-9
        expected = carried.reference(C_DN, W, dW, distance(k * P))
        for name, value in expected.items():
            assert np.abs(f[name][k] - value).max() < 1e-9 * max(1, np.abs(value).max()), (name, k)
        C_DN = carried.carried_on(C_DN, W, dW, P)


@pytest.mark.parametrize("angle", [0.35, 0.01])
def test_steering_with_an_integral_follows_the_reference(fmu, rng, angle):
    """A spin-up that takes as long as spin_accel allows, a limit of the steering from outside, and
    inertias from ratios. From 0.35 rad the steering is at its limit throughout the spin-up; from
    0.01 rad it is within, and only the spin-up lets the integral rest.
    """
    changes = {"k_steer": 0.3, "k_integral": 0.02, "w_steer": 0.02, "spin_accel": 1.5e-3}
    inputs = {"steer_max": 0.01}
    f = simulate(fmu, rng, 60.0, spin_time=8.0, rho=towards(angle), ratios=True, inputs=inputs,
                 steer_input=1, **changes)  # fmt: skip
    T, p = f["T"], carried.Steering(8.0, 0.3, 0.01, 0.02, 1.5e-3)
    rho = f["S"]["r_SN_N"] - T.states(0)["r_TN_N"]
    C_DN, b = carried.start(rho, dcm_of_quaternion(f["S"]["q_SN"])), np.zeros(3)
    of_H, of_T, _ = T.turnings(0.0)
    spin = p.spin(of_H[0], of_T[0])
    assert 8.5 < spin < 20
    grown, within = [], []
    for k in range(600):
        of_H, of_T, C_TN = T.turnings(k * P)
        a = C_TN.T @ f["p_T"]
        W, dW = carried.turning(p, C_DN, k * P, of_H, of_T, a, b, spin)
        expected = carried.reference(C_DN, W, dW, distance(k * P))
        for name, value in expected.items():
            assert np.abs(f[name][k] - value).max() < 1e-9 * max(1, np.abs(value).max()), (name, k)
        rate = carried.growth(p, C_DN, k * P, spin, a)
        b = carried.integrated(p, b, rate, P)
        within.append(0.3 * np.linalg.norm(cross(C_DN[0], a)) <= 0.01)
        C_DN = carried.carried_on(C_DN, W, dW, P)
        grown.append(bool(np.any(rate)))
    assert not any(grown[: int(spin / P)])
    assert any(grown)
    assert all(grown[int(spin / P) + 1 :]) == (angle < 0.1)
    assert any(within[: int(spin / P)]) == (angle < 0.1)


def test_until_spin_is_set_the_frame_turns_with_the_hill_frame(fmu):
    """Then as if its first sample were then; once begun, it goes on."""
    rng = np.random.default_rng(2)
    T = Tumbling(rng, 60.0)
    S = servicer(T.states(0), 20 * random_direction(rng), rng)
    p = CARRIED | {"J_T": T.J, "use_gravity_gradient": 0, "mu": MU, "sample_period": 0.5}
    p |= {"spin_time": 10.0, "spin_input": 1}
    unit = fmu("sync_guidance", p, T.states(0) | S | {"L_ref": 20.0, "spin": 0})
    reference = carried.Steering(10.0)
    C_DN = carried.start(S["r_SN_N"] - T.states(0)["r_TN_N"], dcm_of_quaternion(S["q_SN"]))
    for k in range(100):
        t = 0.5 * k
        unit.step(0.5, T.states(t) | S | {"L_ref": 20.0, "spin": float(k == 40)})
        of_H, of_T, C_TN = T.turnings(t)
        W, dW = of_H
        if k >= 40:
            since = t - 20.0
            W, dW = carried.turning(reference, C_DN, since, of_H, of_T, C_TN.T @ np.eye(3)[0])
        expected = carried.reference(C_DN, W, dW, np.array((20.0, 0, 0)))
        for name, value in expected.items():
            assert np.abs(unit.get(name) - value).max() < 1e-8 * max(1, np.abs(value).max()), name
        C_DN = carried.carried_on(C_DN, W, dW, 0.5)


def drift_of_axis(fmu, bias, **changes):
    """Angle off the grasp axis after 600 s if the rate of the target is known with an error that is
    constant in its axes.
    """
    T = Tumbling(np.random.default_rng(5), 600.0, 0.01)
    p = CARRIED | {"J_T": T.J, "use_gravity_gradient": 0, "mu": MU, "sample_period": 0.5}
    p |= {"spin_time": 10.0, "k_steer": 0.06} | changes
    a = dcm_of_quaternion(T.states(0)["q_TN"])[0]
    S = servicer(T.states(0), 20 * a, np.random.default_rng(1))

    def inputs(t):
        now = T.states(t)
        return now | S | {"omega_TN_T": now["omega_TN_T"] + bias, "L_ref": 20.0}

    unit = fmu("sync_guidance", p, inputs(0.0))
    for k in range(1200):
        unit.step(0.5, inputs(0.5 * k))
    a = dcm_of_quaternion(T.states(599.5)["q_TN"])[0]
    return np.arccos(np.clip(-dcm_of_quaternion(unit.get("q_DN"))[0] @ a, -1, 1))


def test_the_integral_removes_the_lag_behind_a_wrong_rate(fmu):
    """Without it the lag is the error across the axis over k_steer: 6.5e-4/0.06 = 0.62 deg."""
    bias = np.array((2e-4, 5e-4, -4e-4))
    lag = np.linalg.norm(bias[1:]) / 0.06
    assert drift_of_axis(fmu, bias) == pytest.approx(lag, rel=0.02)
    assert drift_of_axis(fmu, bias, k_integral=9e-4) < 0.02 * lag


def test_ratios_of_inertia_take_the_place_of_the_inertia(fmu, rng):
    """Twice the inertia has the same ratios; gravity gradient and free motion have the same
    rates.
    """
    T = Tumbling(rng, 1.0, 0.02)
    u = T.states(0.0) | servicer(T.states(0.0), 20 * random_direction(rng), rng) | ratios_of(T.J)
    p = {"use_gravity_gradient": 1, "mu": MU, "range_input": 1}
    right = fmu("sync_guidance", p | {"J_T": 2 * T.J}, u)
    other = fmu("sync_guidance", p | {"use_inertia_hat": 1}, u)
    wrong = fmu("sync_guidance", p, u)
    for name in ("ddrho_ref_N", "alpha_DN_D"):
        assert other.get(name) == pytest.approx(right.get(name), rel=1e-9, abs=1e-15)
        assert np.abs(wrong.get(name) - right.get(name)).max() > 1e-9


def test_rates_and_derivatives_are_central_differences(fmu, rng):
    """1e-6 at 100 Hz of samples, spinning up too: the step from sample to sample is explicit."""
    h = 0.01
    f = simulate(fmu, rng, 20.0, period=h, spin_time=15.0)
    C = np.array([dcm_of_quaternion(q) for q in f["q_DN"]])
    omega = np.array([vee(-dC @ A.T) for dC, A in zip(derivative(C, h), C[2:-2], strict=True)])
    smooth = slice(4, -4)
    assert np.abs(omega - f["omega_DN_D"][2:-2])[smooth].max() < 1e-6
    jumps = np.abs(np.diff(f["alpha_DN_D"], axis=0)).max(axis=1) > 1e-5  # steering at its limit
    calm = ~np.array([jumps[k : k + 4].any() for k in range(len(C) - 4)])
    alpha = derivative(f["omega_DN_D"], h)
    assert np.abs(alpha - f["alpha_DN_D"][2:-2])[calm].max() < 1e-6
    assert np.abs(derivative(f["rho_ref_N"], h) - f["drho_ref_N"][2:-2]).max() < 2e-6
    assert np.abs(derivative(f["drho_ref_N"], h) - f["ddrho_ref_N"][2:-2])[calm].max() < 1e-5


def towards(angle):
    """A start `angle` away from the grasp axis."""

    def rho(T, p_T):
        a = dcm_of_quaternion(T.states(0)["q_TN"]).T @ p_T
        b = cross(a, np.eye(3)[np.argmin(np.abs(a))])
        return 20 * (np.cos(angle) * a + np.sin(angle) * b / np.linalg.norm(b))

    return rho


def off_axis(f, period):
    """Angle of n from the grasp axis at each sample."""
    T, angles = f["T"], []
    for k, q in enumerate(f["q_DN"]):
        a = dcm_of_quaternion(T.states(k * period)["q_TN"]).T @ f["p_T"]
        n = -dcm_of_quaternion(q)[0]
        angles.append(np.arctan2(np.linalg.norm(cross(n, a)), n @ a))
    return np.array(angles)


@pytest.mark.verifies("A.4-4")
@pytest.mark.parametrize("angle", some([0.3, 1.5, 2.8, np.pi], 2, 1))
def test_from_any_direction_it_ends_on_the_axis_without_changing_the_range(fmu, angle):
    """At most w_steer (0.005 rad/s) once T carries it, the rest fades with k_steer."""
    rng, h = np.random.default_rng(7), 0.5
    f = simulate(fmu, rng, 1200.0, h, 0.006, lambda _: (20.0, 0, 0), towards(angle))
    assert np.abs(np.linalg.norm(f["rho_ref_N"], axis=1) - 20).max() < 1e-12 * 20
    found = off_axis(f, h)
    assert found[0] == pytest.approx(angle, abs=1e-7)
    assert found[-1] < 1e-4
    turned = found[120:]  # spinning up has ended
    assert (np.diff(turned)[turned[1:] > 1e-3] <= 0).all()
    assert (np.diff(turned) >= -0.005 * h * 1.01).all()
    late = turned[(turned < 0.1) & (turned > 1e-2)]
    assert np.log(late[1:] / late[:-1]) == pytest.approx(-0.02 * h, rel=0.05)


def test_in_the_end_the_frame_is_fixed_in_the_target(fmu):
    """It turns as the target does, to 1e-7 rad/s, and stays in its axes to 1e-5 rad over 100 s."""
    rng = np.random.default_rng(3)
    f = simulate(fmu, rng, 900.0, rate=0.006, L=lambda _: (20.0, 0, 0), rho=towards(0.5))
    C_DT = [
        dcm_of_quaternion(f["q_DN"][k]) @ dcm_of_quaternion(f["T"].states(k * P)["q_TN"]).T
        for k in (8000, 8999)
    ]
    assert angle_between_attitudes(*C_DT) < 1e-5
    w_T = C_DT[1] @ f["T"].states(899.9)["omega_TN_T"]
    assert f["omega_DN_D"][-1] == pytest.approx(w_T, abs=1e-7)


def test_first_sample_has_the_roll_of_the_servicer(fmu, rng):
    """Z of D is Z of S without its part along the line of sight; looking along Z: its Y axis."""
    T = Tumbling(rng, 1.0).states(0.0)
    for _ in range(3):
        S = servicer(T, 20 * random_direction(rng), rng)
        C_SN = dcm_of_quaternion(S["q_SN"])
        C_DN = dcm_of_quaternion(fmu("sync_guidance", CARRIED, T | S).get("q_DN"))
        rho = (S["r_SN_N"] - T["r_TN_N"]) / 20
        assert C_DN[0] == pytest.approx(-rho, abs=1e-9)
        assert C_DN[1] @ C_SN[2] == pytest.approx(0, abs=1e-9)
        assert C_DN[2] @ C_SN[2] > 0
        S["r_SN_N"] = T["r_TN_N"] + 20 * (C_SN[2] + 0.05 * C_SN[0])
        C_DN = dcm_of_quaternion(fmu("sync_guidance", CARRIED, T | S).get("q_DN"))
        assert C_DN[1] @ C_SN[1] == pytest.approx(0, abs=1e-8)
        assert C_DN[2] @ C_SN[1] > 0


@pytest.mark.verifies("A.4-5")
def test_distance_as_an_input_takes_the_place_of_the_one_of_the_paper(fmu, rng):
    """Frame of the paper, L_ref, dL_ref, ddL_ref of (10): the same outputs, to rounding."""
    T = Tumbling(rng, 1.0).states(0.0)
    S = servicer(T, 20 * random_direction(rng), rng)
    p, t = {"rho_M": 3.0, "rho_0": 17.0, "beta": 0.02}, 12.0
    decay = 14 * np.exp(-0.02 * t)
    L = {"L_ref": 3 + decay, "dL_ref": -0.02 * decay, "ddL_ref": 4e-4 * decay}
    one = fmu("sync_guidance", p, T | S, t)
    other = fmu("sync_guidance", p | {"range_input": 1}, T | S | L, t)
    for name in ("rho_ref_N", "drho_ref_N", "ddrho_ref_N", "q_DN", "alpha_DN_D"):
        assert one.get(name) == pytest.approx(other.get(name), rel=1e-13, abs=1e-14), name


def test_the_model_of_the_target_knows_no_disturbance(fmu, rng):
    """know_M_dist counts in the frame of the paper only; gravity gradient counts in both."""
    T = Tumbling(rng, 1.0, 0.02).states(0.0)
    u = T | servicer(T, 20 * random_direction(rng), rng)
    known = CARRIED | {"know_M_dist": 1, "M_dist_T": {"bias": (1, 2, 3)}}
    one, other = (fmu("sync_guidance", p | {"spin_time": 0.01}, u) for p in (CARRIED, known))
    for unit in (one, other):
        unit.step(1.0)
        unit.step(1.0)
    assert one.get("alpha_DN_D").tolist() == other.get("alpha_DN_D").tolist()


@pytest.mark.verifies("A.4-7")
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"frame": 1}, "frame = 1: needs range_input = 1"),
        (CARRIED | {"spin_time": 0}, "spin_time = 0: must be > 0"),
        (CARRIED | {"k_steer": -1}, "k_steer = -1: must be >= 0"),
        (CARRIED | {"k_integral": -1}, "k_integral = -1: must be >= 0"),
        ({"steer_input": 1}, "steer_input = 1: needs frame = 1"),
        ({"spin_input": 1}, "spin_input = 1: needs frame = 1"),
        (
            {"use_inertia_hat": 1, "know_M_dist": 1},
            "know_M_dist = 1: needs use_inertia_hat = 0: inertia_hat has no unit",
        ),
    ],
)
def test_rejected(change, words, tmp_path):
    assert words in rejection("sync_guidance", change, tmp_path)
