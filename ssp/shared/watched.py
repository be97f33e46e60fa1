# SPDX-License-Identifier: BSD-2-Clause
"""Metrics of an approach that `harness run --watch` shows during a run."""

from __future__ import annotations

import numpy as np

from harness.mission import WatchedMetric
from harness.results.result import Result

from . import relative_motion as motion

PLACES = (motion.SERVICER, motion.TARGET)


def _attitude(result: Result) -> str:
    """Return "frozen until ..." or "free" for the attitude of the servicer in the last row; "" if
    the attitude is free from the start.
    """
    release = motion.release_time(result)
    if release <= result.time[0]:
        return ""
    return "free" if result.time[-1] >= release else f"frozen until {release:g} s"


WATCHED = (
    WatchedMetric("range", "m", PLACES, motion.range_),
    WatchedMetric("speed", "m/s", motion.VELOCITIES, motion.relative_speed),
    WatchedMetric("position error", "m", (*PLACES, motion.REFERENCE), motion.position_error),
    WatchedMetric(
        "attitude error",
        "deg",
        (motion.ATTITUDE, motion.REFERENCE_ATTITUDE),
        lambda result: np.degrees(motion.attitude_error(result)),
    ),
    WatchedMetric("mode", "", (), "guidance.mode"),
    WatchedMetric("phase", "", (), "controller.phase"),
    WatchedMetric("abort", "", (), "monitor.abort"),
    WatchedMetric("impulse", "N s", (), "propulsion.impulse"),
    WatchedMetric("attitude", "", (motion.ATTITUDE,), _attitude),
)
