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
from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from harness.figures.finish import label_of, plane
from harness.figures.style import Style, place_of
from harness.mission.figure import AXES, Phase
from harness.mission.library import of_result
from harness.report.arrays import Canvas
from harness.results.result import Array, Result
from harness.system.values import base

Plot = dict[str, Any]
Shown = tuple[str, str, str, list[Plot]]
"""Section of a page, name and title of a figure, and its plots."""

PAGE = Style("page", sheets=("screen.mplstyle", "page.mplstyle"))
"""How figures are drawn that a page reads back."""
DASHES = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot")
"""Styles of the elements of a vector, so that no curve is told by its colour alone."""
DECADES = 3.0
"""Positive histories that span so many powers of ten are drawn on a logarithmic axis."""
QUATERNION = ("q0", "q1", "q2", "q3")
SECONDS = {"time [s]": 1.0, "time [h]": 3600.0}
"""Labels of the time axis and their seconds."""
NOTE = "axes fraction"
"""Coordinates of what is written into a corner of axes."""


def sections(found: Iterable[Shown]) -> list[dict[str, Any]]:
    """Figures in their sections, those of one name together; without what has no plots."""
    figures: dict[tuple[str, str], dict[str, Any]] = {}
    for section, name, title, plots in found:
        figure = figures.setdefault((section, name), {"name": name, "title": title, "plots": []})
        figure["plots"] += plots
    listed: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for (section, _), figure in figures.items():
        if figure["plots"]:
            listed[section].append(figure)
    return [{"name": section, "figures": shown} for section, shown in listed.items()]


# ---- what matplotlib was told to draw


def painted(canvas: Canvas, drawing: Any) -> list[Plot]:
    """The plane axes of a figure of matplotlib, from top to bottom."""
    return [_plot(canvas, axes) for axes in plane(drawing)]


def _plot(canvas: Canvas, axes: Any) -> Plot:
    seconds = SECONDS.get(label_of(axes, "x"), 0.0)
    return {
        "title": axes.get_title(),
        "x": "time [s]" if seconds else label_of(axes, "x"),
        "y": " ".join(label_of(axes, "y").split()),
        "time": seconds > 0,
        "levels": _levels(axes),
        "shade": _shade(axes, seconds or 1.0),
        "notes": [t.get_text() for t in axes.texts if getattr(t, "xycoords", "") == NOTE],
        "curves": [*_areas(canvas, axes, seconds or 1.0), *_lines(canvas, axes, seconds)],
        **_scales(axes, seconds > 0),
    }


def _scales(axes: Any, timed: bool) -> Plot:
    """Kinds of axes, limits that were set, and ticks that are words."""
    found: Plot = {"log": axes.get_yscale() == "log", "equal": axes.get_aspect() == 1.0}
    if not axes.get_autoscaley_on():
        found["range"] = [float(limit) for limit in axes.get_ylim()]
    if not axes.get_autoscalex_on() and not timed:
        found["range_x"] = [float(limit) for limit in axes.get_xlim()]
    texts = [label.get_text() for label in axes.get_yticklabels()]
    if any(re.match("[^$]*[A-Za-z]", text) for text in texts):
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


def _lines(canvas: Canvas, axes: Any, seconds: float) -> Iterator[Plot]:
    """Lines and marks; seconds: of the unit of time, 0: x is something else."""
    for line in axes.get_lines():
        if line.get_transform() != axes.transData:
            continue
        x, y = (np.asarray(of(), dtype=float).ravel() for of in (line.get_xdata, line.get_ydata))
        if seconds:
            yield canvas.curve(seconds * x, y, _named(line), **_look(line, len(x)))
        else:
            yield canvas.plane(x, y, name=_named(line), **_look(line, len(x)))


def _look(line: Any, points: int) -> Plot:
    look = {"colour": place_of(line.get_color()), "dash": _dash(line)}
    if line.get_linestyle() in ("None", " ", ""):
        many = "point" if line.get_alpha() is None else "dot"
        look["marker"] = "circle" if points < 3 else many
    if line.get_gid() is not None:
        look["group"] = line.get_gid()
    return look


def _areas(canvas: Canvas, axes: Any, unit: float) -> Iterator[Plot]:
    """What is filled: fields of colours, bands, bars; unit: of x as the page has it."""
    yield from (_image(canvas, image, unit) for image in axes.images)
    for area in axes.collections:
        if hasattr(area, "get_coordinates"):
            yield _mesh(canvas, area, axes.get_title())
            continue
        for path in area.get_paths():
            corners = _corners(np.asarray(path.vertices, dtype=float)) * (unit, 1)
            yield _filled(canvas, corners, area, area.get_facecolor()[0])
    for bar in axes.patches:
        if bar.get_data_transform() == axes.transData:
            corners = bar.get_patch_transform().transform(bar.get_path().vertices)
            yield _filled(canvas, corners, bar, bar.get_facecolor())


def _image(canvas: Canvas, image: Any, unit: float) -> Plot:
    left, right, bottom, top = (float(edge) for edge in image.get_extent())
    field = canvas.arrays.keep(np.asarray(image.get_array()))
    return {"image": field, "edges": [unit * left, unit * right, bottom, top], "name": ""}


def _mesh(canvas: Canvas, mesh: Any, name: str) -> Plot:
    """A field of colours over columns and rows."""
    columns, rows = (mesh.get_coordinates()[..., k] for k in (0, 1))
    field = canvas.arrays.keep(np.ma.filled(mesh.get_array(), np.nan))
    places = {"columns": columns[0].tolist(), "rows": rows[:, 0].tolist()}
    return {"image": field, "name": name, **places}


def _filled(canvas: Canvas, corners: Any, area: Any, colour: Any) -> Plot:
    look = {"name": _named(area), "fill": True, "colour": place_of(colour), "dash": "solid"}
    return canvas.plane(*corners.T, **look, opacity=area.get_alpha())


def _dash(line: Any) -> str:
    """Lengths of dashes and gaps, or solid."""
    _, lengths = line._unscaled_dash_pattern
    return ",".join(f"{length:g}px" for length in lengths) if lengths else "solid"


def _corners(outline: Any) -> Any:
    """An outline without the points between two of the same height."""
    y = outline[:, 1]
    inner = (np.roll(y, 1) == y) & (np.roll(y, -1) == y)
    inner[[0, -1]] = False
    return outline[~inner]


# ---- plots of the page alone


def diagram(title: str, x: str, y: str, curves: list[Plot]) -> Plot:
    """A plot over something else than time."""
    return {"title": title, "x": x, "y": y, "time": False, "curves": curves}


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
    unit, short = result.unit(name), name.partition(".")[2]
    y = f"{short} [{unit}]" if unit else name
    return {"x": "time [s]", "y": y, "time": True, "curves": curves, "log": spans(flat)}


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
