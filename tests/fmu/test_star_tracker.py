# SPDX-License-Identifier: BSD-2-Clause
"""star_tracker.fmu: noise in the axes of the tracker, what makes it blind, the grid of samples."""

from __future__ import annotations

import numpy as np
import pytest

from tests.close import close
from tests.reference.attitude import conjugate, dcm, multiply
from tests.reference.cases import quaternion
from tests.reference.kalman import err, rot
from tests.reference.random_numbers import normals, uniforms

from .rejections import rejection
from .sensor_cases import same_bits_for_any_steps, turn_between, unit_vector

P = 0.5
SIGMA = np.array((1.94e-4, 2.9e-5, 2.9e-5))


def sampled(unit, inputs, count=1, h=P):
    rows = []
    for _ in range(count):
        unit.step(h, inputs)
        rows.append(unit.outputs())
    return rows


def test_measurement_is_truth_times_mounting_times_noise(fmu, rng):
    """Noise by the independent generator, on the right, in A axes."""
    q_SN, q_AS = quaternion(rng), quaternion(rng)
    unit = fmu("star_tracker", {"q_AS": q_AS, "seed": 5, "sigma_A": 100 * SIGMA})
    for n, row in enumerate(sampled(unit, {"q_SN": q_SN}, 5)):
        noise = 100 * SIGMA * normals(5, 1, n, 3)
        expected = multiply(multiply(q_SN, q_AS), rot(noise))
        assert turn_between(row["q_AN"], expected) < 1e-14
        assert row["q_AN"][0] >= 0
        assert (row["star_time"], row["star_valid"]) == (n * P, 1)
        error = err(multiply(conjugate(multiply(q_SN, q_AS)), row["q_AN"]))
        close(error, noise, rel=1e-14, of=1)  # of the quaternions


def test_noise_has_its_standard_deviation_about_each_axis(fmu):
    """3000 samples: 4 % is three standard deviations of the estimate."""
    rows = sampled(fmu("star_tracker"), {"q_SN": [1, 0, 0, 0]}, 3000)
    a = np.array([err(row["q_AN"]) for row in rows])
    assert a.std(axis=0) == pytest.approx(SIGMA, rel=0.04)
    assert np.abs(a.mean(axis=0)) == pytest.approx(0, abs=4 * SIGMA.max() / np.sqrt(3000))


def test_no_measurement_before_the_first_sample(fmu):
    unit = fmu("star_tracker")
    assert (unit.get("star_time"), unit.get("star_valid")) == (-1, 0)
    assert unit.get("q_AN").tolist() == [1, 0, 0, 0]


def blank(row, time):
    return (
        row["star_valid"] == 0 and row["star_time"] == time and row["q_AN"].tolist() == [1, 0, 0, 0]
    )


@pytest.mark.parametrize(("rate", "blind"), [(0.0499999, False), (0.0500001, True)])
def test_fast_turns_blind(fmu, rng, rate, blind):
    row = sampled(fmu("star_tracker"), {"omega_SN_S": rate * unit_vector(rng)})[0]
    assert blank(row, 0.0) == blind


@pytest.mark.parametrize(("offset", "blind"), [(-1e-6, True), (1e-6, False)])
def test_sun_within_the_cone_about_plus_x_of_the_tracker_blinds(fmu, rng, offset, blind):
    """Boresight in N axes is the first row of C_AN; the Sun is a little in or out of the cone."""
    q_SN, q_AS, cone = quaternion(rng), quaternion(rng), 0.6
    boresight, across = dcm(multiply(q_SN, q_AS))[:2]
    sun = np.cos(cone + offset) * boresight + np.sin(cone + offset) * across
    unit = fmu("star_tracker", {"q_AS": q_AS, "sun_N": sun, "sun_cone": cone})
    assert blank(sampled(unit, {"q_SN": q_SN})[0], 0.0) == blind


def test_outage_lasts_from_its_start_until_before_its_end(fmu):
    unit = fmu("star_tracker", {"outage_start": 1.0, "outage_duration": 1.5})
    valid = [row["star_valid"] for row in sampled(unit, {}, 8)]
    assert valid == [1, 1, 0, 0, 0, 1, 1, 1]


def test_drop_outs_match_the_fourth_draw_and_shift_no_other(fmu):
    """The same noise with and without drop-outs: draws have fixed places."""
    full = sampled(fmu("star_tracker"), {}, 60)
    some = sampled(fmu("star_tracker", {"p_drop": 0.3}), {}, 60)
    dropped = [bool(uniforms(0, 1, n, 4)[3] < 0.3) for n in range(60)]
    assert 8 < sum(dropped) < 30
    for n, gone in enumerate(dropped):
        assert blank(some[n], n * P) if gone else (some[n]["q_AN"] == full[n]["q_AN"]).all()


def test_same_bits_for_any_steps(fmu, rng):
    assert same_bits_for_any_steps(fmu, "star_tracker", {}, {"q_SN": quaternion(rng)})


@pytest.mark.parametrize(
    ("parameters", "rule"),
    [
        ({"q_AS": [0, 0, 0, 0]}, "|q_AS| = 0: must be a unit quaternion"),
        ({"q_AS": [1, 0, 1e-4, 0]}, "must be a unit quaternion"),
        ({"sun_N": [1, 1, 0]}, "|sun_N| = 1.41421356: must be a unit vector"),
        ({"p_drop": 1.1}, "p_drop = 1.1: must be in [0, 1]"),
        ({"sigma_A": [1e-4, -1e-4, 0]}, "sigma_A[2] = -0.0001: must be >= 0"),
    ],
)
def test_rejected_with_the_rule(parameters, rule, tmp_path):
    assert rule in rejection("star_tracker", parameters, tmp_path)
