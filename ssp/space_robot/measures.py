# SPDX-License-Identifier: BSD-2-Clause
"""Measures of the pitch motion of the robot."""

from __future__ import annotations

from harness.mission import Measure

from ..shared.measures import SATURATED
from . import pitch

MEASURES = (
    SATURATED,
    Measure("pitch swing", "deg", (pitch.PITCH,), lambda r, _: pitch.swing(r)),
    Measure(
        "rotation number",
        "1/orbit",
        (pitch.PITCH, pitch.RATE, pitch.ANOMALY),
        lambda r, _: pitch.rotation_number(r),
    ),
)
