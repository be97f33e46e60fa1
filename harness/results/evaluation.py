# SPDX-License-Identifier: BSD-2-Clause
"""Values and units of expressions over the variables of a result."""

from __future__ import annotations

import ast
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from harness.results.expressions import (
    BINARY,
    FUNCTIONS,
    UNARY,
    WINDOWED,
    Quantity,
    index_of,
    parsed,
    path_of,
    variables,
)
from harness.results.result import Result
from harness.system.units import convert


def evaluate(node: ast.expr, look_up: Callable[[str], Any]) -> Any:  # noqa: PLR0911 - one per kind
    """Value of an expression; look_up: value of `time`, `component.variable` or `parameter
    component.name`. ValueError where a number has a unit: resolved() first.
    """
    if path := path_of(node):
        return look_up(path)
    match node:
        case ast.Constant(value=Quantity() as value):
            raise ValueError(f"{value:g} {value.unit}: a unit stands in a comparison only")
        case ast.Constant(value=bool() as value):
            return value
        case ast.Constant(value=int() | float() as value):
            return np.float64(value)  # 9**9**9 is infinite and not endless
        case ast.BinOp(left=a, op=op, right=b) | ast.Compare(left=a, ops=[op], comparators=[b]):
            return BINARY[type(op)](evaluate(a, look_up), evaluate(b, look_up))
        case ast.UnaryOp(op=op, operand=a):
            return UNARY[type(op)](evaluate(a, look_up))
        case ast.BoolOp(op=op, values=values):
            parts = [evaluate(v, look_up) for v in values]
            both = np.logical_and if isinstance(op, ast.And) else np.logical_or
            return both.reduce(parts)
        case ast.Call(func=ast.Name(id="parameter"), args=[argument]):
            return look_up(f"parameter {path_of(argument)}")
        case ast.Call(func=ast.Name(id="last"), args=[a]):
            return _picked(a, -1, look_up)
        case ast.Call(func=ast.Name(id=name)) if name in WINDOWED:
            raise ValueError(f"{name}() is a condition of a requirement, not a number")
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return FUNCTIONS[name].value(*(evaluate(a, look_up) for a in arguments))
        case ast.Subscript(value=a, slice=index):
            return _picked(a, index_of(index), look_up)
    raise AssertionError(ast.dump(node))


# ---- one row of what is computed row by row

ROWWISE = ("abs", "cos", "degrees", "exp", "log", "sin", "sqrt")
"""Functions of every element; norm and total are of every row."""


def _picked(node: ast.expr, place: Any, look_up: Callable[[str], Any]) -> Any:
    """Some of an expression; of one row only that row is computed, if it knows nothing of the
    others.
    """
    if not isinstance(place, int) or not _axes(node, look_up):
        return evaluate(node, look_up)[place]

    def one(path: str) -> Any:
        found = look_up(path)
        return found if path.startswith("parameter ") else found[[place]]

    return evaluate(node, one)[0]


def _axes(node: ast.expr, look_up: Callable[[str], Any]) -> int:
    """Axes of the value of an expression whose first one is that of the rows, and whose rows know
    nothing of each other; 0 where that is not so or is not known.
    """
    if path := path_of(node):
        return int(np.ndim(look_up(path)))
    match node:
        case ast.UnaryOp(operand=a):
            return _axes(a, look_up)
        case ast.BinOp(left=a, right=b) | ast.Compare(left=a, comparators=[b]):
            return _axes_of_both(a, b, look_up)
        case ast.Call(func=ast.Name(id=name), args=[a]) if name in ROWWISE:
            return _axes(a, look_up)
        case ast.Call(func=ast.Name(id="norm" | "total"), args=[a]):
            return max(0, _axes(a, look_up) - 1)
    return 0


def _axes_of_both(a: ast.expr, b: ast.expr, look_up: Callable[[str], Any]) -> int:
    """The same for two operands, which have as many, or one is a number or parameter with fewer."""
    fixed = [np.ndim(evaluate(part, look_up)) for part in (a, b) if _is_fixed(part)]
    axes = {_axes(part, look_up) for part in (a, b) if not _is_fixed(part)}
    most = max(axes, default=0)
    return most if len(axes) == 1 and all(each < most for each in fixed) else 0


def _is_fixed(node: ast.expr) -> bool:
    return all(name.startswith("parameter ") for name in variables(node))


def history(result: Result, path: str) -> Any:
    """What a name in an expression stands for in a result; KeyError."""
    if path == "time":
        return result.time
    word, _, parameter = path.partition(" ")
    return result.parameter(parameter) if word == "parameter" else result[path]


# ---- units

KEEPING = {
    "abs", "first", "last", "max", "mean", "min", "norm", "percentile", "rms", "std", "total",
}  # fmt: skip
"""Functions whose value has the unit of their first argument."""


UNITS = {"degrees": "deg", "angle": "rad", "settling_time": "s"}
"""Functions whose value has a unit of its own."""


def unit_of(node: ast.expr, unit: Callable[[str], str]) -> str:  # noqa: PLR0911 - one per kind
    """Unit of the value of an expression, "" if it is not known; unit: that of a name."""
    if path := path_of(node):
        return unit(path)
    match node:
        case ast.UnaryOp(operand=a) | ast.Subscript(value=a):
            return unit_of(a, unit)
        case ast.BinOp(left=a, op=ast.Add() | ast.Sub(), right=b):
            return unit_of(a, unit) or unit_of(b, unit)
        case (
            ast.BinOp(left=ast.Constant(), op=ast.Mult(), right=a)
            | ast.BinOp(left=a, op=ast.Mult() | ast.Div(), right=ast.Constant())
        ):
            return unit_of(a, unit)
        case ast.Call(func=ast.Name(id="parameter"), args=[argument]):
            return unit(f"parameter {path_of(argument)}")
        case ast.Call(func=ast.Name(id=name)) if name in UNITS:
            return UNITS[name]
        case ast.Call(func=ast.Name(id="steady"), args=[_, a]):
            return unit_of(a, unit)
        case ast.Call(func=ast.Name(id=name), args=[a, *_]) if name in KEEPING:
            return unit_of(a, unit)
    return ""


def resolved(tree: ast.expr, unit: Callable[[str], str]) -> ast.expr:
    """The tree with every number with a unit in the unit of the other side of its comparison, its
    own unit as the `kind` of the constant; ValueError if they do not fit, or that unit is not
    known.
    """
    found: ast.expr = _Resolving(unit).visit(tree)
    return found


class _Resolving(ast.NodeTransformer):
    """Not a class of each call: a class would keep the unit, and its result, until the garbage is
    collected.
    """

    def __init__(self, unit: Callable[[str], str]) -> None:
        self.unit = unit

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        a, b = node.left, node.comparators[0]
        return ast.Compare(_plain(a, b, self.unit), node.ops, [_plain(b, a, self.unit)])


def _plain(node: ast.expr, other: ast.expr, unit: Callable[[str], str]) -> ast.expr:
    sign = 1.0
    inner = node
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        sign, inner = -1.0, node.operand
    if not (isinstance(inner, ast.Constant) and isinstance(inner.value, Quantity)):
        return node
    value = inner.value
    if not (wanted := unit_of(other, unit)):
        raise ValueError(
            f"{value:g} {value.unit}: the unit of `{ast.unparse(other)}` is not known, leave it out"
        )
    return ast.Constant(sign * convert(float(value), value.unit, wanted), kind=value.unit)


def unit_in(result: Result, path: str) -> str:
    """Unit of a name in an expression; "" if it is not known."""
    if path == "time":
        return "s"
    word, _, parameter = path.partition(" ")
    table, name = (result.parameters, parameter) if word == "parameter" else (result, path)
    return table.unit(name) if table is not None and name in table else ""


Units = tuple[tuple[str, str], ...]
"""Names of an expression with their units, "" where that is not known."""


def units_in(result: Result, text: str) -> Units:
    """Of everything that an expression names; ValueError if the text is none."""
    return tuple((path, unit_in(result, path)) for path in _named(text))


@lru_cache(maxsize=256)
def _named(text: str) -> tuple[str, ...]:
    return tuple(dict.fromkeys(variables(parsed(text))))


@lru_cache(maxsize=256)
def fitted(text: str, units: Units) -> ast.expr:
    """The resolved() tree of a text, made once for all results with these units: nobody may change
    it.
    """
    known = dict(units)
    return resolved(parsed(text), lambda path: known.get(path, ""))
