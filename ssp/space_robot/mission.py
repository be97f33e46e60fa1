# SPDX-License-Identifier: BSD-2-Clause
"""Mission: space robot, a free-floating robot with two links under gravity gradient."""

from __future__ import annotations

from harness.mission import FinalMetric, Mission, Phase, Scene, Steering

from ..shared.conventions import ORBITS, RESTARTS
from ..shared.meanings import explained
from .claims import PAPERS
from .figures import FIGURES, OVERLAYS
from .pitch import METRICS, PITCH, RATE
from .scene import LINKS, ROBOT, robot

ANGLE, ANGLE_RATE = "robot.joint_angle", "robot.joint_rate"

MISSION = Mission(
    figures=FIGURES,
    overlays=OVERLAYS,
    phases=(
        Phase(
            "Pitch",
            "pitch [deg]",
            "pitch rate [deg/s]",
            (PITCH, RATE),
            f"degrees({PITCH})",
            f"degrees({RATE})",
        ),
        Phase(
            "Joints",
            "joint angle [deg]",
            "joint rate [deg/s]",
            (ANGLE, ANGLE_RATE),
            f"degrees({ANGLE})",
            f"degrees({ANGLE_RATE})",
        ),
    ),
    metrics=explained(METRICS),
    claims=PAPERS,
    steering=(Steering(("joints",), bounds=(("joints.joint_torque", 1.0),)),),
    final=(
        FinalMetric("pitch", "deg", (), f"degrees({PITCH})"),
        FinalMetric("pitch rate", "deg/s", (), f"degrees({RATE})"),
    ),
    exchange=(ORBITS,),
    restarts=RESTARTS,
    scene=(Scene(ROBOT, LINKS, robot),),
)
