# SPDX-License-Identifier: BSD-2-Clause
"""Units of expressions over the variables of a result: check that they are compatible, and convert
the parts of an expression to common units.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import lru_cache
from typing import Any

from harness.results.expressions import FUNCTIONS, Node, parsed
from harness.results.result import Result
from harness.system.units import convert, product


def history(result: Result, path: str) -> Any:
    """Return the value of a name in an expression: `time` and `component.variable` are time series,
    `parameter component.name` is one value. Raise KeyError for an unknown name.
    """
    if path == "time":
        return result.time
    word, _, parameter = path.partition(" ")
    return result.parameter(parameter) if word == "parameter" else result[path]


# ---- units


Measured = tuple[Node, str | None]
"""Node of an expression and the unit of its value: "" for a value without a unit, None if the unit
cannot be derived from the operands, as for the square root of a length.
"""


def unit_of(node: Node, unit: Callable[[str], str]) -> str:
    """Return the unit of the value of an expression; "" if the unit is not known or units in the
    expression are incompatible. unit: function that returns the unit of a variable or parameter by
    name.
    """
    try:
        return _measured(node, unit)[1] or ""
    except ValueError:
        return ""


def resolved(node: Node, unit: Callable[[str], str]) -> Node:
    """Return the tree of an expression with conversions inserted, so that both sides of a sum or
    comparison have the same unit, and arguments of a function have the units in Function.takes.
    Raise ValueError if units are incompatible or unknown. unit: as for unit_of().

    Factors of a product or quotient are converted to one unit if they measure the same kind of
    quantity, as m and km. The node of a comparison with a number stores the unit in which the user
    wrote the number.
    """
    return _measured(node, unit)[0]


def _measured(node: Node, unit: Callable[[str], str]) -> Measured:
    """Return the tree that resolved() returns for `node`, and the unit of its value."""
    if node.kind in ("name", "number"):
        return node, unit(node.name) if node.kind == "name" else node.unit
    parts = [_measured(part, unit) for part in node.parts]
    written = ""
    if node.kind == "call":
        for place, wanted in FUNCTIONS[node.name].takes.items():
            if isinstance(wanted, int):
                parts[place] = _fitting(parts[place], parts[wanted])
            elif parts[place][1] != "1":
                parts[place] = _fitting(parts[place], (Node("number", wanted), wanted))
    elif node.kind == "compare" or node.name in ("+", "-"):
        rule = ruling(parts)
        parts = [part if part is rule else _fitting(part, rule) for part in parts]
        if node.kind == "compare":
            numbers = [part.unit for part in node.parts if part.kind == "number"]
            written = next(filter(None, numbers), "")
    elif node.name in ("*", "/") and all(unit not in ("", "1", None) for _, unit in parts):
        with suppress(ValueError):  # km to m, so that m * km is m2; m / s is not converted
            parts[1] = _fitting(parts[1], parts[0])
    made = replace(node, parts=tuple(part for part, _ in parts), unit=written)
    return made, _unit(made, [unit for _, unit in parts])


def ruling(sides: Sequence[Measured]) -> Measured:
    """Return the side of a comparison or sum to whose unit the other sides are converted: the first
    with variables and a unit, else the first with variables.
    """
    return min(sides, key=lambda side: (not side[0].variables, side[1] == ""))


def _fitting(side: Measured, rule: Measured) -> Measured:
    """Return a side of a comparison, sum or call converted to the unit of the side `rule`. A side
    without a unit stays unchanged. Raise ValueError if the units are incompatible, or a required
    unit is unknown.
    """
    part, given = side
    wanted = rule[1]
    if given == "" or (given == wanted and wanted) or (wanted == "" and part.variables):
        return side
    if not (given and wanted):
        lost = rule[0] if given else part
        if not part.variables:
            raise ValueError(
                f"{part.text}: the unit of `{lost.text}` is not known; write the number "
                "without a unit"
            )
        meeting = f"`{part.text}` cannot be converted to the unit of `{rule[0].text}`"
        raise ValueError(f"{meeting}: the unit of `{lost.text}` is not known")
    try:
        factor = convert(1.0, given, wanted)
        if part.kind == "number":
            return replace(part, value=convert(part.value, given, wanted), unit=wanted), wanted
    except ValueError as error:
        sides = f"`{part.text}` [{given}], `{rule[0].text}` [{wanted}]"
        raise ValueError(f"{sides}: {error}") from None
    scale = Node("number", value=factor, unit=product(wanted, given, -1) or "")
    made = Node("operator", "*", (scale, part), source=part.source)
    return part if factor == 1 else made, wanted


def _unit(node: Node, parts: Sequence[str | None]) -> str | None:
    """Return the unit of the value of a node from the units of its operands; None if unknown."""
    match node:
        case Node("compare" | "not" | "join" | "window"):
            return "1"
        case Node("call", name):
            own = FUNCTIONS[name].unit
            if callable(own):
                return None if parts[0] is None else own(parts[0])
            return own if isinstance(own, str) else parts[own]
        case Node("operator", "+" | "-", sides):
            return ruling(list(zip(sides, parts, strict=True)))[1]
        case Node("operator", name, sides) if any(each != "" for each in parts):
            plain = ["1" if each == "" and not side.variables else each
                     for side, each in zip(sides, parts, strict=True)]  # fmt: skip
            return _product(name, sides[1], *plain)
    return parts[0]


def _product(operation: str, second: Node, a: str | None, b: str | None) -> str | None:
    """Return the unit of a product, a quotient or a power of values in units a and b, None if it is
    unknown, "" without a unit; second: node of the second value, the exponent of a power.
    """
    if operation == "**":
        if a in ("", "1") or a is None or second.kind != "number":
            return a if a in ("", "1") else None
        return product("1", a, second.value)
    if a is None or b is None:
        return None
    return product(a, b, 1 if operation == "*" else -1) if a and b else ""


def unit_in(result: Result, path: str) -> str:
    """Return the unit of a name in an expression; "" if it is not known."""
    if path == "time":
        return "s"
    word, _, parameter = path.partition(" ")
    table, name = (result.parameters, parameter) if word == "parameter" else (result, path)
    return table.unit(name) if table is not None and name in table else ""


def fitted(result: Result, text: str) -> Node:
    """Return the tree of an expression, converted by resolved() to common units for the variables
    of a result; raise ValueError if the text is not an expression or its units do not fit. Trees
    are cached for results with equal units.
    """
    return _fitted(text, tuple(unit_in(result, path) for path in _parsed(text).variables))


_parsed = lru_cache(maxsize=256)(parsed)


@lru_cache(maxsize=256)
def _fitted(text: str, units: tuple[str, ...]) -> Node:
    tree = _parsed(text)
    return resolved(tree, dict(zip(tree.variables, units, strict=True)).__getitem__)
