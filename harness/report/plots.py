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

from harness.figures.finish import ROUNDING
from harness.mission.figure import AXES, IDLE, Curve, Figure, Panel, Phase, unit_of
from harness.mission.library import of_result
from harness.report.arrays import Canvas
from harness.results.result import Array, Result
from harness.system.values import base

Plot = dict[str, Any]

DASHES = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot")
"""Styles of the elements of a vector, so that no curve is told by its colour alone."""
STYLES = {"--": "dash", ":": "dot", "-.": "dashdot", "-": "solid"}
"""Line styles of matplotlib."""
DECADES = 3.0
"""Positive histories that span so many powers of ten are drawn on a logarithmic axis."""
QUATERNION = ("q0", "q1", "q2", "q3")


# ---- the figures of one run


def figure(canvas: Canvas, table: Figure, result: Result) -> list[Plot]:
    """The panels of a figure of one run that are not zero throughout."""
    return calmed(
        [_panel(canvas, panel, result) for panel in table.panels if not panel.is_silent(result)]
    )


def _panel(canvas: Canvas, panel: Panel, result: Result) -> Plot:
    shown = panel.rows(result)
    curves: list[Plot] = []
    size, first = 0.0, 0
    for curve in panel.held(result):
        time, history = curve.broken(result.time[shown], curve.history(result)[shown])
        first, count = (first if curve.anew else len(curves)), len(curves)
        size = max(size, float(np.abs(np.nan_to_num(history)).max()))
        for values, name, dash in _lines(curve, history):
            colour = "ink" if "k" in curve.style else first + len(curves) - count
            curves.append(canvas.curve(time, values, name, colour=colour, dash=dash))
    curves += _least(canvas, panel, result)
    return plot(panel.ylabel, curves, size=size, log=panel.log, **_marks(panel, result))


def _least(canvas: Canvas, panel: Panel, result: Result) -> Iterator[Plot]:
    """A mark where the least value of a curve matters."""
    look = {"colour": "ink", "dash": "solid", "marker": "circle"}
    for time, value in panel.minima(result):
        text = f"least {value:.4g} {unit_of(panel.ylabel)} at {time:g} s"
        yield canvas.curve(np.array([time]), np.array([value]), text, **look)


def diagram(title: str, x: str, y: str, curves: list[Plot]) -> Plot:
    """A plot over something else than time."""
    return {"title": title, "x": x, "y": y, "time": False, "curves": curves}


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


def _lines(curve: Curve, history: Array) -> Iterator[tuple[Array, str, str]]:
    """Values, name and style of every line of a curve."""
    style = STYLES[re.sub(r"[a-z]", "", curve.style) or "-"]
    for k, (values, name) in enumerate(curve.lines(history)):
        yield values, name, DASHES[k % len(DASHES)] if style == "solid" else style


def _marks(panel: Panel, *results: Result) -> dict[str, Any]:
    """The level of the first result, and the time in which what is drawn acts in none."""
    line, idle = panel.line(results[0]), panel.idle(results)
    return {
        "levels": [{"y": line[0], "text": line[1]}] if line else [],
        "shade": [[*idle, IDLE]] if idle else [],
    }


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
        if not panel.is_silent(*fitting.values())
    ]


def _overlaid(
    canvas: Canvas, panel: Panel, results: Mapping[str, Result], labels: list[str]
) -> Plot:
    curves = []
    for label, result in results.items():
        colour = labels.index(label)
        for curve in panel.held(result):
            time, history = curve.broken(result.time, curve.history(result))
            for values, name, style in _lines(curve, history):
                dash = style if curve.style else DASHES[colour % len(DASHES)]
                look = {"colour": colour, "dash": dash, "group": label}
                curves.append(canvas.curve(time, values, f"{label} {name}".strip(), **look))
    return plot(panel.ylabel, curves, log=panel.log, **_marks(panel, *results.values()))


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
    names = {1: ("",), 3: AXES}.get(x.shape[1], tuple(str(k + 1) for k in range(x.shape[1])))
    curves = []
    for k, name in enumerate(names):
        look = {"colour": k, "dash": DASHES[k], "ends": True}
        curves.append({"name": name, **canvas.plane(x[:, k], y[:, k], **look)})
    return diagram(phase.title, phase.x, phase.y, curves)
