# SPDX-License-Identifier: BSD-2-Clause
"""Metrics of a docked assembly: momentum of its gyros, attitude, tracking."""

from __future__ import annotations

import numpy as np

from harness.mission import Limits, Metric
from harness.results.result import Array, Result

from ..shared.live import first_time
from ..shared.metrics import SATURATED
from ..shared.relative_motion import rotation_angle

MOMENTUM, TURN = "assembly.h_cmg", "assembly.rotation"
ASSEMBLY = ("assembly.q_SH", "guidance.q_DH")


def attitude_error(result: Result) -> Array:
    """Return the angle between the attitude of the assembly and its reference, relative to H,
    (rows,) [rad].

    The guidance samples at the beginning of a step, so the reference for a row is in the next row.
    """
    errors = rotation_angle(result[ASSEMBLY[0]][:-1], result[ASSEMBLY[1]][1:])
    return np.concatenate((errors, errors[-1:]))


def _saturates(result: Result, _: Limits) -> float:
    """Return the time at which the gyros first cannot absorb the commanded momentum [s]; NaN if
    they always can.
    """
    rows = np.flatnonzero(result["assembly.saturated"])
    return float(result.time[rows[0]]) if len(rows) else float("nan")


def _tracking_error(result: Result, _: Limits) -> float:
    return float(np.degrees(attitude_error(result)).max())


def _live_error(result: Result, _: Limits) -> str:
    del result
    actual, reference = ASSEMBLY
    return f"max(degrees(next(angle(previous({actual}), {reference}))))"


METRICS = (
    SATURATED,
    Metric(
        "saturates at",
        "s",
        ("assembly.saturated",),
        _saturates,
        live=lambda _result, _limits: first_time("assembly.saturated != 0"),
    ),
    Metric("peak momentum", "N m s", (), f"max({MOMENTUM})"),
    Metric("largest rotation", "deg", (), f"max(degrees({TURN}))"),
    Metric("tracking error", "deg", ASSEMBLY, _tracking_error, live=_live_error),
)
