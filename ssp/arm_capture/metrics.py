# SPDX-License-Identifier: BSD-2-Clause
"""Metrics of the capture by arm."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.mission import Metric
from harness.results.result import Result

from ..shared.live import first_time

MODE, TIP = "arm_guidance.arm_mode", "arm_guidance.position_error"
PLACE, ATTITUDE = "controller.e1_H", "controller.epsilon"
DEPLOY, ALIGN, CLOSE, REST = 1, 2, 3, 4


def during(result: Result, *modes: int) -> NDArray[np.bool_]:
    """Return a mask of the rows in which `arm_guidance.arm_mode` is one of `modes`."""
    return np.isin(result[MODE], modes)


def late(result: Result) -> NDArray[np.bool_]:
    """Return a mask of the rows in the second half of the closing motion of the arm, from T_close/2
    to T_close after the start of the mode CLOSE.
    """
    closing, half = during(result, CLOSE), result.parameter("arm_guidance.T_close") / 2
    since = result.time - (result.time[closing][0] if closing.any() else np.inf)
    return closing & (since >= half) & (since <= 2 * half)


def largest(values: NDArray[np.float64]) -> float:
    """Return the largest of the values (rows,), NaN if there are no rows."""
    return float(values.max()) if len(values) else float("nan")


def rms(values: NDArray[np.float64]) -> float:
    """Return the root mean square of the values (rows,), NaN if there are no rows."""
    return float(np.sqrt(np.mean(values**2))) if len(values) else float("nan")


def turned(result: Result) -> NDArray[np.float64]:
    """Return the angle of the base from the reference attitude of the controller (rows,) [rad]."""
    return np.asarray(4 * np.arctan(np.linalg.norm(result[ATTITUDE], axis=1)))


def off(result: Result) -> NDArray[np.float64]:
    """Return the distance of the base from the reference position of the controller (rows,) [m]."""
    return np.asarray(np.linalg.norm(result[PLACE], axis=1))


def first(result: Result, name: str, value: float) -> float:
    """Return the time [s] of the first row in which a variable is at least `value`, else NaN."""
    rows = np.flatnonzero(result[name] >= value)
    return float(result.time[rows[0]]) if len(rows) else float("nan")


def missed(result: Result) -> float:
    """Return the true distance of the end effector E from its seat in the fixture when the gripper
    closes [m]; NaN without a grip.
    """
    rows = np.flatnonzero(result["arm_guidance.grip"] >= 1)
    seat = (-float(result.parameter("arm_guidance.seat_depth")), 0, 0)
    return float(np.linalg.norm(result["mechanism.tip_Q"][rows[0]] - seat)) if len(rows) else np.nan


TURNED = f"angle(mrp({ATTITUDE}), mrp(0 * {ATTITUDE}))"


def _largest(text: str, *modes: int) -> str:
    """Return the expression of the largest value in the rows in which the arm is in one of these
    modes. Without such rows the expression gives NaN (0 / 0). text: expression of the largest
    value, in which {0} is replaced by the condition that the arm is in one of the modes.
    """
    inside = f"({' or '.join(f'{MODE} == {mode}' for mode in modes)})"
    return f"{text.format(inside)} / max({inside})"


def _begins(name: str, flag: str) -> Metric:
    """Return the metric `name`: the time at which the variable `flag` first is 1 [s]."""
    return Metric(
        name,
        "s",
        (flag,),
        lambda r, _: first(r, flag, 1),
        live=lambda _result, _limits: first_time(f"{flag} >= 1"),
    )


METRICS = (
    Metric(
        "tip error, aligning and closing",
        "mm",
        (),
        _largest(f"1000 * max({TIP} * {{0}})", ALIGN, CLOSE),
    ),
    Metric(
        "tip error, late",
        "mm rms",
        (MODE, TIP),
        lambda r, _: 1e3 * rms(r[TIP][late(r)]),
        ("arm_guidance.T_close",),
    ),
    Metric(
        "base attitude, deploying",
        "deg",
        (MODE, ATTITUDE),
        lambda r, _: float(np.degrees(largest(turned(r)[during(r, DEPLOY)]))),
        live=lambda _result, _limits: _largest(f"max(degrees({TURNED}) * {{0}})", DEPLOY),
    ),
    Metric(
        "base position, deploying",
        "mm",
        (),
        _largest(f"1000 * max(norm({PLACE}) * {{0}})", DEPLOY),
    ),
    Metric(
        "miss at the grip",
        "mm",
        ("arm_guidance.grip", "mechanism.tip_Q"),
        lambda r, _: 1e3 * missed(r),
        ("arm_guidance.seat_depth",),
    ),
    _begins("grip", "arm_guidance.grip"),
    _begins("hard capture", "mechanism.hard"),
    Metric("load of the gripper", "N", (), "max(mechanism.load_force)"),
)
