# SPDX-License-Identifier: BSD-2-Clause
"""Conditions over windows of time.

They follow signal temporal logic (Maler & Nickovic 2004), with the robustness of Donze &
Maler 2010:

    always(x, a, b)      at t:  min of x over [t + a, t + b]
    eventually(x, a, b)  at t:  max of x over [t + a, t + b]
    until(x, y, a, b)    at t:  max over t' in [t + a, t + b] of min(y(t'), min of x over [t, t'))

Without times a window goes on to the end of the run. A window that is not over at the end of the
run, or in which no row lies, is no evidence: NaN, which an outer window leaves out. An until that
has its witness already holds nevertheless.

Least and largest values of all windows come from tables of blocks of 1, 2, 4, ... rows: n log n.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.results.expressions import TOLERANCE
from harness.results.result import Array, Rows


class Windows(NamedTuple):
    """First and last row of the window of every row, and whether the run lasts to its end."""

    first: Rows
    last: Rows
    over: NDArray[np.bool_]


def windows(
    time: Array, begin: float = 0.0, end: float = math.inf, complete: bool = True
) -> Windows:
    """Return the rows within [t + begin, t + end] of every row; times in s; complete: the last row
    is the end of the run.
    """
    slack = TOLERANCE * max(1.0, float(np.abs(time).max()))
    first = np.searchsorted(time, time + (begin - slack), side="left")
    if math.isinf(end):
        last = np.full(len(time), len(time) - 1, dtype=np.intp)
        return Windows(first, last, (first < len(time)) & complete)
    last = np.searchsorted(time, time + (end + slack), side="right") - 1
    return Windows(first, last, (time + (end - slack) <= time[-1]) & (first <= last))


def always(x: Array, within: Windows) -> Array:
    """Return the least value (rows,) in the window of every row; NaN: no evidence."""
    return -eventually(-x, within)


def eventually(x: Array, within: Windows) -> Array:
    """Return the largest value (rows,) in the window of every row; NaN: no evidence."""
    first, last, over = within
    levels = np.frexp((last - first + 1).clip(1))[1] - 1  # floor(log2(length))
    table, found = x, np.full(len(x), np.nan)
    for level in range(int(levels.max()) + 1):
        size = 1 << level
        rows = np.flatnonzero(over & (levels == level))
        found[rows] = np.fmax(table[first[rows]], table[last[rows] + 1 - size])
        table = np.fmax(table[:-size], table[size:])
    return found


def until(x: Array, y: Array, within: Windows) -> Array:
    """Return the largest over the window of every row of the lesser of y and of x before it; NaN:
    no evidence, unless a witness has been seen in a window that is not over.
    """
    first, last, over = within
    begin = np.arange(len(x))
    held, _ = _composed(x, y, begin, np.minimum(first, len(x)) - begin)
    _, witness = _composed(x, y, first, last + 1 - first)
    found = np.where(np.isnan(held), witness, np.minimum(held, witness))
    return np.where(over | (found >= 0), found, np.nan)


def _composed(x: Array, y: Array, begin: Rows, length: Rows) -> tuple[Array, Array]:
    """Return the least x of blocks of rows, and the largest over their rows of min(y, x before);
    NaN without rows.
    """
    least, witness = np.full(len(x), np.nan), np.full(len(x), np.nan)
    place, table = begin.copy(), (x, y)
    for level in range(int(length.max(initial=0)).bit_length()):
        rows = np.flatnonzero((length > 0) & (length >> level & 1 == 1))
        block = table[0][place[rows]], table[1][place[rows]]
        # blocks are taken from the shortest to the longest, so this one comes after those before
        least[rows], witness[rows] = _after(least[rows], witness[rows], *block)
        place[rows] += 1 << level
        size = 1 << level
        table = _after(table[0][:-size], table[1][:-size], table[0][size:], table[1][size:])
    return least, witness


def _after(x_1: Array, y_1: Array, x_2: Array, y_2: Array) -> tuple[Array, Array]:
    """Join two blocks, one after the other: min(x_1, x_2), max(y_1, min(x_1, y_2))."""
    later = np.where(np.isnan(x_1), y_2, np.minimum(x_1, y_2))
    return np.fmin(x_1, x_2), np.fmax(y_1, later)


def empty(time: Array, begin: float, end: float, _: bool = True) -> NDArray[np.bool_]:
    """Return in which rows the window is over and holds no row."""
    first, last, _over = windows(time, begin, end)
    return np.asarray((first > last) & (time + end <= time[-1]))[:, None]
