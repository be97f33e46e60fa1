# SPDX-License-Identifier: BSD-2-Clause
"""Contents of a mission as data, and the search for missions.

The module `mission.py` in the folder of a mission imports the classes and functions that it needs
from this package and defines one Mission.
The rest of the harness obtains the mission of a result from library.of_result(), and contains no
name of a mission.
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
    FinalMetric,
    LeastImpulse,
    Limits,
    Metric,
    Mission,
    Plan,
    Scene,
    Start,
    Steering,
)
from harness.results.verdict import Verdict

__all__ = [
    "Band", "Case", "Claim", "Curve", "Drawing", "Exchange", "Figure", "FinalMetric", "Judgement",
    "LeastImpulse", "Level", "Limits", "Metric", "Mission", "Overlay", "Panel", "Paper", "Phase",
    "Plan", "RuleFinding", "Scene", "Start", "Steering", "Verdict", "at_least", "at_most",
    "inherit",
]  # fmt: skip
