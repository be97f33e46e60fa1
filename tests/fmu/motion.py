# SPDX-License-Identifier: BSD-2-Clause
"""Motion of a rigid body under loads as the balance of inertial angular momentum, and metrics of
numerical error.

Nothing of Euler's equation, Rodrigues parameters or a fixed step: rotation matrix, total momentum,
DOP853.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from scipy.integrate import solve_ivp

from .theory import tilde


@dataclass(frozen=True)
class Vehicle:
    """A rigid body with momentum wheels under loads. A: wheel speeds to wheel momentum in body
    axes.
    """

    J: np.ndarray
    A: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    F_B: Sequence[float] = (0, 0, 0)
    M_B: Callable[[float], np.ndarray] = lambda _: np.zeros(3)
    a_N: Callable[[float, np.ndarray, np.ndarray], np.ndarray] = lambda *_: np.zeros(3)
    gravity: Callable[[np.ndarray], np.ndarray] = lambda _: np.zeros(3)
    torque_of_gravity: Callable[[np.ndarray], np.ndarray] = lambda _: np.zeros(3)
    wheel_accel: Sequence[float] = (0, 0, 0)
    mdot: float = 0.0

    def state(self, r, v, C_BN, omega, *, wheel_speed=(0, 0, 0), mass=1.0):
        """[r, v, C_NB, inertial angular momentum, wheel speeds, mass]"""
        H_B = self.J @ omega + self.A @ wheel_speed
        return np.concatenate([r, v, C_BN.T.ravel(), C_BN.T @ H_B, wheel_speed, [mass]])

    def rate(self, y):
        """Angular velocity, body axes."""
        return np.linalg.solve(self.J, y[6:15].reshape(3, 3).T @ y[15:18] - self.A @ y[18:21])

    def derivative(self, t, y):
        r, v, C_NB, mass = y[:3], y[3:6], y[6:15].reshape(3, 3), y[21]
        acceleration = self.gravity(r) + self.a_N(t, r, v) + C_NB @ self.F_B / mass
        torque = C_NB @ (self.M_B(t) + self.torque_of_gravity(C_NB.T @ r))
        turning = C_NB @ tilde(self.rate(y))
        return np.concatenate(
            [v, acceleration, turning.ravel(), torque, self.wheel_accel, [-self.mdot]]
        )

    def propagate(self, y, t0, t1, breaks=()):
        """State at t1 by DOP853, restarted where a load switches on; no stage sees a load that
        starts at its end.
        """
        times = [t0, *sorted(t for t in set(breaks) if t0 < t < t1), t1]
        for a, b in pairwise(times):
            last = np.nextafter(b, a)
            before_b = lambda t, y, last=last: self.derivative(min(t, last), y)  # noqa: E731
            y = solve_ivp(
                before_b, (a, b), y, method="DOP853", rtol=1e-13, atol=1e-15, max_step=5
            ).y[:, -1]
        return y


def stencil(values, h):
    """Derivative in the middle of five equidistant samples, error h^4/30 of the fifth
    derivative.
    """
    a, b, _, d, e = values
    return (8 * (d - b) - (e - a)) / (12 * h)


def order_ratio(error_of_step, h):
    """|y(4h) - y(2h)| / |y(2h) - y(h)|: 2^p for a method of order p."""
    y4, y2, y1 = (np.asarray(error_of_step(k * h)) for k in (4, 2, 1))
    return np.linalg.norm(y4 - y2) / np.linalg.norm(y2 - y1)


def deviation(actual, expected, scale=1.0):
    """Largest absolute difference of two arrays, in units of `scale`."""
    return np.max(np.abs(np.asarray(actual) - expected)) / scale
