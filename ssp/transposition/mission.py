# SPDX-License-Identifier: BSD-2-Clause
"""Mission: transposition of a docked assembly."""

from __future__ import annotations

import numpy as np

from harness.mission import FinalMetric, Mission, Phase, Scene, Steering

from ..shared.meanings import explained
from .claims import PAPER
from .figures import FIGURES, OVERLAYS, SHAPE
from .metrics import ASSEMBLY as TRACKED
from .metrics import METRICS, attitude_error
from .plan import plan
from .scene import ASSEMBLY, assembly

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
            ERROR,
            f"degrees({RATE_ERROR})",
        ),
    ),
    metrics=explained(METRICS),
    claims=(PAPER,),
    final=(
        FinalMetric("attitude error", "deg", TRACKED, lambda r: np.degrees(attitude_error(r))),
        FinalMetric("rotation", "deg", (), "degrees(assembly.rotation)"),
        FinalMetric("momentum share", "", (), "assembly.momentum_share"),
    ),
    scene=(Scene(ASSEMBLY, (*SHAPE, "assembly.R_C"), assembly),),
    plans=(plan,),
    steering=(Steering(("steering",)),),
)
