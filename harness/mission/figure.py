# SPDX-License-Identifier: BSD-2-Clause
"""What a figure is: panels of curves over time as data, or a drawing of its own; both say what they
need.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.results.result import Array, Result

Axes = Any
"""Axes or figure of matplotlib, which is imported only when something is drawn."""
Colour = Any
"""A colour as matplotlib understands it: a name, or red, green, blue, opacity."""
AXES = ("x", "y", "z")


def unit_of(label: str) -> str:
    """What a label has in brackets, or nothing."""
    found = re.search(r"\[(.*?)\]", label)
    return found[1] if found else ""


@dataclass(frozen=True)
class Curve:
    """One history of a panel, with one line per element.

    source: a variable, or a function of the result that `needs` these variables; convert: maps the
    history of the variable to what is drawn; labels: of the elements; style: "": the style of its
    colour; anew: reuse the colours of the curve before; parameters: parameters of the run that it
    needs; without them only this curve is left out; jump: a step between two rows above this value
    breaks the curve, as where Rodrigues parameters change to their shadow.
    """

    source: str | Callable[[Result], Array]
    label: str = ""
    convert: Callable[[Array], Array] | None = None
    labels: tuple[str, ...] = AXES
    style: str = ""
    needs: tuple[str, ...] = ()
    anew: bool = False
    parameters: tuple[str, ...] = ()
    jump: float = np.inf

    def variables(self) -> tuple[str, ...]:
        """What the result must hold."""
        return (self.source,) if isinstance(self.source, str) else self.needs

    def history(self, result: Result) -> Array:
        """What is drawn: (rows,) or (rows, elements)."""
        values = result[self.source] if isinstance(self.source, str) else self.source(result)
        return self.convert(values) if self.convert else values

    def lines(self, history: Array) -> Iterator[tuple[Array, str]]:
        """Values (rows,) of every line, and its name."""
        if history.ndim == 1:
            yield history, self.label
            return
        for k in range(history.shape[1]):
            element = self.labels[k] if k < len(self.labels) else str(k + 1)
            yield history[:, k], f"{self.label} {element}".strip()

    def broken(self, time: Array, history: Array) -> tuple[Array, Array]:
        """Time and history with a row that is no number in every jump."""
        if np.isinf(self.jump):
            return time, history
        steps = np.abs(np.diff(history.reshape(len(history), -1), axis=0)).max(axis=1, initial=0)
        rows = np.flatnonzero(steps > self.jump) + 1
        if not len(rows):
            return time, history
        return np.insert(time, rows, time[rows]), np.insert(history, rows, np.nan, axis=0)


@dataclass(frozen=True)
class Level:
    """A horizontal line; value: a number, or parameters, of which the first one that the run has
    gives the height.
    """

    label: str
    value: float | tuple[str, ...]

    def height(self, result: Result) -> float | None:
        """Height of the line; None if the result does not hold it."""
        if isinstance(self.value, float):
            return self.value
        held = [name for name in self.value if result.holds(parameters=(name,))]
        return float(result.parameter(held[0])) if held else None


IDLE = "attitude frozen: acts on nothing"


@dataclass(frozen=True)
class Panel:
    """One pair of axes over time; after: start of the time axis [s], or a function of the result
    that returns it; level: a horizontal line; idle_until: shaded up to this time, in which nothing
    drawn here acts; least: mark the least value.
    """

    ylabel: str
    curves: tuple[Curve, ...]
    after: float | Callable[[Result], float] = 0.0
    log: bool = False
    level: Level | None = None
    idle_until: Callable[[Result], float] | None = None
    least: bool = False

    def minima(self, result: Result) -> Iterator[tuple[float, float]]:
        """Time [s] and least value of every curve, where that matters."""
        for curve in self.held(result) if self.least else ():
            values = curve.history(result)[self.rows(result)]
            if values.ndim == 1 and np.isfinite(values).any():
                k = int(np.nanargmin(values))
                yield float(result.time[self.rows(result)][k]), float(values[k])

    def rows(self, result: Result) -> slice:
        """The rows that are drawn: from the start of the time axis on, else all."""
        start = self.after(result) if callable(self.after) else self.after
        shown = start < result.time[-1]
        return slice(int(np.searchsorted(result.time, start)) if shown else 0, None)

    def held(self, result: Result) -> Iterator[Curve]:
        """The curves whose parameters the result holds."""
        return (curve for curve in self.curves if result.holds(parameters=curve.parameters))

    def is_silent(self, *results: Result) -> bool:
        """Whether there is nothing but zeros, or no number at all."""
        return not any(
            np.nan_to_num(curve.history(result)[self.rows(result)]).any()
            for result in results
            for curve in self.held(result)
        )

    def line(self, result: Result) -> tuple[float, str] | None:
        """Height of the level and its label; None if the result has no value for it."""
        if self.level is None or (height := self.level.height(result)) is None:
            return None
        return height, f"{self.level.label} {height:g} {unit_of(self.ylabel)}".strip()

    def idle(self, results: Iterable[Result]) -> tuple[float, float] | None:
        """Begin and end [s] of the time in which what is drawn acts in none of the runs."""
        if self.idle_until is None:
            return None
        begin, end = min((r.time[0], min(self.idle_until(r), r.time[-1])) for r in results)
        return (float(begin), float(end)) if end > begin else None


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

    def is_empty(self, result: Result) -> bool:
        """Whether nothing changes in a figure that fits."""
        return not any(
            np.ptp(curve.history(result)[panel.rows(result)], axis=0).any()
            for panel in self.panels
            for curve in panel.held(result)
        )


@dataclass(frozen=True)
class Drawing:
    """A figure that is no history; draw: into an empty figure of matplotlib, from the result;
    parameters: of the run that it needs; shows: whether there is anything in it, if that is not
    certain.
    """

    name: str
    title: str
    needs: tuple[str, ...]
    draw: Callable[..., None]
    size: tuple[float, float] = (11, 5)
    parameters: tuple[str, ...] = ()
    shows: Callable[[Result], bool] | None = None

    def fits(self, result: Result) -> bool:
        """Whether the result holds everything that is drawn."""
        return result.holds(*self.needs, parameters=self.parameters)

    def is_empty(self, result: Result) -> bool:
        """Whether there is nothing to be seen in a figure that fits."""
        return self.shows is not None and not self.shows(result)


@dataclass(frozen=True)
class Overlay(Drawing):
    """A drawing of several runs; draw: into an empty figure, from the runs and their colours by
    label.
    """


@dataclass(frozen=True)
class Phase:
    """A phase plot, a quantity against its rate: title, labels of the axes, what it needs, (rows,)
    or (rows, n) of both; after: start of what is drawn [s].
    """

    title: str
    x: str
    y: str
    needs: tuple[str, ...]
    value: Callable[[Result], Array]
    rate: Callable[[Result], Array]
    after: Callable[[Result], float] | None = None


def scaled(name: str, factor: float = 1.0) -> Callable[[Result], Array]:
    """The history of a variable times a factor."""
    return lambda result: np.asarray(factor * result[name])


DEGREES = float(np.degrees(1.0))


def degrees(x: Array) -> Array:
    """Radians to degrees."""
    return np.asarray(np.degrees(x))
