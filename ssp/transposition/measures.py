# SPDX-License-Identifier: BSD-2-Clause
"""Measures of a docked assembly: momentum of its gyros, attitude, tracking."""

from __future__ import annotations

import numpy as np

from harness.mission import Limits, Measure
from harness.results.result import Result

from ..shared.measures import SATURATED
from .tracking import ASSEMBLY, attitude_error

MOMENTUM, TURN = "assembly.h_cmg", "assembly.rotation"


def _saturates(result: Result, _: Limits) -> float:
    """Time at which the gyros first have less momentum left than is asked for [s]; NaN if never."""
    rows = np.flatnonzero(result["assembly.saturated"])
    return float(result.time[rows[0]]) if len(rows) else float("nan")


def _tracking_error(result: Result, _: Limits) -> float:
    return float(np.degrees(attitude_error(result)).max())


MEASURES = (
    SATURATED,
    Measure("saturates at", "s", ("assembly.saturated",), _saturates),
    Measure("peak momentum", "N m s", (MOMENTUM,), lambda r, _: float(r[MOMENTUM].max())),
    Measure("largest rotation", "deg", (TURN,), lambda r, _: float(np.degrees(r[TURN]).max())),
    Measure("tracking error", "deg", ASSEMBLY, _tracking_error),
)
