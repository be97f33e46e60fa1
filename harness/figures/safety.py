# SPDX-License-Identifier: BSD-2-Clause
"""Margins of the safety monitor over time, a panel per unit; below zero a rule is violated."""

from __future__ import annotations

import numpy as np

from harness.figures.figure import Axes, Drawing
from harness.results.result import Result
from harness.results.safety import FOUND, RESTING, RULES, Rule, findings


def _draw_margins(canvas: Axes, result: Result) -> None:
    rules = [found.rule for found in findings(result)]
    units = list(dict.fromkeys(rule.unit for rule in rules)) or ["m"]
    panels = canvas.subplots(len(units), 1, sharex=True, squeeze=False)[:, 0]
    for panel, unit in zip(panels, units, strict=True):
        _draw_panel(panel, result, [rule for rule in rules if rule.unit == unit])
        panel.set_ylabel(f"margin [{unit}]")
    panels[-1].set_xlabel("time [s]")


def _draw_panel(panel: Axes, result: Result, rules: list[Rule]) -> None:
    for rule in rules:
        margin = result[rule.history]
        panel.plot(result.time, np.where(margin < RESTING, margin, np.nan), lw=0.9, label=rule.name)
    panel.axhline(0, ls="--", lw=0.8, color="k")
    panel.set_yscale("symlog", linthresh=0.1)
    panel.legend(fontsize="small")
    panel.grid(alpha=0.3)


FIGURES: tuple[Drawing, ...] = (
    Drawing(
        "safety_margins",
        "Margins of the safety monitor",
        (*FOUND, *(rule.history for rule in RULES)),
        _draw_margins,
        (11, 7),
    ),
)
