"""Histories that follow from several variables of a result.

A row holds the states of the plants at its time, and what the flight software made of the states at
its last sample, one sample earlier. Where every sample was recorded, the reference of a state
therefore stands in the next row; the last row, which has no next one, repeats the error of the row
before. With rows further apart than samples the reference of the same row is taken, and the errors
contain its motion during one sample. Which of the two it is shows in the first rows: the outputs at
t = 0 and those of the first sample are the same.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from harness.results.result import Result

Array = NDArray[np.float64]

SERVICER, TARGET, REFERENCE = "servicer.r_SN_N", "target.r_TN_N", "guidance.rho_ref_N"
VELOCITIES = ("servicer.v_SN_N", "target.v_TN_N")
ATTITUDE, REFERENCE_ATTITUDE = "servicer.q_SN", "guidance.q_DN"


def position_error(result: Result) -> Array:
    """Distance of the servicer from its reference position, (rows,) [m]."""
    return _aligned(
        _relative(result), result[REFERENCE], lambda a, b: np.linalg.norm(a - b, axis=1)
    )


def range_error(result: Result) -> Array:
    """Magnitude of range less range of the reference position, (rows,) [m]."""
    return _aligned(_norm(_relative(result)), _norm(result[REFERENCE]), lambda a, b: np.abs(a - b))


def attitude_error(result: Result) -> Array:
    """Angle between the attitude of the servicer and the reference attitude, 0 to pi, (rows,)
    [rad].
    """
    return _aligned(result[ATTITUDE], result[REFERENCE_ATTITUDE], rotation_angle)


def range_(result: Result) -> Array:
    """Distance between servicer and target, (rows,) [m]."""
    return _norm(_relative(result))


def relative_speed(result: Result) -> Array:
    """Magnitude of the velocity of the servicer relative to the target, (rows,) [m/s]."""
    return _norm(result[VELOCITIES[0]] - result[VELOCITIES[1]])


def rotation_angle(a: Array, b: Array) -> Array:
    """Angle of the rotation between attitudes given by quaternions (rows, 4), scalar first; 0 to
    pi, (rows,) [rad].
    """
    scalar = np.abs(np.sum(a * b, axis=1))
    vector = a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    return np.asarray(2 * np.arctan2(_norm(vector), scalar))


def _relative(result: Result) -> Array:
    return np.asarray(result[SERVICER] - result[TARGET])


def _norm(x: Array) -> Array:
    return np.asarray(np.linalg.norm(x, axis=1))


def _aligned(actual: Array, reference: Array, error: Callable[[Array, Array], Array]) -> Array:
    """Error of every row against the reference that belongs to it."""
    if len(actual) < 2 or not np.array_equal(reference[0], reference[1]):
        return error(actual, reference)
    errors = error(actual[:-1], reference[1:])
    return np.concatenate((errors, errors[-1:]))
