# SPDX-License-Identifier: BSD-2-Clause
"""Evaluations of the pitch motion of a locked space robot for the claims of Guo et al. 2014.

The evaluation of a claim returns first the value that decides on the verdict, then further values
that the report shows.
"""

from __future__ import annotations

import numpy as np

from harness.mission.claim import parameter
from harness.results.result import Array, Result

from .pitch import ANOMALY, PITCH, RATE, orbits, strobe

ANGLES = "robot.joint_angle"
MOTION = (PITCH, RATE, ANOMALY)
ECCENTRICITY = "robot.e"
SHAPE = tuple(f"robot.{name}" for name in ("e", "mass", "Ixx", "Iyy", "Izz", "l", "r"))
"""Parameters that the claims need: the eccentricity, and those from which pitch_constants()
computes the constants of the pitch equation.
"""


def locked(result: Result) -> bool:
    """Return whether the joints have not moved."""
    return bool(np.ptp(result[ANGLES], axis=0).max() < 1e-9)


def pitch_constants(result: Result) -> tuple[float, float]:
    """Return the constants theta_hat [rad] and kappa of the pitch equation.

    S is the sum over the bodies of m rho rho^T (rho: position from the common centre of mass, in
    the plane of motion and base axes) and of their second moments. S_1 >= S_2 are its principal
    values, and alpha is the angle of the axis of S_1: theta_hat = -alpha, kappa = 3 (S_1 -
    S_2)/(S_1 + S_2).
    """
    mass, l, r = (parameter(result, f"robot.{name}") for name in ("mass", "l", "r"))  # noqa: E741
    q = np.cumsum([0.0, *result[ANGLES][0]])
    along = np.stack([np.cos(q), np.sin(q)], axis=1)
    joint_1 = r[0] * along[0]
    joint_2 = joint_1 + (l[1] + r[1]) * along[1]
    rho = np.array([0 * joint_1, joint_1 + l[1] * along[1], joint_2 + l[2] * along[2]])
    rho -= mass @ rho / mass.sum()
    second = np.einsum("k,ki,kj->ij", mass, rho, rho) + _bodies(result, along)
    values, axes = np.linalg.eigh(second)
    alpha = np.arctan2(axes[1, 1], axes[0, 1])
    theta_hat = (-alpha + np.pi / 2) % np.pi - np.pi / 2
    return float(theta_hat), float(3 * (values[1] - values[0]) / values.sum())


def _bodies(result: Result, along: Array) -> Array:
    """Return the sum (2, 2) of the second moments of the bodies about their own centres, base
    axes: for each body (Iyy + Izz - Ixx)/2 along its x axis, (Ixx + Izz - Iyy)/2 along its y axis.
    along: x axes of the bodies (bodies, 2).
    """
    xx, yy, zz = (parameter(result, f"robot.{name}") for name in ("Ixx", "Iyy", "Izz"))
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    lengthwise = np.einsum("k,ki,kj->ij", (yy + zz - xx) / 2, along, along)
    sideways = np.einsum("k,ki,kj->ij", (xx + zz - yy) / 2, across, across)
    return np.asarray(lengthwise + sideways)


def equilibrium(result: Result) -> tuple[float, ...]:
    """Return the magnitude of theta_hat [deg], and kappa."""
    theta_hat, kappa = pitch_constants(result)
    return abs(float(np.degrees(theta_hat))), kappa


def largest_turn(result: Result) -> tuple[float, ...]:
    """Return the largest angle between the pitch and the equilibrium nearest to its start [deg],
    and the number of orbits.
    """
    return float(np.degrees(np.abs(_delta(result)).max())), orbits(result)


def _delta(result: Result) -> Array:
    """Return the pitch relative to the equilibrium nearest to its start, (rows,) [rad]."""
    delta = result[PITCH] - pitch_constants(result)[0]
    return np.asarray(delta - np.pi * np.round(delta[0] / np.pi))


def _slope(result: Result) -> Array:
    """Return the pitch rate divided by the rate of the true anomaly, (rows,)."""
    return np.asarray(result[RATE] / np.gradient(result[ANOMALY], result.time))


def critical_rate(result: Result) -> tuple[float, ...]:
    """Return 1 if the motion agrees with criterion (9) of the paper, else 0; the initial rate
    divided by the critical one; the largest angle from the equilibrium [deg].

    By (9) the robot tumbles if |delta'(0)| is above sqrt(kappa) |cos delta(0)|. delta: pitch
    relative to the equilibrium; delta': its derivative by the true anomaly.
    """
    turn, _ = largest_turn(result)
    critical = np.sqrt(pitch_constants(result)[1]) * abs(np.cos(_delta(result)[0]))
    ratio = abs(_slope(result)[0]) / critical
    return float((ratio > 1) == (turn > 180)), float(ratio), turn


def level_change(result: Result) -> tuple[float, ...]:
    """Return the largest change of delta'^2 + kappa sin^2 delta since the start, divided by kappa;
    delta and delta' as in critical_rate().
    """
    kappa = pitch_constants(result)[1]
    level = _slope(result) ** 2 + kappa * np.sin(_delta(result)) ** 2
    return (float(np.abs(level - level[0]).max() / kappa),)


def strobe_spread(result: Result) -> tuple[float, ...]:
    """Return the spread (largest minus smallest value) of the pitch in the Poincare section,
    divided by its spread over the whole run, and the number of orbits.
    """
    points, _ = strobe(result)
    return float(np.ptp(np.unwrap(points)) / np.ptp(result[PITCH])), orbits(result)
