# SPDX-License-Identifier: BSD-2-Clause
"""What the space robot hands the engine."""

from __future__ import annotations

from harness.mission import Gauge, Mission, Phase, Scene
from harness.mission.figure import DEGREES, scaled

from ..shared.conventions import ORBITS, RESTARTS
from .claims import PAPERS
from .figures import FIGURES, OVERLAYS
from .measures import MEASURES
from .pitch import PITCH, RATE
from .scene import LINKS, ROBOT, robot

ANGLE, ANGLE_RATE = "robot.joint_angle", "robot.joint_rate"

MISSION = Mission(
    figures=FIGURES,
    overlays=OVERLAYS,
    phases=(
        Phase(
            "Pitch",
            "pitch [deg]",
            "its rate [deg/s]",
            (PITCH, RATE),
            scaled(PITCH, DEGREES),
            scaled(RATE, DEGREES),
        ),
        Phase(
            "Joints",
            "joint angle [deg]",
            "joint rate [deg/s]",
            (ANGLE, ANGLE_RATE),
            scaled(ANGLE, DEGREES),
            scaled(ANGLE_RATE, DEGREES),
        ),
    ),
    measures=MEASURES,
    claims=PAPERS,
    gauges=(
        Gauge("pitch", "deg", (), f"degrees({PITCH})"),
        Gauge("pitch rate", "deg/s", (), f"degrees({RATE})"),
    ),
    exchange=(ORBITS,),
    restarts=RESTARTS,
    scene=(Scene(ROBOT, LINKS, robot),),
)
