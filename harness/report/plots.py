# SPDX-License-Identifier: BSD-2-Clause
"""Plots as data: the tables of harness/figures and all variables of a result, thinned, as the page
draws them.

A plot is a dictionary: `title`, `x` and `y` (labels of the axes), `time` (whether x is the time of
the run: then its zoom is linked), `log`, `levels` (height and text), `shade` ([begin, end, text])
and `curves`. A curve names its arrays and says how it looks: `colour` is a number of the palette,
or "ink"; `dash` a style of the page; `group` the run it belongs to.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from harness.figures.limits import ROUNDING, unit_of
from harness.mission import Curve, Figure, Panel, Phase
from harness.mission.library import of_result
from harness.report.arrays import Arrays, kept_points, kept_rows
from harness.results.result import Array, Result, Rows
from harness.system.names import base

Plot = dict[str, Any]

DASHES = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot")
"""Styles of the elements of a vector, so that no curve is told by its colour alone."""
STYLES = {"--": "dash", ":": "dot", "-.": "dashdot", "-": "solid"}
"""Line styles of matplotlib."""
DECADES = 3.0
"""Positive histories that span so many powers of ten are drawn on a logarithmic axis."""
AXES = ("x", "y", "z")
QUATERNION = ("q0", "q1", "q2", "q3")


class Canvas:
    """Where the plots of a page keep their numbers; points: of a curve, at most."""

    def __init__(self, arrays: Arrays, points: int) -> None:
        self.arrays, self.points = arrays, points
        self.thinned = False
        self._kept: dict[int, Any] = {}

    def curve(self, time: Array, values: Array, name: str, **look: Any) -> Plot:
        """One history with its extremes."""
        rows = kept_rows(values, self.points)
        self.thinned |= len(rows) < len(values)
        return {
            "name": name,
            "x": self.arrays.keep(time[rows]),
            "y": self.arrays.keep(values[rows]),
            **look,
        }

    def rows_of(self, x: Array, y: Array) -> Rows:
        """The rows of a curve in a plane that are drawn."""
        return kept_points(x, y, self.points)


# ---- the figures of one run


def figure(canvas: Canvas, table: Figure, result: Result) -> list[Plot]:
    """The panels of a figure of one run that are not zero throughout."""
    return calmed(
        [_panel(canvas, panel, result) for panel in table.panels if any_of(panel, result)]
    )


def any_of(panel: Panel, *results: Result) -> bool:
    """Whether a panel shows anything but zeros."""
    return any(
        np.nan_to_num(curve.history(r)[panel.rows(r)]).any()
        for r in results
        for curve in panel.held(r)
    )


def _panel(canvas: Canvas, panel: Panel, result: Result) -> Plot:
    shown = panel.rows(result)
    curves: list[Plot] = []
    size, first = 0.0, 0
    for curve in panel.held(result):
        time, history = curve.broken(result.time[shown], curve.history(result)[shown])
        first, count = (first if curve.anew else len(curves)), len(curves)
        size = max(size, float(np.abs(np.nan_to_num(history)).max()))
        for values, name, dash in _elements(curve, history):
            colour = "ink" if "k" in curve.style else first + len(curves) - count
            curves.append(canvas.curve(time, values, name, colour=colour, dash=dash))
    curves += [_least(canvas, panel, *found) for found in panel.minima(result)]
    about = {"log": panel.log, "levels": _levels(panel, result), "shade": _idle(panel, result)}
    return plot(panel.ylabel, curves, size=size, **about)


def _least(canvas: Canvas, panel: Panel, time: float, value: float) -> Plot:
    """A mark where the least value matters."""
    text = f"least {value:.4g} {unit_of(panel.ylabel)} at {time:g} s"
    look = {"colour": "ink", "dash": "solid", "marker": "circle"}
    return canvas.curve(np.array([time]), np.array([value]), text, **look)


def plot(y: str, curves: list[Plot], **about: Any) -> Plot:
    """A plot over time."""
    return {"x": "time [s]", "y": y, "time": True, "curves": curves, **about}


def calmed(plots: list[Plot]) -> list[Plot]:
    """The same with the axes of plots that show rounding as wide as those beside them in the same
    unit.
    """
    for each in plots:
        beside = [p["size"] for p in plots if unit_of(p["y"]) == unit_of(each["y"])]
        if each["size"] < ROUNDING * max(beside):
            each["range"] = [-max(beside), max(beside)]
    return plots


def _elements(curve: Curve, history: Array) -> Iterator[tuple[Array, str, str]]:
    """Values, name and style of every line of a curve."""
    style = STYLES[re.sub(r"[a-z]", "", curve.style) or "-"]
    if history.ndim == 1:
        yield history, curve.label, style
        return
    for k in range(history.shape[1]):
        label = curve.labels[k] if k < len(curve.labels) else str(k + 1)
        dash = DASHES[k % len(DASHES)] if style == "solid" else style
        yield history[:, k], f"{curve.label} {label}".strip(), dash


def _levels(panel: Panel, result: Result) -> list[Plot]:
    """A horizontal line with its name, if the result says where it is."""
    height = panel.level.height(result) if panel.level else None
    if panel.level is None or height is None:
        return []
    return [
        {"y": height, "text": f"{panel.level.label} {height:g} {unit_of(panel.ylabel)}".strip()}
    ]


def _idle(panel: Panel, *results: Result) -> list[list[Any]]:
    """The time in which what is drawn acts in none of the runs."""
    if panel.idle_until is None:
        return []
    begin, end = min((r.time[0], min(panel.idle_until(r), r.time[-1])) for r in results)
    return [[float(begin), float(end), "attitude frozen: acts on nothing"]] if end > begin else []


# ---- all variables of one run


def signals(canvas: Canvas, result: Result) -> list[dict[str, Any]]:
    """Every variable by component: what does not change with its value, the others as plots."""
    components: dict[str, dict[str, Any]] = {}
    for name in result.names:
        values = result[name]
        component, _, variable = name.partition(".")
        group = components.setdefault(component, {"name": component, "plots": [], "fixed": []})
        about = {"variable": variable, "text": result.description(name), "unit": result.unit(name)}
        if len(values) and (values == values[0]).all():
            group["fixed"].append(about | {"value": number(values[0])})
        elif len(values):
            group["plots"].append(about | _signal(canvas, result, name, values))
    return list(components.values())


def _signal(canvas: Canvas, result: Result, name: str, values: Array) -> Plot:
    flat = values.reshape(len(values), -1)
    if (bound := dict(of_result(result).idle).get(name)) is not None:
        flat = np.where(flat < bound, flat, np.nan)
    labels = _labels(result, name, values)
    curves = [
        canvas.curve(result.time, column, label, colour=k, dash=DASHES[k % len(DASHES)])
        for k, (column, label) in enumerate(zip(flat.T, labels, strict=True))
    ]
    unit = result.unit(name)
    return plot(f"{name.partition('.')[2]} [{unit}]" if unit else name, curves, log=spans(flat))


def _labels(result: Result, name: str, values: Array) -> list[str]:
    if values.ndim == 1:
        return [""]
    if values.ndim == 2 and values.shape[1] == 3:
        return list(AXES)
    if values.ndim == 2 and values.shape[1] == 4 and base(name).rpartition(".")[2].startswith("q_"):
        return list(QUATERNION)
    return [result.columns[i].removeprefix(name) for i in result.vectors[name].flat]


def spans(values: Array) -> bool:
    """Whether values are positive and span decades."""
    finite = values[np.isfinite(values)]
    if not finite.size or finite.min() <= 0:
        return False
    return bool(np.log10(finite.max()) - np.log10(finite.min()) > DECADES)


def number(value: Any) -> str:
    """A number, vector or matrix as text, with the digits that are worth reading."""
    array = np.asarray(value)
    if array.ndim:
        return f"[{', '.join(map(number, array))}]"
    return f"{float(array):.6g}"


# ---- several runs


def overlay(canvas: Canvas, table: Figure, results: Mapping[str, Result]) -> list[Plot]:
    """The panels of a figure of several runs: a colour for each run."""
    fitting = {label: r for label, r in results.items() if table.fits(r)}
    return [
        _overlaid(canvas, panel, fitting, list(results))
        for panel in table.panels
        if any_of(panel, *fitting.values())
    ]


def _overlaid(
    canvas: Canvas, panel: Panel, results: Mapping[str, Result], labels: list[str]
) -> Plot:
    curves = [
        canvas.curve(
            time,
            values,
            f"{label} {name}".strip(),
            colour=labels.index(label),
            dash=dash if curve.style else DASHES[labels.index(label) % len(DASHES)],
            group=label,
        )
        for label, r in results.items()
        for curve in panel.held(r)
        for time, history in [curve.broken(r.time, curve.history(r))]
        for values, name, dash in _elements(curve, history)
    ]
    first = next(iter(results.values()))
    about = {"levels": _levels(panel, first), "shade": _idle(panel, *results.values())}
    return plot(panel.ylabel, curves, log=panel.log, **about)


# ---- a quantity against its rate, for every result that holds both


def phases(canvas: Canvas, result: Result) -> Iterator[Plot]:
    """Phase plots of a result whose quantities move."""
    for phase in of_result(result).phases:
        if not result.holds(*phase.needs):
            continue
        first = int(np.searchsorted(result.time, phase.after(result))) if phase.after else 0
        columns = [
            np.atleast_2d(values.T).T[first:]
            for values in (phase.value(result), phase.rate(result))
        ]
        if all(c.size and np.nanmax(c) > np.nanmin(c) for c in columns):
            yield _plot(canvas, phase, *columns)


def _plot(canvas: Canvas, phase: Phase, x: Array, y: Array) -> Plot:
    curves = []
    for k in range(x.shape[1]):
        rows = canvas.rows_of(x[:, k], y[:, k])
        canvas.thinned |= len(rows) < len(x)
        name = "" if x.shape[1] == 1 else AXES[k] if x.shape[1] == 3 else str(k + 1)
        curves.append(
            {
                "name": name,
                "x": canvas.arrays.keep(x[rows, k]),
                "y": canvas.arrays.keep(y[rows, k]),
                "colour": k,
                "dash": DASHES[k],
                "ends": True,
            }
        )
    return {"title": phase.title, "x": phase.x, "y": phase.y, "time": False, "curves": curves}
