# SPDX-License-Identifier: BSD-2-Clause
"""Mission: servicing mission, from 500 m to a stack of servicer and target at rest."""

from __future__ import annotations

from dataclasses import replace

from harness.mission import FinalMetric

from ..arm_capture.claims import PAPERS as OF_ARMS
from ..arm_capture.figures import ARM
from ..arm_capture.metrics import METRICS as BY_ARM
from ..shared.approach import approach
from ..shared.conventions import STEERED
from ..shared.meanings import explained
from .bound import BOUND
from .claims import PAPER
from .events import METRICS, notes
from .figures import FIGURES
from .scene import SCENE

_APPROACH = approach((*FIGURES, *ARM), (PAPER, *OF_ARMS))
COMMANDED = (
    ("selector.F_cmd_S", 2.0),
    ("selector.M_cmd_S", 0.5),
    ("selector.wheel_accel_cmd", 0.01),
)
"""Bounds of the outputs of the selector when an agent replaces it: force [N], torque [N m], wheel
acceleration [rad/s2], each with either sign.
"""

MISSION = replace(
    _APPROACH,
    final=(
        FinalMetric("phase", "", (), "manager.phase"),
        FinalMetric("latch", "", (), "mechanism.phase"),
        FinalMetric("attempt", "", (), "manager.attempt"),
    ),
    metrics=explained((*_APPROACH.metrics, *METRICS, *BY_ARM)),
    notes=(*_APPROACH.notes, notes),
    scene=(SCENE,),
    bounds=(BOUND,),
    steering=(
        STEERED._replace(
            open=("selector",), every=10, ends=("mechanism.hard >= 1",), bounds=COMMANDED
        ),
    ),
)
