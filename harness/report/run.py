# SPDX-License-Identifier: BSD-2-Clause
"""The page of one run: its figures in their sections, all signals, the replay, facts."""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.figures.choice import figures_of
from harness.figures.style import SCREEN
from harness.mission import Drawing, Figure
from harness.report import facts, models, painted, plots
from harness.report.arrays import Arrays
from harness.report.plots import Canvas
from harness.report.scene import replay
from harness.report.template import render
from harness.results.result import Result

NUMBERS = 2_000_000
"""Characters of the page for numbers of curves, about."""
POINTS = (200, 2400)
"""Least and most points of a curve."""
PER_POINT = 8 * 4 / 3
"""Characters of a point: two numbers of four bytes, four characters for three."""
SECTIONS = ("margins", "figures", "actuators", "phases")
ACTUATORS = {
    "force",
    "torque",
    "wheel_speeds",
    "firing",
    "engines",
    "joints",
    "gimbals",
    "acceleration",
}
"""Figures of what the actuators do."""
PLANES = {"phase_planes", "poincare"}
"""Figures that are phase plots."""
MARGINS = {"safety_margins"}
"""Figures of the safety monitor."""


def of_run(result: Result) -> str:
    """The page of one run as text."""
    canvas = Canvas(Arrays(), points_of(result))
    data = content(canvas, result)
    return models.fitting(render("run.html", canvas.arrays, data, **texts(result, canvas)), result)


def content(canvas: Canvas, result: Result) -> dict[str, Any]:
    """Replay, figures and signals as data, their numbers in the arrays of the canvas."""
    drawn = _figures(canvas, result) if len(result.time) > 1 else []
    return {
        "scene": replay(result, canvas.arrays),
        "figures": drawn,
        "signals": plots.signals(canvas, result) if len(result.time) > 1 else [],
    }


def texts(result: Result, canvas: Canvas) -> dict[str, Any]:
    """What the template shows in words and tables."""
    return {
        "head": facts.head(result),
        "measures": facts.measures(result),
        "papers": facts.papers(result),
        "demands": facts.demands(result),
        "chips": facts.chips(result),
        "margins": facts.margins(result),
        "parameters": facts.parameters(result),
        "points": canvas.points if canvas.thinned else 0,
    }


def points_of(result: Result) -> int:
    """Points of a curve so that all together, each drawn about twice, are not too many."""
    curves = len(result.columns)
    return int(np.clip(NUMBERS / PER_POINT / max(1, 2 * curves), *POINTS))


def _figures(canvas: Canvas, result: Result) -> list[dict[str, Any]]:
    """The figures of the result in their sections, the first of a name."""
    sections: dict[str, list[dict[str, Any]]] = {name: [] for name in SECTIONS}
    for figure in figures_of(result):
        found = [] if figure.is_empty(result) else _drawn(canvas, figure, result)
        if found:
            sections[_section(figure.name)].append(
                {"name": figure.name, "title": figure.title, "plots": found}
            )
    if found := list(plots.phases(canvas, result)):
        sections["phases"].insert(0, {"name": "phases", "title": "", "plots": found})
    return [{"name": name, "figures": drawn} for name, drawn in sections.items() if drawn]


def _section(name: str) -> str:
    if name in ACTUATORS:
        return "actuators"
    if name in MARGINS:
        return "margins"
    return "phases" if name in PLANES else "figures"


def _drawn(canvas: Canvas, figure: Figure | Drawing, result: Result) -> list[plots.Plot]:
    if isinstance(figure, Figure):
        return plots.figure(canvas, figure, result)
    from harness.figures.plots import paint

    with SCREEN.used():
        return painted.plots(canvas, paint(figure, result))
