# SPDX-License-Identifier: BSD-2-Clause
"""Plots as data, thinned, as the page draws them: figures, read back from the axes of matplotlib so
that each is described once, phase plots and all variables. Views in space are left to the replay.

A plot is a dictionary: `title`, `x` and `y` (labels of the axes), `time` (whether x is the time of
the run: then its zoom is linked), `log`, `levels` (height and text), `shade` ([begin, end, text])
and `curves`. A curve names its arrays and says how it looks: `colour` is a number of the palette,
or "ink"; `dash` a style of Plotly; `group` the run it belongs to.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from harness.figures.captions import untexed
from harness.figures.finish import plane
from harness.figures.style import Style
from harness.mission.figure import AXES, Phase
from harness.mission.library import of_result
from harness.report.arrays import Canvas
from harness.results.result import Array, Result
from harness.system.values import base

Plot = dict[str, Any]

PAGE = Style("page", sheets=("screen.mplstyle", "page.mplstyle"))
"""How figures are drawn that a page reads back."""
DASHES = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot")
"""Styles of the elements of a vector, so that no curve is told by its colour alone."""
DECADES = 3.0
"""Positive histories that span so many powers of ten are drawn on a logarithmic axis."""
QUATERNION = ("q0", "q1", "q2", "q3")
SECONDS = {"time [s]": 1.0, "time [h]": 3600.0}
"""Labels of the time axis and their seconds."""
INK = ("k", "black", "#000000", (0.0, 0.0, 0.0, 1.0))


# ---- what matplotlib was told to draw


def painted(canvas: Canvas, drawing: Any) -> list[Plot]:
    """The plane axes of a figure of matplotlib, from top to bottom."""
    return [_plot(canvas, axes) | _scales(axes) for axes in plane(drawing)]


def _plot(canvas: Canvas, axes: Any) -> Plot:
    seconds = _seconds(axes)
    return {
        "title": axes.get_title(),
        "x": "time [s]" if seconds else axes.get_xlabel(),
        "y": " ".join(axes.get_ylabel().split()),
        "time": seconds > 0,
        "log": axes.get_yscale() == "log",
        "equal": axes.get_aspect() == 1.0,
        "levels": _levels(axes),
        "shade": _shade(axes, seconds or 1.0),
        "notes": [
            t.get_text() for t in axes.texts if getattr(t, "xycoords", "") == "axes fraction"
        ],
        "curves": list(_curves(canvas, axes, seconds)),
    }


def _seconds(axes: Any) -> float:
    """Seconds of the unit of an axis of time, 0 of another one."""
    shared = axes.get_shared_x_axes().get_siblings(axes)
    return max((SECONDS.get(each.get_xlabel(), 0.0) for each in shared), default=0.0)


def _scales(axes: Any) -> Plot:
    """Limits of axes that were set, and ticks that are words."""
    found: Plot = {}
    if not axes.get_autoscaley_on():
        found["range"] = [float(limit) for limit in axes.get_ylim()]
    if not axes.get_autoscalex_on() and not _seconds(axes):
        found["range_x"] = [float(limit) for limit in axes.get_xlim()]
    texts = [untexed(label.get_text()) for label in axes.get_yticklabels()]
    if any(re.search("[A-Za-z]", text) for text in texts):
        found["ticks"] = [[float(place) for place in axes.get_yticks()], texts]
    return found


def _levels(axes: Any) -> list[Plot]:
    """Lines that are horizontal through all of the axes."""
    other = [line for line in axes.get_lines() if line.get_transform() != axes.transData]
    flat = [line for line in other if np.ptp(np.asarray(line.get_ydata(), dtype=float)) == 0]
    return [{"y": float(line.get_ydata()[0]), "text": _named(line)} for line in flat]


def _shade(axes: Any, seconds: float) -> list[Any]:
    """Begin, end and name of what spans all of the axes from top to bottom."""
    spans = (bar for bar in axes.patches if bar.get_data_transform() != axes.transData)
    return [
        [seconds * bar.get_x(), seconds * (bar.get_x() + bar.get_width()), _named(bar)]
        for bar in spans
    ]


def _named(drawn: Any) -> str:
    """The label of what is drawn, if it was given one; that of a line of a run is hidden."""
    label, run = str(drawn.get_label()), drawn.get_gid()
    if run is not None:
        return f"{run} {label.removeprefix('_')}".strip()
    return "" if label.startswith("_") else label


def _curves(canvas: Canvas, axes: Any, seconds: float) -> Iterator[Plot]:
    """Everything that is drawn; seconds: of the unit of time, 0: x is something else."""
    palette: dict[Any, int] = {}
    unit = seconds or 1.0
    for line in axes.get_lines():
        if line.get_transform() == axes.transData:
            yield _line(canvas, line, palette, seconds)
    for image in axes.images:
        yield _image(canvas, image, unit)
    for area in axes.collections:
        for path in area.get_paths():
            corners = _corners(np.asarray(path.vertices, dtype=float)) * (unit, 1)
            yield _filled(canvas, corners, len(palette))
    for bar in axes.patches:
        if bar.get_data_transform() == axes.transData:
            yield _filled(canvas, _outline(bar), 0)


def _outline(bar: Any) -> Any:
    left, bottom, width, height = bar.get_bbox().bounds
    right, top = left + width, bottom + height
    return np.array([[left, bottom], [left, top], [right, top], [right, bottom], [left, bottom]])


def _filled(canvas: Canvas, corners: Any, colour: int) -> Plot:
    return _curve(canvas, *corners.T, name="", fill=True, colour=colour, dash="solid")


def _line(canvas: Canvas, line: Any, palette: dict[Any, int], seconds: float) -> Plot:
    x, y = (np.asarray(data, dtype=float).ravel() for data in (line.get_xdata(), line.get_ydata()))
    look = {"colour": _colour(line.get_color(), palette), "dash": _dash(line)}
    if line.get_linestyle() in ("None", " ", ""):
        look["marker"] = "circle" if len(x) < 3 else "point"
    if line.get_gid() is not None:
        look["group"] = line.get_gid()
    if seconds:
        return canvas.curve(seconds * x, y, _named(line), **look)
    return _curve(canvas, x, y, name=_named(line), **look)


def _dash(line: Any) -> str:
    """Lengths of dashes and gaps, or solid."""
    _, lengths = line._unscaled_dash_pattern
    return ",".join(f"{length:g}px" for length in lengths) if lengths else "solid"


def _curve(canvas: Canvas, x: Any, y: Any, **look: Any) -> Plot:
    return (canvas.plane if len(x) > canvas.points else canvas.line)(x, y, **look)


def _colour(colour: Any, palette: dict[Any, int]) -> Any:
    """A place of the palette: that of a colour `C3`, else in the order of appearance."""
    if isinstance(colour, str) and re.fullmatch(r"C\d+", colour):
        palette.setdefault(colour, int(colour[1:]))
        return palette[colour]
    if colour in INK:
        return "ink"
    return palette.setdefault(colour, len(palette))


def _corners(outline: Any) -> Any:
    """An outline without the points between two of the same height."""
    y = outline[:, 1]
    inner = (np.roll(y, 1) == y) & (np.roll(y, -1) == y)
    inner[[0, -1]] = False
    return outline[~inner]


def _image(canvas: Canvas, image: Any, unit: float) -> Plot:
    """A field of colours with the edges left, right, bottom, top."""
    left, right, bottom, top = (float(edge) for edge in image.get_extent())
    edges = [unit * left, unit * right, bottom, top]
    return {"image": canvas.arrays.keep(np.asarray(image.get_array())), "edges": edges, "name": ""}


# ---- plots of the page alone


def diagram(title: str, x: str, y: str, curves: list[Plot]) -> Plot:
    """A plot over something else than time."""
    return {"title": title, "x": x, "y": y, "time": False, "curves": curves}


def plot(y: str, curves: list[Plot], **about: Any) -> Plot:
    """A plot over time."""
    return {"x": "time [s]", "y": y, "time": True, "curves": curves, **about}


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
            yield _phase(canvas, phase, *columns)


def _phase(canvas: Canvas, phase: Phase, x: Array, y: Array) -> Plot:
    names = {1: ("",), 3: AXES}.get(x.shape[1], tuple(str(k + 1) for k in range(x.shape[1])))
    curves = []
    for k, name in enumerate(names):
        look = {"colour": k, "dash": DASHES[k], "ends": True}
        curves.append({"name": name, **canvas.plane(x[:, k], y[:, k], **look)})
    return diagram(phase.title, phase.x, phase.y, curves)
