# SPDX-License-Identifier: BSD-2-Clause
"""Reach of an arm from a fixed base: joint angles for a position and direction of its end effector
E, singular values of its Jacobian there, and clearance between its links.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from harness.results.result import Array

from .kinematics import Arm, Pose, jacobian, pose

STEPS, FREE, STRIDE = 80, 50, 0.3
"""Number of iterations, number of first iterations that also approach the preferred posture, and
largest change of position and attitude of E in one iteration [m, rad].
"""
DAMPING = 0.01
"""Damping of the least-squares steps, so that the steps are finite at singular poses."""
POSTURE = 0.2
"""Share of the way to the preferred posture by which the joints move in one iteration, as far as
this motion does not move E.
"""
REACHED = 1e-3
"""Largest errors of position and attitude at which E counts as having reached a place [m, rad]."""
APART = 3
"""Smallest difference between the numbers of two links whose distance is checked. Links with closer
numbers are not checked, because the joints between them form one mechanical unit.
"""


class Limits(NamedTuple):
    """Least and largest joint angles, and joint angles of the preferred posture (n,) [rad]."""

    low: Array
    high: Array
    posture: Array


class Reach(NamedTuple):
    """Reach of an arm with n joints, one row per place for its end effector E.

    angle: joint angles (rows, n) [rad]; error: larger one of the errors of position [m] and
    attitude [rad] (rows,); singular: singular values of J_m, the Jacobian of E (rows, min(6, n));
    worst: direction of the velocity of E that needs the largest joint rates, unit vectors in base
    axes (rows, 3).
    """

    angle: Array
    error: Array
    singular: Array
    worst: Array

    @property
    def reached(self) -> Array:
        """Return a mask of the places that the arm reaches (rows,)."""
        return np.asarray(self.error <= REACHED)

    @property
    def manipulability(self) -> Array:
        """Return the product of the singular values (rows,): for at least 6 joints the
        manipulability sqrt det J_m J_m^T, with the Jacobian J_m of E.
        """
        return np.asarray(np.prod(self.singular, axis=1))


def shortest_arc(x: Array, to: Array) -> Array:
    """Return the matrices (rows, 3, 3) of the rotations by the smallest angle that turn the unit
    vector x (3,) into each of the unit vectors `to` (rows, 3); the identity for `to` = -x.
    """
    axis, c = np.cross(x, to), to @ x
    across = np.cross(axis[:, None], np.eye(3)).transpose(0, 2, 1)
    factor = 1 / np.maximum(1 + c, 1e-12)
    return np.asarray(np.eye(3) + across + factor[:, None, None] * (across @ across))


def errors(at: Pose, place: Array, frame: Array) -> Array:
    """Return the displacement and the rotation vector that would bring the end effector from its
    pose to a position and frame, (rows, 6) [m, rad].
    """
    turned = frame @ at.frame.transpose(0, 2, 1)
    vector = np.stack([turned[:, k, j] - turned[:, j, k] for j, k in ((1, 2), (2, 0), (0, 1))], 1)
    sine, cosine = np.linalg.norm(vector, axis=1) / 2, (np.trace(turned.T) - 1) / 2
    angle = np.arctan2(sine, cosine)
    scale = np.where(sine > 1e-9, angle / np.maximum(2 * sine, 1e-9), 0.5)
    return np.hstack([place - at.tip, scale[:, None] * vector])


def reach(arm: Arm, limits: Limits, place: Array, outward: Array) -> Reach:
    """Return the reach of the arm for positions of the end effector (rows, 3) [m] with its X axis
    along unit vectors `outward` (rows, 3), both in base axes.

    The attitude of E about its X axis is fixed too: the frame of E in the preferred posture is
    turned by the smallest rotation that brings its X axis to `outward`. The method is damped least
    squares from that posture, with joint angles within their limits.
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
    """Return the least distance [m] between the line segments from a to b and from c to d: the
    distance between inner points of both segments if these are closest, otherwise the least
    distance of an end point from the other segment.
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
    """Return the least distance between the surfaces of two links at joint angles q (n,) [m],
    negative if they overlap, and the numbers of these links, counted from 1.

    If the arm has too few links for a pair to be checked (see APART), the result is infinity and
    (0, 0).
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
