# SPDX-License-Identifier: BSD-2-Clause
"""Conditions over windows of time.

They follow signal temporal logic (Maler & Nickovic 2004), with the robustness of Donze & Maler
2010, where x and y are the signed margins of two conditions, by time:

    always(x, a, b)      at t:  min of x over [t + a, t + b]
    eventually(x, a, b)  at t:  max of x over [t + a, t + b]
    until(x, y, a, b)    at t:  max over t' in [t + a, t + b] of min(y(t'), min of x over [t, t'))

Without times a window extends to the end of the run. A window that extends beyond the end of the
run, or contains no row, provides no evidence: its value is NaN, and an outer window ignores it. The
exception is until() over a window that extends beyond the run: it holds if y already holds in a
recorded row (the witness), and x in all rows before it.

The smallest and largest values of all windows are computed from tables of blocks of 1, 2, 4, ...
rows, in n log n operations for n rows.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.results.expressions import TOLERANCE
from harness.results.result import Array, Rows


class Windows(NamedTuple):
    """First and last row of every row's window; whether it ends within the run and has a row."""

    first: Rows
    last: Rows
    over: NDArray[np.bool_]


def windows(
    time: Array, begin: float = 0.0, end: float = math.inf, complete: bool = True
) -> Windows:
    """Return for every row, at time t [s], the rows within [t + begin, t + end]; complete: whether
    the last row is the end of the run.
    """
    slack = TOLERANCE * max(1.0, float(np.abs(time).max()))
    first = np.searchsorted(time, time + (begin - slack), side="left")
    if math.isinf(end):
        last = np.full(len(time), len(time) - 1, dtype=np.intp)
        return Windows(first, last, (first < len(time)) & complete)
    last = np.searchsorted(time, time + (end + slack), side="right") - 1
    return Windows(first, last, (time + (end - slack) <= time[-1]) & (first <= last))


def always(x: Array, within: Windows) -> Array:
    """Return the smallest x (rows,) in the window of every row; NaN without evidence."""
    return -eventually(-x, within)


def eventually(x: Array, within: Windows) -> Array:
    """Return the largest x (rows,) in the window of every row; NaN without evidence."""
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
    """Return the robustness (rows,) of the condition that x holds until y holds: the largest, over
    the rows of the window, of min(y, smallest x before that row). A window that extends beyond the
    run gives NaN (no evidence), except if its rows within the run already give at least 0.
    """
    first, last, over = within
    begin = np.arange(len(x))
    held, _ = _composed(x, y, begin, np.minimum(first, len(x)) - begin)
    _, witness = _composed(x, y, first, last + 1 - first)
    found = np.where(np.isnan(held), witness, np.minimum(held, witness))
    return np.where(over | (found >= 0), found, np.nan)


def _composed(x: Array, y: Array, begin: Rows, length: Rows) -> tuple[Array, Array]:
    """Return two values for each block of `length` rows from row `begin` on: the smallest x, and
    the largest, over the block's rows, of min(y, smallest x of earlier rows); NaN without rows.
    """
    least, witness = np.full(len(x), np.nan), np.full(len(x), np.nan)
    place, table = begin.copy(), (x, y)
    for level in range(int(length.max(initial=0)).bit_length()):
        rows = np.flatnonzero((length > 0) & (length >> level & 1 == 1))
        block = table[0][place[rows]], table[1][place[rows]]
        # append the next 2^level rows to each block whose length has this binary digit
        least[rows], witness[rows] = _after(least[rows], witness[rows], *block)
        place[rows] += 1 << level
        size = 1 << level
        table = _after(table[0][:-size], table[1][:-size], table[0][size:], table[1][size:])
    return least, witness


def _after(x_1: Array, y_1: Array, x_2: Array, y_2: Array) -> tuple[Array, Array]:
    """Return the two values of _composed() for two blocks joined in order: the smallest x and the
    largest minimum. x_1, y_1 are these two values of the first block, x_2, y_2 of the second.
    """
    later = np.where(np.isnan(x_1), y_2, np.minimum(x_1, y_2))
    return np.fmin(x_1, x_2), np.fmax(y_1, later)


def empty(time: Array, begin: float, end: float, _: bool = True) -> NDArray[np.bool_]:
    """Return a mask (rows, 1) of the rows whose window ends within the run and contains no row."""
    first, last, _over = windows(time, begin, end)
    return np.asarray((first > last) & (time + end <= time[-1]))[:, None]
