# SPDX-License-Identifier: BSD-2-Clause
"""Figure of the margins of the safety monitor over time, a panel per unit. A rule is violated where
its margin is negative; the rule escape already where it is below `monitor.escape_reserve`.
"""

from __future__ import annotations

import numpy as np

from harness.figures.style import legend_above, time_axis
from harness.mission.figure import Axes, Drawing
from harness.results.result import Result

from .safety import FOUND, RESTING, RULES, Rule, findings

LINEAR, DECADE = 0.1, 10.0
"""Absolute margin, in the unit of the panel, up to which a logarithmic axis is linear; a panel gets
a logarithmic axis if a limit of its linear axis is beyond DECADE times LINEAR.
"""


def _draw_margins(canvas: Axes, result: Result) -> None:
    found = {each.name for each in findings(result)}
    rules = [rule for rule in RULES if rule.name in found]
    units = list(dict.fromkeys(rule.unit for rule in rules)) or ["m"]
    panels = canvas.subplots(len(units), 1, sharex=True, squeeze=False)[:, 0]
    for panel, unit in zip(panels, units, strict=True):
        _draw_panel(panel, result, [rule for rule in rules if rule.unit == unit])
        panel.set_ylabel(f"margin [{unit}]")
    panels[-1].set_xlabel(time_axis(result.time).label)


def _draw_panel(panel: Axes, result: Result, rules: list[Rule]) -> None:
    time = result.time / time_axis(result.time).seconds
    for rule in rules:
        margin = result[rule.history]
        panel.plot(time, np.where(margin < RESTING, margin, np.nan), lw=0.9, label=rule.name)
    panel.axhline(0, ls="--", lw=0.8, color="k")
    if max(map(abs, panel.get_ylim())) > DECADE * LINEAR:
        panel.set_yscale("symlog", linthresh=LINEAR)
    legend_above(panel)


FIGURES: tuple[Drawing, ...] = (
    Drawing(
        "safety_margins",
        "Margins of the safety monitor",
        (*FOUND, *(rule.history for rule in RULES if rule.name != "escape")),
        _draw_margins,
        (11, 7),
    ),
)
