# SPDX-License-Identifier: BSD-2-Clause
"""Expressions over the variables of a result, for metrics of campaigns and for requirements.

An expression names variables as the result does, `norm(servicer.r_SN_N - target.r_TN_N)[-1]`, and
knows the functions of FUNCTIONS and nothing else. In a comparison a number may have a unit, which
is converted to that of the other side: `guidance.beta_t <= 2 deg`.
"""

from __future__ import annotations

import ast
import math
import operator
import re
import warnings
from collections.abc import Callable, Sequence
from itertools import count
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
    """What a function of an expression computes, and the names of its arguments."""

    value: Callable[..., Any]
    arguments: tuple[str, ...] = ("x",)


FUNCTIONS: dict[str, Function] = {
    "abs": Function(np.abs),
    "angle": Function(_angle, ("q", "p")),
    "cos": Function(np.cos),
    "degrees": Function(np.degrees),
    "exp": Function(np.exp),
    "first": Function(lambda x: x[0]),
    "last": Function(lambda x: x[-1]),
    "log": Function(np.log),
    "max": Function(np.max),
    "mean": Function(np.mean),
    "min": Function(np.min),
    "norm": Function(norm),
    "percentile": Function(np.percentile, ("x", "percent")),
    "rms": Function(lambda x: np.sqrt(np.mean(np.square(x)))),
    "settling_time": Function(settling_time, ("time", "error", "band")),
    "sin": Function(np.sin),
    "sqrt": Function(np.sqrt),
    "std": Function(np.std),
    "steady": Function(steady_error, ("time", "error")),
    "total": Function(total),
}
"""Functions of an expression: a further argument of one of numpy may be where it writes to."""
WINDOWED = {"always": ("x",), "eventually": ("x",), "until": ("x", "y")}
"""Conditions over windows of time, with the conditions they are made of; up to two times follow."""

IMPLIES = "implies"
"""implies(x, y): y counts in the rows in which x holds."""

BINARY: dict[type[ast.AST], Callable[[Any, Any], Any]] = {
    ast.Add: plus,
    ast.Sub: minus,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.BitAnd: np.logical_and,
    ast.BitOr: np.logical_or,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}
UNARY: dict[type[ast.AST], Callable[[Any], Any]] = {
    ast.USub: operator.neg,
    ast.UAdd: operator.pos,
    ast.Invert: np.logical_not,
    ast.Not: np.logical_not,
}


def parsed(text: str, others: Sequence[str] = (), kind: str = "") -> ast.expr:
    """The tree of a text; ValueError if it is not an expression, or longer, deeper or with more
    digits than the limits. others: names, of such a `kind`, that the user may have meant.
    """
    _limit(text)
    units = [match["unit"] for match in QUANTITY.finditer(text)]
    try:
        marked = _marked(text)
    except (SyntaxError, ValueError, RecursionError, MemoryError) as error:
        names = did_you_mean(text, others)
        what = f"there is no such {kind}, and " if kind else ""
        raise ValueError(f"{what}it is not an expression{names}") from error
    if _depth(marked) > DEEPEST:
        raise ValueError(f"it has more than {DEEPEST} levels, of which each term is one")
    tree: ast.expr = _Quantities(units).visit(marked)
    _walk(tree, [], others, kind)
    return tree


def _marked(text: str) -> ast.expr:
    """The tree of a text with every number with a unit as quantity(number, place of the unit)."""
    places = count()
    marks = QUANTITY.sub(lambda match: f"quantity({match['number']}, {next(places)})", text)
    with warnings.catch_warnings(action="error"):  # 1if: "invalid decimal literal"
        return ast.parse(marks, mode="eval").body


def _limit(text: str) -> None:
    """ValueError at a text that is not worth reading."""
    if len(text) > LONGEST:
        raise ValueError(f"it is longer than {LONGEST} characters")
    if re.search(rf"[\d_]{{{DIGITS + 1}}}", text):
        raise ValueError(f"a number has more than {DIGITS} digits")


def _depth(tree: ast.AST) -> int:
    """Levels of a tree of whatever depth."""
    levels, nodes = 0, [tree]
    while nodes:
        levels += 1
        nodes = [child for node in nodes for child in ast.iter_child_nodes(node)]
    return levels - 1


class Quantity(float):
    """A number with its unit, as it was written."""

    unit: str = ""


class _Quantities(ast.NodeTransformer):
    """Numbers with units in the place of their marks."""

    def __init__(self, units: Sequence[str]) -> None:
        self.units = units

    def visit_Call(self, node: ast.Call) -> ast.AST:
        if isinstance(node.func, ast.Name) and node.func.id == IMPLIES:
            return _implication(self.generic_visit(node))
        if not (isinstance(node.func, ast.Name) and node.func.id == "quantity"):
            return self.generic_visit(node)
        match node.args:
            case [ast.Constant(value=int() | float() as number), ast.Constant(value=int(place))]:
                if place < len(self.units):
                    quantity = Quantity(number)
                    quantity.unit = self.units[place]
                    return ast.Constant(quantity)
        raise ValueError("there is no function quantity")


class Guard(ast.UnaryOp):
    """The `not` of what says in which rows another condition counts, in implies()."""


def _implication(node: ast.AST) -> ast.expr:
    """implies(A, B) as `not A or B`; ValueError unless it has two conditions."""
    match node:
        case ast.Call(args=[when, then], keywords=[]):
            return ast.BoolOp(ast.Or(), [Guard(ast.Not(), when), then])
    raise ValueError(f"{IMPLIES}(x, y): expected 2 conditions")


def variables(tree: ast.expr) -> list[str]:
    """Variables that an expression names, `time` too, and `parameter NAME`."""
    found: list[str] = []
    _walk(tree, found, (), "")
    return found


def _walk(node: ast.expr, found: list[str], others: Sequence[str], kind: str) -> None:
    """Collect variables; ValueError at whatever an expression may not hold."""
    if path := path_of(node):
        if "." not in path and path != "time":
            either = f"{kind} or variable" if kind else "variable"
            raise ValueError(
                f"there is no such {either}: {path}{did_you_mean(path, [*others, 'time'])}"
            )
        found.append(path)
        return
    if isinstance(node, ast.Call) and (inner := _parameter(node)):
        found.append(f"parameter {inner}")
    for part in _parts(node):
        _walk(part, found, others, kind)


def _parameter(node: ast.Call) -> str:
    called = isinstance(node.func, ast.Name) and node.func.id == "parameter"
    return path_of(node.args[0]) if called and len(node.args) == 1 else ""


def _parts(node: ast.expr) -> list[ast.expr]:  # noqa: PLR0911 - one per kind
    """What an expression is made of, if it may be made of that."""
    match node:
        case ast.Constant(value=int() as number) if number > 10**DIGITS:
            raise ValueError(f"there is no number beyond 1e{DIGITS}")
        case ast.Constant(value=int() | float() | bool()):
            return []
        case ast.BinOp(left=a, op=op, right=b) | ast.Compare(left=a, ops=[op], comparators=[b]) if (
            type(op) in BINARY
        ):
            return [a, b]
        case ast.UnaryOp(op=op, operand=a) if type(op) in UNARY:
            return [a]
        case ast.BoolOp(values=values):
            return values
        case ast.Call(func=ast.Name(id="parameter"), args=[argument], keywords=[]):
            if not path_of(argument):
                raise ValueError("parameter() expects component.name")
            return []
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in WINDOWED:
            window_of(node)
            return arguments[: len(WINDOWED[name])]
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]):
            _check_call(name, arguments)
            return arguments
        case ast.Subscript(value=a, slice=index):
            index_of(index)
            return [a]
    raise ValueError(f"an expression cannot hold `{ast.unparse(node)}`")


def _check_call(name: str, given: Sequence[ast.expr]) -> None:
    """ValueError if there is no such function, or with another number of arguments."""
    if name not in FUNCTIONS:
        known = (*FUNCTIONS, *WINDOWED, IMPLIES)
        raise ValueError(f"there is no function {name}{did_you_mean(name, known)}")
    wanted = FUNCTIONS[name].arguments
    if len(given) != len(wanted):
        arguments = "1 argument" if len(wanted) == 1 else f"{len(wanted)} arguments"
        raise ValueError(f"{name}({', '.join(wanted)}): expected {arguments}, got {len(given)}")


def window_of(node: ast.Call) -> tuple[float, float]:
    """Begin and end [s] of the window of always(), eventually() or until(), counted from the row;
    ValueError. `60 s` alone is its end; without times it goes on to the end of the run.
    """
    assert isinstance(node.func, ast.Name)
    conditions = WINDOWED[node.func.id]
    head = f"{node.func.id}({', '.join(conditions)}, ...)"
    times = [_seconds(each, head) for each in node.args[len(conditions) :]]
    if len(node.args) < len(conditions) or len(times) > 2:
        raise ValueError(f"{head}: expected {' and '.join(conditions)}, then at most two times")
    begin, end = (0.0, *times)[-2:] if times else (0.0, math.inf)
    if not 0 <= begin <= end:
        raise ValueError(f"{head}: a window of {begin:g} to {end:g} s ends before it begins")
    return begin, end


def _seconds(node: ast.expr, head: str) -> float:
    match node:
        case ast.Constant(value=Quantity() as time):
            return convert(float(time), time.unit, "s")
        case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
            return float(number)
    raise ValueError(f"{head}: expected a time as `60 s`, got `{ast.unparse(node)}`")


def path_of(node: ast.expr) -> str:
    """`guidance.los.elevation` of nested attributes, "" of anything else."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, ast.Attribute):
        inner = path_of(node.value)
        return f"{inner}.{node.attr}" if inner else ""
    return ""


def index_of(node: ast.expr) -> Any:
    """Indices and slices of numbers, counted from 0 as in numpy."""
    match node:
        case ast.Tuple(elts=elements):
            return tuple(index_of(e) for e in elements)
        case ast.Slice(lower=a, upper=b, step=c):
            return slice(*(None if x is None else index_of(x) for x in (a, b, c)))
        case ast.Constant(value=int(number)) if not isinstance(number, bool):
            return number
        case ast.UnaryOp(op=ast.USub(), operand=ast.Constant(value=int(number))):
            return -number
    raise ValueError(f"an index must be a whole number, not `{ast.unparse(node)}`")
