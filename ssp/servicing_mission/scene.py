# SPDX-License-Identifier: BSD-2-Clause
"""The replay of a mission: an approach with the mechanism on both bodies, phases and events.

After capture the stack needs nothing: both bodies are drawn where they are.
"""

from __future__ import annotations

from functools import partial

from harness.mission import Scene
from harness.report.arrays import Arrays
from harness.report.scene import Rows, number
from harness.results.result import Result

from ..shared.approach_scene import PAIR, Outfit, pair, pairs
from ..shared.docking_scene import DOCKING, LATCH, drogue, floor, probe
from .flight import DOCKING as CAPTURE
from .flight import ISP, NEEDS, PHASE, PHASES, events

LOAD = "mechanism.load_force"
SHOWN = ((PHASE, PHASES), (CAPTURE, LATCH), (LOAD, ()))


def fit(result: Result, rows: Rows, arrays: Arrays) -> Outfit | None:
    """Probe and drogue; phase, latch and contact force run along, events are marked."""
    if not result.holds(*NEEDS, LOAD, parameters=(*DOCKING, ISP)):
        return None
    return Outfit(
        probe(result),
        drogue(result),
        floor(result),
        numbers=tuple(number(result, arrays, rows, name, words) for name, words in SHOWN),
        events=tuple({"time": time, "text": text} for time, text in events(result)),
    )


SCENE = Scene(PAIR, (), partial(pair, fit=fit), partial(pairs, fit=fit))
