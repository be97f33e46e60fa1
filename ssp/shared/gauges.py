# SPDX-License-Identifier: BSD-2-Clause
"""Quantities of an approach that are shown while it goes on."""

from __future__ import annotations

from harness.mission import Gauge
from harness.mission.figure import DEGREES
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
    Gauge("range", "m", motion.range_, PLACES),
    Gauge("speed", "m/s", motion.relative_speed, motion.VELOCITIES),
    Gauge("position error", "m", motion.position_error, (*PLACES, motion.REFERENCE)),
    Gauge(
        "attitude error",
        "deg",
        motion.attitude_error,
        (motion.ATTITUDE, motion.REFERENCE_ATTITUDE),
        DEGREES,
    ),
    Gauge("mode", "", "guidance.mode"),
    Gauge("phase", "", "controller.phase"),
    Gauge("abort", "", "monitor.abort"),
    Gauge("impulse", "N s", "propulsion.impulse"),
    Gauge("attitude", "", _attitude, (motion.ATTITUDE,)),
)
