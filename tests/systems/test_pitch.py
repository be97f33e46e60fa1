# SPDX-License-Identifier: BSD-2-Clause
"""Strobe points and spectrum of motions known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from harness.mission import Limits
from harness.results.result import Result
from ssp.space_robot.pitch import METRICS, orbits, rotation_number, spectrum, strobe

RATE = 0.01
"""Rate of the true anomaly [rad/s]."""


def motion(pitch, turns=20.5, start=0.3):
    """A result of pitch(nu) on a circular orbit, 2000 rows per orbit."""
    nu = start + np.linspace(0, 2 * np.pi * turns, round(2000 * turns) + 1)
    time = (nu - start) / RATE
    angle = pitch(nu)
    values = np.stack([angle, np.gradient(angle, time), nu], axis=1)
    names = ("robot.pitch", "robot.pitch_rate", "robot.true_anomaly")
    return Result("test", time, names, ("rad", "rad/s", "rad"), values)


def test_a_motion_with_the_period_of_the_orbit_is_one_point():
    result = motion(lambda nu: 0.2 + 0.1 * np.sin(nu))
    pitch, rate = strobe(result)
    assert len(pitch) == 21
    assert pitch == pytest.approx(0.2 + 0.1 * np.sin(0.3), abs=1e-6)
    assert rate[1:-1] == pytest.approx(0.1 * np.cos(0.3), abs=1e-5)


def test_a_motion_of_two_periods_is_a_closed_curve():
    """Frequency 0.8: five points, for it repeats after five orbits."""
    pitch, _ = strobe(motion(lambda nu: 0.3 * np.sin(0.8 * (nu - 0.3))))
    assert pitch[:5] == pytest.approx(0.3 * np.sin(0.8 * 2 * np.pi * np.arange(5)), abs=1e-6)
    assert pitch[5:10] == pytest.approx(pitch[:5], abs=1e-6)


def test_tumbling_pitch_is_brought_back_into_one_turn():
    pitch, rate = strobe(motion(lambda nu: 1.25 * nu))
    assert np.all((pitch >= -np.pi) & (pitch < np.pi))
    assert np.diff(np.unwrap(pitch)) == pytest.approx(np.pi / 2, abs=1e-6)
    assert rate == pytest.approx(1.25, rel=1e-6)


def kepler(e, t, n):
    """True anomaly on an eccentric orbit, unwrapped; perigee at t = 0."""
    mean = n * t
    eccentric = mean + e * np.sin(mean)
    for _ in range(20):
        eccentric -= (eccentric - e * np.sin(eccentric) - mean) / (1 - e * np.cos(eccentric))
    beta = e / (1 + np.sqrt(1 - e * e))
    return eccentric + 2 * np.arctan2(beta * np.sin(eccentric), 1 - beta * np.cos(eccentric))


def test_strobe_points_are_at_the_exact_anomaly_of_an_eccentric_orbit_between_the_rows():
    """97 rows per orbit, none of them at perigee again; the nearest is off by up to 0.02 rad."""
    e, n, w = 0.1, 2 * np.pi / 5828.0, 0.8
    time = np.linspace(0, 30 * 5828.0, 30 * 97 + 31)[:-17]
    nu = kepler(e, time, n)
    nu_rate = n * (1 + e * np.cos(nu)) ** 2 / (1 - e * e) ** 1.5
    values = np.stack([0.3 * np.sin(w * nu), 0.3 * w * np.cos(w * nu) * nu_rate, nu], axis=1)
    names = ("robot.pitch", "robot.pitch_rate", "robot.true_anomaly")
    pitch, rate = strobe(Result("test", time, names, ("rad", "rad/s", "rad"), values))
    at = 2 * np.pi * w * np.arange(30)
    assert pitch == pytest.approx(0.3 * np.sin(at), abs=3e-7)
    assert rate == pytest.approx(0.3 * w * np.cos(at), abs=3e-6)


def test_the_rotation_number_is_the_frequency_less_whole_turns():
    for frequency in (0.83, 1.27):
        result = motion(lambda nu, f=frequency: 0.1 + 0.2 * np.sin(f * nu), turns=400)
        assert rotation_number(result) == pytest.approx(frequency % 1, abs=2e-3)


def test_the_swing_is_the_range_of_the_pitch():
    (swing,) = (metric for metric in METRICS if metric.name == "pitch swing")
    found = swing(motion(lambda nu: 0.2 + 0.5 * np.sin(nu)), Limits())
    assert found == pytest.approx(np.degrees(1.0), rel=1e-5)


def test_the_spectrum_has_the_lines_of_the_motion_with_their_amplitudes():
    result = motion(lambda nu: 0.5 + 0.3 * np.sin(0.8 * nu) + 0.05 * np.cos(2 * nu), turns=50)
    frequency, amplitude = spectrum(result)
    assert orbits(result) == pytest.approx(50)
    for line, size in ((0.8, 0.3), (2.0, 0.05)):
        near = np.abs(frequency - line) < 0.1
        assert amplitude[near].max() == pytest.approx(size, rel=0.01)
        assert frequency[near][amplitude[near].argmax()] == pytest.approx(line, abs=0.02)
    assert amplitude[np.abs(frequency - 1.4) < 0.2].max() < 1e-3
