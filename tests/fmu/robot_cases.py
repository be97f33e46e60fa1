# SPDX-License-Identifier: BSD-2-Clause
"""The robot of the paper, and the constants of its pitch equation."""

from __future__ import annotations

import numpy as np

from tests.reference.space_robot import Robot

PAPER = Robot()
Q = (np.radians(30), np.radians(20))
"""Joint angles of the paper [rad]."""


def same_sign(q, like):
    return q * np.sign(np.sum(q * like, axis=-1, keepdims=True))


def pitch_constants(robot, q):
    """kappa and theta_hat of the pitch equation, from the principal axes of the frozen robot in its
    plane.
    """
    mass, rho = robot.points(np.asarray(q, dtype=float))
    J = np.einsum("i,ij,ij->", mass, rho, rho) * np.eye(3) - np.einsum(
        "i,ij,ik->jk", mass, rho, rho
    )
    moments, axes = np.linalg.eigh(J[:2, :2])
    along = axes[:, 0]
    theta_hat = -np.arctan2(along[1], along[0])
    return 3 * (moments[1] - moments[0]) / J[2, 2], (theta_hat + np.pi / 2) % np.pi - np.pi / 2
