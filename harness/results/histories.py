# SPDX-License-Identifier: BSD-2-Clause
"""Arithmetic on time series (rows, elements) of vectors and quaternions (scalar first, v_N = q v_B
q*).

Vectors are computed column by column, because numpy takes several times as long for many rows of a
few elements. The results are bit-identical to the plain numpy operations.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from harness.results.result import Array

PAIRWISE = 8
"""Number of elements from which on numpy adds in pairs. Numpy adds fewer elements from the first to
the last, and so do the functions here, for bit-identical sums.
"""


# ---- vectors


def _is_narrow(x: Any) -> bool:
    """Return whether x is a time series (rows, n) of doubles with n < PAIRWISE, which is computed
    column by column. A subclass of numpy's array is not, because it may record its operations.
    """
    return (
        type(x) is np.ndarray
        and x.dtype == np.float64
        and x.ndim == 2
        and 0 < x.shape[1] < PAIRWISE
    )


def _each(function: Callable[..., Any], plain: Callable[[Any, Any], Any], a: Any, b: Any) -> Any:
    if not (_is_narrow(a) and _is_narrow(b) and a.shape == b.shape):
        return plain(a, b)
    result = np.empty(a.shape)
    for k in range(a.shape[1]):
        function(a[:, k], b[:, k], out=result[:, k])
    return result


plus = partial(_each, np.add, operator.add)
minus = partial(_each, np.subtract, operator.sub)


def norm(x: Any) -> Array:
    """Return the Euclidean norm of the vector in every row."""
    array = np.asarray(x, dtype=np.float64)
    if not _is_narrow(array):
        return np.asarray(np.sqrt(total(np.square(array))))
    squares = np.square(array[:, 0])
    for k in range(1, array.shape[1]):
        squares += np.square(array[:, k])
    return np.asarray(np.sqrt(squares))


def total(x: Any) -> Array:
    """Return the sum (rows,) of the elements in every row of x (rows, n)."""
    if not _is_narrow(x):
        return np.asarray(np.sum(x, axis=-1))
    result = x[:, 0].copy()
    for k in range(1, x.shape[1]):
        result += x[:, k]
    return np.asarray(result)


# ---- quaternions


def turned(q: Array, v: Array) -> Array:
    """Rotate vectors v (..., 3) by quaternions q (..., 4), scalar first: return v_N = q v_B q*."""
    t = 2 * np.cross(q[..., 1:], v)
    return np.asarray(v + q[..., :1] * t + np.cross(q[..., 1:], t))


def of_mrp(sigma: Any) -> Array:
    """Return the quaternions (..., 4) of modified Rodrigues parameters (..., 3)."""
    s = np.asarray(sigma, dtype=np.float64)
    square = np.sum(s * s, axis=-1, keepdims=True)
    return np.asarray(np.concatenate((1 - square, 2 * s), axis=-1) / (1 + square))


def angle_between(u: Any, v: Any) -> Array:
    """Return the angle between vectors (..., 3), 0 to pi [rad]."""
    return np.asarray(np.arctan2(norm(np.cross(u, v)), total(np.asarray(u) * v)))


def orbit_attitude(inc: Any, argp: Any, raan: Any, nu: Any) -> Array:
    """Return the quaternions (..., 4) of the Hill frame of an orbit relative to the inertial frame
    N, from inclination, argument of perigee, right ascension and true anomaly [rad].
    """
    half, sum_, difference = inc / 2, (raan + argp + nu) / 2, (raan - argp - nu) / 2
    parts = (
        np.cos(half) * np.cos(sum_),
        np.sin(half) * np.cos(difference),
        np.sin(half) * np.sin(difference),
        np.cos(half) * np.sin(sum_),
    )
    return np.stack(parts, axis=-1)


def hill_attitude(r: Any, v: Any) -> Array:
    """Return the quaternions (..., 4) of the Hill frame of an orbit relative to the inertial frame
    N, from position r and velocity v (..., 3) in N. The x axis points along r, the z axis along r x
    v.
    """
    r, v = (np.asarray(x, dtype=np.float64) for x in (r, v))
    normal = np.cross(r, v)
    axes = (x.reshape(-1, 3) for x in (r, np.cross(normal, r), normal))
    found = quaternion(*(x / np.linalg.norm(x, axis=1)[:, None] for x in axes))
    return found.reshape(*r.shape[:-1], 4)


def quaternion(x: Array, y: Array, z: Array) -> Array:
    """Return the quaternions (rows, 4) of frames that are given by their unit axes x, y, z (rows,
    3).
    """
    (a, d, g), (b, e, h), (c, f, i) = (axis.T for axis in (x, y, z))
    # each row of the matrix 4 q q^T is a multiple of q; most accurate is the row with the largest
    # diagonal element
    rows = (
        (1 + a + e + i, h - f, c - g, d - b),
        (h - f, 1 + a - e - i, b + d, c + g),
        (c - g, b + d, 1 - a + e - i, f + h),
        (d - b, c + g, f + h, 1 - a - e + i),
    )
    best, most = np.stack(rows[0], axis=1), rows[0][0]
    for k in (1, 2, 3):
        larger = rows[k][k] > most
        best = np.where(larger[:, None], np.stack(rows[k], axis=1), best)
        most = np.where(larger, rows[k][k], most)
    return np.asarray(best / np.linalg.norm(best, axis=1)[:, None])
