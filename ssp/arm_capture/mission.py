# SPDX-License-Identifier: BSD-2-Clause
"""Mission of a capture by arm: the Mission of an approach with additional figures, metrics, claims
and a plan for the arm.
"""

from __future__ import annotations

from dataclasses import replace

from harness.mission import FinalMetric

from ..shared.approach import approach
from ..shared.conventions import STEERED
from ..shared.meanings import explained
from .claims import PAPERS
from .figures import FIGURES
from .metrics import METRICS
from .plan import plan
from .plan_figures import OVERLAYS
from .scene import SCENE

APPROACH = approach(FIGURES, PAPERS, OVERLAYS)
GRASPED = "mechanism.hard >= 1"

MISSION = replace(
    APPROACH,
    metrics=explained((*METRICS, *APPROACH.metrics)),
    scene=(SCENE,),
    plans=(plan,),
    steering=(STEERED._replace(open=("controller", "arm_controller"), every=10, ends=(GRASPED,)),),
    final=(
        FinalMetric("arm mode", "", (), "arm_guidance.arm_mode"),
        FinalMetric("tip error", "mm", (), "1000 * arm_guidance.position_error"),
        FinalMetric("misalignment", "deg", (), "degrees(arm_guidance.misalignment)"),
    ),
)
