# SPDX-License-Identifier: BSD-2-Clause
"""What the capture by arm hands the engine: that of an approach, and the arm."""

from __future__ import annotations

from dataclasses import replace

from harness.mission import Gauge

from ..shared.approach import approach
from .claims import PAPERS
from .figures import FIGURES
from .measures import MEASURES
from .plan import plan
from .plan_figures import OVERLAYS
from .scene import SCENE

APPROACH = approach(FIGURES, PAPERS, OVERLAYS)
MISSION = replace(
    APPROACH,
    measures=(*MEASURES, *APPROACH.measures),
    scene=(SCENE,),
    plans=(plan,),
    gauges=(
        Gauge("arm mode", "", (), "arm_guidance.arm_mode"),
        Gauge("tip error", "mm", (), "1000 * arm_guidance.position_error"),
        Gauge("misalignment", "deg", (), "degrees(arm_guidance.misalignment)"),
    ),
)
