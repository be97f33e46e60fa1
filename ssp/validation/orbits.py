# SPDX-License-Identifier: BSD-2-Clause
"""Attitude matrices and orbital elements in the form of the published values, computed from the
outputs of an FMU.
"""

from __future__ import annotations

import numpy as np

from harness.results.result import Array


def dcm(q: Array) -> Array:
    """Return the direction cosine matrix C_BN of the quaternion q_BN (4,), scalar first."""
    w, v = q[0], q[1:]
    skew = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.asarray(np.eye(3) - 2 * w * skew + 2 * skew @ skew)


def angle_between(a: Array, b: Array) -> float:
    """Return the rotation angle from one direction cosine matrix to another [rad], by the formula
    |A - B|_F = 2 sqrt 2 sin(angle/2), which is accurate near zero.
    """
    return float(2 * np.arcsin(min(np.linalg.norm(a - b) / np.sqrt(8), 1.0)))


def eccentricity(mu: float, r: Array, v: Array) -> float:
    """Return the eccentricity |v x (r x v)/mu - r/|r|| of an orbit.

    mu: gravitational parameter [m3/s2]; r, v: position [m] and velocity [m/s], (3,) each.
    """
    return float(np.linalg.norm(eccentricity_vector(mu, r, v)))


def eccentricity_vector(mu: float, r: Array, v: Array) -> Array:
    """Return the eccentricity vector (3,), which points to the perigee; arguments as of
    `eccentricity`.
    """
    return np.asarray(np.cross(v, np.cross(r, v)) / mu - r / np.linalg.norm(r))


def node_and_perigee(mu: float, r: Array, v: Array) -> Array:
    """Return the right ascension of the ascending node and the argument of perigee, (2,) [rad];
    arguments as of `eccentricity`.
    """
    h = np.cross(r, v)
    node = np.cross([0.0, 0.0, 1.0], h)
    e, across = eccentricity_vector(mu, r, v), np.cross(h / np.linalg.norm(h), node)
    return np.array([np.arctan2(node[1], node[0]), np.arctan2(e @ across, e @ node)])
