# SPDX-License-Identifier: BSD-2-Clause
"""The page: what there is to say about a result, put into the template of the folder `page`."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import HarnessError
from harness.figures import FIGURES, Drawing, Figure
from harness.figures.style import SCREEN
from harness.files.output import written
from harness.report import facts, libraries, painted, phases, plots, scene
from harness.report.arrays import Arrays
from harness.report.plots import Canvas
from harness.results.files import read
from harness.results.result import Result

NUMBERS = 4_000_000
"""Characters of the page for numbers of curves, about."""
POINTS = (300, 2400)
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


def write(source: Result | str | Path, path: str | Path) -> Path:
    """Write the report of a result, or of a results file, to a page of HTML.

    Raises UsageError or ResultsError if it cannot be read, HarnessError if a library of the extra
    `report` is missing, ResultsError if the page cannot be written.
    """
    result = source if isinstance(source, Result) else read(Path(source))
    return _written(of_run(result), Path(path))


def _written(text: str, path: Path) -> Path:
    with written(path) as target:
        target.write_text(text, encoding="utf-8")
    return path


# ---- one run


def of_run(result: Result) -> str:
    """The page of one run as text."""
    arrays = Arrays()
    canvas = Canvas(arrays, _points(len(result.columns)))
    drawn = _figures(canvas, result) if len(result.time) > 1 else []
    data = {
        "scene": scene.replay(result, arrays),
        "figures": drawn,
        "signals": plots.signals(canvas, result) if len(result.time) > 1 else [],
    }
    return render(
        "run.html",
        arrays,
        data,
        head=facts.head(result),
        measures=facts.measures(result),
        papers=facts.papers(result),
        margins=facts.margins(result),
        parameters=facts.parameters(result),
        points=canvas.points if canvas.thinned else 0,
    )


def _points(curves: int) -> int:
    """Points of a curve so that all together, each drawn about twice, are not too many."""
    return int(np.clip(NUMBERS / PER_POINT / max(1, 2 * curves), *POINTS))


def _figures(canvas: Canvas, result: Result) -> list[dict[str, Any]]:
    """The figures of the result in their sections, the first of a name."""
    fitting = {f.name: f for f in reversed(FIGURES) if f.fits(result) and not f.is_empty(result)}
    sections: dict[str, list[dict[str, Any]]] = {name: [] for name in SECTIONS}
    for figure in reversed(fitting.values()):
        found = _drawn(canvas, figure, result)
        if found:
            sections[_section(figure.name)].append(
                {"name": figure.name, "title": figure.title, "plots": found}
            )
    if found := list(phases.phases(canvas, result)):
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


# ---- the template


def render(template: str, arrays: Arrays, data: dict[str, Any], **texts: Any) -> str:
    """A page from a template: texts are filled in, numbers go to its scripts as JSON."""
    try:
        from jinja2 import Environment, PackageLoader, StrictUndefined
    except ImportError as error:
        raise HarnessError("a report needs jinja2: pip install 'servicing-fmus[report]'") from error
    loader = PackageLoader("harness.report", "page")
    environment = Environment(
        loader=loader,
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    page = environment.get_template(template)
    return page.render(
        **texts,
        data=_json(data),
        arrays=_json(arrays.content),
        scripts={name: libraries.script(name) for name in libraries.SCRIPTS},
        style=_file("style.css"),
        code={name: _file(f"{name}.js") for name in ("page", "plots", "replay")},
        version=version("servicing-fmus"),
        date=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
    )


def _file(name: str) -> str:
    return (files("harness.report") / "page" / name).read_text(encoding="utf-8")


def _json(data: Any) -> str:
    """JSON that no markup ends: a script of the page holds it."""
    return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
