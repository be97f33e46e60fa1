# SPDX-License-Identifier: BSD-2-Clause
"""Quantities of an approach that are shown while it goes on."""

from __future__ import annotations

import numpy as np

from harness.mission import Gauge
from harness.results.result import Result

from . import relative_motion as motion

PLACES = (motion.SERVICER, motion.TARGET)


def _attitude(result: Result) -> str:
    """Whether the attitude of the servicer is still frozen, where it is at first."""
    release = motion.release_time(result)
    if release <= result.time[0]:
        return ""
    return "free" if result.time[-1] >= release else f"frozen until {release:g} s"


GAUGES = (
    Gauge("range", "m", PLACES, motion.range_),
    Gauge("speed", "m/s", motion.VELOCITIES, motion.relative_speed),
    Gauge("position error", "m", (*PLACES, motion.REFERENCE), motion.position_error),
    Gauge(
        "attitude error",
        "deg",
        (motion.ATTITUDE, motion.REFERENCE_ATTITUDE),
        lambda result: np.degrees(motion.attitude_error(result)),
    ),
    Gauge("mode", "", (), "guidance.mode"),
    Gauge("phase", "", (), "controller.phase"),
    Gauge("abort", "", (), "monitor.abort"),
    Gauge("impulse", "N s", (), "propulsion.impulse"),
    Gauge("attitude", "", (motion.ATTITUDE,), _attitude),
)
