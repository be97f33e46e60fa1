# SPDX-License-Identifier: BSD-2-Clause
"""Pictures of results: what a mission lists drawn by matplotlib, for one run or several in
one.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import ResultsError
from harness.figures.captions import written_captions
from harness.figures.choice import figure_of, figures_of, overlays_of
from harness.figures.finish import finished
from harness.figures.limits import calm, cut_spikes, unit_of
from harness.figures.style import (
    MANY,
    SCREEN,
    Style,
    fitting,
    legend_above,
    new_canvas,
    save,
    time_axis,
    wrapped,
)
from harness.mission.figure import Colour, Curve, Drawing, Figure, Overlay, Panel
from harness.results.result import Array, Result

_log = logging.getLogger("harness")

Canvas = Any
"""Figure of matplotlib."""


def plot(
    result: Result,
    directory: Path,
    ending: str = "png",
    style: Style = SCREEN,
    variables: Sequence[str] = (),
) -> list[Path]:
    """Draw every figure whose variables the result holds, or one of the variables named; returns
    the files written.

    ending: png, svg or pdf. Raises ResultsError if no figure fits or the directory cannot be
    written, UsageError for a variable that the result does not hold.
    """
    found = [figure_of(result, variables)] if variables else figures_of(result)
    figures = {figure.name: figure for figure in found if figure.fits(result)}
    if not figures:
        raise ResultsError("nothing that the result holds changes: there is no figure to draw")
    empty = [name for name, figure in figures.items() if figure.is_empty(result)]
    if empty and not variables:
        _log.warning("not drawn, for nothing changes in them: %s", ", ".join(empty))
        figures = {name: figure for name, figure in figures.items() if name not in empty}
    drawn = {name: partial(paint, f, result, style) for name, f in figures.items()}
    files = _write(directory, ending, style, drawn)
    captioned = style.printed and not variables
    return files + (written_captions(directory, figures, {"": result}) if captioned else [])


def shown(result: Result, names: Sequence[str] = ()) -> Canvas:
    """A figure for a notebook: that of a name, that of variables, or without names the first one
    that the result has.

    Raises ResultsError if there is none, UsageError for a name that is neither.
    """
    known = {f.name: f for f in figures_of(result) if not f.is_empty(result)}
    if not names and not known:
        raise ResultsError("nothing that the result holds changes: name some variables")
    name = names[0] if names else next(iter(known))
    figure = known[name] if name in known else figure_of(result, names)
    with SCREEN.used():
        canvas = paint(figure, result)
    canvas._repr_png_ = partial(_png, canvas)  # whether or not pyplot was ever imported
    return canvas


def _png(canvas: Canvas) -> bytes:
    buffer = BytesIO()
    canvas.savefig(buffer, format="png")
    return buffer.getvalue()


def overlay(
    results: Mapping[str, Result], directory: Path, ending: str = "png", style: Style = SCREEN
) -> list[Path]:
    """Draw several runs, by label, into the same figures; returns the files written, none if no
    figure fits.

    A run that lacks a variable of a figure is left out of it, and the title says so; a figure that
    one run alone has compares nothing: it is left out with a note. Ten runs or more have the
    colours of a scale and the band of the middle nine tenths instead of a legend. Raises
    ResultsError if the directory cannot be written.
    """
    offered = overlays_of(results) if results else ()
    fitting = {f: {label: r for label, r in results.items() if f.fits(r)} for f in offered}
    colours = _colours(list(results))
    shown = {f: r for f, r in fitting.items() if not all(f.is_empty(run) for run in r.values())}
    if alone := [f for f, runs in shown.items() if len(runs) < min(2, len(results))]:
        names = ", ".join(f"{f.name} ({next(iter(shown[f]))})" for f in alone)
        _log.warning("not compared, for one run alone has them: %s", names)
    figures = {f: runs for f, runs in shown.items() if f not in alone}
    drawn = {f.name: partial(paint_overlay, named(f, runs, results), runs, colours, style)
             for f, runs in figures.items()}  # fmt: skip
    files = _write(directory, ending, style, drawn)
    about = {f.name: named(f, runs, results) for f, runs in figures.items()}
    return files + (written_captions(directory, about, results) if style.printed else [])


def named(
    figure: Figure | Overlay, shown: Mapping[str, Result], results: Mapping[str, Result]
) -> Figure | Overlay:
    """A figure of several runs whose title names those that are not in it."""
    absent = [label for label in results if label not in shown]
    return (
        replace(figure, title=f"{figure.title}; without {', '.join(absent)}") if absent else figure
    )


def _write(
    directory: Path, ending: str, style: Style, figures: Mapping[str, Callable[[], Canvas]]
) -> list[Path]:
    with style.used():
        return [save(draw(), directory / f"{name}.{ending}") for name, draw in figures.items()]


# ---- one run


def paint(figure: Figure | Drawing, result: Result, style: Style = SCREEN) -> Canvas:
    """The figure of one run as matplotlib has it."""
    if isinstance(figure, Drawing):
        canvas = new_canvas(figure.title, figure.size, style)
        figure.draw(canvas, result)
        clock = time_axis(result.time)
        return finished(canvas, _end(clock.seconds, result), style.printed)
    canvas, panels = _panels(figure, [result], style)
    time, labelled = time_axis(result.time), [""]
    for axes, panel in panels:
        for curve in panel.held(result):
            _draw_curve(axes, result, panel, curve, time.seconds)
        _shade(axes, panel, [result], time.seconds)
        _mark_least(axes, panel, result, time.seconds)
        labels = axes.get_legend_handles_labels()[1]
        if labels != labelled:
            legend_above(axes)
        labelled = labels
    calm([(axes, panel.ylabel) for axes, panel in panels])
    return finished(canvas, _end(time.seconds, result), style.printed)


def _end(seconds: float, *results: Result) -> float | None:
    """End of the axis of time of several runs."""
    return max((float(r.time[-1]) for r in results if len(r.time)), default=0.0) / seconds or None


def _mark_least(axes: Any, panel: Panel, result: Result, seconds: float) -> None:
    """A mark with its value where the least value matters."""
    for time, value in panel.minima(result):
        text = f"least {value:.4g} {unit_of(panel.ylabel)}".strip()
        axes.plot(time / seconds, value, "kv", markersize=5, label=text)


def _panels(
    figure: Figure, results: Sequence[Result], style: Style
) -> tuple[Canvas, list[tuple[Any, Panel]]]:
    """Axes of the panels that show something, one below the other; the title names the others."""
    silent = [panel for panel in figure.panels if all(_is_silent(panel, r) for r in results)]
    shown = [panel for panel in figure.panels if panel not in silent] or list(figure.panels)
    left = [panel.ylabel for panel in figure.panels if panel not in shown]
    title = "\n".join([figure.title] + [f"zero throughout: {', '.join(left)}"] * bool(left))
    canvas = new_canvas(title, (8, 1.2 + 2.2 * len(shown)), style)
    column = canvas.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    column[-1].set_xlabel(time_axis(*(r.time for r in results)).label)
    for axes, panel in zip(column, shown, strict=True):
        axes.set_ylabel(wrapped(panel.ylabel, canvas.get_figheight() / (len(shown) + 0.5)))
        if panel.log:
            axes.set_yscale("log")
        _draw_level(axes, panel, results[0])
    canvas.align_ylabels()
    return canvas, list(zip(column, shown, strict=True))


def _is_silent(panel: Panel, result: Result) -> bool:
    """Whether there is nothing but zeros, or no number at all."""
    shown = panel.rows(result)
    return not any(np.nan_to_num(c.history(result)[shown]).any() for c in panel.held(result))


def _draw_level(axes: Any, panel: Panel, result: Result) -> None:
    height = panel.level.height(result) if panel.level else None
    if panel.level and height is not None:
        label = f"{panel.level.label} {height:g} {unit_of(panel.ylabel)}".strip()
        axes.axhline(height, color="0.3", linestyle="--", linewidth=0.8, label=label, zorder=1)


def _shade(axes: Any, panel: Panel, results: Iterable[Result], seconds: float) -> None:
    """Shade the time in which what is drawn acts in none of the runs."""
    if panel.idle_until is None:
        return
    begin, idle = min((r.time[0], min(panel.idle_until(r), r.time[-1])) for r in results)
    if idle > begin:
        look = {"color": "0.5", "alpha": 0.15, "label": "attitude frozen: acts on nothing"}
        axes.axvspan(begin / seconds, idle / seconds, **look)


def _draw_curve(axes: Any, result: Result, panel: Panel, curve: Curve, seconds: float) -> None:
    if curve.anew:
        axes.set_prop_cycle(None)
    shown = panel.rows(result)
    time, history = curve.broken(result.time[shown] / seconds, curve.history(result)[shown])
    given = (curve.style,) if curve.style else ()
    if history.ndim == 1:
        axes.plot(time, history, *given, label=curve.label or None)
        return
    for k in range(history.shape[1]):
        name = curve.labels[k] if k < len(curve.labels) else str(k + 1)
        axes.plot(time, history[:, k], *given, label=f"{curve.label} {name}".strip() or None)


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


def _styles(colours: Mapping[str, Colour]) -> dict[str, Any]:
    """A line style for every run by its label, if the style sheet has some."""
    from matplotlib import rcParams

    cycle = rcParams["axes.prop_cycle"].by_key().get("linestyle", ["-"])
    return {label: cycle[k % len(cycle)] for k, label in enumerate(colours)}


def paint_overlay(
    figure: Figure | Overlay,
    results: Mapping[str, Result],
    colours: Mapping[str, Colour] | None = None,
    style: Style = SCREEN,
) -> Canvas:
    """The figure of several runs as matplotlib has it: a colour for each by its label, one legend
    or scale of colours for all panels.
    """
    colours = _colours(list(results)) if colours is None else colours
    if isinstance(figure, Overlay):
        canvas = new_canvas(figure.title, figure.size, style)
        figure.draw(canvas, results, colours)
    else:
        canvas, panels = _panels(figure, list(results.values()), style)
        seconds = time_axis(*(r.time for r in results.values())).seconds
        for axes, panel in panels:
            _draw_runs(axes, panel, results, colours, seconds)
            _shade(axes, panel, results.values(), seconds)
            legend_above(axes)
        calm([(axes, panel.ylabel) for axes, panel in panels])
        _name_runs(canvas, results, colours, style)
    if len(colours) >= MANY:
        labels = list(colours)
        canvas.colorbar(_mappable(labels), ax=canvas.axes, label=_scale(labels)[0], shrink=0.8)
    seconds = time_axis(*(r.time for r in results.values())).seconds
    printed = style.printed and len(colours) < MANY
    return finished(canvas, _end(seconds, *results.values()), printed)


def _name_runs(
    canvas: Canvas, results: Mapping[str, Result], colours: Mapping[str, Colour], style: Style
) -> None:
    """One legend for all panels, as wide as the names allow."""
    from matplotlib.lines import Line2D

    if len(colours) >= MANY:
        return
    styles = _styles(colours)
    lines = [Line2D([], [], color=colours[r], linestyle=styles[r]) for r in results]
    names = list(results)
    columns = fitting(names, canvas.get_figwidth())
    canvas.legend(lines, names, loc="outside lower center", ncols=columns)


def _draw_runs(
    axes: Any,
    panel: Panel,
    results: Mapping[str, Result],
    colours: Mapping[str, Colour],
    seconds: float,
) -> None:
    histories = [_draw_run(axes, panel, c, results, colours, seconds) for c in panel.curves]
    cut_spikes(axes, list(chain.from_iterable(histories)))


def _draw_run(  # noqa: PLR0913, PLR0917 - a curve of all runs
    axes: Any,
    panel: Panel,
    curve: Curve,
    results: Mapping[str, Result],
    colours: Mapping[str, Colour],
    seconds: float,
) -> list[Array]:
    """One curve of every run; returns what was drawn."""
    histories = {label: _positive(curve.history(r), panel) for label, r in results.items()}
    many, styles = len(results) >= MANY, _styles(colours)
    for label, history in histories.items():
        look = {"linewidth": 0.5, "alpha": 0.5} if many else {"linestyle": styles[label]}
        look |= {"linestyle": curve.style} if curve.style else {}
        drawn_as = curve.broken(results[label].time / seconds, history)
        axes.plot(*drawn_as, color=colours[label], **look)
    times = [result.time for result in results.values()]
    if many and all(np.array_equal(times[0], time) for time in times):
        drawn = np.stack(list(histories.values()))
        percentile = np.nanpercentile if np.isnan(drawn).any() else np.percentile  # far quicker
        low, middle, high = percentile(drawn, BAND, axis=0)
        axes.fill_between(times[0] / seconds, low, high, color="k", alpha=0.15, linewidth=0)
        axes.plot(times[0] / seconds, middle, "k-", linewidth=1)
    return list(histories.values())


def _positive(history: Array, panel: Panel) -> Array:
    """Zeros cannot be drawn on a logarithmic axis."""
    return np.where(history > 0, history, np.nan) if panel.log else history
