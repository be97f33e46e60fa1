# SPDX-License-Identifier: BSD-2-Clause
"""The replay of a mission: an approach with the mechanism on both bodies or with the arm as it is,
phases and events.

After capture the stack needs nothing: both bodies are drawn where they are.
"""

from __future__ import annotations

from functools import partial

from harness.mission import Scene
from harness.report.arrays import Arrays
from harness.report.scene import Rows, number
from harness.results.result import Result

from ..arm_capture.scene import fit as arm
from ..shared.approach_scene import PAIR, Outfit, pair, pairs
from ..shared.docking_scene import DOCKING, LATCH, drogue, floor, probe
from .flight import DOCKING as CAPTURE
from .flight import ISP, NEEDS, PHASE, PHASES, events

LOAD = "mechanism.load_force"
SHOWN = ((PHASE, PHASES), (CAPTURE, LATCH), (LOAD, ()))


def fit(result: Result, rows: Rows, arrays: Arrays) -> Outfit | None:
    """Probe and drogue, or the arm; phase, latch and contact force run along, events are marked."""
    if not result.holds(*NEEDS, LOAD, parameters=(*DOCKING, ISP)):
        return None
    marks = tuple({"time": time, "text": text} for time, text in events(result))
    if (outfit := arm(result, rows, arrays)) is not None:
        phase = number(result, arrays, rows, *SHOWN[0])
        both = sorted((*marks, *outfit.events), key=lambda mark: mark["time"])
        return outfit._replace(numbers=(phase, *outfit.numbers), events=tuple(both))
    numbers = tuple(number(result, arrays, rows, name, words) for name, words in SHOWN)
    return Outfit(probe(result), drogue(result), floor(result), numbers=numbers, events=marks)


SCENE = Scene(PAIR, (), partial(pair, fit=fit), partial(pairs, fit=fit))
