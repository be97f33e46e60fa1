# SPDX-License-Identifier: BSD-2-Clause
"""One variable of an FMU, whatever the version of FMI."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from harness.system.values import Scalar

EXACT = 2**53
"""Whole numbers up to here are the same as a double, which is what the bus carries."""


@dataclass(frozen=True)
class Variable:
    """One scalar variable, or one element of an array of FMI 3.0; unit: None if undeclared;
    settable: may be given a value before initialization.

    type: Real, Integer, Boolean, Enumeration, String or Binary; access: that of the functions of
    FMI that read and set it (Real, Float64, UInt8, ...); reference: value reference, in FMI 3.0 of
    the whole array, of which it is the element `element`, counted from 0, of `size`.

    items: values by name of an enumeration; type_name: name of its type; start: None if it has none
    or is a String; low, high: the limits declared; begin: start value of any type; optional: an
    input that keeps its start value where nobody drives it, by an annotation of its own.
    """

    name: str
    reference: int
    type: str
    causality: str
    unit: str | None
    description: str
    settable: bool
    items: Mapping[str, int] = field(default_factory=dict)
    type_name: str = ""
    start: float | None = None
    low: float | None = None
    high: float | None = None
    begin: float | str | None = None
    optional: bool = False
    access: str = ""
    element: int = 0
    size: int = 1


def resting(variable: Variable) -> Scalar:
    """The value of a variable that nobody gives one."""
    if variable.begin is not None:
        return variable.begin
    return "" if variable.type == "String" else 0


STRUCTURAL = "structuralParameter"
"""Causality of what the sizes of arrays may depend on."""


def structural_problem(variable: Variable) -> str:
    """Why a structural parameter cannot be set."""
    size = f"{variable.begin:g}" if isinstance(variable.begin, (int, float)) else variable.begin
    return f"is a structural parameter; arrays keep the size of the file ({size})"
