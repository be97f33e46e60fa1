# SPDX-License-Identifier: BSD-2-Clause
"""Page of one run: its figures by section, all variables and the replay as data for the scripts,
and the texts and tables of the template `page/run.html` (state, metrics, verdicts, margins,
parameters).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from harness.claims.case import listed
from harness.claims.report import OTHER, judgements, rule_findings
from harness.figures.choice import figures_of
from harness.figures.plots import paint
from harness.files import paths
from harness.mission import Limits, Metric
from harness.mission.exchange import remarks
from harness.mission.figure import LARGEST
from harness.mission.library import missing, notes_of, of_result
from harness.report.arrays import Arrays, Canvas, points_of
from harness.report.plots import PAGE, Shown, painted, phases, sections, signals
from harness.report.template import render
from harness.report.timeline import drawable_rows, replay
from harness.results.requirements import findings
from harness.results.result import Result
from harness.results.verdict import OPEN, Kind
from harness.spelling import number
from harness.ssp.library import load
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
"""Section of the page for each figure named here. All other figures are in the section `figures`.
"""


def canvas_of(result: Result, arrays: Arrays) -> Canvas:
    """Return a canvas that draws so few points per curve that the size of the page of a run is
    limited, under the assumption that every column of the result is drawn about twice.
    """
    return Canvas(arrays, points_of(2 * len(result.columns), 200, 2400))


def of_run(result: Result) -> str:
    """Return the page of one run as HTML text."""
    canvas = canvas_of(result, Arrays())
    return render("run.html", canvas, content(canvas, result), **texts(result))


def content(canvas: Canvas, result: Result) -> dict[str, Any]:
    """Return figures, replay and variables as data for the scripts of the page. The data refer to
    arrays, which are stored in the canvas.
    """
    has_duration = len(result.time) > 1
    return {
        "figures": sections(_figures(canvas, result)) if has_duration else [],
        "scene": replay(result, canvas.arrays),
        "signals": signals(canvas, result) if has_duration else [],
    }


def _figures(canvas: Canvas, result: Result) -> Iterator[Shown]:
    """Yield the phase plots (a quantity against its rate), and the other figures of a result."""
    yield "phases", "phases", "", list(phases(canvas, result))
    with PAGE.used():
        for figure in figures_of(result):
            if not figure.is_empty(result):
                plots = painted(canvas, paint(figure, result, PAGE), result)
                yield SECTIONS.get(figure.name, "figures"), figure.name, figure.title, plots


WORST_FIRST = ("bad", "fair", "none", "idle", "good")
"""Styles of verdicts (CSS classes) in the order in which the head of the page shows them."""


def texts(result: Result) -> dict[str, Any]:
    """Return the texts and tables that the template run.html needs, by name."""
    given = result.provenance.set if result.provenance else ()
    return {
        "result": result,
        "message": message(result),
        "notes": notes(result),
        "headline": headline(result),
        "chips": chips(result),
        "metrics": [each for each in metrics(result) if math.isfinite(each[1])],
        "requirements": findings(result),
        "papers": judgements(result),
        "margins": rule_findings(of_result(result), result),
        "changed": {base(name) for name, _ in given},
        "cell": cell,
        "words": {"Kind": Kind, "OPEN": OPEN, "OTHER": OTHER, "listed": listed, "number": number},
    }


def message(result: Result) -> str:
    """Return the reason why a run is incomplete, "" if it is complete."""
    return result.message or ("" if result.complete else "the run ended early")


def notes(result: Result) -> list[str]:
    """Return the notes and remarks of the mission about a run, and notes on a missing mission and
    on values that cannot be drawn, one line each.
    """
    found = [*notes_of(result), *remarks(result), missing(result), gaps(result)]
    return [line for line in found if line]


def gaps(result: Result) -> str:
    """Return a line that names the variables with values that cannot be drawn; "" if there are
    none.
    """
    rows = len(result.time)
    bad = {name: rows - int(drawable_rows(result[name]).sum()) for name in result.names}
    names = listed([f"{name} in {count} of {rows} rows" for name, count in bad.items() if count])
    what = f"values that are not finite or beyond {LARGEST:g}, left out of plots and replay"
    return f"{what}: {names}" if names else ""


def headline(result: Result) -> tuple[str, str]:
    """Return two sentences for the head of the page: the description of the system with the end
    time, and how the run ended, with up to three final metrics of the mission and counts of the
    verdicts on requirements.
    """
    text = result.system
    if result.system in paths.systems():
        with load(result.system) as system:
            text = system.description or text
    if not len(result.time):
        return text, "The run has no recorded rows."
    end = f"{result.time[-1]:g} s"
    shown = [m for m in of_result(result).final if not m.lacks(result)]
    values = [f"{m.name} {m.text(result)}" for m in shown[:3]]
    given = [each.verdict for each in findings(result)]
    parts = [f"Ended at {end}" if result.complete else f"Incomplete, ended early at {end}"]
    parts[0] += f" with {', '.join(values)}" if values else ""
    for _, word, count in Kind.REQUIREMENT.tally(given):
        parts.append(f"{count} of {len(given)} requirements {word}")
    return f"{text}, {end}", "; ".join(parts) + "."


def chips(result: Result) -> list[tuple[str, str]]:
    """Return the badges in the head of the page, the worst first, as pairs of style and text: the
    state of the run, OTHER for each paper from whose cases the run deviates, and counts of safety
    rules, requirements and claims by verdict, such as `2 requirements not met`.
    """
    given = judgements(result)
    found = [("none", "complete") if result.complete else ("bad", "incomplete")]
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


def cell(value: float, words: Sequence[str] = ()) -> str:
    """Return the value of a metric as text, "-" if it is not finite; words: texts to show for the
    values 0, 1, ... of the metric.
    """
    if words and 0 <= value < len(words):
        return words[int(value)]
    return f"{value:.4g}" if math.isfinite(value) else "-"


def metrics(result: Result) -> Iterator[tuple[Metric, float]]:
    """Yield the metrics of the mission whose variables the result has, except those with `beside`,
    each with its value, which is NaN if the metric has no value in this run.
    """
    offered = of_result(result)
    limits = offered.limits(Limits(), {"": result}) if len(result.time) else Limits()
    for metric in offered.metrics if len(result.time) else ():
        if not (metric.beside or metric.lacks(result)):
            yield metric, metric(result, limits)
