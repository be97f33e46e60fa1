# SPDX-License-Identifier: BSD-2-Clause
"""Requirements as data for the page that flies: their trees, with everything that does not depend
on the rows decided here (units, windows, what stands for time). page/judge.js gives the verdicts.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from harness.results.evaluation import resolved, unit_in, unit_of
from harness.results.expressions import FUNCTIONS, Node
from harness.results.margins import unit_of_margin
from harness.results.requirements import condition
from harness.results.result import Result
from harness.system.units import convert

Tree = dict[str, Any]
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
        return told | {"tree": _tree(resolved(tree, unit), unit), "marginUnit": margin}
    except (KeyError, ValueError) as error:
        return told | {"refused": str(error.args[0])}


def _tree(node: Node, unit: Callable[[str], str]) -> Tree:
    """A condition or a number."""
    parts = [_tree(part, unit) for part in node.parts]
    found: Tree = {"kind": node.kind, "name": node.name, "parts": parts}
    match node:
        case Node("name", name) if name.startswith("parameter "):
            found |= {"kind": "parameter", "name": name.partition(" ")[2]}
        case Node("number", unit=""):
            found["value"] = _finite(node.value)
        case Node("number"):
            raise ValueError(f"{node.value:g} {node.unit}: a unit stands in a comparison only")
        case Node("call", name) if name not in TRANSLATED & FUNCTIONS.keys():
            raise ValueError(f"the page has no function {name}")
        case Node("compare"):
            found |= {"kind": "operator", "compare": True}
        case Node("join"):
            found |= {"kind": "operator", "joins": True}
        case Node("window", value=(begin, end)):
            found |= {"begin": begin, "end": _finite(end)}
        case Node("pick", value=index):
            found["index"] = _index(index)
    if node.kind == "compare" or node.conditions:
        found |= {"timing": node.is_timing, "windowed": node.has_window}
    return found | _shown(node, unit)


def _shown(node: Node, unit: Callable[[str], str]) -> Tree:
    """What is named as the worst value: side of a comparison, unit, conversion to it."""
    given = unit_of(node.shown, unit)
    if node.kind != "compare":
        return {"unit": given} if given else {}
    side = {"shown": node.parts.index(node.shown), "unit": node.unit or given}
    if not node.unit:
        return side
    zero, one = (convert(x, given, node.unit) for x in (0.0, 1.0))
    return side | {"factor": one - zero, "offset": zero}


def _finite(value: float) -> float | None:
    """None: infinite, which JSON has no word for."""
    return None if abs(value) == float("inf") else float(value)


def _index(index: Any) -> list[Tree]:
    parts = index if isinstance(index, tuple) else (index,)
    return [
        {"s": [part.start, part.stop, part.step]} if isinstance(part, slice) else {"i": part}
        for part in parts
    ]
