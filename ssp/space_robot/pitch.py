# SPDX-License-Identifier: BSD-2-Clause
"""What the pitch motion of the space robot shows once per orbit and over many: strobe points and
spectrum.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness.results.result import Array, Result

PITCH, RATE, ANOMALY = "robot.pitch", "robot.pitch_rate", "robot.true_anomaly"
TURN = 2 * np.pi
NEWTON_STEPS = 6
"""From the linear interpolation on, each doubles the digits."""


def orbits(result: Result) -> float:
    """Turns of the true anomaly since the start."""
    return float((result[ANOMALY][-1] - result[ANOMALY][0]) / TURN)


def strobe(result: Result) -> tuple[Array, Array]:
    """Pitch in [-pi, pi) [rad] and its derivative by the true anomaly, once per orbit at the
    anomaly of the start.

    Cubic between the rows, pitch with its own rate: the error falls with the fourth power of their
    distance, 1e-7 rad with 100 rows per orbit.
    """
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    course = CubicSpline(result.time, result[ANOMALY])
    instants = _crossings(result, course)
    pitch = CubicHermiteSpline(result.time, result[PITCH], result[RATE])(instants)
    rate = CubicSpline(result.time, result[RATE])(instants)
    return (pitch + np.pi) % TURN - np.pi, rate / course(instants, 1)


def _crossings(result: Result, course: Callable[..., Array]) -> Array:
    """Times at which the true anomaly is that of the start, by Newton's method [s]."""
    anomaly = result[ANOMALY]
    wanted = anomaly[0] + TURN * np.arange(np.floor(orbits(result) + 1e-9) + 1)
    times: Array = np.interp(wanted, anomaly, result.time)
    for _ in range(NEWTON_STEPS):
        times = times - (course(times) - wanted) / course(times, 1)
    return np.clip(times, result.time[0], result.time[-1])


def rotation_number(result: Result) -> float:
    """Turns of the strobe points about their centre per orbit, in [0, 1); NaN below two orbits.

    The motion is periodic with the orbit where it has no such points, resonant where it is a
    fraction, quasi-periodic where it is not.
    """
    if orbits(result) < 2:
        return float("nan")
    pitch, rate = strobe(result)
    pitch = np.unwrap(pitch)
    angle = np.arctan2(pitch - pitch.mean(), rate - rate.mean())
    steps = np.diff(angle) % TURN
    return float(steps.mean() / TURN)


def swing(result: Result) -> float:
    """Difference of the largest and the smallest pitch [deg]: above 360 deg it has tumbled."""
    return float(np.degrees(np.ptp(result[PITCH])))


def spectrum(result: Result) -> tuple[Array, Array]:
    """Frequencies [1/orbit] and amplitudes [rad] of the pitch over the true anomaly, mean taken
    out, Hann window.

    The amplitude of a single line is that of its sinusoid.
    """
    anomaly = result[ANOMALY]
    even = np.linspace(anomaly[0], anomaly[-1], len(anomaly))
    pitch = np.interp(even, anomaly, result[PITCH])
    window = np.hanning(len(even))
    amplitude = 2 * np.abs(np.fft.rfft(window * (pitch - pitch.mean()))) / window.sum()
    frequency = np.fft.rfftfreq(len(even), 1 / (len(even) - 1)) / orbits(result)
    return np.asarray(frequency, dtype=np.float64), np.asarray(amplitude, dtype=np.float64)
