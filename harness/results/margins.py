# SPDX-License-Identifier: BSD-2-Clause
"""Requirements compiled to instructions (harness.results.program): whether a condition holds in
every row, and its margin, the distance to failing. The live page executes the same instructions.

Every value is a table (rows, elements), with one row if the value is the same in all rows. The
truth of a condition is 1 where it holds, 0 where it fails, and NaN where it cannot be evaluated.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from harness.results.evaluation import fitted, history, ruling, unit_in, unit_of
from harness.results.expressions import Node
from harness.results.program import Program, is_per_row
from harness.results.result import Result
from harness.system.units import convert

ALL = slice(None)
"""Index that selects all rows of a result."""
ORDERS = ("<", "<=", ">", ">=")
"""Comparisons whose truth follows from their margin."""


class Limits:
    """Conditions that limit when a requirement applies: conditions on time, such as `time < 60` in
    `time < 60 or a.x < 5`, and negated premises `not x` of implies(x, y). In a row in which one of
    these holds, the requirement holds regardless of its other conditions.
    """

    def __init__(self, parts: Sequence[Node]) -> None:
        self._program = Program()
        self._holds = list(map(self._program.expression, parts))
        found = [leaf for part in parts for leaf, _ in leaves(part)]
        sides = [side for f in found for side in (f.parts if f.kind == "compare" else (f,))]
        self._sides = list(map(self._program.expression, sides))

    def applying(self, result: Result) -> Any:
        """Return the rows in which none of these conditions holds, so that the requirement depends
        on its other conditions, as an index of an array: ALL, a slice, or an array of row numbers.
        Return None if there is no such row, if one of these conditions does not have exactly one
        value per row, or if a quantity in one of them is NaN in any row.
        """
        if not self._holds:
            return ALL
        values = self._program.run(lambda name: np.ascontiguousarray(history(result, name)))
        applies = np.ones(len(result.time), dtype=np.bool_)
        for holds in (values[k] for k in self._holds):
            if np.shape(holds) != applies.shape:
                return None
            applies &= np.logical_not(holds)
        there = np.flatnonzero(applies)
        if not len(there) or any(np.isnan(np.max(values[k])) for k in self._sides):
            return None
        neighbours = there[-1] - there[0] == len(there) - 1
        return slice(there[0], there[-1] + 1) if neighbours else there


class Single(NamedTuple):
    """Comparison that is the only part of a requirement besides its Limits, as `a.x < 5` in `time <
    60 or a.x < 5`.

    name: operator; difference: number of the instruction that gives left side minus right side;
    value: number of the instruction that gives the side whose worst value is reported; needed:
    numbers of these two and of all instructions on which they depend; units: unit of the reported
    side, and unit as the user wrote it; limits: the other conditions.
    """

    name: str
    difference: int
    value: int
    needed: Sequence[int]
    units: tuple[str, str]
    limits: Limits


class Requirement:
    """Requirement compiled to a program. Each attribute below is the number of the instruction of
    this program that gives the described value.

    truth: 1, 0 or NaN for every row and element; margin: margin of every row, -inf where the margin
    of an element is NaN; elements: margin of every row and element; value, which: compared value of
    the comparison that determines the margin, and index of its unit in `units`; exercised: whether
    the requirement is exercised, as defined in _exercised().

    The condition of a requirement with windows is evaluated in every row, with its windows counted
    from the time of that row; its result in the first row is the verdict (`at_start` is True). Of
    the attributes above such a requirement has only truth and margin, both (rows, 1); truth is 1
    where the condition holds, -1 where it fails, NaN where a window extends beyond the run or
    contains no row. It has two further attributes. undecided: number of the instruction that gives
    whether one of its conditions is NaN in any row; empty: by window, as text such as `0 to 60 s`,
    the number of the instruction that gives whether this window, relative to the time of any row,
    lies within the run but contains no row.
    """

    def __init__(self, tree: Node, unit: Callable[[str], str], program: Program) -> None:
        self.program, self._unit = program, unit
        self.guarded = not tree.is_timing
        self.has_rows, self.at_start = tree.is_history, tree.has_window
        self.single: Single | None = None
        self.margin_unit = unit_of_margin(tree, unit)
        self.units: list[tuple[str, str]] = []
        """Units of compared values, a pair each: unit in which the value is computed, and unit that
        the user wrote ("" if none).
        """
        self.empty: dict[str, int] = {}
        self._inside: list[int] = []
        if tree.has_window:
            self.margin, self.truth = self._over_windows(tree)
            unknown = [self._add("any", self._add("isnan", x)) for x in self._inside]
            self.undecided = self._fold("fmax", unknown)
            return
        self.truth, self.margin, self.elements = (
            each(tree) for each in (self._truth, self._by_row, self._of)
        )
        self.exercised = self._exercised(tree, self._number(1))
        self.value, self.which = self._shown(tree)
        decisive = self.guarded and tree.kind == "join" and tree.name == "or" and is_per_row(tree)
        parts = tree.parts if decisive else (tree,)
        further = [part for part in parts if not part.is_timing]
        if len(further) == 1 and further[0].name in ORDERS:
            limits = Limits([part for part in parts if part.is_timing])
            self.single = self._single(further[0], limits)

    def _single(self, node: Node, limits: Limits) -> Single:
        difference = self._add("difference", *map(self._table, node.parts))
        value = self._table(node.shown)
        needed = self.program.needed((difference, value))
        units = unit_of(node.shown, self._unit), node.unit
        return Single(node.name, difference, value, needed, units, limits)

    def _add(self, operation: str, *parts: int, constant: Any = None) -> int:
        return self.program.add(operation, *parts, constant=constant)

    def _number(self, value: float) -> int:
        return self._add("table", self.program.number(value))

    def _time(self) -> int:
        return self.program.add("look up", constant="time", rows=True)

    def _table(self, node: Node) -> int:
        return self._add("table", self.program.expression(node))

    def _fold(self, operation: str, parts: Sequence[int]) -> int:
        return self.program.fold(operation, parts)

    def _where(self, condition: int, value: float, other: float) -> int:
        return self._add("where", condition, self._number(value), self._number(other))

    # ---- conditions in every row

    def _truth(self, node: Node) -> int:
        match node.kind:
            case "compare":
                sides = list(map(self._table, node.parts))
                return self._add("decided", self._add(node.name, *sides), *sides)
            case "not":
                return self._opposite(self._truth(node.parts[0]))
            case "join":
                parts = list(map(self._truth, node.parts))
                if node.name == "and":
                    return self._fold("both", parts)
                return self._opposite(self._fold("both", list(map(self._opposite, parts))))
        value = self._table(node)
        return self._add("decided", self._add("!=", value, self._number(0)), value)

    def _opposite(self, truth: int) -> int:
        return self._add("-", self._number(1), truth)

    def _holds(self, truth: int) -> int:
        """Return the number of the instruction that gives 1 in every row (rows, 1) in which a
        condition holds in all elements, else 0.
        """
        return self._add("least", self._add("==", truth, self._number(1)))

    def _by_row(self, node: Node) -> int:
        """Return the number of the instruction that gives, for each row, the smallest margin of its
        elements, as (rows, 1); -inf in a row with a margin of NaN.
        """
        least = self._add("least", self._of(node))
        return self._add("where", self._add("isnan", least), self._number(-math.inf), least)

    def _of(self, node: Node) -> int:
        """Return the number of the instruction that gives the margins (rows, elements) of a
        condition; NaN where the condition cannot be evaluated.
        """
        return self._add("decided", self._margin(node), self._truth(node))

    def _margin(self, node: Node) -> int:
        is_true = self._add("==", self._truth(node), self._number(1))
        if self.guarded and node.is_timing:  # a condition on time has no margin of its own
            return self._where(is_true, math.inf, -math.inf)
        match node.kind:
            case "compare":
                found = self._add("difference", *map(self._table, node.parts))
                if node.name in ("==", "!="):
                    found = self._add("abs", found)
                return found if node.name in (">", ">=", "!=") else self._add("negative", found)
            case "not":
                return self._add("negative", self._of(node.parts[0]))
            case "join":
                return self._fold(_extreme(node), list(map(self._of, node.parts)))
        return self._where(is_true, 1, -1)

    def _exercised(self, node: Node, looked: int, negated: bool = False) -> int:
        """Return the number of the instruction that gives whether a condition is exercised. A
        comparison is exercised if at least one row counts for it; `and`, if all its parts except
        conditions on time and premises of implies() are exercised; `or`, if at least one of these
        parts is. Every row counts, unless a condition on time or the premise of implies() alone
        decides an `or` in this row.

        looked: number of the instruction that gives 1 in the rows that count for `node`, else 0;
        negated: whether `node` is inside an odd number of `not`, which make an
        `and` of an `or` and the reverse.
        """
        if node.is_timing:
            return self._number(not self.guarded)
        if node.kind == "not":
            return self._exercised(node.parts[0], looked, not negated)
        if node.kind != "join":
            return self._add("any", looked)
        further = [part for part in node.parts if not part.is_timing]
        if (node.name == "or") is negated:  # `and`, or a negated `or`: all parts must hold
            parts = [self._exercised(part, looked, negated) for part in further]
            return self._fold("*", [self._number(1), *parts])
        for part in node.parts:
            if part.is_timing:
                truth = self._truth(part)
                decided = self._holds(truth if node.name == "or" else self._opposite(truth))
                looked = self._add("*", looked, self._opposite(decided))
        parts = [self._exercised(part, looked, negated) for part in further]
        return self._fold("fmax", [self._number(0), *parts])

    def _shown(self, node: Node) -> tuple[int, int]:
        """Return the numbers of two instructions. The first gives the compared value of the
        comparison that determines the margin of a row (in `and` the least margin, in `or` the
        largest), the second the index of the unit of this value in `units`.
        """
        if node.kind == "not":
            return self._shown(node.parts[0])
        if node.kind != "join":
            units = unit_of(node.shown, self._unit), node.unit
            if units not in self.units:
                self.units.append(units)
            return self._table(node.shown), self._number(self.units.index(units))
        (value, which), best = self._shown(node.parts[0]), self._of(node.parts[0])
        order = "<" if node.name == "and" else ">"
        for part in node.parts[1:]:
            margin, (further, place) = self._of(part), self._shown(part)
            better = self._add("or", self._add("isnan", best), self._add(order, margin, best))
            value = self._add("where", better, further, value)
            which = self._add("where", better, place, which)
            best = self._add(_extreme(node), best, margin)
        return value, which

    # ---- conditions over windows of time

    def _over_windows(self, node: Node) -> tuple[int, int]:
        """Return the numbers of two instructions for a condition with windows. The first gives its
        margin in every row, the second 1 where it holds, -1 where it fails. Both give NaN where the
        window provides no evidence, because it extends beyond the run or contains no row.
        """
        if not node.has_window:
            truth = self._truth(node)
            self._inside.append(truth)
            both = self._by_row(node), self._where(self._holds(truth), 1, -1)
            margin, sign = (self._add("every row", each, self._time()) for each in both)
            return margin, sign
        pairs = [self._over_windows(part) for part in node.parts]
        margins, signs = (list(each) for each in zip(*pairs, strict=True))
        if node.kind == "not":
            return self._add("negative", *margins), self._add("negative", *signs)
        if node.kind == "window":
            begin, end = node.value
            window = self._add("empty", self._time(), constant=node.value)
            self.empty[f"{begin:g} to {end:g} s"] = self._add("any", window)
            margin, sign = (
                self._add(node.name, *parts, self._time(), constant=node.value)
                for parts in (margins, signs)
            )
            return margin, sign
        sign = self._fold(_extreme(node), signs)
        decided = self._add("==", sign, self._number(1 if node.name == "or" else -1))
        margin, sign = (
            self._add("where", decided, each, self._add("decided", each, *signs))
            for each in (self._fold(_extreme(node), margins), sign)
        )
        return margin, sign

    def data(self) -> dict[str, Any]:
        """Return instruction numbers, flags and units of the requirement as plain data for the live
        page.
        """
        numbers = {name: x for name, x in vars(self).items() if isinstance(x, bool | int)}
        units = [_conversion(*each) for each in self.units]
        return numbers | {
            "units": units,
            "empty": list(self.empty.items()),
            "marginUnit": self.margin_unit,
        }


def _conversion(given: str, written: str) -> dict[str, Any]:
    """Return the unit in which a value is shown, and the factor and offset that convert a value
    from `given`, the unit of the variables, to the shown unit. written: unit that the user wrote.
    """
    zero, one = (convert(x, given, written) if written else x for x in (0.0, 1.0))
    return {"unit": written or given, "factor": one - zero, "offset": zero}


def _extreme(node: Node) -> str:
    """Return the name of the operation that joins margins: minimum for `and`, maximum for `or`."""
    return "fmax" if node.name == "or" else "fmin"


def compiled(result: Result, text: str) -> Requirement:
    """Return the requirement `text`, compiled for the units of the variables of a result; raise
    ValueError if it is not an expression or its units do not fit. Requirements are cached.
    """
    tree = fitted(result, text)
    return _compiled(tree, tuple(unit_in(result, path) for path in tree.variables))


@lru_cache(maxsize=256)
def _compiled(tree: Node, units: tuple[str, ...]) -> Requirement:
    return Requirement(tree, dict(zip(tree.variables, units, strict=True)).__getitem__, Program())


# ---- parts of a condition


def leaves(node: Node, inside: bool = False) -> Iterator[tuple[Node, bool]]:
    """Yield all comparisons and other conditions of a tree that contain no further conditions, each
    with whether it is inside a window.
    """
    if not node.conditions:
        yield node, inside
    for part in node.conditions:
        yield from leaves(part, inside or node.kind == "window")


def compared(node: Node) -> Iterator[Node]:
    """Yield all comparisons and other conditions of a tree that contain no further conditions,
    except conditions that determine when other conditions apply.
    """
    if not node.is_timing:
        for part in node.conditions:
            yield from compared(part)
        if not node.conditions:
            yield node


def unit_of_margin(node: Node, unit: Callable[[str], str]) -> str:
    """Return the unit of the margin of a condition, "" if it is unknown or if its comparisons have
    several units.
    """
    sides = [leaf.parts for leaf in compared(node) if leaf.kind == "compare"]
    units = {ruling([(part, unit_of(part, unit)) for part in parts])[1] or "" for parts in sides}
    return units.pop() if len(units) == 1 else ""
