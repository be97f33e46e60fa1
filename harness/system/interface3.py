# SPDX-License-Identifier: BSD-2-Clause
"""Variables of an FMU of FMI 3.0 as the graph has them: every element of an array is a variable of
its own, `r[2]` or `J[1,3]`, as in FMI 2.0.
"""

from __future__ import annotations

from collections.abc import Iterator, Set
from dataclasses import replace
from pathlib import Path

from harness.errors import FmuError
from harness.rules.description3 import NUMBERS, Declared3, Description3
from harness.system.variable import Variable


def read_variables(
    path: Path, description: Description3, optional: Set[str]
) -> tuple[list[Variable], tuple[str, ...]]:
    """Variables in the order of the file, and a line for each that is left out; optional: names of
    inputs that need not be driven. FmuError if an input or output has a clock.
    """
    found: list[Variable] = []
    left_out: list[str] = []
    for v in description.variables:
        if v.type == "Clock":
            left_out.append(f"{v.name}: clocks are not supported, it is left out")
            continue
        if v.clocks and v.causality in ("input", "output"):
            clock = description.by_reference[v.clocks[0]].name
            raise FmuError(f"{path.name}: {clock}: clocks are not supported, and {v.name} has it")
        elements = list(_elements(description, v, v.name in optional))
        found += elements
        for alias in v.element.iterfind("Alias"):
            found += _renamed(elements, v.name, str(alias.get("name")))
    return found, tuple(left_out)


def _renamed(elements: list[Variable], name: str, alias: str) -> Iterator[Variable]:
    """The same variable under another name: it can be read and nothing else."""
    for each in elements:
        called = alias + each.name.removeprefix(name)
        yield replace(each, name=called, causality="local", settable=False, optional=False)


def _elements(d: Description3, v: Declared3, optional: bool) -> Iterator[Variable]:
    indices = d.elements(v)
    kind, tag = v.type, str(v.element.tag)
    items = dict(d.enumerations).get(v.element.get("declaredType"), [])
    starts = v.starts * len(indices) if len(v.starts) == 1 else v.starts
    text = str(v.element.get("description", ""))
    settable = (
        bool(starts)
        and kind != "Binary"
        and v.variability != "constant"
        and v.causality not in ("structuralParameter", "independent")
    )
    whole = Variable(
        v.name, v.reference, kind, v.causality, v.attribute("unit"), text, settable,
        {str(item.get("name")): int(item.get("value")) for item in items},
        str(v.element.get("declaredType", "")), low=v.number("min") if _has_limits(kind) else None,
        high=v.number("max") if _has_limits(kind) else None,
        optional=kind == "Binary" or (optional and v.causality == "input" and bool(starts)),
        access="Int64" if tag == "Enumeration" else tag, size=len(indices),
    )  # fmt: skip
    for place, index in enumerate(indices):
        begin = _begin(kind, starts[place]) if starts else None
        name = v.name + (f"[{','.join(map(str, index))}]" if index else "")
        start = float(begin) if begin is not None and kind in NUMBERS.values() else None
        yield replace(whole, name=name, element=place, begin=begin, start=start)


def _has_limits(kind: str) -> bool:
    return kind in ("Real", "Integer")


def _begin(kind: str, text: str) -> float | str | None:
    """A start value in the type of the variable."""
    if kind == "Boolean":
        return float(text in ("true", "1"))
    if kind in ("Integer", "Enumeration"):
        return int(text)
    return float(text) if kind == "Real" else text
