# SPDX-License-Identifier: BSD-2-Clause
"""The numbers of a page: every array once, whoever draws it, in single precision, and of a curve no
more points than a screen shows, with every peak.

The rows are cut into groups of equal length, and of each group the least and the largest value
stay, where they are: whatever the zoom, a curve that is drawn from them reaches as far up and down
as that of all rows.
"""

from __future__ import annotations

import base64
import hashlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.results.result import Array, Rows


class Arrays:
    """Arrays by short names, which curves and bodies refer to."""

    def __init__(self) -> None:
        self._names: dict[bytes, str] = {}
        self.content: dict[str, dict[str, Any]] = {}

    def keep(self, values: Any) -> str:
        """Name of an array of any shape; equal arrays have one name."""
        with np.errstate(over="ignore"):
            single = np.ascontiguousarray(values, dtype="<f4")
        data = single.tobytes()
        digest = hashlib.sha256(repr(single.shape).encode() + data).digest()
        if digest not in self._names:
            self._names[digest] = self._written(f"a{len(self._names)}", single)
        return self._names[digest]

    def _written(self, name: str, single: NDArray[np.float32]) -> str:
        text = base64.b64encode(single.tobytes()).decode()
        self.content[name] = {"shape": list(single.shape), "data": text}
        return name

    def take(self, name: str) -> NDArray[np.float32]:
        """An array as the page will have it."""
        kept = self.content[name]
        flat = np.frombuffer(base64.b64decode(kept["data"]), dtype="<f4")
        return flat.reshape(kept["shape"])


def kept_rows(values: Array, points: int) -> Rows:
    """Rows of a history (rows,) that are drawn, in order, about `points` at most.

    First and last row, of every group of rows the least, the largest and the first that is no
    number: the curve keeps its gaps.
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
"""Characters of a page for numbers of curves, about."""
PER_POINT = 8 * 4 / 3
"""Characters of a point: two numbers of four bytes, four characters for three."""


def points_of(curves: int, least: int, most: int) -> int:
    """Points of a curve so that so many of them fit a page."""
    return int(np.clip(NUMBERS / PER_POINT / max(1, curves), least, most))


class Canvas:
    """Where the plots of a page keep their numbers; points: of a curve, at most."""

    def __init__(self, arrays: Arrays, points: int) -> None:
        self.arrays, self.points = arrays, points
        self.thinned = False

    def curve(self, time: Array, values: Array, name: str, **look: Any) -> dict[str, Any]:
        """One history with its extremes."""
        return {"name": name, **self._drawn(time, values, kept_rows(values, self.points)), **look}

    def plane(self, x: Array, y: Array, **look: Any) -> dict[str, Any]:
        """A curve in a plane with the extremes of both coordinates."""
        return self._drawn(x, y, self.rows_of(x, y)) | look

    def line(self, x: Any, y: Any, **look: Any) -> dict[str, Any]:
        """A curve of all its points."""
        return {"x": self.arrays.keep(x), "y": self.arrays.keep(y), **look}

    def rows_of(self, x: Array, y: Array) -> Rows:
        """The rows of a curve in a plane that are drawn."""
        if len(x) <= self.points:
            return np.arange(len(x))
        half = self.points // 2
        return np.unique(np.concatenate((kept_rows(x, half), kept_rows(y, half))))

    def _drawn(self, x: Array, y: Array, rows: Rows) -> dict[str, Any]:
        self.thinned |= len(rows) < len(x)
        return self.line(x[rows], y[rows])
