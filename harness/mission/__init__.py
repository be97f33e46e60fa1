# SPDX-License-Identifier: BSD-2-Clause
"""What a mission may offer, as data, and where missions are found.

A mission's Python (`mission.py` in its folder) imports these names and hands over one Mission; the
engine asks library.of_result() what the mission of a result offers, and knows no mission by name.
"""

from __future__ import annotations

from harness.mission.claim import (
    Band,
    Case,
    Claim,
    Judgement,
    Paper,
    RuleFinding,
    at_least,
    at_most,
)
from harness.mission.figure import Curve, Drawing, Figure, Level, Overlay, Panel, Phase
from harness.mission.library import inherit
from harness.mission.mission import (
    Exchange,
    Gauge,
    Limits,
    Measure,
    Mission,
    Plan,
    Scene,
    Start,
)
from harness.results.verdict import Verdict

__all__ = [
    "Band", "Case", "Claim", "Curve", "Drawing", "Exchange", "Figure", "Gauge",
    "Judgement", "Level", "Limits", "Measure", "Mission", "Overlay", "Panel", "Paper", "Phase",
    "Plan", "RuleFinding", "Scene", "Start", "Verdict", "at_least", "at_most", "inherit",
]  # fmt: skip
