# SPDX-License-Identifier: BSD-2-Clause
"""Expressions over the present row, compiled to Python: margins of requirements, conditions and
rewards of every step.

The numbers equal harness.results.margins up to rounding. There whole histories are
evaluated at once, which costs a millisecond for a single row; here a row costs microseconds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache, partial, reduce
from typing import Any

import numpy as np

from harness.results.evaluation import fitted, history
from harness.results.expressions import Node
from harness.results.program import evaluate
from harness.results.result import Result

Row = Callable[[Any, float], float]
"""Value from the numbers of the bus and the time [s]."""

FUNCTIONS: dict[str, Callable[[list[str]], list[str]]] = {
    "abs": lambda x: [f"abs({a})" for a in x],
    "cos": lambda x: [f"cos({a})" for a in x],
    "degrees": lambda x: [f"degrees({a})" for a in x],
    "exp": lambda x: [f"exp({a})" for a in x],
    "log": lambda x: [f"log({a})" for a in x],
    "norm": lambda x: [f"hypot({', '.join(x)})"],
    "sin": lambda x: [f"sin({a})" for a in x],
    "sqrt": lambda x: [f"sqrt({a})" for a in x],
    "total": lambda x: [f"({' + '.join(x)})"],
}
"""Functions of one argument by their elements in Python."""


class _OtherRowsError(Exception):
    """Expression whose value further rows determine; str() is its text."""


def value(result: Result, text: str) -> Row | None:
    """Return the value of an expression in a row of a result, the least element of a vector; None
    if the value does not depend on the row alone.
    """
    return _compiled(_Writer(result), fitted(result, text), margin=False)


def margin(result: Result, text: str) -> Row | None:
    """Return the margin of a requirement in a row of a result: less than 0 where it fails; None if
    it has windows or depends on further rows.
    """
    return _compiled(_Writer(result), fitted(result, text), margin=True)


def _compiled(writer: _Writer, tree: Node, margin: bool) -> Row | None:
    try:
        elements = writer.margin(tree, not tree.is_timing) if margin else writer.elements(tree)
    except _OtherRowsError:
        return None
    text = elements[0] if len(elements) == 1 else f"min({', '.join(elements)})"
    return _function(text)


@lru_cache(maxsize=256)
def _function(text: str) -> Row:
    names = {name: getattr(math, name) for name in _MATHS} | {"inf": math.inf, "nan": math.nan}
    return eval(f"lambda b, t: {text}", {**names, "angle": _angle})  # type: ignore[no-any-return]


_MATHS = ("cos", "degrees", "exp", "hypot", "log", "sin", "sqrt")


def _angle(a: float, b: float) -> float:
    """Return the angle between two attitudes from the norms of q - p and q + p [rad]."""
    return 4 * math.atan2(min(a, b), max(a, b))


class _Writer:
    """Elements of the value of a node as Python over `b`, the bus, and `t`, the time."""

    def __init__(self, result: Result) -> None:
        self._result = result

    def elements(self, node: Node) -> list[str]:  # noqa: PLR0911 - one per kind
        """Return the elements; raise _OtherRowsError if other rows determine them."""
        if all(name.startswith("parameter ") for name in node.variables):
            found = evaluate(node, partial(history, self._result))
            return [repr(x) for x in np.ravel(found).tolist()]
        match node.kind:
            case "name":
                return ["t"] if node.name == "time" else self._columns(node.name)
            case "negative" | "positive":
                sign = "-" if node.kind == "negative" else "+"
                return [f"({sign}{a})" for a in self.elements(node.parts[0])]
            case "operator":
                return self._joined(node, lambda a, b: f"({a} {node.name} {b})")
            case "pick":
                return [self.elements(node.parts[0])[node.value - 1]]
            case "call" if node.name == "angle":
                q, p = map(self.elements, node.parts)
                norms = (", ".join(_together(q, p, f"{{}} {s} {{}}".format)) for s in "-+")
                return [f"angle({', '.join(f'hypot({x})' for x in norms)})"]
            case "call" if node.name in FUNCTIONS:
                return FUNCTIONS[node.name](self.elements(node.parts[0]))
            case "compare" | "join" | "not":
                return [f"({a} > 0)" for a in self.margin(node, guarded=False, signs=True)]
        raise _OtherRowsError(node.text)

    def _columns(self, name: str) -> list[str]:
        columns = self._result.vectors.get(name)
        places = [self._result.columns.index(name)] if columns is None else columns.flat
        return [f"b[{i}]" for i in places]

    def _joined(self, node: Node, write: Callable[[str, str], str]) -> list[str]:
        """Return the elements of the parts joined one by one; a single one meets all others."""
        parts = [self.elements(part) for part in node.parts]
        return reduce(lambda a, b: _together(a, b, write), parts)

    def margin(self, node: Node, guarded: bool, signs: bool = False) -> list[str]:
        """Return the margins of the elements of a condition, or 1 where it holds and else -1;
        guarded: conditions on time state only when others apply.
        """
        if guarded and node.is_timing:
            return [f"(inf * {a})" for a in self.margin(node, guarded=False, signs=True)]
        match node.kind:
            case "compare" if signs:
                return self._joined(node, lambda a, b: f"(1 if {a} {node.name} {b} else -1)")
            case "compare":
                found = self._joined(node, lambda a, b: f"({a} - {b})")
                if node.name in ("==", "!="):
                    found = [f"abs({a})" for a in found]
                return found if node.name in (">", ">=", "!=") else [f"(-{a})" for a in found]
            case "not":
                return [f"(-{a})" for a in self.margin(node.parts[0], guarded, signs)]
            case "join":
                word = "max" if node.name == "or" else "min"
                parts = (self.margin(part, guarded, signs) for part in node.parts)
                return reduce(lambda a, b: _together(a, b, lambda x, y: f"{word}({x}, {y})"), parts)
        return [f"(1 if {a} else -1)" for a in self.elements(node)]


def _together(a: Sequence[str], b: Sequence[str], write: Callable[[str, str], str]) -> list[str]:
    if len(a) != len(b) and 1 not in (len(a), len(b)):
        raise ValueError(f"{len(a)} and {len(b)} elements cannot be joined")
    n = max(len(a), len(b))
    first, second = (list(x) * n if len(x) == 1 else list(x) for x in (a, b))
    return [write(x, y) for x, y in zip(first, second, strict=True)]
