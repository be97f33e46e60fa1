# SPDX-License-Identifier: BSD-2-Clause
"""Values and units of expressions over the variables of a result."""

from __future__ import annotations

import operator
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache, reduce
from typing import Any

import numpy as np

from harness.results.expressions import FUNCTIONS, Node, parsed
from harness.results.histories import minus, plus
from harness.results.result import Result
from harness.system.units import convert

OPERATIONS: Mapping[str, Callable[..., Any]] = {
    "+": plus, "-": minus, "*": operator.mul, "/": operator.truediv, "**": operator.pow,
    "<": operator.lt, "<=": operator.le, ">": operator.gt, ">=": operator.ge, "==": operator.eq,
    "!=": operator.ne, "and": np.logical_and, "or": np.logical_or, "not": np.logical_not,
    "implies": np.logical_not,
    "negative": operator.neg, "positive": operator.pos,
}  # fmt: skip


def evaluate(node: Node, look_up: Callable[[str], Any]) -> Any:
    """Value of an expression; look_up: value of `time`, `component.variable` or `parameter
    component.name`. ValueError where a number has a unit: resolved() first.
    """
    match node:
        case Node("name", name):
            return look_up(name)
        case Node("number", unit=""):  # 9**9**9 is infinite and not endless
            return node.value if isinstance(node.value, bool) else np.float64(node.value)
        case Node("number"):
            raise ValueError(f"{node.value:g} {node.unit}: a unit stands in a comparison only")
        case Node("window", name):
            raise ValueError(f"{name}() is a condition of a requirement, not a number")
        case Node("pick", parts=[a]) | Node("call", "last", [a]):
            return _picked(a, -1 if node.kind == "call" else node.value, look_up)
    values = [evaluate(part, look_up) for part in node.parts]
    if node.kind == "join":
        return reduce(OPERATIONS[node.name], values)
    function = FUNCTIONS[node.name].value if node.kind == "call" else OPERATIONS[node.name]
    return function(*values)


# ---- one row of what is computed row by row

ROWWISE = ("abs", "cos", "degrees", "exp", "log", "sin", "sqrt")
"""Functions of every element; norm and total are of every row."""


def _picked(node: Node, place: Any, look_up: Callable[[str], Any]) -> Any:
    """Some of an expression; of one row only that row is computed, if it knows nothing of the
    others.
    """
    if not isinstance(place, int) or not _axes(node, look_up):
        return evaluate(node, look_up)[place]

    def one(path: str) -> Any:
        found = look_up(path)
        return found if path.startswith("parameter ") else found[[place]]

    return evaluate(node, one)[0]


def _axes(node: Node, look_up: Callable[[str], Any]) -> int:
    """Axes of the value of an expression whose first one is that of the rows, and whose rows know
    nothing of each other; 0 where that is not so or is not known.
    """
    axes = [_axes(part, look_up) for part in node.parts if not _is_scalar(part, look_up)]
    match node:
        case Node("name", name) if not name.startswith("parameter "):
            return int(np.ndim(look_up(name)))
        case Node("call", "norm" | "total"):
            return max(0, sum(axes) - 1)
        case Node("call", name) if name not in ROWWISE:
            return 0
    elementwise = node.kind in ("call", "negative", "positive", "not", "operator", "compare")
    return axes[0] if elementwise and len(set(axes)) == 1 else 0


def _is_scalar(node: Node, look_up: Callable[[str], Any]) -> bool:
    """Whether a part is a number, or a parameter that is one."""
    fixed = node.kind == "name" and node.name.startswith("parameter ")
    return node.kind == "number" or (fixed and not np.ndim(look_up(node.name)))


def history(result: Result, path: str) -> Any:
    """What a name in an expression stands for in a result; KeyError."""
    if path == "time":
        return result.time
    word, _, parameter = path.partition(" ")
    return result.parameter(parameter) if word == "parameter" else result[path]


# ---- units


def unit_of(node: Node, unit: Callable[[str], str]) -> str:
    """Unit of the value of an expression, "" if it is not known; unit: that of a name."""
    match node:
        case Node("name", name):
            return unit(name)
        case Node("negative" | "positive" | "pick", parts=[a]):
            return unit_of(a, unit)
        case Node("operator", "+" | "-", [a, b]):
            return unit_of(a, unit) or unit_of(b, unit)
        case Node("operator", "*", [Node("number"), a]) | Node(
            "operator", "*" | "/", [a, Node("number")]
        ):
            return unit_of(a, unit)
        case Node("call", name, parts):
            own = FUNCTIONS[name].unit
            return own if isinstance(own, str) else unit_of(parts[own], unit)
    return ""


def resolved(node: Node, unit: Callable[[str], str]) -> Node:
    """The tree with every number with a unit in the unit of the other side of its comparison, which
    then has the unit as it was written; ValueError if they do not fit, or that unit is not known.
    """
    parts = [resolved(part, unit) for part in node.parts]
    if node.kind != "compare":
        return replace(node, parts=tuple(parts))
    given = [part.unit for part in node.parts]
    for k in (0, 1):
        if given[k]:
            parts[k] = _fitting(parts[k], node.parts[1 - k], unit)
    return replace(node, parts=tuple(parts), unit=given[0] or given[1])


def _fitting(number: Node, other: Node, unit: Callable[[str], str]) -> Node:
    """A number with a unit in the unit of what it is compared with."""
    if not (wanted := unit_of(other, unit)):
        raise ValueError(
            f"{number.value:g} {number.unit}: the unit of `{other.text}` is not known, leave it out"
        )
    return replace(number, value=convert(number.value, number.unit, wanted), unit="")


def unit_in(result: Result, path: str) -> str:
    """Unit of a name in an expression; "" if it is not known."""
    if path == "time":
        return "s"
    word, _, parameter = path.partition(" ")
    table, name = (result.parameters, parameter) if word == "parameter" else (result, path)
    return table.unit(name) if table is not None and name in table else ""


def fitted(result: Result, text: str) -> Node:
    """The resolved() tree of a text in the units of a result, made once for all that have these;
    ValueError.
    """
    return _fitted(text, tuple(unit_in(result, path) for path in _parsed(text).variables))


_parsed = lru_cache(maxsize=256)(parsed)


@lru_cache(maxsize=256)
def _fitted(text: str, units: tuple[str, ...]) -> Node:
    tree = _parsed(text)
    return resolved(tree, dict(zip(tree.variables, units, strict=True)).__getitem__)
