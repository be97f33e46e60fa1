# SPDX-License-Identifier: BSD-2-Clause
"""Arrays that a page contains, each stored once in single precision; and curves that are thinned to
the number of points that a screen can show, without loss of peaks.

To thin a curve, its rows are divided into groups of equal length, and the rows with the smallest
and the largest value of each group are drawn. So the thinned curve has the same extremes as the
full curve.
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
    """Source of an array with the values of a variable or expression at the instants of a replay,
    from which a live page computes the array for another run.

    history: number of the instruction in Arrays.program that computes the values in all rows of the
    run; over: "row": the array has the value in the row of each instant; "mean", "least",
    "largest": it has this value over the rows from each instant up to the next; time: instants [s].
    """

    history: int
    over: str
    time: Array


class Arrays:
    """Arrays of a page by short names (`a0`, `a1`, ...), with which curves and the bodies of the
    replay refer to them.

    content: shape and base64 data of each array; program: instructions with which a live page
    computes curves and arrays of the replay for another run; samples: sources of the arrays of the
    replay, by name of the array.
    """

    def __init__(self) -> None:
        self._names: dict[bytes, str] = {}
        self.content: dict[str, dict[str, Any]] = {}
        self.program = Program()
        self.samples: dict[str, Sample] = {}

    def store(self, values: Any, source: Any = None) -> str:
        """Store an array of any shape and return its name. Arrays with equal values and equal
        `source` are stored once; source: pair (history, over) as in Sample, None for an array that
        no instruction computes.
        """
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
        """Store the values of a variable or expression at the instants of a replay, and return the
        name of the array; rows: row of each instant; text: variable or expression; over: see
        Sample.
        """
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
        """Add instructions to the program of the page that compute a variable or an expression, or
        one of its elements, in all rows of a run; return the index of the last instruction.
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
        """Return the array with this name, in single precision as the page contains it."""
        stored = self.content[name]
        flat = np.frombuffer(base64.b64decode(stored["data"]), dtype="<f4")
        return flat.reshape(stored["shape"])


REDUCED = {"mean": np.add, "least": np.minimum, "largest": np.maximum}
"""Functions of numpy that combine the rows from one instant of a replay to the next, by name; the
sum for `mean` is divided by the number of rows.
"""


def thinned_rows(values: Array, points: int) -> Rows:
    """Return in order the indices of about `points` rows of a time series (rows,) that are drawn.

    These are the first and the last row, and from each group of rows the rows with the smallest
    value, the largest value, and the first value that is not finite, so that gaps of the curve
    remain.
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
"""Approximate number of characters that the points of all curves may take in a page."""
PER_POINT = 8 * 4 / 3
"""Characters per point of a curve: two numbers of four bytes, and four characters per three bytes
in base64.
"""


def points_of(curves: int, least: int, most: int) -> int:
    """Return the number of points per curve for a page whose `curves` curves take about NUMBERS
    characters together; at least `least` and at most `most`.
    """
    return int(np.clip(NUMBERS / PER_POINT / max(1, curves), least, most))


class Canvas:
    """Thinning and storage of the curves of a page; arrays: storage; points: about how many points
    a long curve has; thinned: whether a curve has been drawn with fewer points than it has rows.
    """

    def __init__(self, arrays: Arrays, points: int) -> None:
        self.arrays, self.points = arrays, points
        self.thinned = False

    def curve(self, time: Array, values: Array, name: str, **look: Any) -> dict[str, Any]:
        """Return a curve over time, thinned without loss of peaks; look: colour, line style, ..."""
        return {
            "name": name,
            **self._drawn(time, values, thinned_rows(values, self.points)),
            **look,
        }

    def source(self, result: Result, begin: float, **parts: int) -> dict[str, Any]:
        """Return the entry `source` of a curve: the instructions with which a live page computes
        the curve for another run.

        begin: time of the first point [s]; parts: numbers of the instructions for `y` and `x`
        (without `x`: the time).
        """
        time = self.arrays.instruction(result, "time")
        return {"source": {"x": time, "begin": float(begin)} | parts}

    def plane(self, x: Array, y: Array, **look: Any) -> dict[str, Any]:
        """Return a curve y over x, thinned without loss of the peaks of both coordinates."""
        return self._drawn(x, y, self.rows_of(x, y)) | look

    def line(self, x: Any, y: Any, **look: Any) -> dict[str, Any]:
        """Return a curve with all its points, without thinning."""
        return {"x": self.arrays.store(x), "y": self.arrays.store(y), **look}

    def rows_of(self, x: Array, y: Array) -> Rows:
        """Return the indices of the rows at which a curve y over x is drawn."""
        if len(x) <= self.points:
            return np.arange(len(x))
        half = self.points // 2
        return np.unique(np.concatenate((thinned_rows(x, half), thinned_rows(y, half))))

    def _drawn(self, x: Array, y: Array, rows: Rows) -> dict[str, Any]:
        self.thinned |= len(rows) < len(x)
        return self.line(x[rows], y[rows])
