# SPDX-License-Identifier: BSD-2-Clause
"""Sliders of a live page: parameters of a system by name, each with its range."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import NamedTuple

from harness.spelling import did_you_mean
from harness.system.interface import Interfaces
from harness.system.model import Range
from harness.system.values import Variable


class Slider(NamedTuple):
    """Variable that can be set before a run, and the range of its slider on a live page."""

    name: str
    variable: Variable
    low: float
    high: float


def problems(ranges: Mapping[str, Range], interfaces: Interfaces) -> Iterator[str]:
    """Yield the problems of sliders, one line each: no component has a Real parameter of this name,
    or the range is missing or invalid. ranges: by `component.parameter`.
    """
    for name, given in ranges.items():
        try:
            _slider(name, given, interfaces)
        except ValueError as error:
            yield f"{name}: {error}"


def sliders(ranges: Mapping[str, Range], interfaces: Interfaces) -> Iterator[Slider]:
    """Yield the sliders of a system, without sliders that are invalid for its FMUs. ranges: by
    `component.parameter`.
    """
    for name, given in ranges.items():
        with suppress(ValueError):
            yield _slider(name, given, interfaces)


BOUND = 1e300
"""Absolute value from which on a declared limit counts as no limit: FMUs declare the largest double
for a variable without limits.
"""


def _slider(name: str, given: Range, interfaces: Interfaces) -> Slider:
    """Return the slider of the parameter `name`; an end that `given` leaves open (None) is the
    limit in the FMU. Raise ValueError if the parameter does not exist or the range is invalid.
    """
    real = {
        f"{component}.{v.name}": v
        for component, interface in interfaces.items()
        for v in interface.settable().values()
        if v.type == "Real"
    }
    if name not in real:
        raise ValueError(f"there is no such parameter of type Real{did_you_mean(name, real)}")
    variable = real[name]
    both = (variable.low, variable.high)
    least, largest = (None if x is None or abs(x) >= BOUND else x for x in both)
    low, high = (a if a is not None else b for a, b in zip(given, (least, largest), strict=True))
    if low is None or high is None:
        raise ValueError("the FMU declares no range with both limits; give one as [least, largest]")
    if not low < high:
        raise ValueError(f"expected [least, largest], got [{low:g}, {high:g}]")
    if (least is not None and low < least) or (largest is not None and high > largest):
        raise ValueError(f"{low:g} to {high:g} exceeds the range of the FMU; give a range inside")
    return Slider(name, variable, low, high)
