# SPDX-License-Identifier: BSD-2-Clause
"""What the servicing mission hands the engine."""

from __future__ import annotations

from dataclasses import replace

from harness.mission import Gauge
from harness.results.result import Result

from ..arm_capture.claims import PAPERS as OF_ARMS
from ..arm_capture.figures import ARM
from ..arm_capture.measures import MEASURES as BY_ARM
from ..shared.approach import approach
from ..shared.gauges import GAUGES as OF_APPROACHES
from .claims import PAPER
from .figures import FIGURES
from .flight import MEASURES, PHASE, PHASES, notes
from .scene import SCENE


def _words(result: Result) -> str:
    """What ground says: go or no-go for each hold."""
    go = [result[f"timeline.go_{k}"][-1] for k in (1, 2, 3)]
    return " ".join("go" if flag else "no-go" for flag in go)


def _phase(result: Result) -> str:
    return PHASES[int(result[PHASE][-1])]


GAUGES = (
    Gauge("phase", "", (PHASE,), _phase),
    Gauge("ground", "", tuple(f"timeline.go_{k}" for k in (1, 2, 3)), _words),
    Gauge("attempt", "", (), "manager.attempt"),
    Gauge("latch", "", (), "mechanism.phase"),
)
_APPROACH = approach((*FIGURES, *ARM), (PAPER, *OF_ARMS))
MISSION = replace(
    _APPROACH,
    gauges=(*GAUGES, *OF_APPROACHES),
    measures=(*_APPROACH.measures, *MEASURES, *BY_ARM),
    notes=(*_APPROACH.notes, notes),
    scene=(SCENE,),
)
