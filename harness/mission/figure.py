# SPDX-License-Identifier: BSD-2-Clause
"""Figures as data: panels of curves over time, or a function that draws. Both state the variables
and parameters that they need.
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
"""Source of the values of a curve: a variable, an expression, or a function of the result. A curve
from a function does not change with the sliders of a live page.
"""
Axes = Any
"""Axes or figure of matplotlib. The library is imported only when something is drawn."""
Colour = Any
"""Colour as matplotlib understands it: a name, or (red, green, blue, opacity)."""
AXES = ("x", "y", "z")
LARGEST = 1e300
"""Largest absolute value that is drawn; larger values would cause an overflow in the axis."""


def variables_of(text: str) -> tuple[str, ...]:
    """Return the variables in an expression; the text itself if it is not an expression."""
    try:
        return parsed(text).outputs
    except ValueError:
        return (text,)


def values_of(result: Result, source: Source) -> Array:
    """Return the time series of a source, (rows,) or (rows, elements); a constant is repeated in
    every row.
    """
    if callable(source):
        return source(result)
    if source in result:
        return result[source]
    values = np.asarray(value_of(result, source))
    is_fixed = not fitted(result, source).is_history
    return np.full((len(result.time), *values.shape), values) if is_fixed else values


def unit_of(label: str) -> str:
    """Return the unit in the brackets of a label, `m` for `range [m]`; "" without brackets."""
    found = re.search(r"\[(.*?)\]", label)
    return found[1] if found else ""


@dataclass(frozen=True)
class Curve(Checked):
    """Time series in a panel, drawn as one line per element.

    source: a variable, an expression of variables and parameters, or a function of the result that
    needs the variables `needs`; convert: function of the time series that returns the values to
    draw; labels: names of the elements; style: line style ("": the style that belongs to the
    colour); anew: whether the colours of the lines begin again with the first colour, instead of
    the colour after the last one in the panel; parameters: parameters of the run without which the
    curve is left out; jump: difference between two rows above which the line is interrupted, as
    where Rodrigues parameters change to their shadow set.
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
        """Return the variables that the result must have for this curve."""
        return variables_of(self.source) if isinstance(self.source, str) else self.needs

    def history(self, result: Result) -> Array:
        """Return the values to draw, (rows,) or (rows, elements), NaN where a value exceeds
        LARGEST. Raise HarnessError if a function returns no array or not one row per row of the
        result.
        """
        values = values_of(result, self.source)
        drawn = self.convert(values) if self.convert else values
        if not isinstance(drawn, np.ndarray) or drawn.shape[:1] != result.time.shape:
            place = place_of(self.convert or self.source)
            wanted = f"an array of {len(result.time)} rows"
            raise HarnessError(f"{place}expected {wanted} for a curve, got {drawn!r:.40}")
        return np.where(np.abs(drawn) > LARGEST, np.nan, drawn)

    def lines(self, history: Array) -> Iterator[tuple[Array, str]]:
        """Yield the values (rows,) and the label of each line; history: the values to draw."""
        if history.ndim == 1:
            yield history, self.label
            return
        history = history.reshape(len(history), -1)
        for k in range(history.shape[1]):
            element = self.labels[k] if k < len(self.labels) else str(k + 1)
            yield history[:, k], f"{self.label} {element}".strip()

    def broken(self, time: Array, history: Array) -> tuple[Array, Array]:
        """Return time and values with a row of NaN inserted at every jump, where the line is
        interrupted.
        """
        if np.isinf(self.jump):
            return time, history
        steps = np.abs(np.diff(history.reshape(len(history), -1), axis=0)).max(axis=1, initial=0)
        rows = np.flatnonzero(steps > self.jump) + 1
        if not len(rows):
            return time, history
        return np.insert(time, rows, time[rows]), np.insert(history, rows, np.nan, axis=0)


@dataclass(frozen=True)
class Level(Checked):
    """Horizontal line in a panel. value: height of the line, or names of parameters: the height
    is the first of these parameters that the run has.
    """

    label: str
    value: float | tuple[str, ...]

    def height(self, result: Result) -> float | None:
        """Return the height of the line; None if the result contains no parameter for it."""
        if not isinstance(self.value, tuple | list):
            return self.value
        held = [name for name in self.value if result.holds(parameters=(name,))]
        return float(result.parameter(held[0])) if held else None


IDLE = "attitude frozen: no effect"


@dataclass(frozen=True)
class Panel(Checked):
    """Pair of axes over time. after: begin of the time axis [s], or a function of the result that
    returns it; log: logarithmic values; level: a horizontal line; idle_until: function of the
    result that returns a time [s]: before it the drawn quantities have no effect, and the panel is
    shaded; least: whether the smallest value of each curve with a single line is labelled. In
    figures of several runs, `after`, `least`, and `anew` and `parameters` of curves have no effect
    on the drawing.
    """

    ylabel: str
    curves: tuple[Curve, ...]
    after: float | Callable[[Result], float] = 0.0
    log: bool = False
    level: Level | None = None
    idle_until: Callable[[Result], float] | None = None
    least: bool = False

    def minima(self, result: Result) -> Iterator[tuple[float, float]]:
        """Yield time [s] and smallest value of every curve with a single line, if the panel labels
        the smallest values (`least`).
        """
        for curve in self.held(result) if self.least else ():
            values = curve.history(result)[self.rows(result)]
            if values.ndim == 1 and np.isfinite(values).any():
                k = int(np.nanargmin(values))
                yield float(result.time[self.rows(result)][k]), float(values[k])

    def rows(self, result: Result) -> slice:
        """Return the rows to draw: rows from the start of the time axis on, or all rows if the run
        ends at or before this time.
        """
        start = self.after(result) if callable(self.after) else self.after
        shown = start < result.time[-1]
        return slice(int(np.searchsorted(result.time, start)) if shown else 0, None)

    def held(self, result: Result) -> Iterator[Curve]:
        """Yield the curves for which the result contains all parameters in Curve.parameters."""
        return (curve for curve in self.curves if result.holds(parameters=curve.parameters))

    def is_silent(self, *results: Result) -> bool:
        """Return whether every value to draw, in all results, is zero or NaN."""
        return not any(
            np.nan_to_num(curve.history(result)[self.rows(result)]).any()
            for result in results
            for curve in self.held(result)
        )

    def line(self, result: Result) -> tuple[float, str] | None:
        """Return height and label of the horizontal line; None if there is none or the result gives
        no height.
        """
        if self.level is None or (height := self.level.height(result)) is None:
            return None
        return height, f"{self.level.label} {height:g} {unit_of(self.ylabel)}".strip()

    def idle(self, results: Iterable[Result]) -> tuple[float, float] | None:
        """Return begin and end [s] of the shaded time, in which the drawn quantities have no effect
        in any of the runs; None if there is no such time.
        """
        if self.idle_until is None:
            return None
        begin, end = min((r.time[0], min(self.idle_until(r), r.time[-1])) for r in results)
        return (float(begin), float(end)) if end > begin else None


@dataclass(frozen=True)
class Figure(Checked):
    """Figure of panels from top to bottom. name: name of the file; when: further variables that the
    result must contain; only: function that returns whether a result has this figure (None: every
    result with all these variables has it).
    """

    name: str
    title: str
    panels: tuple[Panel, ...]
    when: tuple[str, ...] = ()
    only: Callable[[Result], bool] | None = None

    def fits(self, result: Result) -> bool:
        """Return whether the result contains everything that this figure needs."""
        drawn = (v for panel in self.panels for curve in panel.curves for v in curve.variables())
        return result.holds(*self.when, *drawn) and (self.only is None or self.only(result))

    def is_empty(self, result: Result) -> bool:
        """Return whether all values in the figure are constant, for a result that fits."""
        return not any(
            np.ptp(curve.history(result)[panel.rows(result)], axis=0).any()
            for panel in self.panels
            for curve in panel.held(result)
        )


@dataclass(frozen=True)
class Drawing(Checked):
    """Figure that is drawn by a function and not defined as curves over time. draw: function that
    fills an empty matplotlib figure from the result; size: width and height [inch]; parameters:
    required parameters of the run; shows: function that returns whether the figure of a result
    would show anything (None: always).
    """

    name: str
    title: str
    needs: tuple[str, ...]
    draw: Callable[..., None]
    size: tuple[float, float] = (11, 5)
    parameters: tuple[str, ...] = ()
    shows: Callable[[Result], bool] | None = None

    def fits(self, result: Result) -> bool:
        """Return whether the result contains everything that this figure needs."""
        return result.holds(*self.needs, parameters=self.parameters)

    def is_empty(self, result: Result) -> bool:
        """Return whether the figure would show nothing, for a result that fits."""
        return self.shows is not None and not self.shows(result)


@dataclass(frozen=True)
class Overlay(Drawing):
    """Drawing of several runs. draw: function that fills an empty matplotlib figure from the
    results and the colours of the runs, both by label of the run.
    """


@dataclass(frozen=True)
class Phase(Checked):
    """Phase plot: a quantity against its rate. x, y: labels of the axes; needs: variables that the
    result must contain; value, rate: Source of the quantity and of its rate, each (rows,) or
    (rows, n); after: function that returns the time [s] of the first row to draw (None: all rows).
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
