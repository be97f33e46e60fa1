# SPDX-License-Identifier: BSD-2-Clause
"""Expressions over the variables of a result, for metrics of campaigns and for requirements.

An expression contains the names of variables of the result, as in `last(norm(servicer.r_SN_N -
target.r_TN_N))`, or of elements, as in `servicer.r_SN_N[1]`. It can call only the functions listed
in FUNCTIONS and WINDOWED, implies() and parameter(). A number may have a unit: `guidance.beta_t <=
2 deg`. Names are compared in Unicode's normal form NFKC.
"""

from __future__ import annotations

import ast
import math
import re
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple
from unicodedata import normalize

import numpy as np
from numpy.typing import NDArray

from harness.results.histories import (
    angle_between,
    hill_attitude,
    minus,
    norm,
    of_mrp,
    orbit_attitude,
    plus,
    total,
    turned,
)
from harness.results.result import Array
from harness.spelling import did_you_mean
from harness.system.units import convert, product

STEADY = 0.2
"""Last part of the time span of a run, as a fraction, that steady() evaluates."""
TOLERANCE = 1e-9
"""Tolerance in the comparison of the times of rows with an instant, relative to the largest time.
"""

LONGEST = 10_000
"""Largest number of characters of an expression."""
DIGITS = 300
"""Largest number of digits of a number in an expression; the largest double is about 1e308."""
DEEPEST = 200
"""Largest number of levels of the tree of an expression; every further term of a sum adds a level.
"""

QUANTITY = re.compile(
    r"(?<![\w.])(?P<number>(?>\d+\.?\d*|\.\d+)(?>[eE][-+]?\d+)?)\s+"
    r"(?!(?:and|or|not|if|else|in|is)\b)(?P<unit>[A-Za-z%][A-Za-z0-9./%^]*(?:-\d[A-Za-z0-9./%^]*)*)"
)
"""Regular expression of a number followed by its unit, such as `2 deg`."""


def settling_time(time: Array, error: Array, band: float) -> float:
    """Return the time [s] between the first row and the row from which on `error` (rows,) stays at
    most `band`; NaN if the last error is larger than `band`. An error of NaN counts as larger.
    """
    if np.shape(error) != np.shape(time):
        raise ValueError("settling_time(time, error, band): error is a vector; write norm(error)")
    outside = np.flatnonzero(~(error <= band))
    first_inside = outside[-1] + 1 if len(outside) else 0
    return float(time[first_inside] - time[0]) if first_inside < len(time) else float("nan")


def steady_error(time: Array, error: Array) -> float:
    """Return the largest error (rows,) in the last fifth of the time span of a run."""
    return float(np.max(error[is_steady(time)]))


def is_steady(time: Array) -> NDArray[np.bool_]:
    """Return a mask (rows,) of the rows in the last fifth of the time span of a run."""
    return np.asarray(time >= time[-1] - STEADY * (time[-1] - time[0]))


def _angle(q: Array, p: Array) -> Array:
    """Return the angle [rad] between two attitudes, unit quaternions q and p, in every row.

    The smaller of |q - p| and |q + p| is 2 sin(angle / 4), the larger is 2 cos(angle / 4). The
    angle from both is accurate near zero, unlike the arc cosine of q . p.
    """
    a, b = norm(minus(q, p)), norm(plus(q, p))
    return np.asarray(4 * np.arctan2(np.minimum(a, b), np.maximum(a, b)))


def row_at(instant: float, time: Array) -> int:
    """Return the index of the last row at or before an instant [s]; raise ValueError if the instant
    is outside the time span of the run.
    """
    slack = TOLERANCE * max(1.0, float(np.abs(time).max()))
    if not time[0] - slack <= instant <= time[-1] + slack:
        raise ValueError(
            f"at(): expected a time from {time[0]:g} to {time[-1]:g} s, got {instant:g} s"
        )
    return max(0, int(np.searchsorted(time, instant + slack, side="right")) - 1)


def _plain(unit: str) -> str | None:
    """Return the unit of exp(x) or log(x) from the unit of x: unchanged if it is "" or "1", else
    None (unknown).
    """
    return unit if unit in ("", "1") else None


def _in_degrees(unit: str) -> str | None:
    if unit in ("", "1"):
        return "deg"
    return product(unit, "deg/rad") if "rad" in unit else None


class Function(NamedTuple):
    """Function that an expression may call.

    value: implementation (for the names in ROW it returns the index of the selected row);
    arguments: names of the arguments; unit: unit of the returned value, as a text, as the index of
    the argument with the same unit, or as a function of the unit of the first argument; takes: by
    index of an argument, the unit to which the argument is converted, or the index of another
    argument to whose unit it is converted; per_row: whether the returned value in a row depends on
    the arguments in that row alone; shifts: whether the returned value in a row is the argument in
    a neighbouring row.
    """

    value: Callable[..., Any]
    arguments: tuple[str, ...] = ("x",)
    unit: int | str | Callable[[str], str | None] = 0
    takes: Mapping[int, int | str] = {}
    per_row: bool = False
    shifts: bool = False

    @property
    def reduces(self) -> bool:
        """Return whether the function reduces a time series to one row or number."""
        return not (self.per_row or self.shifts)


FUNCTIONS: dict[str, Function] = {
    "abs": Function(np.abs, per_row=True),
    "angle": Function(_angle, ("q", "p"), "rad", {1: 0}, per_row=True),
    "angle_between": Function(angle_between, ("u", "v"), "rad", per_row=True),
    "at": Function(row_at, ("x", "time"), takes={1: "s"}),
    "cos": Function(np.cos, unit="1", takes={0: "rad"}, per_row=True),
    "degrees": Function(np.degrees, unit=_in_degrees, per_row=True),
    "exp": Function(np.exp, unit=_plain, per_row=True),
    "first": Function(lambda: 0),
    "hill": Function(hill_attitude, ("r", "v"), "1", per_row=True),
    "last": Function(lambda: -1),
    "log": Function(np.log, unit=_plain, per_row=True),
    "max": Function(np.max),
    "mean": Function(np.mean),
    "min": Function(np.min),
    "mrp": Function(of_mrp, ("sigma",), "1", per_row=True),
    "next": Function(lambda x: np.concatenate((x[1:], x[-1:])), shifts=True),
    "norm": Function(norm, per_row=True),
    "orbit": Function(orbit_attitude, ("inc", "argp", "raan", "nu"), "1", per_row=True),
    "percentile": Function(np.percentile, ("x", "percent"), takes={1: "%"}),
    "previous": Function(lambda x: np.concatenate((x[:1], x[:-1])), shifts=True),
    "rms": Function(lambda x: np.sqrt(np.mean(np.square(x)))),
    "settling_time": Function(settling_time, ("time", "error", "band"), takes={2: 1}),
    "sin": Function(np.sin, unit="1", takes={0: "rad"}, per_row=True),
    "sqrt": Function(np.sqrt, unit=partial(product, "1", power=0.5), per_row=True),
    "std": Function(np.std),
    "steady": Function(steady_error, ("time", "error"), 1),
    "sum": Function(np.sum),
    "total": Function(total, per_row=True),
    "turned": Function(turned, ("q", "v"), 1, per_row=True),
}
"""Functions of expressions by name. The number of arguments must be checked, because functions of
numpy take a further argument as the array for their result.
"""
SHIFTS = [name for name, each in FUNCTIONS.items() if each.shifts]
"""Names of the functions whose value in a row comes from a neighbouring row."""
ROW = ("first", "last", "at")
"""Names of the functions that select one row of their first argument."""
WINDOWED = {"always": ("x",), "eventually": ("x",), "until": ("x", "y")}
"""Conditions over windows of time, with the names of the conditions that each takes as arguments.
Up to two times, which limit the window, may follow these arguments.
"""

IMPLIES = "implies"
"""Name of the condition implies(x, y): y must hold in the rows in which x holds."""

OPERATORS: dict[type[ast.AST], tuple[str, str]] = {
    ast.Add: ("operator", "+"), ast.Sub: ("operator", "-"), ast.Mult: ("operator", "*"),
    ast.Div: ("operator", "/"), ast.Pow: ("operator", "**"), ast.Lt: ("compare", "<"),
    ast.LtE: ("compare", "<="), ast.Gt: ("compare", ">"), ast.GtE: ("compare", ">="),
    ast.Eq: ("compare", "=="), ast.NotEq: ("compare", "!="), ast.And: ("join", "and"),
    ast.Or: ("join", "or"), ast.Not: ("not", "not"), ast.USub: ("negative", "negative"),
    ast.UAdd: ("positive", "positive"),
}  # fmt: skip
"""Kind and name of the operators that an expression may contain."""
BITWISE = (ast.BitAnd, ast.BitOr, ast.Invert)
"""Operators that are rejected, because in Python they have precedence over comparisons: `a < 1 & b
< 2` is `a < (1 & b) < 2`.
"""


@dataclass(frozen=True, eq=False)
class Node:
    """Node of the tree of an expression.

    kind: `name` (of a variable, `time`, or `parameter component.name`), `number`, `operator`,
    `compare`, `negative`, `positive`, `not`, `join` (and, or), `window`, `call`, or `pick` (element
    of a computed vector); name: name of the variable, function or operator; parts: operands or
    arguments; value: the number, the index of the element for `pick`, or begin and end [s] of a
    window; unit: unit of a number, or unit in which the number in a comparison was written; source:
    Python's syntax tree of the node.
    """

    kind: str
    name: str = ""
    parts: tuple[Node, ...] = ()
    value: Any = None
    unit: str = ""
    source: ast.expr | None = None

    @property
    def text(self) -> str:
        """Return the text of this node, with numbers, spaces and brackets as Python writes them."""
        written = ast.unparse(self.source) if self.source else self.name
        return re.sub(r"quantity\((\S+), '(\S+)'\)", r"\1 \2", written)

    def walk(self) -> Iterator[Node]:
        """Yield the node and all nodes below it."""
        yield self
        for part in self.parts:
            yield from part.walk()

    @cached_property
    def variables(self) -> tuple[str, ...]:
        """Return the names in the expression: variables, `time` and `parameter component.name`."""
        return tuple(dict.fromkeys(n.name for n in self.walk() if n.kind == "name"))

    @property
    def outputs(self) -> tuple[str, ...]:
        """Return the variables in the expression, without `time` and parameters."""
        return tuple(n for n in self.variables if n != "time" and not n.startswith("parameter "))

    @cached_property
    def is_history(self) -> bool:
        """Return whether the value is a time series: the expression depends on a variable or the
        time, and no function such as last() or max() reduces it to a single row or number.
        """
        if self.kind == "name":
            return not self.name.startswith("parameter ")
        reduces = self.kind == "call" and FUNCTIONS[self.name].reduces
        return not reduces and any(part.is_history for part in self.parts)

    # ---- conditions

    @property
    def conditions(self) -> tuple[Node, ...]:
        """Return the operands of `and`, `or`, `not`, implies() or a window, which are themselves
        conditions; () for a comparison and any other node.
        """
        return self.parts if self.kind in ("not", "join", "window") else ()

    @property
    def shown(self) -> Node:
        """Return the operand of a comparison whose worst value is reported: the left operand, or
        the right operand if the left is a number. For other nodes return the node itself.
        """
        if self.kind != "compare":
            return self
        return self.parts[1 if self.parts[0].kind == "number" else 0]

    @cached_property
    def has_window(self) -> bool:
        """Return whether the expression contains a window of time. A requirement with a window
        applies to the start of the run, not to every row.
        """
        return any(node.kind == "window" for node in self.walk())

    @cached_property
    def is_timing(self) -> bool:
        """Return whether the condition determines when other conditions apply: a condition on time
        and parameters alone, or the part `not x` of implies(x, y), which is `not x or y`.
        """
        return self.name == IMPLIES or ("time" in self.variables and not self.outputs)


def parsed(text: str, others: Sequence[str] = (), kind: str = "") -> Node:
    """Return the tree of a text; raise ValueError if the text is not an expression, or exceeds the
    limits of length, depth and digits.

    others: further names that an error message may suggest for a misspelt function; kind: word for
    these names in the message, such as `metric`.
    """
    text = normalize("NFKC", text)
    if len(text) > LONGEST:
        raise ValueError(f"expression is longer than {LONGEST} characters")
    if re.search(rf"[\d_]{{{DIGITS + 1}}}", text):
        raise ValueError(f"a number in the expression has more than {DIGITS} digits")
    if "#" in text:
        raise ValueError(f"`{text[text.index('#') :]}`: an expression cannot contain a comment (#)")
    try:
        tree = _tree(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        names = did_you_mean(text, others)
        what = f"neither a known {kind} nor" if kind else "not"
        raise ValueError(f"is {what} an expression{names}") from error
    if _depth(tree) > DEEPEST:
        raise ValueError(
            f"expression is nested too deeply (limit {DEEPEST} levels, one per term of a sum)"
        )
    for each in ast.walk(tree):
        if isinstance(getattr(each, "op", None), BITWISE):
            raise ValueError(f"`{ast.unparse(each)}`: write `and`, `or`, `not` for &, |, ~")
    return _Reader(others, kind).node(tree)


def _tree(text: str) -> ast.expr:
    """Return Python's syntax tree of a text in which a number with a unit, `2 deg`, is replaced by
    the call `quantity(2, 'deg')`.
    """
    # reject also texts such as `1if x else y`, for which Python only gives a warning
    with warnings.catch_warnings(action="error"):
        marked = QUANTITY.sub(r"quantity(\g<number>, '\g<unit>')", text)
        return ast.parse(marked, mode="eval").body


def _depth(tree: ast.AST) -> int:
    """Return the number of levels of a syntax tree, counted without recursion."""
    levels, nodes = 0, [tree]
    while nodes:
        levels += 1
        nodes = [child for node in nodes for child in ast.iter_child_nodes(node)]
    return levels - 1


Make = Callable[..., Node]
"""Constructor of Node in which the argument `source` is already set."""


class _Reader:
    """Converter of Python's syntax tree to nodes of an expression. It raises ValueError for syntax
    that an expression must not contain.
    """

    def __init__(self, others: Sequence[str], kind: str) -> None:
        self.others, self.kind = others, kind

    def node(self, given: ast.expr) -> Node:  # noqa: PLR0911 - one per kind
        """Return the node for a part of Python's syntax tree."""
        node = partial(Node, source=given)
        if path := _path_of(given):
            return node("name", self._known(path))
        match given:
            case ast.Constant(value=int() | float() as number):
                return node("number", value=_within(number))
            case ast.BoolOp(op=op, values=parts):
                return self._operation(op, parts, node)
            case ast.UnaryOp(op=op, operand=a) if type(op) in OPERATORS:
                return self._operation(op, [a], node)
            case (
                ast.BinOp(left=a, op=op, right=b) | ast.Compare(left=a, ops=[op], comparators=[b])
            ) if type(op) in OPERATORS:
                return self._operation(op, [a, b], node)
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
                return self._called(name, arguments, node)
            case ast.Subscript(value=a, slice=index):
                return self._element(a, _index_of(index), node)
        raise ValueError(f"an expression cannot contain `{ast.unparse(given)}`")

    def _operation(self, op: ast.AST, given: Sequence[ast.expr], node: Make) -> Node:
        parts = self._all(given)
        if isinstance(op, ast.USub) and parts[0].kind == "number":  # -2 deg
            return replace(node("number"), value=-parts[0].value, unit=parts[0].unit)
        return node(*OPERATORS[type(op)], parts)

    def _all(self, given: Sequence[ast.expr]) -> tuple[Node, ...]:
        return tuple(map(self.node, given))

    def _element(self, given: ast.expr, index: tuple[int, ...], node: Make) -> Node:
        """Return the node of an element: kind `name` for an element of a variable, as `a.b[1]`,
        kind `pick` for an element of a computed vector.
        """
        whole, places = self.node(given), ",".join(map(str, index))
        if whole.kind == "name":
            return node("name", f"{whole.name}[{places}]")
        if len(index) > 1 or index[0] < 1:
            raise ValueError(f"{ELEMENT}, not [{places}]")
        return node("pick", parts=(whole,), value=index[0])

    def _known(self, path: str) -> str:
        if "." in path or path == "time":
            return path
        either = f"{self.kind} or variable" if self.kind else "variable"
        names = did_you_mean(path, [*self.others, "time"])
        raise ValueError(f"there is no such {either}: {path}{names}")

    def _called(self, name: str, given: Sequence[ast.expr], node: Make) -> Node:
        match name, given:
            case "quantity", [
                ast.Constant(value=int() | float() as x),
                ast.Constant(value=str(unit)),
            ]:
                return node("number", value=float(x), unit=unit)
            case "parameter", [argument]:
                if (inner := self.node(argument)).kind != "name":
                    raise ValueError("parameter() expects component.name")
                return node("name", f"parameter {inner.name}")
        if name not in WINDOWED:
            _check_call(name, len(given))
        parts = self._all(given)
        if name == "at":
            if parts[1].is_history:
                raise ValueError(f"at(x, time): expected a time as `60 s`, got `{parts[1].text}`")
            parts += (Node("name", "time"),)
        if name in WINDOWED:
            count = len(WINDOWED[name])
            return node("window", name, parts[:count], _window(name, parts))
        if name == IMPLIES:
            return node("join", "or", (node("not", IMPLIES, parts[:1]), parts[1]))
        return node("call", name, parts)


def _within(number: float) -> float:
    if isinstance(number, int) and number > 10**DIGITS:
        raise ValueError(f"a number exceeds 1e{DIGITS}")
    return number


def _check_call(name: str, given: int) -> None:
    """Raise ValueError if a function does not exist or has another number of arguments than
    `given`.
    """
    known = {name: each.arguments for name, each in FUNCTIONS.items()} | {IMPLIES: ("x", "y")}
    if name not in known:
        raise ValueError(f"there is no function {name}{did_you_mean(name, (*known, *WINDOWED))}")
    if given != len(known[name]):
        wanted = "1 argument" if len(known[name]) == 1 else f"{len(known[name])} arguments"
        raise ValueError(f"{name}({', '.join(known[name])}): expected {wanted}, got {given}")


def _window(name: str, parts: Sequence[Node]) -> tuple[float, float]:
    """Return begin and end [s] of the window of always(), eventually() or until(), relative to the
    time of the row; raise ValueError for invalid times. A single time is the end, and the begin is
    then 0. Without times the window extends to the end of the run.
    """
    conditions = WINDOWED[name]
    head = f"{name}({', '.join(conditions)}, ...)"
    times = [_seconds(each, head) for each in parts[len(conditions) :]]
    if len(parts) < len(conditions) or len(times) > 2:
        raise ValueError(
            f"{head}: expected {' and '.join(conditions)}, then at most two times "
            "(begin and end of the window, or only the end)"
        )
    begin, end = (0.0, *times)[-2:] if times else (0.0, math.inf)
    if not 0 <= begin <= end:
        raise ValueError(
            f"{head}: expected 0 <= begin <= end, got a window of {begin:g} to {end:g} s"
        )
    return begin, end


def _seconds(node: Node, head: str) -> float:
    if node.kind != "number" or isinstance(node.value, bool):
        raise ValueError(f"{head}: expected a time as `60 s`, got `{node.text}`")
    return convert(float(node.value), node.unit or "s", "s")


def _path_of(node: ast.expr) -> str:
    """Return the dotted name, such as `guidance.los.elevation`, of nested attributes, "" for other
    nodes.
    """
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        inner = _path_of(node.value)
        return f"{inner}.{node.attr}" if inner else ""
    return ""


ELEMENT = "an index is the number of an element, counted from 1"


def _index_of(node: ast.expr) -> tuple[int, ...]:
    """Return the indices in a subscript, such as (1, 2) for [1, 2]; raise ValueError if they are
    not whole numbers.
    """
    found = []
    indices = node.elts if isinstance(node, ast.Tuple) else [node]
    for each in indices:
        if not isinstance(each, ast.Constant) or type(each.value) is not int:
            given = ", ".join(map(ast.unparse, indices))
            rows = "for a row, write first(x), last(x) or at(x, 60 s)"
            raise ValueError(f"{ELEMENT}, not [{given}]; {rows}")
        found.append(each.value)
    return tuple(found)
