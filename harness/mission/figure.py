# SPDX-License-Identifier: BSD-2-Clause
"""Figures as data: panels of curves over time, or a drawing function; both declare what
they need.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.errors import HarnessError
from harness.mission.fields import Checked, place_of
from harness.results.evaluation import fitted
from harness.results.expressions import parsed
from harness.results.program import value_of
from harness.results.result import Array, Result

Source = str | Callable[[Result], Array]
"""A variable, an expression, or a function of the result. A curve of a function does not follow the
sliders of a live page.
"""
Axes = Any
"""Axes or figure of matplotlib, which is imported only when something is drawn."""
Colour = Any
"""A colour as matplotlib understands it: a name, or red, green, blue, opacity."""
AXES = ("x", "y", "z")
LARGEST = 1e300
"""Largest size of a value that is drawn; an axis over larger ones would overflow."""


def variables_of(text: str) -> tuple[str, ...]:
    """Return the variables of an expression; the text itself if it is not one."""
    try:
        return parsed(text).outputs
    except ValueError:
        return (text,)


def values_of(result: Result, source: Source) -> Array:
    """Return the history of a source, (rows,) or (rows, elements)."""
    if callable(source):
        return source(result)
    if source in result:
        return result[source]
    values = np.asarray(value_of(result, source))
    is_fixed = not fitted(result, source).is_history
    return np.full((len(result.time), *values.shape), values) if is_fixed else values


def unit_of(label: str) -> str:
    """Return the text in brackets of a label, or nothing."""
    found = re.search(r"\[(.*?)\]", label)
    return found[1] if found else ""


@dataclass(frozen=True)
class Curve(Checked):
    """One history of a panel, with one line per element.

    source: a variable, an expression of variables and parameters, or a function of the result that
    `needs` these variables; convert: maps the history to what is drawn; labels: of the elements;
    style: "": the style of its colour; anew: reuse the colours of the curve before; parameters:
    parameters of the run that it needs, without which only this curve is left out; jump: a step
    between two rows above this value breaks the curve, as where Rodrigues parameters change to
    their shadow.
    """

    source: Source
    label: str = ""
    convert: Callable[[Array], Array] | None = None
    labels: tuple[str, ...] = AXES
    style: str = ""
    needs: tuple[str, ...] = ()
    anew: bool = False
    parameters: tuple[str, ...] = ()
    jump: float = np.inf

    def variables(self) -> tuple[str, ...]:
        """Return the variables that the result must have."""
        return variables_of(self.source) if isinstance(self.source, str) else self.needs

    def history(self, result: Result) -> Array:
        """Return the drawn history, (rows,) or (rows, elements), NaN where it cannot be drawn."""
        values = values_of(result, self.source)
        drawn = self.convert(values) if self.convert else values
        if not isinstance(drawn, np.ndarray) or drawn.shape[:1] != result.time.shape:
            place = place_of(self.convert or self.source)
            wanted = f"an array of {len(result.time)} rows"
            raise HarnessError(f"{place}expected {wanted} for a curve, got {drawn!r:.40}")
        return np.where(np.abs(drawn) > LARGEST, np.nan, drawn)

    def lines(self, history: Array) -> Iterator[tuple[Array, str]]:
        """Yield values (rows,) and name of every line."""
        if history.ndim == 1:
            yield history, self.label
            return
        history = history.reshape(len(history), -1)
        for k in range(history.shape[1]):
            element = self.labels[k] if k < len(self.labels) else str(k + 1)
            yield history[:, k], f"{self.label} {element}".strip()

    def broken(self, time: Array, history: Array) -> tuple[Array, Array]:
        """Return time and history with a NaN row in every jump."""
        if np.isinf(self.jump):
            return time, history
        steps = np.abs(np.diff(history.reshape(len(history), -1), axis=0)).max(axis=1, initial=0)
        rows = np.flatnonzero(steps > self.jump) + 1
        if not len(rows):
            return time, history
        return np.insert(time, rows, time[rows]), np.insert(history, rows, np.nan, axis=0)


@dataclass(frozen=True)
class Level(Checked):
    """Horizontal line; value: a number, or parameters, of which the first one in the run gives the
    height.
    """

    label: str
    value: float | tuple[str, ...]

    def height(self, result: Result) -> float | None:
        """Return the height of the line; None if the result lacks it."""
        if not isinstance(self.value, tuple | list):
            return self.value
        held = [name for name in self.value if result.holds(parameters=(name,))]
        return float(result.parameter(held[0])) if held else None


IDLE = "attitude frozen: acts on nothing"


@dataclass(frozen=True)
class Panel(Checked):
    """Pair of axes over time; after: start of the time axis [s], or a function of the result that
    returns it; level: a horizontal line; idle_until: shaded up to this time, because nothing
    drawn acts earlier; least: mark the least value.
    """

    ylabel: str
    curves: tuple[Curve, ...]
    after: float | Callable[[Result], float] = 0.0
    log: bool = False
    level: Level | None = None
    idle_until: Callable[[Result], float] | None = None
    least: bool = False

    def minima(self, result: Result) -> Iterator[tuple[float, float]]:
        """Yield time [s] and least value of every curve, if the panel labels them."""
        for curve in self.held(result) if self.least else ():
            values = curve.history(result)[self.rows(result)]
            if values.ndim == 1 and np.isfinite(values).any():
                k = int(np.nanargmin(values))
                yield float(result.time[self.rows(result)][k]), float(values[k])

    def rows(self, result: Result) -> slice:
        """Return the drawn rows: from the start of the time axis on, else all."""
        start = self.after(result) if callable(self.after) else self.after
        shown = start < result.time[-1]
        return slice(int(np.searchsorted(result.time, start)) if shown else 0, None)

    def held(self, result: Result) -> Iterator[Curve]:
        """Yield the curves whose parameters the result has."""
        return (curve for curve in self.curves if result.holds(parameters=curve.parameters))

    def is_silent(self, *results: Result) -> bool:
        """Return whether all values are zero, or none is a number."""
        return not any(
            np.nan_to_num(curve.history(result)[self.rows(result)]).any()
            for result in results
            for curve in self.held(result)
        )

    def line(self, result: Result) -> tuple[float, str] | None:
        """Return height and label of the level; None if the result has no value for it."""
        if self.level is None or (height := self.level.height(result)) is None:
            return None
        return height, f"{self.level.label} {height:g} {unit_of(self.ylabel)}".strip()

    def idle(self, results: Iterable[Result]) -> tuple[float, float] | None:
        """Return begin and end [s] of the shading, in which nothing drawn acts in any run."""
        if self.idle_until is None:
            return None
        begin, end = min((r.time[0], min(self.idle_until(r), r.time[-1])) for r in results)
        return (float(begin), float(end)) if end > begin else None


@dataclass(frozen=True)
class Figure(Checked):
    """Panels from top to bottom; name: of the file; when: variables that must be in the result;
    only: whether a result has this figure (None: all that have the variables).
    """

    name: str
    title: str
    panels: tuple[Panel, ...]
    when: tuple[str, ...] = ()
    only: Callable[[Result], bool] | None = None

    def fits(self, result: Result) -> bool:
        """Return whether the result has everything that is drawn."""
        drawn = (v for panel in self.panels for curve in panel.curves for v in curve.variables())
        return result.holds(*self.when, *drawn) and (self.only is None or self.only(result))

    def is_empty(self, result: Result) -> bool:
        """Return whether nothing changes in a figure that fits."""
        return not any(
            np.ptp(curve.history(result)[panel.rows(result)], axis=0).any()
            for panel in self.panels
            for curve in panel.held(result)
        )


@dataclass(frozen=True)
class Drawing(Checked):
    """Figure other than a history; draw: fills an empty matplotlib figure from the result;
    parameters: required parameters of the run; shows: whether the figure of a result would show
    anything (None: always).
    """

    name: str
    title: str
    needs: tuple[str, ...]
    draw: Callable[..., None]
    size: tuple[float, float] = (11, 5)
    parameters: tuple[str, ...] = ()
    shows: Callable[[Result], bool] | None = None

    def fits(self, result: Result) -> bool:
        """Return whether the result has everything that is drawn."""
        return result.holds(*self.needs, parameters=self.parameters)

    def is_empty(self, result: Result) -> bool:
        """Return whether nothing is visible in a figure that fits."""
        return self.shows is not None and not self.shows(result)


@dataclass(frozen=True)
class Overlay(Drawing):
    """Drawing of several runs; draw: fills an empty figure from the runs and their colours by
    label.
    """


@dataclass(frozen=True)
class Phase(Checked):
    """Phase plot, a quantity against its rate: title, labels of the axes, needs, variable,
    expression or function that gives (rows,) or (rows, n) of both; after: start of the drawn rows
    [s].
    """

    title: str
    x: str
    y: str
    needs: tuple[str, ...]
    value: Source
    rate: Source
    after: Callable[[Result], float] | None = None


def degrees(x: Array) -> Array:
    """Convert radians to degrees."""
    return np.asarray(np.degrees(x))
