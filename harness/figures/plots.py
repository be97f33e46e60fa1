# SPDX-License-Identifier: BSD-2-Clause
"""Pictures of results: the tables of harness/figures drawn by matplotlib, for one run or several in
one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import ResultsError
from harness.figures import FIGURES, OVERLAYS, Curve, Drawing, Figure, Overlay, Panel
from harness.figures.figure import MANY, Colour
from harness.files.output import written
from harness.results.result import Result

Canvas = Any
"""Figure of matplotlib."""


def plot(result: Result, directory: Path, ending: str = "png") -> list[Path]:
    """Draw every figure whose variables the result holds; returns the files written.

    ending: png, svg or pdf. Raises ResultsError if no figure fits or the directory cannot be
    written.
    """
    figures = {figure.name: figure for figure in FIGURES if figure.fits(result)}
    if not figures:
        raise ResultsError("the result holds the variables of no known figure")
    return _write(
        directory, ending, {name: partial(paint, f, result) for name, f in figures.items()}
    )


def overlay(results: Mapping[str, Result], directory: Path, ending: str = "png") -> list[Path]:
    """Draw several runs, by label, into the same figures; returns the files written, none if no
    figure fits.

    A run that lacks a variable of a figure is left out of it. Ten runs or more have the colours of
    a scale and the band of the middle nine tenths instead of a legend. Raises ResultsError if the
    directory cannot be written.
    """
    fitting = {f: {label: r for label, r in results.items() if f.fits(r)} for f in OVERLAYS}
    colours = _colours(list(results))
    figures = {
        f.name: partial(paint_overlay, f, runs, colours) for f, runs in fitting.items() if runs
    }
    return _write(directory, ending, figures)


def _write(directory: Path, ending: str, figures: Mapping[str, Callable[[], Canvas]]) -> list[Path]:
    return [save(draw(), directory / f"{name}.{ending}") for name, draw in figures.items()]


def save(canvas: Canvas, path: Path) -> Path:
    """Write a canvas of new_canvas() to a file; ResultsError if that fails."""
    with written(path) as target:
        canvas.savefig(target, dpi=110, metadata={"Date": None} if path.suffix == ".svg" else None)
    return path


def new_canvas(title: str, size: tuple[float, float]) -> Canvas:
    """A figure of matplotlib without a window and without pyplot's global state."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as MatplotlibFigure

    canvas = MatplotlibFigure(layout="constrained", figsize=size)
    FigureCanvasAgg(canvas)
    canvas.suptitle(title)
    return canvas


# ---- one run


def paint(figure: Figure | Drawing, result: Result) -> Canvas:
    """The figure of one run as matplotlib has it."""
    if isinstance(figure, Drawing):
        canvas = new_canvas(figure.title, figure.size)
        figure.draw(canvas, result)
        return canvas
    canvas = new_canvas(figure.title, (8, 1.2 + 2.6 * len(figure.panels)))
    for axes, panel in _panels(canvas, figure):
        for curve in panel.curves:
            _draw_curve(axes, result, panel, curve)
        _shade(axes, panel, [result])
        if axes.get_legend_handles_labels()[1]:
            axes.legend(loc="best", fontsize="small", ncols=3)
    return canvas


def _panels(canvas: Canvas, figure: Figure) -> Iterator[tuple[Any, Panel]]:
    for i, panel in enumerate(figure.panels, start=1):
        axes = canvas.add_subplot(len(figure.panels), 1, i)
        axes.set(xlabel="time [s]", ylabel=panel.ylabel)
        axes.grid(alpha=0.3)
        if panel.log:
            axes.set_yscale("log")
        if panel.level is not None:
            axes.axhline(panel.level, color="k", linestyle="--", linewidth=1)
        yield axes, panel


def _shade(axes: Any, panel: Panel, results: Iterable[Result]) -> None:
    """Shade the time in which what is drawn acts in none of the runs."""
    if panel.idle_until is None:
        return
    begin, idle = min((r.time[0], min(panel.idle_until(r), r.time[-1])) for r in results)
    if idle > begin:
        axes.axvspan(begin, idle, color="0.5", alpha=0.15, label="attitude frozen: acts on nothing")


def _draw_curve(axes: Any, result: Result, panel: Panel, curve: Curve) -> None:
    shown = panel.rows(result)
    time, history = result.time[shown], curve.history(result)[shown]
    if history.ndim == 1:
        axes.plot(time, history, curve.style, label=curve.label or None)
        return
    for k in range(history.shape[1]):
        name = curve.labels[k] if k < len(curve.labels) else str(k + 1)
        axes.plot(time, history[:, k], curve.style, label=f"{curve.label} {name}".strip() or None)


# ---- several runs

BAND = (5.0, 50.0, 95.0)
"""Percentiles of the runs at every time: edges and middle of the band."""


def _scale(labels: Sequence[str]) -> tuple[str, list[float]]:
    """What many runs are coloured by: the one parameter that varies, else their number."""
    names, _, values = zip(*(label.partition("=") for label in labels), strict=True)
    try:
        numbers = [float(value) for value in values]
    except ValueError:
        numbers = []
    if len(set(names)) == 1 and numbers:
        return names[0], numbers
    return "run", [float(k) for k in range(1, len(labels) + 1)]


def _mappable(labels: Sequence[str]) -> Any:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    values = _scale(labels)[1]
    return ScalarMappable(Normalize(min(values), max(values)), "viridis")


def _colours(labels: Sequence[str]) -> dict[str, Colour]:
    """A colour for every run by its label."""
    if len(labels) < MANY:
        return {label: f"C{number}" for number, label in enumerate(labels)}
    return dict(zip(labels, _mappable(labels).to_rgba(_scale(labels)[1]), strict=True))


def paint_overlay(
    figure: Figure | Overlay, results: Mapping[str, Result], colours: Mapping[str, Colour]
) -> Canvas:
    """The figure of several runs as matplotlib has it: a colour for each by its label, one legend
    or scale of colours for all panels.
    """
    if isinstance(figure, Overlay):
        canvas = new_canvas(figure.title, figure.size)
        figure.draw(canvas, results, colours)
    else:
        canvas = new_canvas(figure.title, (9, 1.6 + 2.4 * len(figure.panels)))
        for axes, panel in _panels(canvas, figure):
            for curve in panel.curves:
                _draw_runs(axes, panel, curve, results, colours)
            _shade(axes, panel, results.values())
    if len(colours) >= MANY:
        labels = list(colours)
        canvas.colorbar(_mappable(labels), ax=canvas.axes, label=_scale(labels)[0], shrink=0.8)
    elif isinstance(figure, Figure):
        lines = canvas.axes[0].get_lines()[:: len(figure.panels[0].curves)]
        canvas.legend(lines, list(results), loc="outside lower center", ncols=2, fontsize="small")
    return canvas


def _draw_runs(
    axes: Any,
    panel: Panel,
    curve: Curve,
    results: Mapping[str, Result],
    colours: Mapping[str, Colour],
) -> None:
    histories = {label: _positive(curve.history(r), panel) for label, r in results.items()}
    many = len(results) >= MANY
    for label, history in histories.items():
        look = {"linewidth": 0.5, "alpha": 0.5} if many else {"linewidth": 1}
        axes.plot(results[label].time, history, curve.style, color=colours[label], **look)
    times = [result.time for result in results.values()]
    if many and all(np.array_equal(times[0], time) for time in times):
        low, middle, high = np.nanpercentile(list(histories.values()), BAND, axis=0)
        axes.fill_between(times[0], low, high, color="k", alpha=0.15, linewidth=0)
        axes.plot(times[0], middle, "k-", linewidth=1)


def _positive(history: np.ndarray[Any, Any], panel: Panel) -> np.ndarray[Any, Any]:
    """Zeros cannot be drawn on a logarithmic axis."""
    return np.where(history > 0, history, np.nan) if panel.log else history
