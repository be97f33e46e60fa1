# SPDX-License-Identifier: BSD-2-Clause
"""Evaluations of the relay approach for the claims of Kozlova & Fomichev 2023.

The evaluation of a claim returns first the value that decides on the verdict, then further values
that the report shows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.mission.claim import NotExercisedError, NotJudgedError, final
from harness.results.result import Array, Result

RANGE, TRANSITION = "guidance.range", "guidance.q_DS"
VELOCITIES = ("servicer.v_SN_N", "target.v_TN_N")
RATE_ERROR, IMPULSE = "controller.domega_S", "propulsion.impulse"

STOP = 40000.0
"""Duration of the run [s], which the paper does not state."""
HOLD = 50.0
"""Range at which the servicer of the paper stays [m]."""
CAPTURE = 1000.0
"""Time after the arrival at HOLD from which the servicer counts as staying there [s]."""
ALIGNED = 2000.0
"""Time after the start at which the first alignment is over, and time before the arrival at which
the first leg ends [s].
"""
IN_ORBIT = 100.0
"""Speed of the target [m/s] above which it is on an orbit. The speeds of the paper refer to a frame
that moves along the orbit, and the result of such a run does not contain them.
"""


# ---- histories


def speeds(result: Result) -> tuple[Array, Array]:
    """Return the speeds of servicer and target in the frame of the paper, (rows,) each [m/s]; raise
    NotJudgedError if the target is on an orbit.
    """
    servicer, target = (np.linalg.norm(result[name], axis=1) for name in VELOCITIES)
    if target.max() > IN_ORBIT:
        raise NotJudgedError(
            "the target is on an orbit: the speeds of the paper refer to a frame that moves along "
            "this orbit, and the result does not contain them"
        )
    return np.asarray(servicer), np.asarray(target)


def arrival_time(result: Result) -> float:
    """Return the time at which the range is first at most HOLD [s]; raise NotJudgedError if it
    never is.
    """
    there = np.flatnonzero(result[RANGE] <= HOLD)
    if not len(there):
        raise NotJudgedError(f"the range has not reached {HOLD:g} m by {result.time[-1]:g} s")
    return float(result.time[there[0]])


def first_leg(result: Result) -> NDArray[np.bool_]:
    """Return a mask of the rows of the first leg, from the end of the first alignment to ALIGNED
    seconds before the arrival; raise NotJudgedError if there are none.
    """
    leg = np.asarray((result.time >= ALIGNED) & (result.time <= arrival_time(result) - ALIGNED))
    if not leg.any():
        raise NotJudgedError(f"no first leg: the arrival is before {2 * ALIGNED:g} s")
    return leg


def hold(result: Result) -> NDArray[np.bool_]:
    """Return a mask of the rows in which the servicer stays at HOLD; raise NotExercisedError if
    the run ends less than 2000 s after the first of these rows.
    """
    held = np.asarray(result.time >= arrival_time(result) + CAPTURE)
    if result.time[-1] < arrival_time(result) + CAPTURE + ALIGNED:
        raise NotExercisedError(
            f"the run ends at {result.time[-1]:g} s, less than 3000 s after the arrival"
        )
    return held


# ---- metrics


def arrival(result: Result) -> tuple[float, ...]:
    """Return the time of arrival at 50 m [s] and the range at the start [m]."""
    return arrival_time(result), result[RANGE][0]


def speed_ripple(result: Result) -> tuple[float, ...]:
    """Return the largest minus the smallest speed of the servicer in the first leg, divided by its
    mean [%], and the mean [m/s].
    """
    leg = speeds(result)[0][first_leg(result)]
    return 100 * np.ptp(leg) / leg.mean(), leg.mean()


def approach_speed(result: Result) -> tuple[float, ...]:
    """Return the mean speed of the servicer in the first leg, divided by twice the mean speed of
    the target (the speed that the paper states), and the mean speed of the servicer [m/s].
    """
    servicer, target = speeds(result)
    leg = servicer[first_leg(result)].mean()
    return leg / (2 * target.mean()), leg


def hold_error(result: Result) -> tuple[float, ...]:
    """Return the largest difference between the range and HOLD while the servicer stays there, and
    the least and the largest range in this time [m].
    """
    distance = result[RANGE][hold(result)]
    return np.abs(distance - HOLD).max(), distance.min(), distance.max()


def hold_speed(result: Result) -> tuple[float, ...]:
    """Return the mean speed of the servicer while it stays at HOLD, divided by the mean speed of
    the target, and the mean speed of the servicer [m/s].
    """
    servicer, target = (speed[hold(result)].mean() for speed in speeds(result))
    return servicer / target, servicer


def heading(result: Result) -> tuple[float, ...]:
    """Return the mean angle between the velocities of servicer and target in the last 2000 s of the
    hold [deg].
    """
    hold(result)
    speeds(result)
    rows = final(result, 2000.0, arrival_time(result) + CAPTURE)
    v_S, v_T = (result[name][rows] for name in VELOCITIES)
    angle = np.arctan2(np.linalg.norm(np.cross(v_S, v_T), axis=1), (v_S * v_T).sum(axis=1))
    return (np.degrees(angle).mean(),)


def rate_error(result: Result) -> tuple[float, ...]:
    """Return the root mean square and the maximum of the difference between the required and
    the actual angular rate of the servicer after 2000 s [mrad/s]; raise NotExercisedError if the
    run ends before 3000 s.
    """
    if result.time[-1] < ALIGNED + CAPTURE:
        raise NotExercisedError(
            f"the run ends at {result.time[-1]:g} s, before {ALIGNED + CAPTURE:g} s"
        )
    size = np.linalg.norm(result[RATE_ERROR][result.time >= ALIGNED], axis=1)
    return 1e3 * np.sqrt((size**2).mean()), 1e3 * size.max()


def transition_angle(result: Result) -> tuple[float, ...]:
    """Return the largest rotation angle [deg] and the least scalar part L0 of the transition
    quaternion in the last 5000 s.
    """
    L = result[TRANSITION][final(result, 5000.0, 6000.0)]
    angle = np.degrees(2 * np.arctan2(np.linalg.norm(L[:, 1:], axis=1), L[:, 0]))
    return angle.max(), L[:, 0].min()
