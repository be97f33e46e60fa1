# SPDX-License-Identifier: BSD-2-Clause
"""Mission: servicing mission."""

from __future__ import annotations

from dataclasses import replace

from harness.mission import WatchedMetric
from harness.results.result import Result

from ..arm_capture.claims import PAPERS as OF_ARMS
from ..arm_capture.figures import ARM
from ..arm_capture.metrics import METRICS as BY_ARM
from ..shared.approach import approach
from ..shared.conventions import STEERED
from ..shared.meanings import explained
from ..shared.watched import WATCHED as OF_APPROACHES
from .bound import BOUND
from .claims import PAPER
from .events import METRICS, notes
from .figures import FIGURES
from .scene import SCENE


def _words(result: Result) -> str:
    """Return the decisions of the ground in the last row as text: go or no-go for each hold."""
    go = [result[f"timeline.go_{k}"][-1] for k in (1, 2, 3)]
    return " ".join("go" if flag else "no-go" for flag in go)


WATCHED = (
    WatchedMetric("phase", "", (), "manager.phase"),
    WatchedMetric("latch", "", (), "mechanism.phase"),
    WatchedMetric("attempt", "", (), "manager.attempt"),
    WatchedMetric("ground", "", tuple(f"timeline.go_{k}" for k in (1, 2, 3)), _words),
)
_APPROACH = approach((*FIGURES, *ARM), (PAPER, *OF_ARMS))
COMMANDED = (
    ("selector.F_cmd_S", 2.0),
    ("selector.M_cmd_S", 0.5),
    ("selector.wheel_accel_cmd", 0.01),
    ("selector.throttle", (0.0, 1.0)),
)
"""Bounds of the commands that the selector passes to thrusters and wheels of the servicer."""

MISSION = replace(
    _APPROACH,
    watched=(*WATCHED, *OF_APPROACHES),
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
