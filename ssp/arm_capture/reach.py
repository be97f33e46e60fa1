# SPDX-License-Identifier: BSD-2-Clause
"""Reach of an arm from a fixed base: joint angles for a position and direction of its end effector,
singular values, clearance of its links.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from harness.results.result import Array

from .kinematics import Arm, Pose, jacobian, pose

STEPS, FREE, STRIDE = 80, 50, 0.3
"""Iterations, those that look for the posture too, and the largest step of one [m, rad]."""
DAMPING = 0.01
"""Damping of the iteration: it stays finite at singular poses."""
POSTURE = 0.2
"""Share of the way to the posture by which the joints move in each step without moving E."""
REACHED = 1e-3
"""Largest errors of position and attitude of a place that counts as reached [m, rad]."""
APART = 3
"""Smallest difference of the numbers of two links that can touch; nearer links share a joint block.
"""


class Limits(NamedTuple):
    """Least and largest joint angles, and those that the arm prefers (n,) [rad]."""

    low: Array
    high: Array
    posture: Array


class Reach(NamedTuple):
    """Reach of an arm: joint angles (rows, n), errors of place and direction (rows,) [m, rad],
    singular values of J_m (rows, 6), and the direction of the velocity of E that needs the largest
    joint rates, unit vectors (rows, 3), base axes.
    """

    angle: Array
    error: Array
    singular: Array
    worst: Array

    @property
    def reached(self) -> Array:
        """Return which places are reached."""
        return np.asarray(self.error <= REACHED)

    @property
    def manipulability(self) -> Array:
        """Return the manipulability sqrt det J_m J_m^T (rows,)."""
        return np.asarray(np.prod(self.singular, axis=1))


def shortest_arc(x: Array, to: Array) -> Array:
    """Return the matrices (rows, 3, 3) of the shortest rotation of a unit vector (3,) to others
    (rows, 3).
    """
    axis, c = np.cross(x, to), to @ x
    across = np.cross(axis[:, None], np.eye(3)).transpose(0, 2, 1)
    factor = 1 / np.maximum(1 + c, 1e-12)
    return np.asarray(np.eye(3) + across + factor[:, None, None] * (across @ across))


def errors(at: Pose, place: Array, frame: Array) -> Array:
    """Return the distance and the small rotation still to go, (rows, 6) [m, rad]."""
    turned = frame @ at.frame.transpose(0, 2, 1)
    vector = np.stack([turned[:, k, j] - turned[:, j, k] for j, k in ((1, 2), (2, 0), (0, 1))], 1)
    sine, cosine = np.linalg.norm(vector, axis=1) / 2, (np.trace(turned.T) - 1) / 2
    angle = np.arctan2(sine, cosine)
    scale = np.where(sine > 1e-9, angle / np.maximum(2 * sine, 1e-9), 0.5)
    return np.hstack([place - at.tip, scale[:, None] * vector])


def reach(arm: Arm, limits: Limits, place: Array, outward: Array) -> Reach:
    """Return the reach of the arm for end-effector positions (rows, 3) [m] with X_E along unit
    vectors (rows, 3), base axes. The roll is the roll of the posture turned by the shortest arc.

    The method is damped least squares from the posture, with joints within their limits.
    """
    q = np.tile(limits.posture, (len(place), 1))
    own = pose(arm, q[:1]).frame[0]
    frame = shortest_arc(own[:, 0], outward) @ own
    for k in range(STEPS):
        at = pose(arm, q)
        J, left = jacobian(at), errors(at, place, frame)
        left *= np.minimum(1, STRIDE / np.maximum(np.linalg.norm(left, axis=1), STRIDE))[:, None]
        home = POSTURE * (limits.posture - q) * (k < FREE)
        rest = left - np.einsum("kij,kj->ki", J, home)
        weight = J @ J.transpose(0, 2, 1) + DAMPING**2 * np.eye(6)
        step = home + np.einsum("kji,kj->ki", J, np.linalg.solve(weight, rest[..., None])[..., 0])
        q = np.clip(q + step, limits.low, limits.high)
    return _evaluated(arm, q, place, frame)


def _evaluated(arm: Arm, q: Array, place: Array, frame: Array) -> Reach:
    at = pose(arm, q)
    left, (U, singular, _) = errors(at, place, frame), np.linalg.svd(jacobian(at))
    worst = U[:, :3, -1] / np.maximum(np.linalg.norm(U[:, :3, -1], axis=1), 1e-12)[:, None]
    far = np.maximum(np.linalg.norm(left[:, :3], axis=1), np.linalg.norm(left[:, 3:], axis=1))
    return Reach(q, far, singular, worst)


# ---- clearance


def between(a: Array, b: Array, c: Array, d: Array) -> float:
    """Return the least distance between the line segments from a to b and from c to d [m]. It is
    between inner points of both segments, or else at an end of one.
    """
    u, v, w = b - a, d - c, a - c
    ends = [_from_line(p, c, v) for p in (a, b)] + [_from_line(p, a, u) for p in (c, d)]
    matrix = np.array([[u @ u, -u @ v], [-u @ v, v @ v]])
    if np.linalg.det(matrix) > 1e-12 * (u @ u) * (v @ v):
        s, t = np.linalg.solve(matrix, [-u @ w, v @ w])
        if 0 <= s <= 1 and 0 <= t <= 1:
            return float(np.linalg.norm(w + s * u - t * v))
    return min(ends)


def _from_line(p: Array, begin: Array, along: Array) -> float:
    part = np.clip((p - begin) @ along / max(float(along @ along), 1e-300), 0, 1)
    return float(np.linalg.norm(p - begin - part * along))


def clearance(arm: Arm, q: Array) -> tuple[float, tuple[int, int]]:
    """Return the least distance between the surfaces of two links [m], negative where they overlap,
    and their numbers from 1 on; q: (n,). Inf and (0, 0) of an arm that is too short to touch
    itself.
    """
    at = pose(arm, q[None])
    points = [*at.joint[0], at.tip[0]]
    n = len(arm.axis)
    found = [
        (
            between(*points[i : i + 2], *points[j : j + 2]) - arm.radius[i] - arm.radius[j],
            (i + 1, j + 1),
        )
        for i in range(n)
        for j in range(i + APART, n)
    ]
    return min(found, default=(float("inf"), (0, 0)))
