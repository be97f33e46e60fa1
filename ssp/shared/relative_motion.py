# SPDX-License-Identifier: BSD-2-Clause
"""Motion of the servicer relative to the target and to its reference, computed from a result.
The reference that belongs to a state may be in the next row, as ssp.shared.samples explains.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness.results.histories import minus, norm, turned
from harness.results.result import Array, Result

from .samples import aligned, is_late

ALL = slice(None)
SERVICER, TARGET, REFERENCE = "servicer.r_SN_N", "target.r_TN_N", "guidance.rho_ref_N"
VELOCITIES = ("servicer.v_SN_N", "target.v_TN_N")
DISTANCE = f"norm({SERVICER} - {TARGET})"
SPEED = "norm({} - {})".format(*VELOCITIES)
ATTITUDE, REFERENCE_ATTITUDE = "servicer.q_SN", "guidance.q_DN"
POSITION_H = ("guidance.rho_H", "guidance.rho_ref_H")
POSITION_ERROR_H = "{} - {}".format(*POSITION_H)
FORCE_H = ("propulsion.F_S", ATTITUDE, TARGET, VELOCITIES[1])
RELEASE = "servicer.t_att"
"""Parameter with the time before which the attitude of the servicer is frozen [s]."""
RATE = "servicer.omega_SN_S"
"""Variable that is zero while the attitude of the servicer is frozen."""


def position_error(result: Result, rows: slice = ALL) -> Array:
    """Return the distance of the servicer from its reference position, (rows,) [m]."""
    return _aligned(result, lambda a, b: norm(minus(a, b)), rows)


def range_error(result: Result, rows: slice = ALL) -> Array:
    """Return the absolute difference between the range and the range of the reference position,
    (rows,) [m].
    """
    return _aligned(result, lambda a, b: np.abs(norm(a) - norm(b)), rows)


def rotation_angle(a: Array, b: Array) -> Array:
    """Return the angle (rows,) [rad], 0 to pi, of the rotation between attitudes given by
    quaternions (rows, 4), scalar first.
    """
    a0, a1, a2, a3 = np.ascontiguousarray(a.T)
    b0, b1, b2, b3 = np.ascontiguousarray(b.T)
    scalar = np.abs(a0 * b0 + a1 * b1 + a2 * b2 + a3 * b3)
    x = a0 * b1 - b0 * a1 + (a2 * b3 - a3 * b2)
    y = a0 * b2 - b0 * a2 + (a3 * b1 - a1 * b3)
    z = a0 * b3 - b0 * a3 + (a1 * b2 - a2 * b1)
    return np.asarray(2 * np.arctan2(np.sqrt(x * x + y * y + z * z), scalar))


def attitude_error(result: Result, rows: slice = ALL) -> Array:
    """Return the angle between the attitude of the servicer and the reference attitude, 0 to pi,
    (rows,) [rad].
    """
    return _turned_from(result, rotation_angle, rows)


def position_error_H(result: Result) -> Array:
    """Return the position minus the reference position, both as the guidance publishes them, in
    Hill axes, (rows, 3) [m].
    """
    return np.asarray(result[POSITION_H[0]] - result[POSITION_H[1]])


def _relative_mrp(actual: Array, reference: Array) -> Array:
    """Return the modified Rodrigues parameters (rows, 3) of the rotation from `reference` to
    `actual`, both quaternions (rows, 4), with a rotation angle of at most 180 deg.
    """
    scalar = np.sum(actual * reference, axis=1)
    vector = reference[:, :1] * actual[:, 1:] - actual[:, :1] * reference[:, 1:]
    vector -= np.cross(reference[:, 1:], actual[:, 1:])
    sign = np.where(scalar < 0, -1.0, 1.0)
    return np.asarray((sign / (1 + np.abs(scalar)))[:, None] * vector)


def attitude_error_vector(result: Result) -> Array:
    """Return the attitude of S relative to D as modified Rodrigues parameters, |sigma| <= 1, (rows,
    3).
    """
    return _turned_from(result, _relative_mrp, ALL)


def force_H(result: Result) -> Array:
    """Return the force of the actuators on the servicer in axes of the target's Hill frame, (rows,
    3) [N].

    Axes: x radial outward, y along track, z orbit normal. Each row is converted from axes of the
    servicer with the attitude of the servicer in the same row.
    """
    r, v = result[TARGET], result[VELOCITIES[1]]
    normal = np.cross(r, v)
    axes = np.stack([r, np.cross(normal, r), normal], axis=1)
    axes /= np.linalg.norm(axes, axis=2)[:, :, None]
    return np.asarray(np.einsum("kij,kj->ki", axes, turned(result[ATTITUDE], result[FORCE_H[0]])))


def release_time(result: Result) -> float:
    """Return the time from which torques turn the servicer [s], infinite if they never do.

    It is the parameter t_att of the servicer. In a result without parameters it is the time of the
    row before the first angular velocity that is not zero.
    """
    if result.holds(parameters=(RELEASE,)):
        return float(result.parameter(RELEASE))
    turning = np.flatnonzero(result[RATE].any(axis=1)) if RATE in result else np.zeros(1, int)
    return float(result.time[max(0, turning[0] - 1)]) if len(turning) else float("inf")


def range_(result: Result) -> Array:
    """Return the distance between servicer and target, (rows,) [m]."""
    return norm(_relative(result))


def initial_range(result: Result) -> float:
    """Return the distance between servicer and target in the first row [m]."""
    return float(norm(result[SERVICER][:1] - result[TARGET][:1])[0])


def relative_speed(result: Result) -> Array:
    """Return the magnitude of the velocity of the servicer relative to the target, (rows,)
    [m/s].
    """
    return norm(minus(result[VELOCITIES[0]], result[VELOCITIES[1]]))


def _relative(result: Result, rows: slice = ALL) -> Array:
    return np.asarray(minus(result[SERVICER][rows], result[TARGET][rows]))


def _aligned(result: Result, error: Callable[[Array, Array], Array], rows: slice) -> Array:
    """Return error(position, reference position) for these rows, (rows, ...). The reference for
    each row is the one that the guidance computed from the states of this row. If
    the result contains it one row later (is_late()), it is taken from that row.
    """
    late = is_late(result, REFERENCE)
    return aligned(_relative(result, rows), result[REFERENCE][rows], error, late)


def _turned_from(result: Result, error: Callable[[Array, Array], Array], rows: slice) -> Array:
    """Return error(attitude, reference attitude) for these rows, (rows, ...). The reference for
    each row is the one that the guidance computed from the states of this row. It is taken from the
    next row where the result contains it only there (is_late()).
    """
    late = is_late(result, REFERENCE_ATTITUDE)
    return aligned(result[ATTITUDE][rows], result[REFERENCE_ATTITUDE][rows], error, late)
