# SPDX-License-Identifier: BSD-2-Clause
"""Plots of a page as data with thinned curves: figures, phase plots, and all variables. Figures are
drawn with matplotlib and read back from the drawn axes, so that one definition of a figure serves
files and pages. Axes in three dimensions are left out, because the page has a replay.

Main entries of a plot: `title`, `x` and `y` (labels of the axes), `time` (whether x is the time of
the run; all such plots zoom together), `log` (logarithmic y), `levels` (horizontal lines: height
and text), `shade` (vertical bands: [begin, end, text]) and `curves`. A curve contains the names of
its arrays, and its look: `colour` is an index of the palette or "ink", `dash` a line style of
Plotly, `group` the run that the curve belongs to.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from harness.figures.finish import label_of, plane
from harness.figures.style import Style, place_of
from harness.mission.figure import AXES, Phase, values_of
from harness.mission.library import of_result
from harness.report.arrays import Canvas
from harness.results.result import Array, Result
from harness.spelling import number
from harness.system.values import base

Plot = dict[str, Any]
Shown = tuple[str, str, str, list[Plot]]
"""Figure of a page: section of the page, name and title of the figure, and its plots."""

PAGE = Style(("screen.mplstyle", "page.mplstyle"))
"""Style in which matplotlib draws figures for a page, before painted() reads the curves and texts
from their axes.
"""
DASHES = ("solid", "dash", "dot", "dashdot", "longdash", "longdashdot")
"""Line styles for the elements of a vector, in their order, so that curves differ in more than
colour.
"""
DECADES = 3.0
"""Number of powers of ten that the values of a positive time series must span for a logarithmic
axis.
"""
QUATERNION = ("q0", "q1", "q2", "q3")
"""Labels of the elements of a quaternion."""
SECONDS = {"time [s]": 1.0, "time [h]": 3600.0}
"""Labels by which a time axis is recognised, with the length of the unit of the axis [s]."""
NOTE = "axes fraction"
"""Coordinates in which figures place a note in a corner of the axes. painted() recognises notes by
these coordinates, since all other texts have other coordinates.
"""


def sections(found: Iterable[Shown]) -> list[dict[str, Any]]:
    """Return the sections of a page, each with `name` and `figures`; a figure has `name`, `title`
    and `plots`. Figures with the same section and name are combined into one, and figures without
    plots are left out.
    """
    listed: dict[str, dict[str, dict[str, Any]]] = defaultdict(dict)
    for section, name, title, plots in found:
        if plots:
            empty = {"name": name, "title": title, "plots": []}
            listed[section].setdefault(name, empty)["plots"] += plots
    return [{"name": name, "figures": list(shown.values())} for name, shown in listed.items()]


# ---- figures read back from matplotlib


def painted(canvas: Canvas, drawing: Any, result: Result | None = None) -> list[Plot]:
    """Return a plot for each two-dimensional axes of a matplotlib figure, from top to bottom.

    canvas: store of the curves of the page; drawing: the figure; result: the run that the figure
    shows (None: several runs).
    """
    return [_plot(canvas, axes, result) for axes in plane(drawing)]


def _plot(canvas: Canvas, axes: Any, result: Result | None) -> Plot:
    seconds = SECONDS.get(label_of(axes, "x"), 0.0)
    return {
        "title": axes.get_title(),
        "x": "time [s]" if seconds else label_of(axes, "x"),
        "y": " ".join(label_of(axes, "y").split()),
        "time": seconds > 0,
        "levels": _levels(axes),
        "shade": _shade(axes, seconds or 1.0),
        "notes": [t.get_text() for t in axes.texts if getattr(t, "xycoords", "") == NOTE],
        "curves": [*_areas(canvas, axes, seconds or 1.0), *_lines(canvas, axes, seconds, result)],
        **_scales(axes, seconds > 0),
    }


def _scales(axes: Any, timed: bool) -> Plot:
    """Return the entries of a plot that describe its axes: logarithmic or not, equal scales, limits
    that the figure sets, and words at ticks; timed: whether x is time.
    """
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
    """Return a dictionary for each horizontal line that spans the axes from left to right: `y`, its
    height, and `text`, its label.
    """
    other = [line for line in axes.get_lines() if line.get_transform() != axes.transData]
    flat = [line for line in other if np.ptp(np.asarray(line.get_ydata(), dtype=float)) == 0]
    return [{"y": float(line.get_ydata()[0]), "text": _named(line)} for line in flat]


def _shade(axes: Any, seconds: float) -> list[Any]:
    """Return [begin, end, name] of each vertical band that spans the axes from top to bottom.

    seconds: factor from the unit of x in the figure to the unit of x in the page.
    """
    spans = (bar for bar in axes.patches if bar.get_data_transform() != axes.transData)
    return [
        [seconds * bar.get_x(), seconds * (bar.get_x() + bar.get_width()), _named(bar)]
        for bar in spans
    ]


def _named(drawn: Any) -> str:
    """Return the label of an object drawn by matplotlib, "" if it has none. In a figure of several
    runs the label begins with the label of the run.
    """
    label, run = str(drawn.get_label()), drawn.get_gid()
    if run is not None:
        return f"{run} {label.removeprefix('_')}".strip()
    return "" if label.startswith("_") else label


def _lines(canvas: Canvas, axes: Any, seconds: float, result: Result | None) -> Iterator[Plot]:
    """Yield the lines and markers of axes as curves; seconds: length of the unit of time on the x
    axis [s], 0 if x is not time; result: the run that the axes show (None: several runs).
    """
    for line in axes.get_lines():
        if line.get_transform() != axes.transData:
            continue
        x, y = (np.asarray(of(), dtype=float).ravel() for of in (line.get_xdata, line.get_ydata))
        if seconds:
            look = _look(line, len(x))
            if result is not None and (source := getattr(line, "source", None)):
                look |= canvas.source(
                    result, seconds * x[0], y=canvas.arrays.instruction(result, *source)
                )
            yield canvas.curve(seconds * x, y, _named(line), **look)
        else:
            yield canvas.plane(x, y, name=_named(line), **_look(line, len(x)))


def _look(line: Any, points: int) -> Plot:
    """Return the appearance of a line of matplotlib with this number of points: colour, line style
    and marker, and the label of the run that it shows.
    """
    look = {"colour": place_of(line.get_color()), "dash": _dash(line)}
    if line.get_linestyle() in ("None", " ", ""):
        many = "point" if line.get_alpha() is None else "dot"
        look["marker"] = "circle" if points < 3 else many
    if line.get_gid() is not None:
        look["group"] = line.get_gid()
    return look


def _areas(canvas: Canvas, axes: Any, unit: float) -> Iterator[Plot]:
    """Yield the images, coloured meshes, filled areas and bars of axes as curves of the page;
    unit: factor from the unit of x in the figure to its unit in the page, not applied to meshes.
    """
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
    field = canvas.arrays.store(np.asarray(image.get_array()))
    return {"image": field, "edges": [unit * left, unit * right, bottom, top], "name": ""}


def _mesh(canvas: Canvas, mesh: Any, name: str) -> Plot:
    """Return a mesh of coloured cells as an image with the edges of its columns and rows."""
    columns, rows = (mesh.get_coordinates()[..., k] for k in (0, 1))
    field = canvas.arrays.store(np.ma.filled(mesh.get_array(), np.nan))
    places = {"columns": columns[0].tolist(), "rows": rows[:, 0].tolist()}
    return {"image": field, "name": name, **places}


def _filled(canvas: Canvas, corners: Any, area: Any, colour: Any) -> Plot:
    look = {"name": _named(area), "fill": True, "colour": place_of(colour), "dash": "solid"}
    return canvas.plane(*corners.T, **look, opacity=area.get_alpha())


def _dash(line: Any) -> str:
    """Return the line style for Plotly: lengths of dashes and gaps as `4px,2px`, or "solid"."""
    _, lengths = line._unscaled_dash_pattern
    return ",".join(f"{length:g}px" for length in lengths) if lengths else "solid"


def _corners(outline: Any) -> Any:
    """Return the points of an outline (points, 2) without those inside a horizontal line: points
    with the same y as both neighbours.
    """
    y = outline[:, 1]
    inner = (np.roll(y, 1) == y) & (np.roll(y, -1) == y)
    inner[[0, -1]] = False
    return outline[~inner]


# ---- plots without a figure of matplotlib


def diagram(title: str, x: str, y: str, curves: list[Plot]) -> Plot:
    """Return a plot of curves over a quantity that is not time; x, y: labels of the axes."""
    return {"title": title, "x": x, "y": y, "time": False, "curves": curves}


def signals(canvas: Canvas, result: Result) -> list[dict[str, Any]]:
    """Return all variables of a result, one dictionary per component: its `name`, its constant
    variables with their value (`fixed`), and its other variables with their plot (`plots`).
    """
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
    """Return the plot of a variable over time. If the mission defines a bound for the variable
    (Mission.idle), values that reach or exceed this bound have no meaning and are left out.
    """
    flat, arrays = values.reshape(len(values), -1), canvas.arrays
    bound = dict(of_result(result).idle).get(name)
    if bound is not None:
        flat = np.where(flat < bound, flat, np.nan)
    curves = []
    for k, (column, label) in enumerate(zip(flat.T, _labels(result, name, values), strict=True)):
        history = arrays.instruction(result, name, k)
        if bound is not None:
            below, gap = arrays.program.number(bound), arrays.program.number(np.nan)
            moves = arrays.program.add("<", history, below)
            history = arrays.program.add("where", moves, history, gap)
        look = canvas.source(result, result.time[0], y=history)
        look |= {"colour": k, "dash": DASHES[k % len(DASHES)]}
        curves.append(canvas.curve(result.time, column, label, **look))
    unit, short = result.unit(name), name.partition(".")[2]
    y = f"{short} [{unit}]" if unit else name
    return {"x": "time [s]", "y": y, "time": True, "curves": curves, "log": spans(flat)}


def _labels(result: Result, name: str, values: Array) -> list[str]:
    """Return the labels of the elements of a variable: names of axes, parts of a quaternion, or
    indices.
    """
    if values.ndim == 1:
        return [""]
    if values.ndim == 2 and values.shape[1] == 3:
        return list(AXES)
    if values.ndim == 2 and values.shape[1] == 4 and base(name).rpartition(".")[2].startswith("q_"):
        return list(QUATERNION)
    return [result.columns[i].removeprefix(name) for i in result.vectors[name].flat]


def spans(values: Array) -> bool:
    """Return whether all finite values are positive and span more than DECADES powers of ten."""
    finite = values[np.isfinite(values)]
    if not finite.size or finite.min() <= 0:
        return False
    return bool(np.log10(finite.max()) - np.log10(finite.min()) > DECADES)


# ---- phase plots: a quantity against its rate


def phases(canvas: Canvas, result: Result) -> Iterator[Plot]:
    """Yield the phase plots that the mission defines for the variables of a result, without those
    in which a quantity is constant.
    """
    for phase in of_result(result).phases:
        if not result.holds(*phase.needs):
            continue
        first = int(np.searchsorted(result.time, phase.after(result))) if phase.after else 0
        if found := _phase(canvas, phase, result, first):
            yield found


def _phase(canvas: Canvas, phase: Phase, result: Result, first: int) -> Plot | None:
    """Return a phase plot of the rows from `first` on; None if value or rate is constant."""
    sources = phase.value, phase.rate
    x, y = (np.atleast_2d(values_of(result, source).T).T[first:] for source in sources)
    if not all(c.size and np.nanmax(c) > np.nanmin(c) for c in (x, y)):
        return None
    names = {1: ("",), 3: AXES}.get(x.shape[1], tuple(str(k + 1) for k in range(x.shape[1])))
    curves = []
    for k, name in enumerate(names):
        look: Plot = {"colour": k, "dash": DASHES[k % len(DASHES)], "ends": True}
        if all(isinstance(source, str) for source in sources):
            parts = (canvas.arrays.instruction(result, str(source), k) for source in sources)
            look |= canvas.source(result, result.time[first], **dict(zip("xy", parts, strict=True)))
        curves.append({"name": name, **canvas.plane(x[:, k], y[:, k], **look)})
    return diagram(phase.title, phase.x, phase.y, curves)
