# SPDX-License-Identifier: BSD-2-Clause
"""stack_guidance.fmu: profile, its derivatives, the torque it needs, unloading, rest."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from tests.close import close

from .driver import bits
from .rejections import rejection

J, A = np.diag((300.0, 550, 390)), np.diag((12.0, 15, 10))
PERIOD = 0.1
LIMITS = 0.5 * 0.01 * np.diag(A)


def quaternion(turn):
    q = np.roll(turn.as_quat(), 1)
    return q if q[0] >= 0 else -q


def turn_of(q):
    return Rotation.from_quat(np.roll(q, -1))


def inputs(rng, omega, wheel_speed=(0, 0, 0), active=1):
    values = {f"{x}_{b}N_N": 7e6 * rng.normal(size=3) for x in "rv" for b in "ST"}
    return values | {
        "q_SN": quaternion(Rotation.random(random_state=rng)),
        "omega_SN_S": omega,
        "wheel_speed": wheel_speed,
        "active": active,
    }


def begun(fmu, u, **parameters):
    """Guidance after its first active sample, at 0."""
    unit = fmu("stack_guidance", {"sample_period": PERIOD} | parameters, u)
    unit.step(PERIOD, u)
    return unit


def fade(x):
    """Part of the rate that is left: 1 - (10 x^3 - 15 x^4 + 6 x^5)."""
    return 1 - np.polyval((6, -15, 10, 0, 0, 0), np.clip(x, 0, 1))


def duration(w, Omega, J=J, A=A, share=0.5, accel=0.01, least=60.0):
    spin = J @ w
    lim = share * accel * np.diag(A)
    g = np.abs(np.cross(w, spin + A @ Omega))
    return max(least, 1.875 * np.max(np.abs(spin) / np.maximum(lim - g, 0.1 * lim)))


@pytest.mark.verifies("I.6-1")
@pytest.mark.parametrize("size", [1e-13, 1e-3, 5e-3, 0.02])
def test_attitude_is_the_integral_of_the_rate_and_the_rate_the_one_of_the_acceleration(
    fmu, rng, size
):
    """Quadrature of the rate about its fixed axis, and of the acceleration."""
    w = size * rng.normal(size=3)
    Omega = rng.uniform(-0.1, 0.1, 3)
    u = inputs(rng, w, Omega)
    unit = begun(fmu, u)
    T = duration(w, Omega)
    assert unit.get("duration") == pytest.approx(T, rel=1e-13)
    other = inputs(rng, rng.normal(size=3))  # nothing that comes later changes the profile
    for k in range(1, 6):
        t = round(k * T / 5.5 / PERIOD) * PERIOD
        unit.step(t + PERIOD - unit.time, other)
        x = t / T
        angle = np.linalg.norm(w) * T * quad(fade, 0, x, epsabs=1e-15)[0]
        turned = turn_of(u["q_SN"]) * Rotation.from_rotvec(angle * w / np.linalg.norm(w))
        assert np.allclose(unit.get("q_DN"), quaternion(turned), atol=1e-12)
        close(unit.get("omega_DN_D"), fade(x) * w, rel=1e-12, of=size)
        lost = quad(lambda s: 30 * s**2 * (1 - s) ** 2, 0, x, epsabs=1e-15)[0]
        assert np.allclose(unit.get("omega_DN_D"), (1 - lost) * w, atol=1e-12 * size)
        assert np.allclose(unit.get("alpha_DN_D"), -30 * x**2 * (1 - x) ** 2 * w / T, rtol=1e-10)
        assert unit.get("progress") == pytest.approx(x, abs=1e-12)
        assert unit.get("done") == 0


@pytest.mark.verifies("I.6-1")
def test_rate_and_acceleration_are_the_differences_of_attitude_and_rate(fmu, rng):
    w = 0.01 * rng.normal(size=3)
    u, h = inputs(rng, w), 0.1
    unit = begun(fmu, u)
    rows = []
    for _ in range(400):
        unit.step(h, u)
        rows.append([unit.get(n) for n in ("q_DN", "omega_DN_D", "alpha_DN_D")])
    for k in range(2, 398, 37):
        turns = [turn_of(rows[k + i][0]) for i in (-1, 1)]
        rate = (turns[0].inv() * turns[1]).as_rotvec() / (2 * h)
        assert np.allclose(rate, rows[k][1], atol=1e-8)
        assert np.allclose((rows[k + 1][1] - rows[k - 1][1]) / (2 * h), rows[k][2], atol=1e-8)


@pytest.mark.verifies("I.6-3")
def test_in_the_end_the_reference_rests(fmu, rng):
    w = 0.004 * rng.normal(size=3)
    u = inputs(rng, w)
    unit = begun(fmu, u)
    T = duration(w, np.zeros(3))
    for at in (T - 2 * PERIOD, T + PERIOD, 3 * T):
        unit.step(at - unit.time, u)
        assert unit.get("done") == (at > T)
    assert not np.any(unit.get("omega_DN_D")) and not np.any(unit.get("alpha_DN_D"))
    end = turn_of(u["q_SN"]) * Rotation.from_rotvec(w * T / 2)
    assert np.allclose(unit.get("q_DN"), quaternion(end), atol=1e-13)


@pytest.mark.verifies("I.6-2")
def test_wheel_torque_along_the_profile_retains_within_its_share(fmu, rng):
    """A_w dOmega = -(J alpha + w x H), wheels from rest: total momentum constant in N."""
    w = rng.normal(size=3)
    w *= 0.006 / np.linalg.norm(w)
    T = duration(w, np.zeros(3))
    for x in np.linspace(0, 1, 200):
        rate, alpha = fade(x) * w, -30 * x**2 * (1 - x) ** 2 * w / T
        angle = np.linalg.norm(w) * T * (x - 5 * x**4 / 2 + 3 * x**5 - x**6)
        H = Rotation.from_rotvec(angle * w / np.linalg.norm(w)).inv().apply(J @ w)
        assert np.all(np.abs(J @ alpha + np.cross(rate, H)) <= LIMITS * (1 + 1e-12))
    unit = begun(fmu, inputs(rng, w))
    assert unit.get("duration") == pytest.approx(T, rel=1e-13) and T > 60


def test_reference_position_is_the_present_one_and_momentum_the_one_of_stack_and_wheels(fmu, rng):
    w, Omega = 0.01 * rng.normal(size=3), rng.normal(size=3)
    u = inputs(rng, w, Omega)
    unit = begun(fmu, u)
    assert np.array_equal(unit.get("rho_ref_N"), u["r_SN_N"] - u["r_TN_N"])
    assert np.array_equal(unit.get("drho_ref_N"), u["v_SN_N"] - u["v_TN_N"])
    assert not np.any(unit.get("ddrho_ref_N"))
    assert np.allclose(unit.get("momentum_S"), J @ w + A @ Omega, rtol=1e-14)


# ---- unloading


@pytest.mark.verifies("I.6-4")
def test_unloading_begins_and_ends_at_its_thresholds_and_is_cut_per_axis(fmu, rng):
    ref = np.array((0.02, -0.01, 0.03))
    unit = begun(fmu, inputs(rng, (0, 0, 0), ref), wheel_speed_ref=ref)
    seen = []
    for X in (0.69, 0.71, 0.3, 0.11, 0.09, 0.69, 0.7 + 1e-12, 0.1 - 1e-12):
        excess = np.array((0.4 * X, -X, 0.2 * X)) * 0.3
        unit.step(PERIOD, inputs(rng, (0, 0, 0), ref + excess))
        seen.append(unit.get("unloading"))
        required = np.clip(-0.02 * A @ excess, -0.05, 0.05) if seen[-1] else np.zeros(3)
        assert np.allclose(unit.get("M_unload_S"), required, atol=1e-16)
    assert seen == [0, 1, 1, 1, 0, 0, 1, 0]


def test_a_limit_of_zero_is_no_torque(fmu, rng):
    unit = begun(fmu, inputs(rng, (0, 0, 0), (0.3, 0, 0)), M_unload_max=0)
    assert unit.get("unloading") == 1 and not np.any(unit.get("M_unload_S"))


def test_unloaded_momentum_leaves_stack_and_wheels_together(fmu, rng):
    """Wheels that take up M_unload by A_w^-1 M: their momentum and the impulse add up to what was
    there, and the largest speed falls below unload_off.
    """
    Omega = np.array((0.25, -0.1, 0.05))
    unit = begun(fmu, inputs(rng, (0, 0, 0), Omega))
    impulse, before = np.zeros(3), A @ Omega
    for _ in range(4000):
        M = unit.get("M_unload_S")
        Omega = Omega + np.linalg.solve(A, M) * PERIOD
        impulse += M * PERIOD
        unit.step(PERIOD, inputs(rng, (0, 0, 0), Omega))
    assert np.allclose(A @ Omega - impulse, before, atol=1e-9)
    assert 0.05 < np.max(np.abs(Omega)) / 0.3 <= 0.1
    assert unit.get("unloading") == 0


# ---- rest


@pytest.mark.verifies("I.6-5")
def test_at_rest_it_shows_what_a_first_sample_would_and_retains_nothing(fmu, rng):
    unit = begun(fmu, inputs(rng, 0.01 * rng.normal(size=3), (0.29, 0, 0)))
    assert unit.get("unloading") == 1
    unit.step(10, inputs(rng, 0.01 * rng.normal(size=3)))
    w = 0.01 * rng.normal(size=3)
    idle = inputs(rng, w, (0.29, 0, 0), active=0)
    unit.step(PERIOD, idle)
    assert not np.any(unit.get("M_unload_S")) and unit.get("unloading") == 0
    assert unit.get("progress") == unit.get("done") == 0
    assert np.array_equal(unit.get("omega_DN_D"), w)
    assert np.allclose(unit.get("q_DN"), idle["q_SN"], atol=1e-15)
    assert unit.get("duration") == pytest.approx(duration(w, np.array((0.29, 0, 0))), rel=1e-13)
    start = round(unit.time / PERIOD)
    now = inputs(rng, 0.01 * rng.normal(size=3), (0.2, 0, 0))
    fresh = fmu("stack_guidance", {"sample_period": PERIOD}, now, start * PERIOD)
    for k in range(start, start + 5):
        for each in (unit, fresh):
            each.time = k * PERIOD
            each.step(PERIOD, now)
        assert bits(unit) == bits(fresh)


@pytest.mark.verifies("I.6-5")
def test_nothing_is_retained_from_initialization(fmu, rng):
    """Inputs may be anything while start values travel through a system."""
    unit = fmu("stack_guidance", {"sample_period": PERIOD}, inputs(rng, (1, 2, 3), (0.3, 0, 0)))
    assert unit.get("unloading") == 0 and not np.any(unit.get("M_unload_S"))
    now = inputs(rng, (1e-3, 0, 0))
    unit.step(PERIOD, now)
    assert np.array_equal(unit.get("omega_DN_D"), (1e-3, 0, 0))


@pytest.mark.verifies("I.6-6")
@pytest.mark.parametrize(
    ("parameters", "name"),
    [
        ({"J_stack": np.diag((1, 1, 3))}, "J_stack"),
        ({"A_w": np.diag((1, 0, 3))}, "A_w"),
        ({"unload_on": 0.1, "unload_off": 0.2}, "unload_off"),
        ({"wheel_accel_max": 0}, "wheel_accel_max"),
        ({"wheel_speed_max": 0}, "wheel_speed_max"),
        ({"torque_share": 0}, "torque_share"),
        ({"duration_min": 0}, "duration_min"),
        ({"k_unload": -1}, "k_unload"),
        ({"M_unload_max": -1}, "M_unload_max"),
    ],
)
def test_bad_parameters_are_rejected(tmp_path, parameters, name):
    assert name in rejection("stack_guidance", parameters, tmp_path)
