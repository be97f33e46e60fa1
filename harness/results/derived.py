# SPDX-License-Identifier: BSD-2-Clause
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
POSITION_H = ("guidance.rho_H", "guidance.rho_ref_H")
FORCE_H = ("propulsion.F_S", ATTITUDE, TARGET, VELOCITIES[1])
ASSEMBLY = ("assembly.q_SH", "guidance.q_DH")
RELEASE = "servicer.t_att"
"""Parameter: the attitude of the servicer is frozen before this time [s]."""
RATE = "servicer.omega_SN_S"
"""Published as zero as long as the attitude is frozen."""


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


def position_error_H(result: Result) -> Array:
    """Position less reference position as the guidance sees them, Hill axes, (rows, 3) [m]."""
    return np.asarray(result[POSITION_H[0]] - result[POSITION_H[1]])


def attitude_error_vector(result: Result) -> Array:
    """Attitude of S relative to D as modified Rodrigues parameters, |sigma| <= 1, (rows, 3)."""
    return _aligned(result[ATTITUDE], result[REFERENCE_ATTITUDE], _relative_mrp)


def force_H(result: Result) -> Array:
    """Force of the actuators on the servicer in axes of the target's Hill frame, (rows, 3) [N].

    x radial outward, y along track, z orbit normal; turned with the attitude of the same row.
    """
    r, v = result[TARGET], result[VELOCITIES[1]]
    normal = np.cross(r, v)
    axes = np.stack([r, np.cross(normal, r), normal], axis=1)
    axes /= np.linalg.norm(axes, axis=2)[:, :, None]
    return np.asarray(np.einsum("kij,kj->ki", axes, _turned(result[ATTITUDE], result[FORCE_H[0]])))


def release_time(result: Result) -> float:
    """Time from which on torques turn the servicer [s]; infinite if that is never.

    The parameter t_att of the servicer; where the result does not hold parameters, the row before
    the first angular velocity that is not zero.
    """
    if result.holds(parameters=(RELEASE,)):
        return float(result.parameter(RELEASE))
    turning = np.flatnonzero(result[RATE].any(axis=1)) if RATE in result else np.zeros(1, int)
    return float(result.time[max(0, turning[0] - 1)]) if len(turning) else float("inf")


def range_(result: Result) -> Array:
    """Distance between servicer and target, (rows,) [m]."""
    return _norm(_relative(result))


def initial_range(result: Result) -> float:
    """Distance between servicer and target in the first row [m]."""
    return float(_norm(result[SERVICER][:1] - result[TARGET][:1])[0])


def reference_range(result: Result) -> Array:
    """Range of the reference position, in the row of the state that it belongs to, (rows,) [m]."""
    return _aligned(_norm(_relative(result)), _norm(result[REFERENCE]), lambda _, b: b)


def relative_speed(result: Result) -> Array:
    """Magnitude of the velocity of the servicer relative to the target, (rows,) [m/s]."""
    return _norm(result[VELOCITIES[0]] - result[VELOCITIES[1]])


def assembly_attitude_error(result: Result) -> Array:
    """Angle between the attitude of the assembly and its reference, relative to H, (rows,) [rad].

    The guidance samples at the beginning of a step: the reference of a row stands in the next one.
    """
    errors = rotation_angle(result[ASSEMBLY[0]][:-1], result[ASSEMBLY[1]][1:])
    return np.concatenate((errors, errors[-1:]))


def rotation_angle(a: Array, b: Array) -> Array:
    """Angle of the rotation between attitudes given by quaternions (rows, 4), scalar first; 0 to
    pi, (rows,) [rad].
    """
    scalar = np.abs(np.sum(a * b, axis=1))
    vector = a[:, :1] * b[:, 1:] - b[:, :1] * a[:, 1:] + np.cross(a[:, 1:], b[:, 1:])
    return np.asarray(2 * np.arctan2(_norm(vector), scalar))


def _relative_mrp(actual: Array, reference: Array) -> Array:
    """MRP of the rotation reference -> actual from quaternions (rows, 4), the shorter way round."""
    scalar = np.sum(actual * reference, axis=1)
    vector = reference[:, :1] * actual[:, 1:] - actual[:, :1] * reference[:, 1:]
    vector -= np.cross(reference[:, 1:], actual[:, 1:])
    sign = np.where(scalar < 0, -1.0, 1.0)
    return np.asarray((sign / (1 + np.abs(scalar)))[:, None] * vector)


def _turned(q: Array, v: Array) -> Array:
    """v_N = q v_B q* for quaternions (rows, 4), scalar first, and vectors (rows, 3)."""
    t = 2 * np.cross(q[:, 1:], v)
    return np.asarray(v + q[:, :1] * t + np.cross(q[:, 1:], t))


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
