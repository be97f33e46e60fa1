# SPDX-License-Identifier: BSD-2-Clause
"""What a figure is: panels of curves over time as data, or a drawing of its own; both say what they
need.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.results.result import Result

Array = NDArray[np.float64]
Axes = Any
"""Axes or figure of matplotlib, which is imported only when something is drawn."""
Colour = Any
"""A colour as matplotlib understands it: a name, or red, green, blue, opacity."""
AXES = ("x", "y", "z")
MANY = 10
"""From so many runs on their names do not fit into a legend."""


@dataclass(frozen=True)
class Curve:
    """One history of a panel, with one line per element.

    source: a variable, or a function of the result that `needs` these variables; convert: maps the
    history of the variable to what is drawn; labels: of the elements.
    """

    source: str | Callable[[Result], Array]
    label: str = ""
    convert: Callable[[Array], Array] | None = None
    labels: tuple[str, ...] = AXES
    style: str = "-"
    needs: tuple[str, ...] = ()

    def variables(self) -> tuple[str, ...]:
        """What the result must hold."""
        return (self.source,) if isinstance(self.source, str) else self.needs

    def history(self, result: Result) -> Array:
        """What is drawn: (rows,) or (rows, elements)."""
        values = result[self.source] if isinstance(self.source, str) else self.source(result)
        return self.convert(values) if self.convert else values


@dataclass(frozen=True)
class Panel:
    """One pair of axes over time; after: start of the time axis [s], or the function of the result
    that says it; level: a horizontal line; idle_until: time up to which nothing that is drawn acts,
    shaded.
    """

    ylabel: str
    curves: tuple[Curve, ...]
    after: float | Callable[[Result], float] = 0.0
    log: bool = False
    level: float | None = None
    idle_until: Callable[[Result], float] | None = None

    def rows(self, result: Result) -> slice:
        """The rows that are drawn: from the start of the time axis on, else all."""
        start = self.after(result) if callable(self.after) else self.after
        shown = start < result.time[-1]
        return slice(int(np.searchsorted(result.time, start)) if shown else 0, None)


@dataclass(frozen=True)
class Figure:
    """Panels from top to bottom; name: of the file; when: variables by which the result is known to
    be meant.
    """

    name: str
    title: str
    panels: tuple[Panel, ...]
    when: tuple[str, ...] = ()

    def fits(self, result: Result) -> bool:
        """Whether the result holds everything that is drawn."""
        drawn = (v for panel in self.panels for curve in panel.curves for v in curve.variables())
        return result.holds(*self.when, *drawn)


@dataclass(frozen=True)
class Drawing:
    """A figure that is no history; draw: into an empty figure of matplotlib; parameters: of the run
    that it needs.
    """

    name: str
    title: str
    needs: tuple[str, ...]
    draw: Callable[[Axes, Result], None]
    size: tuple[float, float] = (11, 5)
    parameters: tuple[str, ...] = ()

    def fits(self, result: Result) -> bool:
        """Whether the result holds everything that is drawn."""
        return result.holds(*self.needs, parameters=self.parameters)


@dataclass(frozen=True)
class Overlay:
    """A drawing of several runs; draw: into an empty figure, from the runs and their colours by
    label.
    """

    name: str
    title: str
    needs: tuple[str, ...]
    draw: Callable[[Axes, Mapping[str, Result], Mapping[str, Colour]], None]
    size: tuple[float, float] = (11, 5)
    parameters: tuple[str, ...] = ()

    def fits(self, result: Result) -> bool:
        """Whether the result holds everything that is drawn."""
        return result.holds(*self.needs, parameters=self.parameters)


def degrees(x: Array) -> Array:
    """Radians to degrees."""
    return np.asarray(np.degrees(x))


def norm(x: Array) -> Array:
    """Length of every row."""
    return np.asarray(np.linalg.norm(x, axis=1))


def draw_paths(
    canvas: Axes,
    paths: Mapping[str, tuple[Array, str]],
    names: tuple[str, str, str],
    plane: tuple[int, int],
    colours: Mapping[str, Colour] | None = None,
) -> Axes:
    """Paths (rows, 3) with a style each, in space and seen along one axis; returns the axes of the
    plane.

    names: of the three coordinates; plane: horizontal and vertical coordinate of the second view;
    colours: by label.
    """
    space = canvas.add_subplot(1, 2, 1, projection="3d")
    flat = canvas.add_subplot(1, 2, 2)
    for label, (path, style) in paths.items():
        look = {"linewidth": 1, "label": label} | (
            {"color": colours[label]} if colours and label in colours else {}
        )
        space.plot(*path.T, style, **look)
        flat.plot(path[:, plane[0]], path[:, plane[1]], style, **look)
    space.set(xlabel=names[0], ylabel=names[1], zlabel=names[2])
    flat.set(xlabel=names[plane[0]], ylabel=names[plane[1]], aspect="equal")
    flat.grid(alpha=0.3)
    return flat
