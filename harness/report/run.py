# SPDX-License-Identifier: BSD-2-Clause
"""The page of one run: its figures in their sections, all signals, the replay, facts."""

from __future__ import annotations

from typing import Any

from harness.figures.choice import figures_of
from harness.figures.plots import paint
from harness.report import facts, plots
from harness.report.arrays import Arrays, Canvas, points_of
from harness.report.plots import PAGE, painted
from harness.report.story import replay
from harness.report.template import render
from harness.results.result import Result

SECTIONS = {
    "margins": {"safety_margins"},
    "figures": {},
    "actuators": {
        "force", "torque", "wheel_speeds", "firing", "engines", "joints", "gimbals", "acceleration",
    },
    "phases": {"phase_planes", "poincare"},
}  # fmt: skip
"""Sections of the page with the figures that they have; others are in `figures`."""


def canvas_of(result: Result, arrays: Arrays) -> Canvas:
    """A canvas on which all curves of a run, each drawn about twice, fit a page."""
    return Canvas(arrays, points_of(2 * len(result.columns), 200, 2400))


def of_run(result: Result) -> str:
    """The page of one run as text."""
    canvas = canvas_of(result, Arrays())
    return render("run.html", canvas, content(canvas, result), **facts.texts(result))


def content(canvas: Canvas, result: Result) -> dict[str, Any]:
    """Replay, figures and signals as data, their numbers in the arrays of the canvas."""
    drawn = _figures(canvas, result) if len(result.time) > 1 else []
    return {
        "scene": replay(result, canvas.arrays),
        "figures": drawn,
        "signals": plots.signals(canvas, result) if len(result.time) > 1 else [],
    }


def _figures(canvas: Canvas, result: Result) -> list[dict[str, Any]]:
    """The figures of the result in their sections, the first of a name."""
    sections: dict[str, list[dict[str, Any]]] = {name: [] for name in SECTIONS}
    with PAGE.used():
        for figure in figures_of(result):
            found = () if figure.is_empty(result) else painted(canvas, paint(figure, result, PAGE))
            if found:
                sections[_section(figure.name)].append(
                    {"name": figure.name, "title": figure.title, "plots": found}
                )
    if found := list(plots.phases(canvas, result)):
        sections["phases"].insert(0, {"name": "phases", "title": "", "plots": found})
    return [{"name": name, "figures": drawn} for name, drawn in sections.items() if drawn]


def _section(name: str) -> str:
    return next((section for section, names in SECTIONS.items() if name in names), "figures")
