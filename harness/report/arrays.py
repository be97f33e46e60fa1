# SPDX-License-Identifier: BSD-2-Clause
"""Numbers of a page: every array once, in single precision, and of each curve no more points than a
screen shows, with every peak.

The rows are divided into groups of equal length. Of each group the rows with the least and the
largest value are drawn: at every zoom the curve reaches as far up and down as the curve of all
rows.
"""

from __future__ import annotations

import base64
import hashlib
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.results.evaluation import fitted
from harness.results.program import Program, value_of
from harness.results.result import Array, Result, Rows


class Sample(NamedTuple):
    """Array of a history at instants of a replay: the instruction that gives the history, what is
    taken `over` the rows from one instant to the next (REDUCED, or "row": the first of them), and
    the instants [s].
    """

    history: int
    over: str
    time: Array


class Arrays:
    """Arrays by short names, which curves and bodies refer to.

    program: the expressions behind curves and samples, from which a live page computes them again;
    samples: by the name of the array.
    """

    def __init__(self) -> None:
        self._names: dict[bytes, str] = {}
        self.content: dict[str, dict[str, Any]] = {}
        self.program = Program()
        self.samples: dict[str, Sample] = {}

    def store(self, values: Any, source: Any = None) -> str:
        """Return the name of an array of any shape; equal arrays of one source have one name."""
        with np.errstate(over="ignore"):
            single = np.ascontiguousarray(values, dtype="<f4")
        data = single.tobytes()
        digest = hashlib.sha256(repr((single.shape, source)).encode() + data).digest()
        if digest not in self._names:
            name = self._names[digest] = f"a{len(self._names)}"
            text = base64.b64encode(data).decode()
            self.content[name] = {"shape": list(single.shape), "data": text}
        return self._names[digest]

    def sample(self, result: Result, rows: Rows, text: str, over: str = "row") -> str:
        """Return the name of the array of an expression at rows of a result, see Sample."""
        values = np.asarray(value_of(result, text))
        reduces = over != "row"
        found = REDUCED[over].reduceat(values, rows, axis=0) if reduces else values[rows]
        if over == "mean":
            counts = np.diff(np.append(rows, len(values)))
            found = found / counts.reshape(-1, *[1] * (values.ndim - 1))
        sample = Sample(self.instruction(result, text), over, result.time[rows])
        name = self.store(found, sample[:2])
        self.samples[name] = sample
        return name

    def instruction(self, result: Result, text: str, element: int | None = None) -> int:
        """Return the number of the instruction that gives the history of a variable or an
        expression, or one of its elements.
        """
        add, is_history = self.program.add, True
        if text in result:
            found = add("look up", constant=text, rows=True)
        else:
            tree = fitted(result, text)
            found, is_history = self.program.expression(tree), tree.is_history
        if not is_history:
            found = add(
                "every row", add("table", found), add("look up", constant="time", rows=True)
            )
        return found if element is None else add("element", found, constant=(element, text))

    def take(self, name: str) -> NDArray[np.float32]:
        """Return an array as stored for the page, in single precision."""
        stored = self.content[name]
        flat = np.frombuffer(base64.b64decode(stored["data"]), dtype="<f4")
        return flat.reshape(stored["shape"])


REDUCED = {"mean": np.add, "least": np.minimum, "largest": np.maximum}
"""Reductions of the rows from one instant to the next, by name."""


def thinned_rows(values: Array, points: int) -> Rows:
    """Return the rows of a history (rows,) that are drawn, in order, about `points` at most.

    These are the first and the last row, and of every group of rows the least, the largest and the
    first that is not finite, so that gaps of the curve remain.
    """
    count = len(values)
    if count <= points:
        return np.arange(count)
    length = -(-2 * count // points)
    starts = np.arange(0, count, length)
    missing = np.full(len(starts) * length - count, np.nan)
    groups = np.concatenate((values, missing)).reshape(len(starts), length)
    number = np.isfinite(groups)
    least = starts + np.where(number, groups, np.inf).argmin(axis=1)
    largest = starts + np.where(number, groups, -np.inf).argmax(axis=1)
    gaps = starts + number.argmin(axis=1)
    found = np.unique(np.concatenate(([0, count - 1], least, largest, gaps[~number.all(axis=1)])))
    return np.asarray(found[found < count])


NUMBERS = 2_000_000
"""Approximate number of characters of a page for the numbers of curves."""
PER_POINT = 8 * 4 / 3
"""Characters of a point: two numbers of four bytes, four characters for three."""


def points_of(curves: int, least: int, most: int) -> int:
    """Return the number of points per curve with which this number of curves fits a page."""
    return int(np.clip(NUMBERS / PER_POINT / max(1, curves), least, most))


class Canvas:
    """Numbers of the plots of a page; points: largest number of points of a curve."""

    def __init__(self, arrays: Arrays, points: int) -> None:
        self.arrays, self.points = arrays, points
        self.thinned = False

    def curve(self, time: Array, values: Array, name: str, **look: Any) -> dict[str, Any]:
        """Return one history with its extremes."""
        return {
            "name": name,
            **self._drawn(time, values, thinned_rows(values, self.points)),
            **look,
        }

    def source(self, result: Result, begin: float, **parts: int) -> dict[str, Any]:
        """Return the instructions from which a live page computes a curve again: x (the time, if it
        is not given) and y, from the time `begin` [s] on.
        """
        time = self.arrays.instruction(result, "time")
        return {"source": {"x": time, "begin": float(begin)} | parts}

    def plane(self, x: Array, y: Array, **look: Any) -> dict[str, Any]:
        """Return a curve in a plane with the extremes of both coordinates."""
        return self._drawn(x, y, self.rows_of(x, y)) | look

    def line(self, x: Any, y: Any, **look: Any) -> dict[str, Any]:
        """Return a curve of all its points."""
        return {"x": self.arrays.store(x), "y": self.arrays.store(y), **look}

    def rows_of(self, x: Array, y: Array) -> Rows:
        """Return the rows of a curve in a plane that are drawn."""
        if len(x) <= self.points:
            return np.arange(len(x))
        half = self.points // 2
        return np.unique(np.concatenate((thinned_rows(x, half), thinned_rows(y, half))))

    def _drawn(self, x: Array, y: Array, rows: Rows) -> dict[str, Any]:
        self.thinned |= len(rows) < len(x)
        return self.line(x[rows], y[rows])
