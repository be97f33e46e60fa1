# SPDX-License-Identifier: BSD-2-Clause
"""Requirements as data for the page that flies: their trees, with everything that does not depend
on the rows decided here (units, windows, what stands for time). page/judge.js gives the verdicts.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from functools import partial
from typing import Any

from harness.results.evaluation import resolved, unit_in, unit_of
from harness.results.expressions import FUNCTIONS, WINDOWED, Quantity, index_of, path_of, window_of
from harness.results.margins import has_window, is_timing, parts_of, unit_of_margin
from harness.results.requirements import condition
from harness.results.result import Result
from harness.system.units import convert

Tree = dict[str, Any]
OPERATORS: dict[type[ast.AST], str] = {
    ast.Add: "+", ast.Sub: "-", ast.Mult: "*", ast.Div: "/", ast.Pow: "**", ast.BitAnd: "and",
    ast.BitOr: "or", ast.And: "and", ast.Or: "or", ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">",
    ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip
UNARY: dict[type[ast.AST], str] = {
    ast.USub: "negative", ast.UAdd: "positive", ast.Not: "not", ast.Invert: "not",
}  # fmt: skip
TRANSLATED = frozenset({
    "abs", "angle", "cos", "degrees", "exp", "first", "last", "log", "max", "mean", "min", "norm",
    "percentile", "rms", "settling_time", "sin", "sqrt", "std", "steady", "total",
})  # fmt: skip
"""Functions that page/judge.js has."""


def requirement(result: Result, name: str, text: str) -> Tree:
    """A requirement of a result for the page: name, text, tree and unit of the margin, or why it
    cannot be judged there.
    """
    told: Tree = {"name": name, "text": text}
    unit = partial(unit_in, result)
    try:
        tree = condition(text)
        margin = unit_of_margin(tree, unit)
        return told | {"tree": _Writer(unit).tree(resolved(tree, unit)), "marginUnit": margin}
    except (KeyError, ValueError) as error:
        return told | {"refused": str(error.args[0])}


class _Writer:
    def __init__(self, unit: Callable[[str], str]) -> None:
        self.unit = unit

    def tree(self, node: ast.expr) -> Tree:
        """A condition or a number."""
        found = self._plain(node)
        if isinstance(node, ast.Compare) or parts_of(node):
            found |= {"timing": is_timing(node), "windowed": has_window(node)}
        return found | self._shown(node)

    def _plain(self, node: ast.expr) -> Tree:  # noqa: PLR0911 - one per kind
        if path := path_of(node):
            return {"kind": "name", "name": path}
        match node:
            case ast.Constant(value=Quantity() as value):
                raise ValueError(f"{value:g} {value.unit}: a unit stands in a comparison only")
            case ast.Constant(value=bool() | int() | float() as value):
                return {"kind": "number", "value": _finite(value)}
            case ast.Compare(left=a, ops=[op], comparators=[b]):
                return self._operator(op, [a, b]) | {"compare": True}
            case ast.BinOp(left=a, op=op, right=b):
                return self._operator(op, [a, b])
            case ast.BoolOp(op=op, values=values):
                return self._operator(op, values)
            case ast.UnaryOp(op=op, operand=a):
                return {"kind": UNARY[type(op)], "parts": [self.tree(a)]}
            case ast.Call():
                return self._called(node)
            case ast.Subscript(value=a, slice=index):
                return {"kind": "pick", "parts": [self.tree(a)], "index": _index(index_of(index))}
        raise ValueError(f"the page has no word for `{ast.unparse(node)}`")

    def _called(self, node: ast.Call) -> Tree:
        match node:
            case ast.Call(func=ast.Name(id="parameter"), args=[argument]):
                return {"kind": "parameter", "name": path_of(argument)}
            case ast.Call(func=ast.Name(id=name)) if name in WINDOWED:
                begin, end = window_of(node)
                times = {"begin": begin, "end": _finite(end)}
                return {
                    "kind": "window",
                    "name": name,
                    "parts": self._parts(parts_of(node)),
                    **times,
                }
            case ast.Call(func=ast.Name(id=name)) if name not in TRANSLATED & FUNCTIONS.keys():
                raise ValueError(f"the page has no function {name}")
            case ast.Call(func=ast.Name(id=name), args=arguments):
                return {"kind": "call", "name": name, "parts": self._parts(arguments)}
        raise ValueError(f"the page has no word for `{ast.unparse(node)}`")

    def _operator(self, op: ast.AST, parts: list[ast.expr]) -> Tree:
        name = OPERATORS[type(op)]
        found: Tree = {"kind": "operator", "name": name, "parts": self._parts(parts)}
        return found | ({"joins": True} if name in ("and", "or") else {})

    def _parts(self, nodes: list[ast.expr]) -> list[Tree]:
        return [self.tree(node) for node in nodes]

    def _shown(self, node: ast.expr) -> Tree:
        """What is named as the worst value: side of a comparison, unit, conversion to it."""
        if not isinstance(node, ast.Compare):
            unit = unit_of(node, self.unit)
            return {"unit": unit} if unit else {}
        sides = [node.left, node.comparators[0]]
        side = 1 if isinstance(node.left, ast.Constant) else 0
        given = unit_of(sides[side], self.unit)
        units = [s.kind for s in sides if isinstance(s, ast.Constant) and s.kind]
        if not units:
            return {"shown": side, "unit": given}
        zero, one = (convert(x, given, units[0]) for x in (0.0, 1.0))
        return {"shown": side, "unit": units[0], "factor": one - zero, "offset": zero}


def _finite(value: float) -> float | None:
    """None: infinite, which JSON has no word for."""
    return None if abs(value) == float("inf") else float(value)


def _index(index: Any) -> list[Tree]:
    parts = index if isinstance(index, tuple) else (index,)
    return [
        {"s": [part.start, part.stop, part.step]} if isinstance(part, slice) else {"i": part}
        for part in parts
    ]
