# SPDX-License-Identifier: BSD-2-Clause
"""Claims about the arm in two groups. The claims of the first group are from the paper on the
synchronised approach, and concern the grasp by an arm after this approach. The claims of the
second group are results of an independent simulation of the control laws of arm_capture.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.mission.claim import (
    Band,
    Case,
    Claim,
    Evaluation,
    NotExercisedError,
    Paper,
    at_least,
    at_most,
)
from harness.results.histories import turned as rotated
from harness.results.result import Array, Result

from ..shared.relative_motion import SERVICER, TARGET
from .kinematics import ARM, arm_of
from .metrics import (
    ALIGN,
    ATTITUDE,
    CLOSE,
    DEPLOY,
    MODE,
    PLACE,
    REST,
    TIP,
    during,
    first,
    largest,
    late,
    off,
    rms,
    turned,
)

GRIP, HARD, LOCK = "arm_guidance.grip", "mechanism.hard", "arm_controller.joint_lock"
FIXTURE, SPEED, T_CLOSE = "arm_guidance.p_QT_T", "arm_guidance.grip_speed", "arm_guidance.T_close"
BODIES = (SERVICER, TARGET, "servicer.q_SN", "target.q_TN")
RATES = ("servicer.omega_SN_S", "target.omega_TN_T")
START = 1e-6
"""Largest attitude error at which the base counts as starting at its reference attitude [rad]."""


def _once(result: Result, name: str, what: str) -> float:
    time = first(result, name, 1)
    if not np.isfinite(time):
        raise NotExercisedError(f"no {what}")
    return time


# ---- the paper of the synchronised approach


def fixture(result: Result) -> Array:
    """Return the position of the grapple fixture relative to the origin S of the base, in base
    axes, (rows, 3) [m].
    """
    place = np.tile(result.parameter(FIXTURE), (len(result.time), 1))
    from_S = result[TARGET] + rotated(result["target.q_TN"], place) - result[SERVICER]
    return np.asarray(rotated(result["servicer.q_SN"] * (1, -1, -1, -1), from_S))


def reaching(result: Result) -> Array:
    """Return a mask of the rows from the first motion of the arm to the grip, or to the end; raise
    NotExercisedError if the arm does not move.
    """
    out = result[MODE] >= DEPLOY
    if not out.any():
        raise NotExercisedError("the arm never leaves its stowed position")
    free = result[GRIP] < 1
    return np.asarray(np.maximum.accumulate(out) & np.minimum.accumulate(free))


def within_reach(result: Result) -> tuple[float, ...]:
    """Return three values for the time before the grip: the ratio of the next two, the largest
    distance of the fixture from the second joint of the arm [m], and the length of the arm from
    that joint on [m].
    """
    arm, rows = arm_of(result), reaching(result)
    length = float(np.linalg.norm([*arm.offset[2:], arm.tip], axis=1).sum())
    far = np.linalg.norm(fixture(result)[rows] - arm.offset[:2].sum(axis=0), axis=1).max()
    return float(far) / length, float(far), length


def at_any_time(result: Result) -> tuple[float, ...]:
    """Return the share of the rows in which an arm at rest could grip, that is, in which the
    fixture moves relative to the base no faster than the gripper permits, and the largest speed of
    the fixture relative to the base [m/s].
    """
    rows = reaching(result)
    if rows.sum() < 3:
        raise NotExercisedError("fewer than 3 rows from the first motion of the arm to the grip")
    v = np.gradient(fixture(result)[rows], result.time[rows], axis=0)
    speed = np.linalg.norm(v, axis=1)
    return float(np.mean(speed <= float(result.parameter(SPEED)))), float(speed.max())


APPROACH = Paper(
    title="Synchronised approach: claims of the paper about a grasp by an arm",
    needs=(MODE, GRIP, *BODIES),
    parameters=(*ARM, FIXTURE, SPEED),
    meant=lambda result: bool((result[MODE] >= DEPLOY).any()),
    claims=(
        Claim(
            "within reach",
            "the range shrinks until the target is within reach of the arm and is then maintained",
            "abstract",
            (MODE, GRIP, *BODIES),
            within_reach,
            "fixture at most {1:.2f} m from the second joint; arm of {2:.2f} m from there",
            "",
            at_most(0.95),
            at_most(1.0),
        ),
        Claim(
            "grasped at any time",
            "once the attitude error has converged, the target can be grasped at any time",
            "section 3",
            (MODE, GRIP, *BODIES),
            at_any_time,
            "an arm that stands still could grip in {0:.0%} of the time; the fixture moves by up "
            "to {1:.1g} m/s",
            "",
            at_least(1.0),
            at_least(0.5),
            interval=1.0,
        ),
    ),
)


# ---- independent simulation of the same laws


def deploying(result: Result) -> NDArray[np.bool_]:
    """Return a mask of the rows in which the arm deploys; raise NotExercisedError if the base does
    not start at its reference attitude.
    """
    if turned(result)[0] > START:
        raise NotExercisedError("the base does not start at its reference attitude")
    return during(result, DEPLOY)


def base_turned(result: Result) -> tuple[float, ...]:
    """Return the largest attitude error of the base while the arm deploys [deg]."""
    return (float(np.degrees(largest(turned(result)[deploying(result)]))),)


def base_shifted(result: Result) -> tuple[float, ...]:
    """Return the largest position error of the base while the arm deploys [mm]."""
    return (1e3 * largest(off(result)[deploying(result)]),)


def tip_largest(result: Result) -> tuple[float, ...]:
    """Return the largest position error of the end effector E in the modes ALIGN and CLOSE [mm]."""
    rows = during(result, ALIGN, CLOSE)
    if not rows.any():
        raise NotExercisedError("the arm is never in mode ALIGN or CLOSE")
    return (1e3 * largest(result[TIP][rows]),)


def tip_late(result: Result) -> tuple[float, ...]:
    """Return the root mean square of the position error of the end effector in the second half of
    the mode CLOSE [mm].
    """
    rows = late(result)
    if not rows.any():
        raise NotExercisedError("the arm has no row in the second half of the mode CLOSE")
    return (1e3 * rms(result[TIP][rows]),)


def grip(result: Result) -> tuple[float, ...]:
    """Return the time from the start of ALIGN to the grip [s]."""
    time = _once(result, GRIP, "grip")
    return (time - float(result.time[during(result, ALIGN)][0]),)


def locked_after(result: Result) -> tuple[float, ...]:
    """Return the time from the grip to the closing of the joint brakes [s]."""
    time = _once(result, GRIP, "grip")
    braked = (result[LOCK][:, 0] == 1) & during(result, REST) & (result.time >= time)
    if not braked.any():
        raise NotExercisedError("the joint brakes do not close after the grip")
    return (float(result.time[braked][0]) - time,)


def hard_after(result: Result) -> tuple[float, ...]:
    """Return the time from the grip to hard capture [s]."""
    return (_once(result, HARD, "hard capture") - _once(result, GRIP, "grip"),)


def stack_rate(result: Result) -> tuple[float, ...]:
    """Return the magnitudes of the angular rates of servicer and target at hard capture [rad/s]."""
    row = np.searchsorted(result.time, _once(result, HARD, "hard capture"))
    rates = (float(np.linalg.norm(result[name][row])) for name in RATES)
    return tuple(rates)


def _line(  # noqa: PLR0913, PLR0917 - the columns of the table
    name: str, there: str, evaluation: Evaluation, figure: str, unit: str, band: Band, *needs: str
) -> Claim:
    return Claim(name, f"{name}: {there}", "table", (MODE, *needs), evaluation, figure, unit, band,
                 interval=0.2)  # fmt: skip


INDEPENDENT = Paper(
    title="Capture by the arm (independent simulation of the same laws)",
    needs=(MODE, TIP, GRIP, HARD, LOCK),
    parameters=(T_CLOSE,),
    meant=lambda result: bool((result[MODE] >= DEPLOY).any()),
    cases=(
        Case("arm_capture", free=("stop",)),
        Case("arm_capture", "clean"),
        Case("arm_capture", "fast"),
        Case("arm_capture", "friction"),
    ),
    claims=(
        _line("base attitude in deployment", "0.039 deg", base_turned, "{0:.3f} deg", "deg",
              Band(0.037, 0.041), ATTITUDE),
        _line("base position in deployment", "14.6 mm", base_shifted, "{0:.1f} mm", "mm",
              Band(13.9, 15.3), PLACE),
        _line("tip error, aligning and closing", "0.040 mm", tip_largest, "{0:.3f} mm", "mm",
              at_most(0.1), TIP),
        _line("tip error, late", "0.028 mm rms", tip_late, "{0:.3f} mm", "mm", at_most(0.05), TIP),
        _line("grip", "56.3 s after ALIGN", grip, "{0:.2f} s", "s", Band(50, 65), GRIP),
        _line("brakes", "2.0 s after the grip", locked_after, "{0:.2f} s", "s", Band(1.9, 2.1),
              GRIP, LOCK),
        _line("hard capture", "15.0 s after the grip", hard_after, "{0:.2f} s", "s",
              Band(12, 18), GRIP, HARD),
        _line("rate of the stack", "0.0166 rad/s at hard capture", stack_rate,
              "servicer {0:.4f}, target {1:.4f} rad/s", "rad/s", Band(0.0163, 0.0169), HARD,
              *RATES),
    ),
)  # fmt: skip

PAPERS = (APPROACH, INDEPENDENT)
