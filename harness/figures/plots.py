# SPDX-License-Identifier: BSD-2-Clause
"""Drawing of the figures of a mission by matplotlib, each for one run or several runs together."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.errors import ResultsError
from harness.figures.choice import compared, figure_of, figures_of
from harness.figures.finish import finish, hide_rounding
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
from harness.mission.figure import IDLE, Colour, Curve, Drawing, Figure, Overlay, Panel, unit_of
from harness.results.result import Array, Result
from harness.spelling import is_number

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
    """Draw every figure that changes and whose variables the result has, or one figure of the named
    variables; return the paths of the files.

    ending: png, svg or pdf. Raises ResultsError if no figure fits and all variables are constant,
    or the directory cannot be written, UsageError for a variable that the result lacks.
    """
    figures = _moving(result, variables)
    drawn = {name: partial(paint, f, result, style) for name, f in figures.items()}
    return _write(directory, ending, style, drawn)


def _moving(result: Result, variables: Sequence[str]) -> dict[str, Figure | Drawing]:
    """Return the figures of a result by name, without figures in which nothing changes. If
    `variables` names variables, return only one figure of them, even if nothing changes. Raises
    ResultsError if no figure of the mission fits and all variables are constant.
    """
    if variables:
        figure = figure_of(result, variables)
        return {figure.name: figure}
    figures = {figure.name: figure for figure in figures_of(result) if figure.fits(result)}
    if not figures:
        raise ResultsError("all variables are constant: there is no figure to draw")
    empty = [name for name, figure in figures.items() if figure.is_empty(result)]
    if empty:
        _log.warning("figures not drawn, since they are empty or constant: %s", ", ".join(empty))
    return {name: figure for name, figure in figures.items() if name not in empty}


def shown(result: Result, names: Sequence[str] = ()) -> Canvas:
    """Return a matplotlib figure for a notebook.

    names: name of one figure of the mission, or names of variables; without names the first figure
    of the result is drawn. Raises ResultsError if all figures are empty or constant and no name is
    given, UsageError for a name that is neither a figure nor a variable.
    """
    known = {f.name: f for f in figures_of(result) if not f.is_empty(result)}
    if not names and not known:
        raise ResultsError("all figures are empty or constant: name some variables to draw")
    name = names[0] if names else next(iter(known))
    figure = known[name] if name in known else figure_of(result, names)
    with SCREEN.used():
        canvas = paint(figure, result)
    canvas._repr_png_ = partial(_png, canvas)  # shows the figure in a notebook without pyplot
    return canvas


def _png(canvas: Canvas) -> bytes:
    buffer = BytesIO()
    canvas.savefig(buffer, format="png")
    return buffer.getvalue()


def overlay(
    results: Mapping[str, Result], directory: Path, ending: str = "png", style: Style = SCREEN
) -> list[Path]:
    """Draw several runs into the same figures; return the paths of the files, [] if no figure can
    be drawn. results: by label of the run.

    A figure leaves out the runs that lack one of its variables, and its title names these runs. A
    figure for which only one run has the variables is not drawn, and a note names it. Ten or more
    runs are coloured by a scale instead of a legend, and have a band from the 5th to the 95th
    percentile if their times are equal. Raises ResultsError if the directory cannot be written.
    """
    found, alone = compared(results) if results else ([], [])
    if alone:
        _log.warning("figures of only one run (in brackets) are not drawn: %s", ", ".join(alone))
    colours = _colours(list(results))
    drawn = {f.name: partial(paint_overlay, f, runs, colours, style) for f, runs in found}
    return _write(directory, ending, style, drawn)


def _write(
    directory: Path, ending: str, style: Style, figures: Mapping[str, Callable[[], Canvas]]
) -> list[Path]:
    with style.used():
        return [save(draw(), directory / f"{name}.{ending}") for name, draw in figures.items()]


# ---- one run


def paint(figure: Figure | Drawing, result: Result, style: Style = SCREEN) -> Canvas:
    """Return the figure of one run as a figure of matplotlib."""
    seconds = time_axis(result.time).seconds
    if isinstance(figure, Drawing):
        canvas = new_canvas(figure.title, figure.size, style)
        figure.draw(canvas, result)
    else:
        canvas = _histories(figure, result, style, seconds)
    return finish(canvas, _end(seconds, result), style.printed)


def _histories(figure: Figure, result: Result, style: Style, seconds: float) -> Canvas:
    """Return a matplotlib figure with the panels of one run. A legend that is equal to the legend
    of the panel above is left out. seconds: length of the unit of the time axis [s].
    """
    canvas, panels = _panels(figure, [result], style)
    labelled = [""]
    for axes, panel in panels:
        _draw_panel(axes, panel, result, seconds)
        labels = axes.get_legend_handles_labels()[1]
        if labels != labelled:
            legend_above(axes)
        labelled = labels
    hide_rounding([(axes, panel.ylabel) for axes, panel in panels])
    return canvas


def _end(seconds: float, *results: Result) -> float | None:
    """Return the end of the longest run in units of `seconds`; None if no run has rows."""
    return max((float(r.time[-1]) for r in results if len(r.time)), default=0.0) / seconds or None


def _draw_panel(axes: Any, panel: Panel, result: Result, seconds: float) -> None:
    for curve in panel.held(result):
        _draw_curve(axes, result, panel, curve, seconds)
    _shade(axes, panel, [result], seconds)
    for time, value in panel.minima(result):
        text = f"least {value:.4g} {unit_of(panel.ylabel)} at {time:g} s"
        axes.plot(time / seconds, value, "kv", markersize=5, label=text)


def _panels(
    figure: Figure, results: Sequence[Result], style: Style
) -> tuple[Canvas, list[tuple[Any, Panel]]]:
    """Return a matplotlib figure, and its panels with their axes, one below the other. Panels whose
    variables are zero in all rows are left out, and the title names them.
    """
    shown = [p for p in figure.panels if not p.is_silent(*results)] or list(figure.panels)
    left = ", ".join(panel.ylabel for panel in figure.panels if panel not in shown)
    title = f"{figure.title}\nzero throughout: {left}" if left else figure.title
    canvas = new_canvas(title, (8, 1.2 + 2.2 * len(shown)), style)
    column = canvas.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
    column[-1].set_xlabel(time_axis(*(r.time for r in results)).label)
    for axes, panel in zip(column, shown, strict=True):
        axes.set_ylabel(wrapped(panel.ylabel, canvas.get_figheight() / (len(shown) + 0.5)))
        _prepare(axes, panel, results[0])
    canvas.align_ylabels()
    return canvas, list(zip(column, shown, strict=True))


def _prepare(axes: Any, panel: Panel, result: Result) -> None:
    """Set the y scale of a panel, and draw its level line. A panel with `log` has a logarithmic
    scale. A panel of a mode (a variable whose values have names) has these names as ticks.
    """
    if panel.log:
        axes.set_yscale("log")
    if names := _modes(panel, result):
        axes.set_yticks(range(len(names)), names, fontsize="x-small")
    if line := panel.line(result):
        height, text = line
        look = {"color": "0.3", "linestyle": "--", "linewidth": 0.8, "zorder": 1}
        axes.axhline(height, label=text, **look)


def _modes(panel: Panel, result: Result) -> tuple[str, ...]:
    """Return the names of the values 0, 1, .. if a panel shows only one variable, whose values have
    names (a mode), else ().
    """
    held = list(panel.held(result))
    source = held[0].source if len(held) == 1 else None
    return result.mode_names(source) if isinstance(source, str) and source in result else ()


def _shade(axes: Any, panel: Panel, results: Iterable[Result], seconds: float) -> None:
    """Shade the times at which the drawn quantities have no effect in any run, such as torques
    while the attitude is frozen. seconds: length of the unit of the time axis [s].
    """
    if idle := panel.idle(results):
        begin, end = idle
        axes.axvspan(begin / seconds, end / seconds, color="0.5", alpha=0.15, label=IDLE)


def _draw_curve(axes: Any, result: Result, panel: Panel, curve: Curve, seconds: float) -> None:
    if curve.anew:
        axes.set_prop_cycle(None)
    shown = panel.rows(result)
    before = result.time[shown] / seconds
    time, history = curve.broken(before, curve.history(result)[shown])
    given = (curve.style,) if curve.style else ()
    for k, (values, name) in enumerate(curve.lines(history)):
        (line,) = axes.plot(time, values, *given, label=name or None)
        if isinstance(curve.source, str) and curve.convert is None and time is before:
            # a live page draws the line again from this variable and element (None: a scalar)
            line.source = curve.source, None if history.ndim == 1 else k


# ---- several runs

BAND = (5.0, 50.0, 95.0)
"""Percentiles over all runs at every time: lower edge, middle line and upper edge of the band."""


def _scale(labels: Sequence[str]) -> tuple[str, list[float]]:
    """Return the name of the quantity that determines the colours of many runs, and its value for
    every run. If all labels are `NAME=VALUE` with the same name and numbers as values, it is this
    parameter, otherwise the number of the run.
    """
    names, _, values = zip(*(label.partition("=") for label in labels), strict=True)
    if len(set(names)) == 1 and all(map(is_number, values)):
        return names[0], [float(value) for value in values]
    return "run", [float(k) for k in range(1, len(labels) + 1)]


def _mappable(labels: Sequence[str]) -> Any:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    values = _scale(labels)[1]
    return ScalarMappable(Normalize(min(values), max(values)), "viridis")


def _colours(labels: Sequence[str]) -> dict[str, Colour]:
    """Return a colour for every run by its label."""
    if len(labels) < MANY:
        return {label: f"C{number}" for number, label in enumerate(labels)}
    return dict(zip(labels, _mappable(labels).to_rgba(_scale(labels)[1]), strict=True))


class _Runs(NamedTuple):
    """Several runs and their colours, both by label. seconds: unit of the time axis in seconds,
    such as 3600 for hours.
    """

    results: Mapping[str, Result]
    colours: Mapping[str, Colour]
    seconds: float

    @property
    def looks(self) -> dict[str, dict[str, Any]]:
        """Return the line properties of every run by its label: thin lines for many runs, the line
        styles of the style sheet for few.
        """
        from matplotlib import rcParams

        cycle = rcParams["axes.prop_cycle"].by_key().get("linestyle", ["-"])
        looks = [{"linestyle": cycle[k % len(cycle)]} for k in range(len(self.colours))]
        if self.many:
            looks = [{"linewidth": 0.5, "alpha": 0.5}] * len(self.colours)
        found = zip(self.colours.items(), looks, strict=True)
        return {label: {"color": colour, **look} for (label, colour), look in found}

    @property
    def many(self) -> bool:
        """Return whether there are so many runs that they are drawn thin, with a colour scale for a
        legend, and with a band of percentiles if all have the same times.
        """
        return len(self.results) >= MANY


def paint_overlay(
    figure: Figure | Overlay,
    results: Mapping[str, Result],
    colours: Mapping[str, Colour] | None = None,
    style: Style = SCREEN,
) -> Canvas:
    """Return a figure of several runs as a figure of matplotlib, with one legend or colour scale
    for all panels.

    results: by label of the run; colours: by label (None: chosen here).
    """
    colours = _colours(list(results)) if colours is None else colours
    runs = _Runs(results, colours, time_axis(*(r.time for r in results.values())).seconds)
    if isinstance(figure, Overlay):
        canvas = new_canvas(figure.title, figure.size, style)
        figure.draw(canvas, results, colours)
    else:
        canvas = _together(figure, runs, style)
    if many := len(colours) >= MANY:
        labels = list(colours)
        canvas.colorbar(_mappable(labels), ax=canvas.axes, label=_scale(labels)[0], shrink=0.8)
    return finish(canvas, _end(runs.seconds, *results.values()), style.printed and not many)


def _together(figure: Figure, runs: _Runs, style: Style) -> Canvas:
    """Return a figure whose panels contain the curves of every run."""
    canvas, panels = _panels(figure, list(runs.results.values()), style)
    for axes, panel in panels:
        for curve in panel.curves:
            _draw_runs(axes, panel, curve, runs)
        _shade(axes, panel, runs.results.values(), runs.seconds)
        legend_above(axes)
    hide_rounding([(axes, panel.ylabel) for axes, panel in panels])
    if len(runs.colours) < MANY:
        _name_runs(canvas, runs)
    return canvas


def _name_runs(canvas: Canvas, runs: _Runs) -> None:
    """Add one legend of all runs below the panels, with as many columns as fit side by side."""
    from matplotlib.lines import Line2D

    names, looks = list(runs.results), runs.looks
    lines = [Line2D([], [], **looks[name]) for name in names]
    columns = fitting(names, canvas.get_figwidth())
    canvas.legend(lines, names, loc="outside lower center", ncols=columns)


def _draw_runs(axes: Any, panel: Panel, curve: Curve, runs: _Runs) -> None:
    """Draw a curve for every run; for many runs also its percentile band."""
    histories = {label: curve.history(result) for label, result in runs.results.items()}
    if panel.log:  # values <= 0 cannot be drawn
        histories = {label: np.where(h > 0, h, np.nan) for label, h in histories.items()}
    looks, own = runs.looks, {"linestyle": curve.style} if curve.style else {}
    for label, history in histories.items():
        look = looks[label] | own | {"gid": label}
        time, broken = curve.broken(runs.results[label].time / runs.seconds, history)
        for values, name in curve.lines(broken):
            axes.plot(time, values, label=f"_{name}", **look)
    if runs.many:
        _draw_band(axes, list(histories.values()), runs)


def _draw_band(axes: Any, histories: Sequence[Array], runs: _Runs) -> None:
    """Draw the percentiles BAND of one curve over all runs, if all runs have the same times."""
    times = [result.time for result in runs.results.values()]
    if all(np.array_equal(times[0], time) for time in times):
        drawn, time = np.stack(histories), times[0] / runs.seconds
        percentile = np.nanpercentile if np.isnan(drawn).any() else np.percentile  # far quicker
        low, middle, high = percentile(drawn, BAND, axis=0)
        axes.fill_between(time, low, high, color="k", alpha=0.15, linewidth=0)
        axes.plot(time, middle, "k-", linewidth=1)
