# SPDX-License-Identifier: BSD-2-Clause
"""The page of one run: its figures in their sections, all signals, the replay, facts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from harness.figures.choice import figures_of
from harness.figures.plots import paint
from harness.report import facts
from harness.report.arrays import Arrays, Canvas, points_of
from harness.report.plots import PAGE, Shown, painted, phases, sections, signals
from harness.report.story import replay
from harness.report.template import render
from harness.results.result import Result

ACTUATORS = (
    "force", "torque", "wheel_speeds", "firing", "engines", "joints", "gimbals", "acceleration",
)  # fmt: skip
SECTIONS = {
    "safety_margins": "margins",
    "phase_planes": "phases",
    "poincare": "phases",
    **dict.fromkeys(ACTUATORS, "actuators"),
}
"""Sections of the page by figure; others are in `figures`."""


def canvas_of(result: Result, arrays: Arrays) -> Canvas:
    """A canvas on which all curves of a run, each drawn about twice, fit a page."""
    return Canvas(arrays, points_of(2 * len(result.columns), 200, 2400))


def of_run(result: Result) -> str:
    """The page of one run as text."""
    canvas = canvas_of(result, Arrays())
    return render("run.html", canvas, content(canvas, result), **facts.texts(result))


def content(canvas: Canvas, result: Result) -> dict[str, Any]:
    """Replay, figures and signals as data, their numbers in the arrays of the canvas."""
    lasts = len(result.time) > 1
    return {
        "figures": sections(_figures(canvas, result)) if lasts else [],
        "scene": replay(result, canvas.arrays),
        "signals": signals(canvas, result) if lasts else [],
    }


def _figures(canvas: Canvas, result: Result) -> Iterator[Shown]:
    """The figures of the result."""
    yield "phases", "phases", "", list(phases(canvas, result))
    with PAGE.used():
        for figure in figures_of(result):
            if not figure.is_empty(result):
                plots = painted(canvas, paint(figure, result, PAGE))
                yield SECTIONS.get(figure.name, "figures"), figure.name, figure.title, plots
