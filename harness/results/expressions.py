# SPDX-License-Identifier: BSD-2-Clause
"""Expressions over the variables of a result, for metrics of campaigns and for requirements.

An expression names variables as the result does, `norm(servicer.r_SN_N - target.r_TN_N)[-1]`, and
knows the functions of FUNCTIONS and nothing else. In a comparison a number may have a unit, which
is converted to that of the other side: `guidance.beta_t <= 2 deg`.
"""

from __future__ import annotations

import ast
import math
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np

from harness.results.histories import minus, norm, plus, total
from harness.results.result import Array
from harness.spelling import did_you_mean
from harness.system.units import convert

STEADY = 0.2
"""Last part of the time in which an error is steady."""

LONGEST = 10_000
"""Characters of an expression."""
DIGITS = 300
"""Digits of a number: 1e308 is the end of the doubles."""
DEEPEST = 200
"""Levels of an expression; every further term of a sum is one."""

QUANTITY = re.compile(
    r"(?<![\w.])(?P<number>(?>\d+\.?\d*|\.\d+)(?>[eE][-+]?\d+)?)\s+"
    r"(?!(?:and|or|not|if|else|in|is)\b)(?P<unit>[A-Za-z%][A-Za-z0-9./%^]*(?:-\d[A-Za-z0-9./%^]*)*)"
)
"""A number and its unit."""


def settling_time(time: Array, error: Array, band: float) -> float:
    """Time [s] after which an error (rows,) stays within a band, which one that is no number is
    not; NaN if it never does.
    """
    outside = np.flatnonzero(~(error <= band))
    first_inside = outside[-1] + 1 if len(outside) else 0
    return float(time[first_inside] - time[0]) if first_inside < len(time) else float("nan")


def steady_error(time: Array, error: Array) -> float:
    """Largest error (rows,) in the last fifth of the time."""
    return float(np.max(error[time >= time[-1] - STEADY * (time[-1] - time[0])]))


def _angle(q: Array, p: Array) -> Array:
    """Angle between two attitudes [rad] by their unit quaternions, row by row; exact near zero: of
    q and p the shorter of difference and sum is 2 sin(angle / 4), the longer 2 cos(angle / 4).
    """
    a, b = norm(minus(q, p)), norm(plus(q, p))
    return np.asarray(4 * np.arctan2(np.minimum(a, b), np.maximum(a, b)))


class Function(NamedTuple):
    """What a function of an expression computes, the names of its arguments, and the unit of its
    value: that of an argument by its place, or one of its own.
    """

    value: Callable[..., Any]
    arguments: tuple[str, ...] = ("x",)
    unit: int | str = ""


FUNCTIONS: dict[str, Function] = {
    "abs": Function(np.abs, unit=0),
    "angle": Function(_angle, ("q", "p"), "rad"),
    "cos": Function(np.cos),
    "degrees": Function(np.degrees, unit="deg"),
    "exp": Function(np.exp),
    "first": Function(lambda x: x[0], unit=0),
    "last": Function(lambda x: x[-1], unit=0),
    "log": Function(np.log),
    "max": Function(np.max, unit=0),
    "mean": Function(np.mean, unit=0),
    "min": Function(np.min, unit=0),
    "norm": Function(norm, unit=0),
    "percentile": Function(np.percentile, ("x", "percent"), 0),
    "rms": Function(lambda x: np.sqrt(np.mean(np.square(x))), unit=0),
    "settling_time": Function(settling_time, ("time", "error", "band"), "s"),
    "sin": Function(np.sin),
    "sqrt": Function(np.sqrt),
    "std": Function(np.std, unit=0),
    "steady": Function(steady_error, ("time", "error"), 1),
    "total": Function(total, unit=0),
}
"""Functions of an expression: a further argument of one of numpy may be where it writes to."""
WINDOWED = {"always": ("x",), "eventually": ("x",), "until": ("x", "y")}
"""Conditions over windows of time, with the conditions they are made of; up to two times follow."""

IMPLIES = "implies"
"""implies(x, y): y counts in the rows in which x holds."""

OPERATORS: dict[type[ast.AST], tuple[str, str]] = {
    ast.Add: ("operator", "+"), ast.Sub: ("operator", "-"), ast.Mult: ("operator", "*"),
    ast.Div: ("operator", "/"), ast.Pow: ("operator", "**"), ast.Lt: ("compare", "<"),
    ast.LtE: ("compare", "<="), ast.Gt: ("compare", ">"), ast.GtE: ("compare", ">="),
    ast.Eq: ("compare", "=="), ast.NotEq: ("compare", "!="), ast.And: ("join", "and"),
    ast.BitAnd: ("join", "and"), ast.Or: ("join", "or"), ast.BitOr: ("join", "or"),
    ast.Not: ("not", "not"), ast.Invert: ("not", "not"), ast.USub: ("negative", "negative"),
    ast.UAdd: ("positive", "positive"),
}  # fmt: skip
"""Kind and name of the operators that an expression may hold."""


@dataclass(frozen=True, eq=False)
class Node:
    """A part of an expression, which is made of further parts.

    kind: `name` (of a variable, `time`, or `parameter component.name`), `number`, `operator`,
    `compare`, `negative`, `positive`, `not`, `join` (and, or), `window`, `call` or `pick`; name: of
    what is looked up, called or done; value: of a number, index of a pick, begin and end [s] of a
    window; unit: of a number as it was written; source: what it was made of.
    """

    kind: str
    name: str = ""
    parts: tuple[Node, ...] = ()
    value: Any = None
    unit: str = ""
    source: ast.expr | None = None

    @property
    def text(self) -> str:
        """The part as it was written."""
        written = ast.unparse(self.source) if self.source else self.name
        return re.sub(r"quantity\((\S+), '(\S+)'\)", r"\1 \2", written)

    def walk(self) -> Iterator[Node]:
        """The part itself and all that it is made of."""
        yield self
        for part in self.parts:
            yield from part.walk()

    @cached_property
    def variables(self) -> tuple[str, ...]:
        """What it looks up: variables, `time` and `parameter component.name`."""
        return tuple(dict.fromkeys(n.name for n in self.walk() if n.kind == "name"))

    # ---- of conditions

    @property
    def conditions(self) -> tuple[Node, ...]:
        """Those that a condition joins, negates or looks at over a window; none of a leaf."""
        return self.parts if self.kind in ("not", "join", "window") else ()

    @property
    def shown(self) -> Node:
        """Of a comparison what is named as the worst value: the side that is not a number."""
        if self.kind != "compare":
            return self
        return self.parts[1 if self.parts[0].kind == "number" else 0]

    @cached_property
    def has_window(self) -> bool:
        """Whether it holds at the start of the run, not in every row."""
        return any(node.kind == "window" for node in self.walk())

    @cached_property
    def is_timing(self) -> bool:
        """Whether it says when others count: a condition on time alone, beside parameters, or what
        implies() begins with.
        """
        others = [name for name in self.variables if not name.startswith("parameter ")]
        return self.name == IMPLIES or others == ["time"]


def parsed(text: str, others: Sequence[str] = (), kind: str = "") -> Node:
    """The tree of a text; ValueError if it is not an expression, or longer, deeper or with more
    digits than the limits. others: names, of such a `kind`, that the user may have meant.
    """
    if len(text) > LONGEST:
        raise ValueError(f"it is longer than {LONGEST} characters")
    if re.search(rf"[\d_]{{{DIGITS + 1}}}", text):
        raise ValueError(f"a number has more than {DIGITS} digits")
    try:
        tree = _tree(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        names = did_you_mean(text, others)
        what = f"there is no such {kind}, and " if kind else ""
        raise ValueError(f"{what}it is not an expression{names}") from error
    if _depth(tree) > DEEPEST:
        raise ValueError(f"it has more than {DEEPEST} levels, of which each term is one")
    return _Reader(others, kind).node(tree)


def _tree(text: str) -> ast.expr:
    """The text as Python reads it, a number with its unit as a call of quantity()."""
    with warnings.catch_warnings(action="error"):  # 1if: "invalid decimal literal"
        marked = QUANTITY.sub(r"quantity(\g<number>, '\g<unit>')", text)
        return ast.parse(marked, mode="eval").body


def _depth(tree: ast.AST) -> int:
    """Levels of a tree of whatever depth."""
    levels, nodes = 0, [tree]
    while nodes:
        levels += 1
        nodes = [child for node in nodes for child in ast.iter_child_nodes(node)]
    return levels - 1


Make = Callable[..., Node]
"""Node, of what was read."""


class _Reader:
    """Makes nodes of what Python has read; ValueError at whatever an expression may not hold."""

    def __init__(self, others: Sequence[str], kind: str) -> None:
        self.others, self.kind = others, kind

    def node(self, given: ast.expr) -> Node:  # noqa: PLR0911 - one per kind
        """The node of an expression."""
        node = partial(Node, source=given)
        if path := _path_of(given):
            return node("name", self._known(path))
        match given:
            case ast.Constant(value=int() | float() as number):
                return node("number", value=_within(number))
            case ast.BoolOp(op=op, values=parts):
                return self._operation(op, parts, node)
            case ast.UnaryOp(op=op, operand=a):
                return self._operation(op, [a], node)
            case (
                ast.BinOp(left=a, op=op, right=b) | ast.Compare(left=a, ops=[op], comparators=[b])
            ) if type(op) in OPERATORS:
                return self._operation(op, [a, b], node)
            case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
                return self._called(name, arguments, node)
            case ast.Subscript(value=a, slice=index):
                return node("pick", parts=self._all([a]), value=_index_of(index))
        raise ValueError(f"an expression cannot hold `{ast.unparse(given)}`")

    def _operation(self, op: ast.AST, given: Sequence[ast.expr], node: Make) -> Node:
        parts = self._all(given)
        if isinstance(op, ast.USub) and parts[0].unit:  # -2 deg
            return replace(parts[0], value=-parts[0].value)
        return node(*OPERATORS[type(op)], parts)

    def _all(self, given: Sequence[ast.expr]) -> tuple[Node, ...]:
        return tuple(map(self.node, given))

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
                if not (path := _path_of(argument)):
                    raise ValueError("parameter() expects component.name")
                return node("name", f"parameter {path}")
        if name not in WINDOWED:
            _check_call(name, len(given))
        parts = self._all(given)
        if name in WINDOWED:
            count = len(WINDOWED[name])
            return node("window", name, parts[:count], _window(name, parts))
        if name == IMPLIES:
            return node("join", "or", (node("not", IMPLIES, parts[:1]), parts[1]))
        return node("call", name, parts)


def _within(number: float) -> float:
    if isinstance(number, int) and number > 10**DIGITS:
        raise ValueError(f"there is no number beyond 1e{DIGITS}")
    return number


def _check_call(name: str, given: int) -> None:
    """ValueError if there is no such function, or with another number of arguments."""
    known = {name: each.arguments for name, each in FUNCTIONS.items()} | {IMPLIES: ("x", "y")}
    if name not in known:
        raise ValueError(f"there is no function {name}{did_you_mean(name, (*known, *WINDOWED))}")
    if given != len(known[name]):
        wanted = "1 argument" if len(known[name]) == 1 else f"{len(known[name])} arguments"
        raise ValueError(f"{name}({', '.join(known[name])}): expected {wanted}, got {given}")


def _window(name: str, parts: Sequence[Node]) -> tuple[float, float]:
    """Begin and end [s] of the window of always(), eventually() or until(), counted from the row;
    ValueError. `60 s` alone is its end; without times it goes on to the end of the run.
    """
    conditions = WINDOWED[name]
    head = f"{name}({', '.join(conditions)}, ...)"
    times = [_seconds(each, head) for each in parts[len(conditions) :]]
    if len(parts) < len(conditions) or len(times) > 2:
        raise ValueError(f"{head}: expected {' and '.join(conditions)}, then at most two times")
    begin, end = (0.0, *times)[-2:] if times else (0.0, math.inf)
    if not 0 <= begin <= end:
        raise ValueError(f"{head}: a window of {begin:g} to {end:g} s ends before it begins")
    return begin, end


def _seconds(node: Node, head: str) -> float:
    if node.kind != "number" or isinstance(node.value, bool):
        raise ValueError(f"{head}: expected a time as `60 s`, got `{node.text}`")
    return convert(float(node.value), node.unit or "s", "s")


def _path_of(node: ast.expr) -> str:
    """`guidance.los.elevation` of nested attributes, "" of anything else."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        inner = _path_of(node.value)
        return f"{inner}.{node.attr}" if inner else ""
    return ""


def _index_of(node: ast.expr) -> Any:
    """Indices and slices of numbers, counted from 0 as in numpy."""
    match node:
        case ast.Tuple(elts=elements):
            return tuple(_index_of(e) for e in elements)
        case ast.Slice(lower=a, upper=b, step=c):
            return slice(*(None if x is None else _index_of(x) for x in (a, b, c)))
        case ast.Constant(value=int(number)) if not isinstance(number, bool):
            return number
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int(number))):
            return -number
    raise ValueError(f"an index must be a whole number, not `{ast.unparse(node)}`")
