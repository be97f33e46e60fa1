# SPDX-License-Identifier: BSD-2-Clause
"""Drawings of harness/figures as plots of the page: what matplotlib was told to draw is read back
from its axes, so that a drawing is written once. Views in space are left to the replay.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from harness.figures.captions import untexed
from harness.figures.finish import plane
from harness.report.arrays import Canvas
from harness.report.plots import STYLES, Plot

SECONDS = {"time [s]": 1.0, "time [h]": 3600.0}
"""Labels of the time axis and their seconds."""
INK = ("k", "black", "#000000", (0.0, 0.0, 0.0, 1.0))


def plots(canvas: Canvas, drawing: Any) -> list[Plot]:
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
        "curves": list(_curves(canvas, axes, seconds or 1.0)),
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


def _named(line: Any) -> str:
    """The label of a line, if it was given one."""
    label = str(line.get_label())
    return "" if label.startswith("_") else label


def _curves(canvas: Canvas, axes: Any, unit: float) -> Iterator[Plot]:
    """Everything that is drawn; unit: of x as the page has it."""
    palette: dict[Any, int] = {}
    for line in axes.get_lines():
        if line.get_transform() == axes.transData:
            yield _line(canvas, line, palette, unit)
    for image in axes.images:
        yield _image(canvas, image, unit)
    for area in axes.collections:
        for path in area.get_paths():
            corners = _corners(np.asarray(path.vertices, dtype=float)) * (unit, 1)
            yield _filled(canvas, corners, len(palette))
    for bar in axes.patches:
        yield _filled(canvas, _outline(bar), 0)


def _outline(bar: Any) -> Any:
    left, bottom, width, height = bar.get_bbox().bounds
    right, top = left + width, bottom + height
    return np.array([[left, bottom], [left, top], [right, top], [right, bottom], [left, bottom]])


def _filled(canvas: Canvas, corners: Any, colour: int) -> Plot:
    return _curve(canvas, *corners.T, name="", fill=True, colour=colour, dash="solid")


def _line(canvas: Canvas, line: Any, palette: dict[Any, int], unit: float) -> Plot:
    x, y = (np.asarray(data, dtype=float).ravel() for data in (line.get_xdata(), line.get_ydata()))
    look = {
        "name": _named(line),
        "colour": _colour(line.get_color(), palette),
        "dash": STYLES.get(line.get_linestyle(), "solid"),
    }
    if line.get_linestyle() in ("None", " ", ""):
        look["marker"] = "circle" if len(x) < 3 else "point"
    return _curve(canvas, unit * x, y, **look)


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
