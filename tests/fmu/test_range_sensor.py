# SPDX-License-Identifier: BSD-2-Clause
"""range_sensor.fmu: distance, noise by range, bias by seed, limits, drop-outs, latency."""

from __future__ import annotations

import numpy as np
import pytest

from tests.reference.random_numbers import normals, uniforms

from .driver import bits
from .rejections import rejection
from .sensor_cases import same_bits_for_any_steps, unit_vector

P, STREAM = 0.5, 5
PROMPT = {"latency": 0}


def apart(rng, R):
    r_SN_N = 7e6 * unit_vector(rng)
    return {"r_SN_N": r_SN_N, "r_TN_N": r_SN_N + R * unit_vector(rng)}


def rows(unit, inputs, count, h=P):
    found = []
    for _ in range(count):
        unit.step(h, inputs)
        found.append(unit.outputs())
    return found


@pytest.mark.parametrize("R", [0.7, 20.0, 4000.0])
def test_range_is_distance_bias_and_noise_that_grows_with_it(fmu, rng, R):
    """2e-9 m: rounding of positions of 7e6 m."""
    unit = fmu("range_sensor", PROMPT | {"seed": 7, "bias_0": -0.3})
    for n, row in enumerate(rows(unit, apart(rng, R), 20)):
        z = normals(7, STREAM, n, 1)[0]
        assert row["range_meas"] == pytest.approx(R - 0.3 + (0.1 + 1e-3 * R) * z, abs=2e-9)
        assert (row["range_time"], row["range_valid"]) == (n * P, 1)


def test_noise_has_its_moments_and_no_memory(fmu, rng):
    """Of 4000 ranges: mean, deviation and correlation of neighbours within 4 standard errors."""
    R, count = 50.0, 4000
    found = rows(fmu("range_sensor", PROMPT | {"sample_period": 0.1}), apart(rng, R), count, 0.1)
    z = (np.array([row["range_meas"] for row in found]) - R) / 0.15
    assert abs(z.mean()) < 4 / np.sqrt(count)
    assert abs(z.std() - 1) < 4 / np.sqrt(2 * count)
    assert abs(np.mean(z[1:] * z[:-1])) < 4 / np.sqrt(count)


def test_bias_is_drawn_once_per_run_by_the_seed(fmu, rng):
    inputs = apart(rng, 20.0)
    silent = PROMPT | {"sigma_range_0": 0, "sigma_range_1": 0, "bias_0": 0.5, "sigma_bias_0": 2}
    biases = []
    for seed in range(40):
        found = rows(fmu("range_sensor", silent | {"seed": seed}), inputs, 3)
        values = [row["range_meas"] for row in found]
        assert len(set(values)) == 1
        expected = 0.5 + 2 * normals(seed, STREAM, 0, 1, once=True)[0]
        assert values[0] - 20 == pytest.approx(expected, abs=2e-9)
        biases.append(expected)
    assert 1.3 < np.std(biases) < 2.7


@pytest.mark.parametrize(
    ("R", "parameters", "valid"),
    [
        (0.5 - 1e-6, {}, 0),
        (0.5 + 1e-6, {}, 1),
        (5000 - 1e-6, {}, 1),
        (5000 + 1e-6, {}, 0),
        (20, {"outage_duration": 1}, 0),
        (20, {"p_drop": 1}, 0),
    ],
)
def test_no_range_out_of_limits_in_an_outage_or_dropped(fmu, rng, R, parameters, valid):
    row = rows(fmu("range_sensor", PROMPT | parameters), apart(rng, R), 1)[0]
    assert (row["range_time"], row["range_valid"]) == (0, valid)
    assert (row["range_meas"] != 0) == valid


def test_drop_outs_and_outages_leave_time_and_zero(fmu, rng):
    p = PROMPT | {"outage_start": 3, "outage_duration": 2, "p_drop": 0.3, "seed": 1}
    valid = []
    for n, row in enumerate(rows(fmu("range_sensor", p), apart(rng, 20), 60)):
        gone = 3 <= n * P < 5 or uniforms(1, STREAM, n, 7)[6] < 0.3
        valid.append(not gone)
        assert (row["range_valid"], row["range_time"]) == (not gone, n * P)
        assert (row["range_meas"] == 0) == gone
    assert 25 < sum(valid) < 50


@pytest.mark.parametrize("latency", [0, 0.05, 0.1, 0.5, 1.2, 3.5])
def test_range_is_released_after_its_latency_and_matches_its_time(fmu, latency):
    """At the end of the step to t: the newest sample with n P + latency < t; the target recedes by
    2 m/s, so that the value shows when it was taken.
    """
    silent = {"latency": latency, "sigma_range_0": 0, "sigma_range_1": 0}
    unit, h = fmu("range_sensor", silent), 0.05
    for k in range(1, 150):
        unit.step(h, {"r_TN_N": (10 + 2 * (k - 1) * h, 0, 0)})
        n = int(np.ceil(np.round((k * h - latency) / P, 9))) - 1
        row = unit.outputs()
        assert row["range_time"] == (n * P if n >= 0 else -1), k * h
        assert row["range_meas"] == pytest.approx(10 + 2 * n * P if n >= 0 else 0, abs=1e-9)


def test_nothing_before_the_first_sample(fmu):
    assert list(fmu("range_sensor").outputs().values()) == [0, -1, 0]


def test_same_bits_for_any_steps(fmu, rng):
    assert same_bits_for_any_steps(fmu, "range_sensor", {"latency": 0.6}, apart(rng, 20))


def test_same_bits_by_seed_and_other_ones_by_another(fmu, rng):
    inputs = apart(rng, 20)
    a, b, c = (fmu("range_sensor", {"seed": seed}) for seed in (1, 1, 2))
    for unit in (a, b, c):
        rows(unit, inputs, 5)
    assert bits(a) == bits(b) != bits(c)


def test_rejected_with_the_rule(tmp_path):
    bad = {"p_drop": 1.5, "sigma_range_0": -1, "latency": 4, "range_min": 6000}
    text = rejection("range_sensor", bad, tmp_path)
    assert "p_drop = 1.5: must be in [0, 1]" in text
    assert "sigma_range_0 = -1: must be >= 0" in text
    assert "latency = 4: must be at most 7 sample periods" in text
    assert "range_max = 5000: must be above range_min" in text
