# SPDX-License-Identifier: BSD-2-Clause
"""The page of one run: its figures in their sections, all signals, the replay; in words and numbers
state, measures, verdicts, margins, parameters, as `page/run.html` words them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

from harness.claims.case import listed
from harness.claims.report import OTHER, judged, rule_findings
from harness.figures.choice import figures_of
from harness.figures.plots import paint
from harness.mission import Limits
from harness.mission.exchange import remarks
from harness.mission.library import missing, notes_of, of_result
from harness.report.arrays import Arrays, Canvas, points_of
from harness.report.plots import PAGE, Shown, number, painted, phases, sections, signals
from harness.report.story import replay
from harness.report.template import render
from harness.results.requirements import findings
from harness.results.result import Result
from harness.results.verdict import OPEN, Kind
from harness.system.values import base

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
    return render("run.html", canvas, content(canvas, result), **texts(result))


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


WORST_FIRST = ("bad", "fair", "none", "idle", "good")
"""Looks of verdicts in the order of the head."""


def texts(result: Result) -> dict[str, Any]:
    """What the template shows in words and tables."""
    given = result.provenance.set if result.provenance else ()
    return {
        "result": result,
        "message": message(result),
        "notes": notes(result),
        "chips": chips(result),
        "measures": list(measures(result)),
        "demands": findings(result),
        "papers": judged(result),
        "margins": rule_findings(of_result(result), result),
        "changed": {base(name) for name, _ in given},
        "told": {"Kind": Kind, "OPEN": OPEN, "OTHER": OTHER, "listed": listed, "number": number},
    }


def message(result: Result) -> str:
    """Why a run is not complete, "" if it is."""
    return result.message or ("" if result.complete else "the run ended early")


def notes(result: Result) -> list[str]:
    """What else is to be known of a run."""
    return [*notes_of(result), *remarks(result), *filter(None, (missing(result),))]


def chips(result: Result) -> list[tuple[str, str]]:
    """How many rules, requirements and claims have which verdict, with its look, worst first."""
    given = judged(result)
    found = [("good", "complete") if result.complete else ("bad", "incomplete")]
    found += [("fair", OTHER) for paper in given if paper.deviations]
    tallies = {
        Kind.RULE: [each.verdict for each in rule_findings(of_result(result), result)],
        Kind.REQUIREMENT: [each.verdict for each in findings(result)],
        Kind.CLAIM: [each.verdict for paper in given for _, each in paper.claims],
    }
    for kind, verdicts in tallies.items():
        for verdict, word, count in kind.tally(verdicts):
            text = f"{count} {kind.value}{'' if count == 1 else 's'} {word}"
            found.append((verdict.value, text.replace("rules holds", "rules hold")))
    return sorted(found, key=lambda chip: WORST_FIRST.index(chip[0]))


def measures(result: Result) -> Iterator[tuple[str, float, str]]:
    """Name, value and unit of the measures of harness compare that this run has."""
    offered = of_result(result)
    limits = offered.limits(Limits(), {"": result}) if len(result.time) else Limits()
    for measure in offered.measures if len(result.time) else ():
        value = measure(result, limits)
        if math.isfinite(value) and not measure.beside:
            yield measure.name, value, measure.unit
