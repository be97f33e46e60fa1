# SPDX-License-Identifier: BSD-2-Clause
"""Expressions of metrics, requirements, curves and arrays of a replay as lists of instructions,
which Python and the live page (in harness/report/page/program.js) interpret.

An instruction takes the values of earlier instructions and gives one value: a number () or a vector
(elements,), or a time series of these, (rows,) or (rows, elements). Conditions are compiled to
operations on tables (rows, elements), which have one row if the value is the same in all rows
(harness.results.margins).
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache, partial, reduce
from typing import Any, NamedTuple

import numpy as np

from harness.results import windows
from harness.results.evaluation import fitted, history
from harness.results.expressions import FUNCTIONS, ROW, SHIFTS, Node, is_steady
from harness.results.histories import minus, plus
from harness.results.result import Result

LookUp = Callable[[str], Any]
"""Function that returns the value of `time`, `component.variable` or `parameter component.name`."""


class Instruction(NamedTuple):
    """Operation of a program.

    operation: name of the operation; parts: numbers of the instructions whose values are its
    operands; constant: name of a variable, number, index of an element, or window; rows: whether
    the value of the instruction is a time series.
    """

    operation: str
    parts: tuple[int, ...] = ()
    constant: Any = None
    rows: bool = False


class Program:
    """List of instructions, executed in order; of equal instructions only the first is stored."""

    def __init__(self) -> None:
        self.instructions: list[Instruction] = []
        self._numbers: dict[tuple[Any, ...], int] = {}

    def add(self, operation: str, *parts: int, constant: Any = None, rows: Any = None) -> int:
        """Add an instruction unless an equal one exists, and return its number. Its value is a time
        series if one of its operands (`parts`) is a time series; `rows` overrides this.
        """
        if rows is None:
            rows = any(self.instructions[part].rows for part in parts)
        key = operation, parts, repr(constant), rows  # repr: True differs from 1, 0.0 from -0.0
        number = self._numbers.setdefault(key, len(self.instructions))
        if number == len(self.instructions):
            self.instructions.append(Instruction(operation, parts, constant, rows))
        return number

    def number(self, value: float) -> int:
        """Return the number of the instruction that gives a constant."""
        return self.add("number", constant=value)

    def expression(self, node: Node, row: int | None = None) -> int:  # noqa: PLR0911 - per kind
        """Return the number of the instruction that gives the value of a resolved() expression.

        row: number of the instruction that gives the index of the only row to be evaluated; time
        series then have one row.
        """
        match node:
            case Node("name", name):
                found = self.add("look up", constant=name, rows=node.is_history)
                if row is None or not node.is_history:
                    return found
                return self.add("one row", found, row)
            case Node("number"):
                return self.number(node.value)
            case Node("window", name):
                raise ValueError(f"{name}() is a condition of a requirement, not a number")
            case Node("call", name) if name in ROW:
                return self._row(node)
        parts = [self.expression(part, row) for part in node.parts]
        match node:
            case Node("pick"):
                about = (node.value - 1, node.parts[0].text)
                return self.add("element", *parts, constant=about)
            case Node("call", name):
                if FUNCTIONS[name].shifts:
                    _check_rows(node)
                return self.add(name, *parts, rows=node.is_history)
            case Node("join"):
                return self.fold(node.name, parts)
        return self.add(node.name, *parts)

    def fold(self, operation: str, parts: Sequence[int]) -> int:
        """Return the number of the instruction that joins the values of all parts, from the first
        to the last, by an operation on two values.
        """
        found = parts[0]
        for part in parts[1:]:
            found = self.add(operation, found, part)
        return found

    def _row(self, node: Node) -> int:
        """Return the number of the instruction that gives one row of an expression, for first(),
        last() and at(). If the value in a row does not depend on other rows, only that row is
        evaluated.
        """
        inner = node.parts[0]
        _check_rows(node)
        row = self.add(node.name, *map(self.expression, node.parts[1:]), rows=False)
        if not is_per_row(inner):
            return self.add("row", self.expression(inner), row, rows=False)
        first = self.add("first", rows=False)
        return self.add("row", self.expression(inner, row), first, rows=False)

    def needed(self, wanted: Sequence[int]) -> list[int]:
        """Return, in order, the numbers of the wanted instructions and of all instructions on which
        they depend.
        """
        found = {*wanted}
        for k in range(max(wanted), -1, -1):
            found |= {*self.instructions[k].parts} if k in found else set()
        return sorted(found)

    def run(
        self,
        look_up: LookUp,
        complete: bool = True,
        rows: bool = True,
        only: Sequence[int] | None = None,
    ) -> list[Any]:
        """Execute the instructions and return the value of each, None for one that is not executed.

        look_up: function that returns the value of a name; complete: whether the last row is the
        end of the run; rows: whether to execute instructions whose value is a time series; only:
        numbers of the instructions to execute, from needed() (None: all).
        """
        values: list[Any] = [None] * len(self.instructions)
        with np.errstate(all="ignore"):
            for k in range(len(values)) if only is None else only:
                each = self.instructions[k]
                if each.operation == "look up" and (rows or not each.rows):
                    values[k] = _flat(look_up(each.constant), each.rows)
                elif rows or not each.rows:
                    given = [(values[part], self.instructions[part].rows) for part in each.parts]
                    values[k] = _value(each, given, complete)
        return values

    def data(self) -> list[list[Any]]:
        """Return operation, parts and constant of each instruction as plain data for the live page;
        numbers that are not finite are texts, such as "NaN".
        """
        return [[each.operation, each.parts, _finite(each.constant)] for each in self.instructions]


def _check_rows(node: Node) -> None:
    """Raise ValueError if the first argument of a function is not a time series."""
    if not node.parts[0].is_history:
        raise ValueError(f"{node.name}(): `{node.parts[0].text}` has no rows: it is constant")


def is_per_row(tree: Node) -> bool:
    """Return whether the value of an expression in a row depends on that row alone."""
    reducing = (n for n in tree.walk() if n.kind == "call" and not FUNCTIONS[n.name].per_row)
    return not tree.has_window and not any(p.is_history for n in reducing for p in n.parts)


def is_local(tree: Node) -> bool:
    """Return whether an expression is a time series whose value in a row depends on that row and
    its neighbours alone.
    """
    calls = (node.name for node in tree.walk() if node.kind == "call")
    near = all(FUNCTIONS[name].per_row or FUNCTIONS[name].shifts for name in calls)
    return near and tree.is_history and not tree.has_window


def _finite(constant: Any) -> Any:
    if isinstance(constant, tuple):
        return [_finite(each) for each in constant]
    if isinstance(constant, float) and not math.isfinite(constant):
        return "NaN" if math.isnan(constant) else f"{'-' if constant < 0 else ''}Infinity"
    return constant


# ---- values


def _value(instruction: Instruction, given: list[tuple[Any, bool]], complete: bool) -> Any:
    """Return the value of an instruction; given: pairs of the value of a part and whether this
    value is a time series; complete: whether the last row is the end of the run.
    """
    operation, _, constant, _ = instruction
    values = [value for value, _ in given]
    if operation in OPERATIONS:
        return OPERATIONS[operation](*_aligned(given))
    if operation in FUNCTIONS:
        vectors = (_vector(*each) for each in given)
        return FUNCTIONS[operation].value(*(vectors if operation in OF_VECTORS else values))
    if operation in WINDOWED:
        return WINDOWED[operation](*values, *constant, complete)
    if operation in TABLES:
        return TABLES[operation](*values)
    return SPECIAL[operation](given, constant)


def _flat(value: Any, rows: bool) -> Any:
    """Return a matrix as the vector of its elements; rows: whether the value is a time series."""
    leading = np.shape(value)[:rows]
    return value if np.ndim(value) <= len(leading) + 1 else np.reshape(value, (*leading, -1))


def _vector(value: Any, rows: bool) -> Any:
    """Return a value with an axis of elements; a scalar gets an axis of length 1. rows: whether the
    value is a time series.
    """
    return value if np.ndim(value) > rows else np.asarray(value)[..., np.newaxis]


def _aligned(given: list[tuple[Any, bool]]) -> list[Any]:
    """Return the values of operands in shapes that numpy combines element by element: if one
    operand is a vector, a scalar time series gets an axis of one element. given: pairs of a
    value and whether it is a time series.
    """
    if all(np.ndim(value) <= rows for value, rows in given):
        return [value for value, _ in given]
    return [_vector(*each) for each in given]


def _element(given: list[tuple[Any, bool]], constant: tuple[int, str]) -> Any:
    vector, (index, text) = _vector(*given[0]), constant
    if index >= vector.shape[-1]:
        raise ValueError(f"`{text}` has {vector.shape[-1]} elements")
    return vector[..., index]


OF_VECTORS = ("angle", "angle_between", "hill", "mrp", "norm", "total", "turned")
"""Names of functions of vectors. A scalar argument of such a function gets an axis of one element.
"""
OPERATIONS: Mapping[str, Callable[..., Any]] = {
    "+": plus, "-": minus, "*": operator.mul, "/": operator.truediv, "**": operator.pow,
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq,
    "!=": operator.ne, "not": np.logical_not, "implies": np.logical_not, "and": np.logical_and,
    "or": np.logical_or, "negative": operator.neg, "positive": operator.pos,
}  # fmt: skip
"""Operations element by element."""


# ---- tables (rows, elements) of conditions


def _table(given: list[tuple[Any, bool]], _: None) -> Any:
    """Return a value as a table (rows, elements), with one row if the value is no time series."""
    ((value, rows),) = given
    array = np.asarray(value, dtype=np.float64)
    return array.reshape(len(array) if rows else 1, -1)


def _number(_: Any, constant: float) -> Any:
    # converted to a double, because 9**9**9 with Python integers would not end
    return constant if isinstance(constant, bool) else np.float64(constant)


def _least(table: Any) -> Any:
    """Return the least element of every row as (rows, 1). A table of one column is returned
    unchanged, because np.min() would take long for it.
    """
    return table if table.shape[1] == 1 else np.min(table, axis=1, keepdims=True)


def _decided(x: Any, *by: Any) -> Any:
    """Return x as doubles, NaN where an element of one of the arrays `by` is NaN."""
    unknown = reduce(np.logical_or, map(np.isnan, by))
    if np.shape(x) == unknown.shape and not unknown.any():  # np.where takes ten times as long
        return np.asarray(x, dtype=np.float64)
    return np.where(unknown, np.nan, x)


def _difference(a: Any, b: Any) -> Any:
    """Return a - b; 0 where both are the same infinity."""
    found = a - b
    return np.where(a == b, 0.0, found) if np.isnan(found).any() else found


def _over_windows(function: Callable[..., Any]) -> Callable[..., Any]:
    def of_tables(*given: Any) -> Any:
        *tables, time, begin, end, complete = given
        within = windows.windows(time, begin, end, complete)
        return function(*(table[:, 0] for table in tables), within)[:, None]

    return of_tables


TABLES: Mapping[str, Callable[..., Any]] = {
    "row": lambda x, row: x[row],
    "one row": lambda x, row: x[[row]],
    "decided": _decided,
    "both": lambda a, b: np.where((a == 0) | (b == 0), 0.0, a * b),
    "where": np.where,
    "difference": _difference,
    "fmin": np.fmin,
    "fmax": np.fmax,
    "isnan": np.isnan,
    "any": lambda x: np.array([[x.any()]]),
    "least": _least,
    "every row": lambda x, time: np.broadcast_to(x, (len(time), x.shape[1])),
}
"""Operations whose operands are not brought to a common shape first. `decided`: see _decided();
`both`: truth of `a and b`, 0 where a or b is 0, else NaN where a or b is NaN; `difference`: see
_difference().
"""
WINDOWED: Mapping[str, Callable[..., Any]] = {
    "always": _over_windows(windows.always),
    "eventually": _over_windows(windows.eventually),
    "until": _over_windows(windows.until),
    "empty": windows.empty,
}
"""Operations over the window of every row. The last operand of the instruction is the time; the
constant of the instruction is begin and end of the window [s], relative to the time of the row.
"""
SPECIAL: Mapping[str, Callable[..., Any]] = {
    "element": _element,
    "number": _number,
    "table": _table,
}
"""Operations that are called with two arguments: the operands, as pairs of a value and whether the
value is a time series (needed by `element` and `table`), and the constant of the instruction
(needed by `element` and `number`).
"""


# ---- expressions over a result


@lru_cache(maxsize=256)
def _compiled(node: Node) -> Program:
    """Return the program whose last value is the value of an expression."""
    program = Program()
    program.expression(node)
    return program


def value_of(result: Result, text: str) -> Any:
    """Return the value of the expression `text` for a result, in the shapes of evaluate(); raise
    ValueError for an invalid expression, KeyError for an unknown name.
    """
    return evaluate(fitted(result, text), partial(history, result))


def evaluate(node: Node, look_up: LookUp) -> Any:
    """Return the value of a resolved() expression: (rows,) or (rows, elements) if Node.is_history,
    else () or (elements,). look_up: function that returns the value of a name.
    """
    if node.name == "steady" and node.parts[0].name == "time" and is_local(node.parts[1]):
        return _steady(node.parts[1], look_up)
    return _compiled(node).run(look_up)[-1]


def of_rows(look_up: LookUp, rows: Any) -> LookUp:
    """Return a function that looks up the same names, with time series restricted to the given
    rows.
    """
    return lambda name: look_up(name) if name.startswith("parameter ") else look_up(name)[rows]


def _steady(error: Node, look_up: LookUp) -> float:
    """Return the value of steady(time, error). `error` is evaluated only in the rows that steady()
    uses and in those before them from which previous() takes values.
    """
    first = int(np.argmax(is_steady(look_up("time"))))
    before = max(0, first - sum(node.name in SHIFTS for node in error.walk()))
    return float(np.max(evaluate(error, of_rows(look_up, slice(before, None)))[first - before :]))
