# SPDX-License-Identifier: BSD-2-Clause
"""Evaluations of the transposition for the claims of the patent of Zhang et al. 2016.

The evaluation of a claim returns first the value that decides on the verdict, then further values
that the report shows. "Saturation" is the momentum H_sat at which the plan assumes that the gyros
saturate; the window is the time span that the plan covers. The patent states neither.
"""

from __future__ import annotations

import numpy as np

from harness.mission.claim import NotJudgedError, final, parameter, scalar, since
from harness.results.result import Array, Result

from ..shared.relative_motion import rotation_angle

ATTITUDE, RATE, MOMENTUM = "assembly.q_SH", "assembly.omega_SN_S", "assembly.h_cmg_S"
SHARE, ROTATION, RELATIVE_RATE = (
    "assembly.momentum_share",
    "assembly.rotation",
    "assembly.omega_SH_S",
)
INERTIAL, TOTAL, INERTIA = "assembly.q_SN", "assembly.h_total_N", "assembly.J_A"
GRAVITY, AIR = "assembly.M_gravity_S", "assembly.M_aero_S"
ARM = ("assembly.arm_angle", "assembly.arm_rate", "assembly.arm_accel")
REFERENCE, PREDICTED = "guidance.q_DH", "guidance.h_ref_D"
STATUS, ITERATIONS, PEAK = "guidance.status", "guidance.iterations", "guidance.peak"
MASSES, HINGE, MODULE = (
    ("assembly.m0", "assembly.m1"),
    "assembly.hinge",
    "assembly.module",
)


# ---- histories


def size(rows: Array) -> Array:
    """Return the Euclidean norm of every row."""
    return np.asarray(np.linalg.norm(rows, axis=1))


def window(result: Result) -> float:
    """Return the time at which the time span that the plan covers (window) ends [s]."""
    return scalar(result, "guidance.window_start") + scalar(result, "guidance.window")


def saturation(result: Result) -> float:
    """Return the momentum at which the plan assumes that the gyros saturate [N m s]."""
    return scalar(result, "guidance.H_sat")


def tracking(result: Result) -> Array:
    """Return the angle between the attitude at every sample and the reference for this sample,
    which the result contains in the next row [deg].
    """
    if len(result.time) < 2:
        raise NotJudgedError("the result has one row; the tracking error needs two or more")
    return np.asarray(np.degrees(rotation_angle(result[ATTITUDE][:-1], result[REFERENCE][1:])))


def to_body(q: Array, v: Array) -> Array:
    """Return vectors v (rows, 3) in the axes of a body; q: attitudes of the body (rows, 4) relative
    to the axes of v.
    """
    w, u = q[:, :1], -q[:, 1:]
    return np.asarray(v + 2 * np.cross(u, np.cross(u, v) + w * v))


def to_inertial(q: Array, v: Array) -> Array:
    """Return vectors (rows, 3) in inertial axes; v: in the axes of a body with attitudes q."""
    return to_body(q * np.array([1, -1, -1, -1]), v)


def module_motion(result: Result) -> tuple[Array, Array, Array]:
    """Return position [m], velocity [m/s] and acceleration [m/s2] of the centre of mass of the
    module relative to the centre of mass of the base, as seen in the base, (rows, 3) each, in base
    axes.
    """
    angle, rate, acceleration = (result[name] for name in ARM)
    x, y, z = parameter(result, MODULE)
    c, s, zero = np.cos(angle), np.sin(angle), 0 * angle
    arm = np.column_stack((c * x - s * y, s * x + c * y, zero + z))
    across = np.column_stack((-arm[:, 1], arm[:, 0], zero))
    inward = arm * np.array([-1, -1, 0])
    return (
        parameter(result, HINGE) + arm,
        rate[:, None] * across,
        acceleration[:, None] * across + rate[:, None] ** 2 * inward,
    )


# ---- metrics


def peak_share(result: Result) -> tuple[float, ...]:
    """Return the momentum of the gyros: its largest share of their capacity, which is the largest
    momentum that they can have in the same direction; its largest magnitude [N m s]; and the time
    of the largest share [s].
    """
    rows = since(result, 0.0, window(result))
    share, momentum = result[SHARE][rows], size(result[MOMENTUM][rows])
    return share.max(), momentum.max(), result.time[rows][share.argmax()]


def first_peak(result: Result) -> tuple[float, ...]:
    """Return the largest momentum that the gyros would need if the nominal attitude were held, as a
    share of saturation and in N m s.
    """
    first = result[PEAK][0, 0]
    if first == 0:
        raise NotJudgedError(
            "guidance.peak is 0: nothing was planned (needs guidance.use_plan = 1)"
        )
    return first / saturation(result), first


def last_peak(result: Result) -> tuple[float, ...]:
    """Return the largest momentum that the planned attitude history needs, as a share of
    saturation; the number of planning steps; this momentum before the first step and after the last
    one [N m s].
    """
    if result[STATUS][0] == 1:
        raise NotJudgedError(
            "guidance.status is 1: nothing was planned (needs guidance.use_plan = 1)"
        )
    count = int(result[ITERATIONS][0])
    peaks = result[PEAK][0, : count + 1]
    return peaks[-1] / saturation(result), count, peaks[0], peaks[-1]


def descent(result: Result) -> tuple[float, ...]:
    """Return the largest factor by which a planning step changes the peak, which is the largest
    momentum that the planned attitude history needs; and the number of steps. A factor below 1
    means that every step reduces the peak.
    """
    count = int(result[ITERATIONS][0])
    if count == 0:
        raise NotJudgedError("the planner took no step in this run")
    peaks = result[PEAK][0, : count + 1]
    return float(np.max(peaks[1:] / peaks[:-1])), count


def tracking_error(result: Result) -> tuple[float, ...]:
    """Return the largest angle from the reference attitude [deg], its time [s], and the angle in
    the last row but one, the last with a reference [deg].
    """
    error = tracking(result)[since(result, 0.0, window(result))[:-1]]
    return error.max(), result.time[error.argmax()], error[-1]


def end_attitude(result: Result) -> tuple[float, ...]:
    """Return the rotation from the nominal attitude [deg], the rate relative to H [deg/s] and the
    angle of the arm [deg], in the last row. Raise NotExercisedError if the run ends before the end
    of the window.
    """
    rows = final(result, 0.0, window(result))
    rate = np.degrees(size(result[RELATIVE_RATE][rows]))
    arm = np.degrees(result[ARM[0]][-1])
    return np.degrees(result[ROTATION][rows]).max(), rate.max(), arm


def prediction_error(result: Result) -> tuple[float, ...]:
    """Return the largest difference between the momentum of the gyros and its prediction, in
    percent of saturation and in N m s.
    """
    rows = since(result, 0.0, window(result))[:-1]
    off = size(result[MOMENTUM][rows] - result[PREDICTED][rows + 1]).max()
    return 100 * off / saturation(result), off


def balance_error(result: Result) -> tuple[float, ...]:
    """Return two magnitudes: the largest difference between the change of the total momentum since
    the start and the integral of the external torques, in parts per million of saturation
    (H_sat); and this integral at the end [N m s]. The integral is computed by Simpson's rule, every
    second row.
    """
    since(result, 0.0, window(result))
    torque = to_inertial(result[INERTIAL], result[GRAVITY] + result[AIR])
    step = np.diff(result.time)
    if not np.allclose(step, step[0], rtol=1e-6):
        raise NotJudgedError("the rows are not equally spaced in time, which Simpson's rule needs")
    pairs = (torque[:-2:2] + 4 * torque[1:-1:2] + torque[2::2]) * step[0] / 3
    gained = np.cumsum(pairs, axis=0)
    total = result[TOTAL][2::2][: len(gained)] - result[TOTAL][0]
    return 1e6 * size(total - gained).max() / saturation(result), size(gained)[-1]


def printed_equation_error(result: Result) -> tuple[float, ...]:
    """Return the largest momentum error of the equation as printed in the patent, in percent of
    saturation, and the largest torque error [N m].

    The momentum error is the integral of the torque error, which is the difference between the
    printed term 2 m_r R x (R' x omega) and the correct term m_r R x V'. R, V = R' and V': results
    of module_motion(), m_r: reduced mass, omega: angular velocity of the base.
    """
    since(result, 0.0, window(result))
    m0, m1 = (scalar(result, name) for name in MASSES)
    R, V, dV = module_motion(result)
    printed = 2 * np.cross(R, np.cross(V, result[RATE]))
    off = m0 * m1 / (m0 + m1) * (np.cross(R, dV) - printed)
    turned = to_inertial(result[INERTIAL], off)
    steps = np.diff(result.time)[:, None] * (turned[1:] + turned[:-1]) / 2
    drift = size(np.cumsum(steps, axis=0))
    return 100 * drift.max() / saturation(result), size(off).max()


def gains(result: Result) -> tuple[float, ...]:
    """Return the smaller of the gains k1 and k2 of the control law that the run uses (corrected, or
    as printed in the patent), 0 if one is not a whole number, then k1 and k2.
    """
    k1 = scalar(result, "controller.k1")
    corrected = scalar(result, "controller.law") != 0
    k2 = scalar(result, "controller.k2" if corrected else "controller.k2_printed")
    return min(k1, k2) if k1.is_integer() and k2.is_integer() else 0.0, k1, k2
