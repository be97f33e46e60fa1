# SPDX-License-Identifier: BSD-2-Clause
"""Page of a comparison: its table of metrics, plots that contain all runs, and a common replay of
all runs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from harness.errors import ResultsError
from harness.figures.choice import compared, overlays_of
from harness.figures.plots import paint_overlay
from harness.mission import Figure
from harness.mission.library import of_result
from harness.mission.mission import apart, exceeding, together
from harness.report import run
from harness.report.arrays import Arrays, Canvas, points_of
from harness.report.plots import PAGE, Shown, painted, sections
from harness.report.template import render
from harness.report.timeline import replay_several
from harness.results.files import read
from harness.results.requirements import Finding, findings
from harness.results.result import Result
from harness.results.verdict import Kind
from harness.studies.compare import TABLE, read_csv
from harness.studies.variants import Variant, with_files


def of_folder(folder: Path) -> str:
    """Return the page of a comparison as HTML text; folder: folder that `harness compare` has
    written. Raises ResultsError if the table or one of the results cannot be read.
    """
    columns, labels = read_csv(folder / TABLE)
    results = _results(folder, labels)
    canvas = canvas_of(results, Arrays())
    metrics = together(map(of_result, results.values())).metrics
    values = {(m.name, m.unit): columns.get(f"{m.name} [{m.unit}]", {}) for m in metrics}
    return render(
        "compare.html",
        canvas,
        side_by_side(results, canvas.arrays, figures(canvas, results)),
        name=folder.resolve().name,
        labels=labels,
        results=results,
        message=run.message,
        gaps=run.gaps,
        table={head: c for head, c in columns.items() if any(map(math.isfinite, c.values()))},
        words={f"{m.name} [{m.unit}]": m.words for m in metrics},
        cell=run.cell,
        requirements=_by_requirement(results),
        warnings=[*apart(metrics, values), *exceeding(metrics, values)],
        Kind=Kind,
    )


def _by_requirement(results: Mapping[str, Result]) -> dict[str, dict[str, Finding]]:
    """Return the findings about all requirements, by name of the requirement, then by label of the
    run.
    """
    found: dict[str, dict[str, Finding]] = {}
    for label, result in results.items():
        for each in findings(result):
            found.setdefault(each.name, {})[label] = each
    return found


def canvas_of(results: Mapping[str, Result], arrays: Arrays) -> Canvas:
    """Return a canvas that draws so few points per curve that the size of a page with these runs is
    limited. results: by label of the run.
    """
    return Canvas(arrays, points_of(sum(map(_curves, results.values())), 150, 1500))


def side_by_side(
    results: Mapping[str, Result], arrays: Arrays, figures: Iterable[Shown]
) -> dict[str, Any]:
    """Return the data for the scripts of a page with several runs: a common replay, the figures by
    section, and the labels of the runs. results: by label of the run.
    """
    scene = replay_several(results, arrays) if results else None
    return {"scene": scene, "figures": sections(figures), "runs": list(results)}


def _results(folder: Path, labels: list[str]) -> dict[str, Result]:
    """Return the results of a comparison by label; raise ResultsError if there are none. A partial
    result takes precedence over a complete one, since a complete run removes it.
    """
    found = {}
    for variant in with_files([Variant(label, {}) for label in labels]):
        files = (folder / f"{variant.file}{ending}" for ending in (".partial.nc", ".nc"))
        if file := next((f for f in files if f.is_file()), None):
            found[variant.label] = read(file)
    if not found:
        raise ResultsError(f"{folder}: contains none of the results that {TABLE} lists")
    return found


def _curves(result: Result) -> int:
    """Return the approximate number of curves in all figures of a run."""
    fitting = (f for f in overlays_of({"": result}) if f.fits(result))
    return sum(3 * len(f.panels) if isinstance(f, Figure) else 3 for f in fitting)


def figures(
    canvas: Canvas, results: Mapping[str, Result], section: str = "figures"
) -> Iterator[Shown]:
    """Yield the figures that show several runs in the same axes. A figure for which only one of
    several runs has the variables, or in which nothing changes, is left out. section: section of
    the page.
    """
    colours = {label: f"C{k}" for k, label in enumerate(results)}
    with PAGE.used():
        for figure, runs in compared(results)[0]:
            plots = painted(canvas, paint_overlay(figure, runs, colours, PAGE))
            yield section, figure.name, figure.title, plots
