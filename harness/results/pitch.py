# SPDX-License-Identifier: BSD-2-Clause
"""What the pitch motion of the space robot shows once per orbit and over many: strobe points and
spectrum.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.results.result import Result

Array = NDArray[np.float64]

PITCH, RATE, ANOMALY = "robot.pitch", "robot.pitch_rate", "robot.true_anomaly"
TURN = 2 * np.pi


def orbits(result: Result) -> float:
    """Turns of the true anomaly since the start."""
    return float((result[ANOMALY][-1] - result[ANOMALY][0]) / TURN)


def strobe(result: Result) -> tuple[Array, Array]:
    """Pitch in [-pi, pi) [rad] and its derivative by the true anomaly, once per orbit at the
    anomaly of the start.

    The motion is interpolated between the rows: they must be much closer than an orbit.
    """
    anomaly = result[ANOMALY]
    instants = anomaly[0] + TURN * np.arange(np.floor(orbits(result) + 1e-9) + 1)
    pitch, rate = (np.interp(instants, anomaly, result[name]) for name in (PITCH, RATE))
    anomaly_rate = np.interp(instants, anomaly, np.gradient(anomaly, result.time))
    return (pitch + np.pi) % TURN - np.pi, rate / anomaly_rate


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
