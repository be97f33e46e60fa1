# SPDX-License-Identifier: BSD-2-Clause
"""Margins of conditions over the rows of a result: how far each is from failing.

Conditions over windows of time are those of signal temporal logic (Maler & Nickovic 2004), with the
robustness of Donze & Maler 2010:

    always(x, a, b)      at t:  min of x over [t + a, t + b]
    eventually(x, a, b)  at t:  max of x over [t + a, t + b]
    until(x, y, a, b)    at t:  max over t' in [t + a, t + b] of min(y(t'), min of x over [t, t'))

Without times a window goes on to the end of the run. A window that is not over at the end of the
run is no evidence: NaN, which an outer window leaves out. An until that has its witness already
holds nevertheless.

Least and largest values of all windows come from tables of blocks of 1, 2, 4, ... rows: n log n.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial, reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.results.evaluation import OPERATIONS, evaluate, history, unit_in, unit_of
from harness.results.expressions import Node
from harness.results.result import Array, Result, Rows
from harness.system.units import convert

TOLERANCE = 1e-9
"""Part of the time by which a row may miss the end of a window and still belong to it."""


class Windows(NamedTuple):
    """Of every row: first and last row of its window, and whether the run lasts to its end."""

    first: Rows
    last: Rows
    over: NDArray[np.bool_]


def windows(
    time: Array, begin: float = 0.0, end: float = math.inf, complete: bool = True
) -> Windows:
    """The rows within [t + begin, t + end] of every row; times in s; complete: the last row is the
    end of the run.
    """
    slack = TOLERANCE * max(1.0, float(np.abs(time).max()))
    first = np.searchsorted(time, time + (begin - slack), side="left")
    if math.isinf(end):
        last = np.full(len(time), len(time) - 1, dtype=np.intp)
        return Windows(first, last, (first < len(time)) & complete)
    last = np.searchsorted(time, time + (end + slack), side="right") - 1
    return Windows(first, last, (time + (end - slack) <= time[-1]) & (first <= last))


def always(x: Array, within: Windows) -> Array:
    """Least value (rows,) in the window of every row; NaN: no evidence."""
    return -eventually(-x, within)


def eventually(x: Array, within: Windows) -> Array:
    """Largest value (rows,) in the window of every row; NaN: no evidence."""
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
    """Largest over the window of every row of the lesser of y and of x before it; NaN: no evidence,
    unless a witness has been seen in a window that is not over.
    """
    first, last, over = within
    begin = np.arange(len(x))
    held, _ = _composed(x, y, begin, np.minimum(first, len(x)) - begin)
    _, witness = _composed(x, y, first, last + 1 - first)
    found = np.where(np.isnan(held), witness, np.minimum(held, witness))
    return np.where(over | (found >= 0), found, np.nan)


def _composed(x: Array, y: Array, begin: Rows, length: Rows) -> tuple[Array, Array]:
    """Of blocks of rows: the least x, and the largest over its rows of min(y, x before); NaN of no
    rows.
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
    """The same of two blocks one after the other: min(x_1, x_2), max(y_1, min(x_1, y_2))."""
    later = np.where(np.isnan(x_1), y_2, np.minimum(x_1, y_2))
    return np.fmin(x_1, x_2), np.fmax(y_1, later)


class Margins:
    """How far the conditions of an expression are from failing, row by row; negative: they fail.

    guarded: conditions on time alone, as those of implies(), say when the others count.
    """

    def __init__(self, result: Result, guarded: bool) -> None:
        self.result = result
        self.guarded = guarded
        self.look_up = partial(history, result)
        self._known: dict[Node, Any] = {}
        self._truths: dict[Node, Array] = {}
        self._margins: dict[Node, Array] = {}
        self.undecided = False
        """Whether some condition of a window hangs on what is no number."""

    def over_windows(self, node: Node) -> tuple[Array, Array]:
        """Margin (rows,) of every row, and 1 where it holds, -1 where not; NaN: no evidence."""
        if node.has_window:
            pairs = [self.over_windows(part) for part in node.parts]
            if node.kind == "not":
                return -pairs[0][0], -pairs[0][1]
            if node.kind == "join":
                return _combined(pairs, node)
            begin, end = node.value
            within = windows(self.result.time, begin, end, self.result.complete)
            margin, sign = (STL[node.name](*parts, within) for parts in zip(*pairs, strict=True))
            return margin, sign
        truth, rows = self.rows_of(self.truth(node)), np.ones(len(self.result.time))
        self.undecided |= bool(np.isnan(truth).any())
        return self.of(node) * rows, np.where((truth == 1).all(axis=1), 1.0, -1.0) * rows

    def truth(self, node: Node) -> Array:
        """1 where a condition holds, 0 where it does not, NaN where that hangs on what is no
        number, with the rows and elements of its parts.
        """
        if node not in self._truths:
            self._truths[node] = self._truth(node)
        return self._truths[node]

    def _truth(self, node: Node) -> Array:
        match node.kind:
            case "compare":
                a, b = map(self._evaluated, node.parts)
                return np.where(np.isnan(a) | np.isnan(b), np.nan, OPERATIONS[node.name](a, b))
            case "not":
                return 1 - self.truth(node.parts[0])
            case "join":
                parts = np.array(np.broadcast_arrays(*map(self.truth, node.parts)))
                decides = _decides(node)
                some = (parts == decides).any(axis=0)
                return np.where(some, decides, _extreme(node).reduce(parts))
        value = np.asarray(evaluate(node, self.look_up), dtype=np.float64)
        return np.where(np.isnan(value), np.nan, value != 0)

    def of(self, node: Node) -> Array:
        """Margin of every row, or (1,) if the rows do not matter; -inf where it is not a number."""
        if node not in self._margins:
            margin = self._margin(node)
            self._margins[node] = np.where(np.isnan(margin), -np.inf, margin)
        return self._margins[node]

    def _margin(self, node: Node) -> Array:
        if self.guarded and node.is_timing:  # says when, not how well
            return np.where(self._holds(node), np.inf, -np.inf)
        match node.kind:
            case "compare":
                return by_row(np.min, self._elements(node))
            case "not":
                return -self.of(node.parts[0])
            case "join":
                return reduce(_extreme(node), map(self.of, node.parts))
        return np.where(self._holds(node), 1.0, -1.0)

    def exercised(self, node: Node, looked: Any = True, negated: bool = False) -> bool:
        """Whether every part that must hold was looked at in some row: where time alone, or what
        implies() begins with, does not decide on the whole. looked: rows (rows,) that matter;
        negated: below a `not`.
        """
        if node.is_timing:
            return not self.guarded
        if node.kind == "not":
            return self.exercised(node.parts[0], looked, not negated)
        if node.kind != "join":
            return bool(np.any(looked))
        further = [part for part in node.parts if not part.is_timing]
        if bool(_decides(node)) is negated:  # all must hold
            return all(self.exercised(part, looked, negated) for part in further)
        open_ = looked & self._left_open(node)
        return any(self.exercised(part, open_, negated) for part in further)

    def _left_open(self, node: Node) -> Any:
        """Rows (rows,) in which time alone does not decide on joined conditions."""
        timing = [self.rows_of(self.truth(part)) for part in node.parts if part.is_timing]
        decided = [(truth == _decides(node)).all(axis=1) for truth in timing]
        return ~reduce(np.logical_or, decided, np.False_)

    def decisive(self, node: Node, row: int) -> Node:
        """The part of a condition that has its margin in a row."""
        if node.kind not in ("not", "join"):
            return node
        margins = [_at(self.of(part), row) for part in node.parts]
        which = int(np.argmin(margins) if node.name == "and" else np.argmax(margins))
        return self.decisive(node.parts[which], row)

    def value(self, node: Node, row: int) -> tuple[float, str]:
        """What is compared in a row, the element with the least margin, and its unit."""
        shown, element = node.shown, 0
        if shown is not node:
            element = int(np.argmin(_at(self._elements(node), row)))
        values = _at(self.rows_of(self._evaluated(shown)), row)
        value = float(values[min(element, len(values) - 1)])
        given = unit_of(shown, partial(unit_in, self.result))
        return (convert(value, given, node.unit), node.unit) if node.unit else (value, given)

    def _elements(self, node: Node) -> Array:
        """Margins of a comparison by row and element."""
        a, b = (np.asarray(self._evaluated(side), dtype=np.float64) for side in node.parts)
        return self.rows_of(SIGNED[node.name](a - b))

    def _evaluated(self, side: Node) -> Any:
        """One side of a comparison, which truth, margin and worst value all look at."""
        if side not in self._known:
            self._known[side] = evaluate(side, self.look_up)
        return self._known[side]

    def _holds(self, node: Node) -> NDArray[np.bool_]:
        return by_row(np.all, self.rows_of(self.truth(node)) == 1)

    def rows_of(self, values: Any) -> Array:
        """Values as (rows, elements), or (1, elements) where the rows do not matter."""
        array = np.asarray(values, dtype=np.float64)
        rows = len(self.result.time)
        history = array.ndim > 0 and len(array) == rows
        return array.reshape(rows if history else 1, -1)


def by_row(function: Callable[..., Any], elements: NDArray[Any]) -> NDArray[Any]:
    """The least, all or any of the elements of every row; numpy takes long for rows of one."""
    return elements[:, 0] if elements.shape[1] == 1 else np.asarray(function(elements, axis=1))


STL: Mapping[str, Callable[..., Array]] = {
    "always": always,
    "eventually": eventually,
    "until": until,
}


def _combined(pairs: Sequence[tuple[Array, Array]], node: Node) -> tuple[Array, Array]:
    """Margins and signs of joined conditions; no evidence of one leaves the others to decide."""
    extreme, decides = (np.fmax, 1) if node.name == "or" else (np.fmin, -1)
    margins, signs = (np.array(each) for each in zip(*pairs, strict=True))
    sign = extreme.reduce(signs)
    open_ = np.isnan(signs).any(axis=0) & (sign != decides)
    return np.where(open_, np.nan, extreme.reduce(margins)), np.where(open_, np.nan, sign)


SIGNED: Mapping[str, Callable[[Array], Array]] = {
    "<": np.negative,
    "<=": np.negative,
    ">": np.positive,
    ">=": np.positive,
    "==": lambda difference: -np.abs(difference),
    "!=": np.abs,
}
"""Margin of a comparison by the difference of its sides."""


def _extreme(node: Node) -> np.ufunc:
    """The least margin of all counts, or the largest of any."""
    return np.maximum if node.name == "or" else np.minimum


def _decides(node: Node) -> float:
    """The truth of one part that decides on the whole, whatever the other parts are."""
    return 1.0 if node.name == "or" else 0.0


def _at(rows: Array, row: int) -> Any:
    return rows[row if len(rows) > 1 else 0]


# ---- what a condition is made of


def leaves(node: Node, inside: bool = False) -> Iterator[tuple[Node, bool]]:
    """Conditions that are not made of others, and whether they stand in a window."""
    if not node.conditions:
        yield node, inside
    for part in node.conditions:
        yield from leaves(part, inside or node.kind == "window")


def compared(node: Node) -> Iterator[Node]:
    """Conditions that are not made of others, without those that say when the others count."""
    if not node.is_timing:
        for part in node.conditions:
            yield from compared(part)
        if not node.conditions:
            yield node


def unit_of_margin(node: Node, unit: Callable[[str], str]) -> str:
    """Unit of the margin of a condition, "" if it is not known or there are several."""
    sides = [leaf.parts for leaf in compared(node) if leaf.kind == "compare"]
    units = {unit_of(a, unit) or unit_of(b, unit) for a, b in sides}
    return units.pop() if len(units) == 1 else ""
