# SPDX-License-Identifier: BSD-2-Clause
"""gyro.fmu: increments are the true turn, random walks have the slopes of Allan's deviation, the
residue of the rounding is carried on.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.close import close
from tests.reference.attitude import multiply
from tests.reference.cases import quaternion
from tests.reference.kalman import turn
from tests.reference.random_numbers import normals

from .rejections import rejection
from .sensor_cases import same_bits_for_any_steps, turn_between

T = 0.1
QUIET = {"sigma_v": 0, "sigma_u": 0, "bias_0": [0, 0, 0]}


def attitudes(rng, count, size=0.05):
    """A tumbling servicer: attitude at every sample, and the turns between them."""
    q, steps = quaternion(rng), size * rng.normal(size=(count - 1, 3))
    history = [q]
    for phi in steps:
        history.append(multiply(history[-1], turn(phi)))
    return np.array(history), steps


def increments(unit, history, h=T):
    rows = []
    for q in history:
        unit.step(h, {"q_SN": q})
        rows.append(unit.get("dtheta_S"))
    return np.array(rows)


def test_increments_are_the_turns_between_samples(fmu, rng):
    """For either sign of the quaternion; turns of up to 3 rad."""
    history, steps = attitudes(rng, 40, 0.8)
    steps_inside = np.linalg.norm(steps, axis=1) < np.pi
    signs = rng.choice([-1, 1], len(history))[:, None]
    measured = increments(fmu("gyro", QUIET), signs * history)[1:]
    assert np.count_nonzero(steps_inside) > 30
    close(measured[steps_inside], steps[steps_inside], rel=1e-14)


def test_first_sample_only_takes_the_attitude(fmu, rng):
    unit = fmu("gyro")
    assert (unit.get("gyro_time"), unit.get("gyro_valid")) == (-1, 0)
    unit.step(T, {"q_SN": quaternion(rng)})
    assert (unit.get("gyro_time"), unit.get("gyro_valid")) == (0, 0)
    assert not unit.get("dtheta_S").any()
    unit.step(T, {"q_SN": quaternion(rng)})
    assert (unit.get("gyro_time"), unit.get("gyro_valid")) == (T, 1)


@pytest.mark.parametrize("per_period", [1, 2, 5])
def test_sum_of_increments_is_the_true_turn(fmu, per_period):
    """Turn about one axis at a varying rate, 1e-12 rad; macro steps that divide the period."""
    axis, h = np.array((2, -1, 2)) / 3, T / per_period
    angles = [2 * np.sin(0.03 * k * h) + 0.02 * k * h for k in range(400 * per_period)]
    unit, total = fmu("gyro", QUIET), np.zeros(3)
    for k, angle in enumerate(angles):
        unit.step(h, {"q_SN": turn(angle * axis)})
        if k % per_period == 0:
            total += unit.get("dtheta_S")
    last = angles[(len(angles) - 1) // per_period * per_period]
    assert total == pytest.approx((last - angles[0]) * axis, abs=1e-12)


def test_coning_inside_a_period_is_in_the_increment(fmu):
    """Attitude by the increments alone stays the true one on a coning motion sampled at 10 Hz:
    body rates integrated instead would drift 8e-3 rad.
    """
    unit, q = fmu("gyro", QUIET), None
    for k in range(600):
        t = k * T
        true = turn(0.1 * np.array((np.cos(6 * t), np.sin(6 * t), 0)))
        unit.step(T, {"q_SN": true})
        q = true if q is None else multiply(q, turn(unit.get("dtheta_S")))
    assert turn_between(q, true) < 1e-12


def test_noise_and_bias_match_the_reference(fmu, rng):
    """m = (I + M) phi + P (b + b+)/2 + white noise: half of the bias step in its first period."""
    p = {
        "sigma_v": 1e-3,
        "sigma_u": 2e-3,
        "bias_0": rng.normal(size=3),
        "sigma_bias_0": [0.1, 0.2, 0.3],
        "misalignment": 0.01 * rng.normal(size=(3, 3)),
        "seed": 3,
    }
    history, steps = attitudes(rng, 30)
    unit = fmu("gyro", p)
    b = p["bias_0"] + p["sigma_bias_0"] * normals(3, 2, 0, 3, once=1)
    assert unit.get("bias_S") == pytest.approx(b, rel=1e-14)
    measured = increments(unit, history)[1:]
    for n, (m, phi) in enumerate(zip(measured, steps, strict=True), start=1):
        z = normals(3, 2, n, 6)
        after = b + p["sigma_u"] * np.sqrt(T) * z[3:]
        white = np.sqrt(p["sigma_v"] ** 2 * T + p["sigma_u"] ** 2 * T**3 / 12) * z[:3]
        expected = phi + p["misalignment"] @ phi + T * (b + after) / 2 + white
        assert m == pytest.approx(expected, abs=1e-14)
        b = after
    assert unit.get("bias_S") == pytest.approx(b, rel=1e-13)


def test_rounding_never_loses_more_than_half_a_quantum(fmu, rng):
    history, steps = attitudes(rng, 200, 0.01)
    quantum = 3e-4
    measured = increments(fmu("gyro", QUIET | {"quantum": quantum}), history)[1:]
    assert np.abs(measured / quantum - np.round(measured / quantum)).max() < 1e-9
    assert np.abs(np.cumsum(measured - steps, axis=0)).max() <= quantum / 2 * (1 + 1e-9)
    assert np.abs(measured - steps).max() > 0.4 * quantum


def allan(rate, m):
    """Allan deviation of rates sampled at T, for an averaging time m T (overlapping)."""
    angle = np.concatenate((np.zeros((1, 3)), np.cumsum(rate, axis=0))) * T
    second = angle[2 * m :] - 2 * angle[m:-m] + angle[: -2 * m]
    return np.sqrt(np.mean(second**2, axis=0) / 2) / (m * T)


def rates_at_rest(unit, count):
    """Increments of a body at rest, one raw call per sample."""
    references, slave = unit.kind.references["dtheta_S"], unit.slave
    rows = np.empty((count, 3))
    for n in range(count):
        slave.doStep(n * T, T)
        rows[n] = slave.getReal(references)
    return rows[1:] / T


def test_allan_deviation_at_short_times_is_angle_random_walk(fmu):
    """sigma_v/sqrt(tau), 5 %; 2e4 samples of three axes."""
    rate = rates_at_rest(fmu("gyro", {"sigma_v": 1e-3, "sigma_u": 0}), 20_000)
    for m in (1, 4, 10):
        assert np.sqrt(np.mean(allan(rate, m) ** 2)) == pytest.approx(
            1e-3 / np.sqrt(m * T), rel=0.05
        )


def test_rate_random_walk_grows_at_once_as_a_bias(fmu):
    """Steps of the bias: sigma_u sqrt(P), 3 %; Allan deviation sigma_u sqrt(tau/3) at tau of ten
    periods and more, 15 %.
    """
    rate = rates_at_rest(fmu("gyro", {"sigma_v": 0, "sigma_u": 1e-3, "bias_0": [0, 0, 0]}), 20_000)
    for m in (10, 30):
        assert np.sqrt(np.mean(allan(rate, m) ** 2)) == pytest.approx(
            1e-3 * np.sqrt(m * T / 3), rel=0.15
        )


@pytest.mark.long
def test_allan_deviation_has_both_slopes(fmu):
    """2e5 samples with both noises: 5 % at short, 15 % at long averaging times."""
    v, u = 1e-3, 1e-4
    rate = rates_at_rest(fmu("gyro", {"sigma_v": v, "sigma_u": u}), 200_000)
    for m in (1, 5, 10):
        tau = m * T
        assert allan(rate, m) == pytest.approx(v / np.sqrt(tau), rel=0.05)
    for m in (2000, 4000):
        tau = m * T
        both = np.sqrt(v**2 / tau + u**2 * tau / 3)
        assert np.sqrt(np.mean(allan(rate, m) ** 2)) == pytest.approx(both, rel=0.15)


def test_same_bits_for_any_steps(fmu, rng):
    """A body at rest; the increment is of the last period alone."""
    assert same_bits_for_any_steps(fmu, "gyro", {"sigma_u": 1e-3}, {"q_SN": quaternion(rng)})


@pytest.mark.parametrize("name", ["sigma_v", "sigma_u", "quantum"])
def test_negative_values_are_rejected(name, tmp_path):
    assert f"{name} = -1: must be >= 0" in rejection("gyro", {name: -1}, tmp_path)
