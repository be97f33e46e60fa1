# SPDX-License-Identifier: BSD-2-Clause
"""Analysis of the pitch motion of the space robot: points of the Poincare section (strobe points,
once per orbit), rotation number, spectrum, and metrics.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness.mission import Metric
from harness.results.result import Array, Result

from ..shared.metrics import SATURATED

PITCH, RATE, ANOMALY = "robot.pitch", "robot.pitch_rate", "robot.true_anomaly"
TURN = 2 * np.pi
NEWTON_STEPS = 6
"""Number of Newton steps by which the interpolated times of strobe points are refined; each step
doubles the number of correct digits.
"""


def orbits(result: Result) -> float:
    """Return the number of orbits: turns of the true anomaly from the first to the last row."""
    return float((result[ANOMALY][-1] - result[ANOMALY][0]) / TURN)


def strobe(result: Result) -> tuple[Array, Array]:
    """Return the pitch in [-pi, pi) [rad] and its derivative by the true anomaly, once per orbit
    whenever the true anomaly has its start value.

    Between rows the pitch and its rate are interpolated by cubic polynomials, the pitch with its
    rate from the result. The error falls with the fourth power of the time between rows; it is
    1e-7 rad with 100 rows per orbit.
    """
    from scipy.interpolate import CubicHermiteSpline, CubicSpline

    course = CubicSpline(result.time, result[ANOMALY])
    instants = _crossings(result, course)
    pitch = CubicHermiteSpline(result.time, result[PITCH], result[RATE])(instants)
    rate = CubicSpline(result.time, result[RATE])(instants)
    return (pitch + np.pi) % TURN - np.pi, rate / course(instants, 1)


def _crossings(result: Result, course: Callable[..., Array]) -> Array:
    """Return the times [s] at which the true anomaly equals its start value, by Newton's method;
    course: true anomaly as a function of time and order of derivative.
    """
    anomaly = result[ANOMALY]
    wanted = anomaly[0] + TURN * np.arange(np.floor(orbits(result) + 1e-9) + 1)
    times: Array = np.interp(wanted, anomaly, result.time)
    for _ in range(NEWTON_STEPS):
        times = times - (course(times) - wanted) / course(times, 1)
    return np.clip(times, result.time[0], result.time[-1])


def rotation_number(result: Result) -> float:
    """Return the rotation number: turns of the strobe points about their centre per orbit
    (mean), in [0, 1); NaN for a run of less than two orbits.

    A rational number means resonant motion, any other number quasi-periodic motion. If all points
    coincide, the motion is periodic with the orbit.
    """
    if orbits(result) < 2:
        return float("nan")
    pitch, rate = strobe(result)
    pitch = np.unwrap(pitch)
    angle = np.arctan2(pitch - pitch.mean(), rate - rate.mean())
    steps = np.diff(angle) % TURN
    return float(steps.mean() / TURN)


def spectrum(result: Result) -> tuple[Array, Array]:
    """Return frequencies [1/orbit] and amplitudes [rad] of the spectrum of the pitch over the true
    anomaly, with the mean removed and a Hann window.

    For a sinusoid the amplitude at its frequency is the amplitude of the sinusoid.
    """
    anomaly = result[ANOMALY]
    even = np.linspace(anomaly[0], anomaly[-1], len(anomaly))
    pitch = np.interp(even, anomaly, result[PITCH])
    window = np.hanning(len(even))
    amplitude = 2 * np.abs(np.fft.rfft(window * (pitch - pitch.mean()))) / window.sum()
    frequency = np.fft.rfftfreq(len(even), 1 / (len(even) - 1)) / orbits(result)
    return np.asarray(frequency, dtype=np.float64), np.asarray(amplitude, dtype=np.float64)


METRICS = (
    SATURATED,
    Metric("pitch swing", "deg", (), f"degrees(max({PITCH}) - min({PITCH}))"),
    Metric(
        "rotation number",
        "1/orbit",
        (PITCH, RATE, ANOMALY),
        lambda r, _: rotation_number(r),
    ),
)
