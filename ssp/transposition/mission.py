# SPDX-License-Identifier: BSD-2-Clause
"""What the transposition of a docked assembly hands the engine."""

from __future__ import annotations

from harness.mission import Gauge, Mission, Phase, Scene
from harness.mission.figure import DEGREES, scaled

from .claims import PAPER
from .figures import FIGURES, OVERLAYS, SHAPE
from .measures import MEASURES
from .plan import plan
from .scene import ASSEMBLY, assembly
from .tracking import ASSEMBLY as TRACKED
from .tracking import attitude_error

ERROR, RATE_ERROR = "controller.eps_e", "controller.domega_S"

MISSION = Mission(
    figures=FIGURES,
    overlays=OVERLAYS,
    phases=(
        Phase(
            "Tracking of the planned attitude",
            "vector part of the error",
            "rate error [deg/s]",
            (ERROR, RATE_ERROR),
            scaled(ERROR),
            scaled(RATE_ERROR, DEGREES),
        ),
    ),
    measures=MEASURES,
    claims=(PAPER,),
    gauges=(
        Gauge("attitude error", "deg", TRACKED, lambda r: DEGREES * attitude_error(r)),
        Gauge("rotation", "deg", (), "degrees(assembly.rotation)"),
        Gauge("momentum share", "", (), "assembly.momentum_share"),
    ),
    scene=(Scene(ASSEMBLY, (*SHAPE, "assembly.R_C"), assembly),),
    plans=(plan,),
)
