# SPDX-License-Identifier: BSD-2-Clause
"""What the reader of a page may change: parameters of a system by name, each with its range."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from harness.spelling import did_you_mean
from harness.system.interface import Interface
from harness.system.model import Range
from harness.system.values import Variable


class Slider(NamedTuple):
    """A variable that can be set before a run, and the range in which a page sets it."""

    name: str
    variable: Variable
    low: float
    high: float


def problems(ranges: Mapping[str, Range], interfaces: Mapping[str, Interface]) -> Iterator[str]:
    """What is wrong with sliders, a line each: nobody has such a parameter, or it has no range."""
    for name, given in ranges.items():
        variable = _variable(name, interfaces)
        if variable is None:
            names = [f"{c}.{n}" for c, i in interfaces.items() for n in i.settable()]
            yield f"{name}: there is no such parameter{did_you_mean(name, names)}"
        elif problem := _problem(given, variable):
            yield f"{name}: {problem}"


def _problem(given: Range, variable: Variable) -> str | None:
    low, high = _range(given, variable)
    least, largest = variable.low, variable.high
    if low is None or high is None:
        return "has no range of its own, give one as [least, largest]"
    if not low < high:
        return f"{low:g} to {high:g} is no range"
    if (least is not None and low < least) or (largest is not None and high > largest):
        return f"{low:g} to {high:g} goes beyond what the FMU allows"
    return None


def sliders(ranges: Mapping[str, Range], interfaces: Mapping[str, Interface]) -> Iterator[Slider]:
    """The sliders of a system whose parameters its FMUs have: a swapped FMU may have others."""
    for name, given in ranges.items():
        variable = _variable(name, interfaces)
        low, high = (None, None) if variable is None else _range(given, variable)
        if variable is not None and low is not None and high is not None:
            yield Slider(name, variable, low, high)


def _variable(name: str, interfaces: Mapping[str, Interface]) -> Variable | None:
    component, _, variable = name.partition(".")
    interface = interfaces.get(component)
    found = None if interface is None else interface.settable().get(variable)
    return found if found is not None and found.type == "Real" else None


BOUND = 1e300
"""A limit beyond that is none."""


def _range(given: Range, variable: Variable) -> Range:
    """That of the file, else that of the FMU where it has one."""
    own = (variable.low, variable.high)
    low, high = (
        mine if mine is not None else (x if x is not None and abs(x) < BOUND else None)
        for mine, x in zip(given, own, strict=True)
    )
    return low, high
