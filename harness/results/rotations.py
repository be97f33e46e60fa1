# SPDX-License-Identifier: BSD-2-Clause
"""Rotations of histories: quaternions (rows, 4), scalar first, v_N = q v_B q*."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rotation_angle(a: Array, b: Array) -> Array:
    """Angle of the rotation between attitudes given by quaternions (rows, 4), scalar first; 0 to
    pi, (rows,) [rad].
    """
    scalar = np.abs(np.sum(a * b, axis=1))
    vector = a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    return np.asarray(2 * np.arctan2(np.linalg.norm(vector, axis=1), scalar))


def relative_mrp(actual: Array, reference: Array) -> Array:
    """MRP of the rotation reference -> actual from quaternions (rows, 4), the shorter way round."""
    scalar = np.sum(actual * reference, axis=1)
    vector = reference[:, :1] * actual[:, 1:] - actual[:, :1] * reference[:, 1:]
    vector -= np.cross(reference[:, 1:], actual[:, 1:])
    sign = np.where(scalar < 0, -1.0, 1.0)
    return np.asarray((sign / (1 + np.abs(scalar)))[:, None] * vector)


def turned(q: Array, v: Array) -> Array:
    """v_N = q v_B q* for quaternions (rows, 4), scalar first, and vectors (rows, 3)."""
    t = 2 * np.cross(q[:, 1:], v)
    return np.asarray(v + q[:, :1] * t + np.cross(q[:, 1:], t))
