# SPDX-License-Identifier: BSD-2-Clause
"""Evaluations of the synchronised approach for the claims of Zhu & Yang 2009.

The evaluation of a claim returns first the value that decides on the verdict, then further values
that the report shows. The times of the simulation and the true inertias are taken from the paper,
not from the run.
"""

from __future__ import annotations

import numpy as np

from harness.mission.claim import NotExercisedError, NotJudgedError, at, final, since
from harness.results.result import Array, Result

from ..shared import relative_motion as derived

STOP = 1800.0
"""Duration of the paper's simulation [s]."""
APPROACHED = 600.0
"""Time at which the exponential part of the reference is over: exp(-600 s / 120 s) < 1 % [s]."""
ARM = 1200.0
"""Time from which the paper turns the arm to the target [s]."""
SLEW = 600.0
"""Time from the start of attitude control to the end of the paper's simulation [s]."""
ETA_S = np.array([200, 0, 0, 250, 0, 150, 12, 0, 0, 15, 0, 10])
"""True J11 J12 J13 J22 J23 J33 A11 A12 A13 A22 A23 A33 in the paper's case: elements of the inertia
matrices J of the body and A of the wheels [kg m2]."""
LARGEST = np.array([250.0] * 6 + [15.0] * 6)
"""For each element of ETA_S, the largest element of its matrix, J or A [kg m2]."""

RANGE, REFERENCE, BETA_T, BETA_P = (
    "guidance.range",
    "guidance.rho_ref_H",
    "guidance.beta_t",
    "guidance.beta_p",
)
MASS_ESTIMATE, ESTIMATES = "controller.m_hat", "controller.eta_hat"
TURNED = (derived.ATTITUDE, derived.REFERENCE_ATTITUDE, derived.RATE)
MASS, WHEELS = "servicer.mass", "servicer.wheel_speed"


# ---- histories


def size(result: Result, vector: str) -> Array:
    """Return the Euclidean norm of a vector at every row."""
    return np.asarray(np.linalg.norm(result[vector], axis=1))


def position_error(result: Result) -> Array:
    """Return the distance of the servicer from its reference position, (rows,) [m]."""
    return np.asarray(np.linalg.norm(derived.position_error_H(result), axis=1))


def attitude_error(result: Result) -> Array:
    """Return the rotation angle from the desired attitude D to the attitude S, (rows,) [deg]."""
    return np.asarray(np.degrees(derived.attitude_error(result)))


def safe_distance(result: Result) -> float:
    """Return rho_M, the final range of the reference [m]; raise NotJudgedError if the reference
    still moves by more than 1 cm in the last 100 s.
    """
    distance = size(result, REFERENCE)[final(result, 100.0, ARM)]
    if np.ptp(distance) > 0.01:
        raise NotJudgedError("the reference does not come to rest at a safe distance")
    return float(distance[-1])


def attitude_start(result: Result) -> float:
    """Return the time until which the attitude of the servicer is frozen [s]; raise
    NotExercisedError if the run ends before, NotJudgedError if the attitude remains frozen.
    """
    start = derived.release_time(result)
    end = float(result.time[-1])
    if np.isfinite(start) and start >= end:
        raise NotExercisedError(
            f"the run ends at {end:g} s, but the attitude is frozen until {start:g} s"
        )
    if not start < end:
        raise NotJudgedError("the attitude is not controlled in this run")
    return start


# ---- metrics


def arrival(result: Result) -> tuple[float, ...]:
    """Return the largest difference between range and safe distance rho_M after 20 min [m], then
    the range at the start, after 10 min, after 20 min and at the end [m].
    """
    distance = result[RANGE]
    off = np.abs(distance - safe_distance(result))[since(result, ARM, ARM)]
    return (
        off.max(),
        distance[0],
        distance[at(result, APPROACHED)],
        distance[at(result, ARM)],
        distance[-1],
    )


def shortfall(result: Result) -> tuple[float, ...]:
    """Return the amount by which the minimum range is below the safe distance rho_M (0 if it is
    not) [mm], the minimum range [m] and its time [s].
    """
    least = result[RANGE].argmin()
    distance = result[RANGE][least]
    return 1e3 * max(0.0, safe_distance(result) - distance), distance, result.time[least]


def grasp_axis_error(result: Result) -> tuple[float, ...]:
    """Return the largest angle between relative position and grasp axis after 10 min, and this
    angle at the start [deg].
    """
    angle = np.degrees(result[BETA_T])
    return angle[since(result, APPROACHED, ARM)].max(), angle[0]


def tracking_error(result: Result) -> tuple[float, ...]:
    """Return the largest position error after 10 min, and the position error at the start and at
    the end [m].
    """
    error = position_error(result)
    return error[since(result, APPROACHED, ARM)].max(), error[0], error[-1]


def force_rate(result: Result) -> tuple[float, ...]:
    """Return the largest change of the force per second in percent of the largest force [%/s], the
    force at the start [N], and the largest force [N].
    """
    since(result, 0.0, APPROACHED)
    force = derived.force_H(result)
    size = np.linalg.norm(force, axis=1)
    rate = np.linalg.norm(np.diff(force, axis=0), axis=1) / np.diff(result.time)
    return 100 * rate.max() / size.max(), size[0], size.max()


def mass_drift(result: Result) -> tuple[float, ...]:
    """Return the largest minus the smallest mass estimate of the last 10 min, and the estimate at
    the start and at the end [kg].
    """
    estimate = result[MASS_ESTIMATE]
    return np.ptp(estimate[final(result, 600.0, STOP)]), estimate[0], estimate[-1]


def mass_offset(result: Result) -> tuple[float, ...]:
    """Return the absolute difference between mass estimate and mass at the end, and both [kg]."""
    end = final(result, 0.0, STOP)[-1]
    estimate, true = result[MASS_ESTIMATE][end], result[MASS][end]
    return abs(estimate - true), estimate, true


def position_decay(result: Result) -> tuple[float, ...]:
    """Return the ratio of the largest position error of the last 10 min to the largest one of the
    10 min before; the earlier and the later error [mm].
    """
    error = 1e3 * position_error(result)
    late, early = (
        error[final(result, 600.0, STOP)].max(),
        error[final(result, 600.0, STOP, before=600.0)].max(),
    )
    return late / early, early, late


def attitude_end(result: Result) -> tuple[float, ...]:
    """Return the largest attitude error of the last 100 s, then the attitude error after 1, 2, 5
    and 10 min of attitude control [deg].
    """
    start, error = attitude_start(result), attitude_error(result)
    largest = error[final(result, 100.0, start + SLEW)].max()
    return largest, *(error[at(result, start + 60.0 * minutes)] for minutes in (1, 2, 5, 10))


def attitude_decay(result: Result) -> tuple[float, ...]:
    """Return the ratio of the largest attitude error of the last 100 s to the largest one of the
    100 s before; the earlier and the later error [deg].
    """
    end, error = attitude_start(result) + SLEW, attitude_error(result)
    late, early = (
        error[final(result, 100.0, end)].max(),
        error[final(result, 100.0, end, before=100.0)].max(),
    )
    return late / early, early, late


def wheel_speed(result: Result) -> tuple[float, ...]:
    """Return the largest wheel speed of the run, and of its last 100 s [rad/s]."""
    last = final(result, 100.0, attitude_start(result) + SLEW)
    speed = np.abs(result[WHEELS])
    return speed.max(), speed[last].max()


def inertia_drift(result: Result) -> tuple[float, ...]:
    """Return three changes of inertia estimates in the last 100 s: the largest change of an element
    in percent of the largest element of its matrix, then the largest change of an element of J and
    the largest change of an element of A [kg m2].
    """
    moved = np.ptp(result[ESTIMATES][final(result, 100.0, attitude_start(result) + SLEW)], axis=0)
    return 100 * (moved / LARGEST).max(), moved[:6].max(), moved[6:].max()


def inertia_offset(result: Result) -> tuple[float, ...]:
    """Return three errors of inertia estimates at the end: the largest error of an element in
    percent of the largest element of its matrix, then the largest error of an element of J and the
    largest error of an element of A [kg m2].
    """
    off = np.abs(result[ESTIMATES][final(result, 0.0, attitude_start(result) + SLEW)][-1] - ETA_S)
    return 100 * (off / LARGEST).max(), off[:6].max(), off[6:].max()


def grasp_share(result: Result) -> tuple[float, ...]:
    """Return the share of the last 200 s in which the target can be grasped [%], and the largest
    angle beta_p between the arm and the direction to the target in these 200 s [deg].

    The target can be grasped if the range is within 5 cm of the safe distance rho_M, the relative
    position within 1 deg of the grasp axis (angle beta_t), and beta_p is at most 5 deg.
    """
    last = final(result, 200.0, attitude_start(result) + SLEW)
    near = np.abs(result[RANGE] - safe_distance(result)) <= 0.05
    facing = (np.degrees(result[BETA_T]) <= 1.0) & (np.degrees(result[BETA_P]) <= 5.0)
    return 100 * float(np.mean((near & facing)[last])), np.degrees(result[BETA_P][last]).max()
