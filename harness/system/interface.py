# SPDX-License-Identifier: BSD-2-Clause
"""What an FMU says about itself: variables and units, read from modelDescription.xml by FMPy
without any FMI call.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

from fmpy import platform, platform_tuple, read_model_description, sharedLibraryExtension

from harness.errors import FmuError
from harness.files import machine
from harness.files.archive import head, inspect, unpacked_size
from harness.files.paths import Stamp, is_file, stamp
from harness.rules.description import readable
from harness.rules.judge import Verdict, judge
from harness.system.units import Unit

FmpyObject = Any
"""Something of FMPy's model description, which is not typed."""

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad", "factor", "offset")
"""Attributes of an FMI (and SSP) base unit: exponents of the SI units, then factor and offset."""

OPTIONAL = "ModelVariables/ScalarVariable[Annotations/Tool/OptionalInput]/@name"
"""Where a description names the inputs that a system need not drive."""


@dataclass(frozen=True)
class Variable:
    """One scalar variable; unit: None if undeclared; settable: may be given a value before
    initialization.

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


@dataclass(frozen=True)
class Interface:
    """Variables by name in the order of the file; units: base units by name; model: FMPy's
    description; warnings: what is not by the book, one line each; size: bytes when unpacked.
    """

    path: Path
    variables: Mapping[str, Variable]
    units: Mapping[str, Mapping[str, float]]
    model: FmpyObject
    warnings: tuple[str, ...] = ()
    size: int = 0

    def named(self, causality: str) -> Mapping[str, Variable]:
        """Variables of one causality (input, output, parameter, ...)."""
        return self._by_causality.get(causality, {})

    @cached_property
    def _by_causality(self) -> dict[str, dict[str, Variable]]:
        found: dict[str, dict[str, Variable]] = {}
        for name, variable in self.variables.items():
            found.setdefault(variable.causality, {})[name] = variable
        return found

    def unit(self, variable: Variable) -> Unit | None:
        """Unit of a variable with its meaning, if declared; None if there is no unit."""
        return None if variable.unit is None else Unit(variable.unit, self.units.get(variable.unit))

    def outputs(self) -> Mapping[str, Variable]:
        """Outputs that a connection can carry: all but strings."""
        return self._outputs

    @cached_property
    def _outputs(self) -> dict[str, Variable]:
        return {name: v for name, v in self.named("output").items() if v.type != "String"}

    def settable(self) -> Mapping[str, Variable]:
        """Variables that may be given a value before initialization: parameters, inputs, start
        values of states.
        """
        return self._settable

    @cached_property
    def _settable(self) -> dict[str, Variable]:
        return {name: v for name, v in self.variables.items() if v.settable}


def read_interface(path: Path) -> Interface:
    """Interface of a .fmu; FmuError if it is missing, damaged, invalid, or not FMI 2.0
    co-simulation.
    """
    if not is_file(path):
        raise FmuError(f"{path.name}: no such FMU")
    return _read(path, stamp(path))


@lru_cache(maxsize=64)
def _read(path: Path, _: Stamp) -> Interface:
    path = path.resolve()
    verdict = judge(path)
    if verdict.errors:
        raise FmuError("\n".join(f"{path.name}: {problem}" for problem in verdict.errors))
    model = _description(path, verdict)
    optional = set(verdict.root.xpath(OPTIONAL))
    variables = {v.name: _variable(v, v.name in optional) for v in model.modelVariables}
    units = {
        u.name: _base_unit(u.baseUnit) for u in model.unitDefinitions if u.baseUnit is not None
    }
    return Interface(path, variables, units, model, verdict.warnings, unpacked_size(path))


def _description(path: Path, verdict: Verdict) -> FmpyObject:
    """FMPy's reading of modelDescription.xml, from the very bytes that were judged."""
    mended = io.BytesIO()
    with zipfile.ZipFile(mended, "w") as archive:
        archive.writestr("modelDescription.xml", readable(verdict.root))
    try:
        return read_model_description(mended, validate=False)
    except Exception as error:  # FMPy raises bare Exceptions
        raise FmuError(f"{path.name}: cannot be read ({' '.join(str(error).split())})") from error


def _variable(v: FmpyObject, optional: bool) -> Variable:
    unit = v.unit if v.unit is not None or v.declaredType is None else v.declaredType.unit
    settable = v.start is not None and v.variability != "constant"
    items = v.declaredType.items if v.type == "Enumeration" and v.declaredType is not None else ()
    values = {item.name: int(item.value) for item in items}
    name = "" if v.declaredType is None else v.declaredType.name
    text = v.description or ""
    start, low, high = _start(v), _limit(v, "min"), _limit(v, "max")
    return Variable(
        v.name, v.valueReference, v.type, v.causality, unit, text, settable, values, name,
        start, low, high, v.start if v.type == "String" else start,
        optional and v.causality == "input" and start is not None,
    )  # fmt: skip


def _limit(v: FmpyObject, which: str) -> float | None:
    """The limit `min` or `max` of a variable, its own or that of its type."""
    for owner in (v, v.declaredType):
        text = getattr(owner, which, None)
        if text is not None and v.type in ("Real", "Integer"):
            return float(text)
    return None


def _start(v: FmpyObject) -> float | None:
    """Start value as the bus would carry it."""
    if v.start is None or v.type == "String":
        return None
    return {"true": 1.0, "false": 0.0}[v.start] if v.start in ("true", "false") else float(v.start)


def _base_unit(base: FmpyObject) -> dict[str, float]:
    return {name: getattr(base, name) for name in BASE_UNITS}


def binaries(interface: Interface) -> tuple[str, ...]:
    """Places inside the archive where FMI 2.0 looks for the binary of this platform (the second
    since FMI 2.0.5).
    """
    file = interface.model.coSimulation.modelIdentifier + sharedLibraryExtension
    return f"binaries/{platform}/{file}", f"binaries/{platform_tuple}/{file}"


def binary_problem(interface: Interface) -> str | None:
    """Why the archive holds nothing that can be loaded here, or None."""
    names = inspect(interface.path)
    found = next((name for name in binaries(interface) if name in names), None)
    if found is not None:
        reason = machine.foreign(head(interface.path, found, machine.HEAD))
        return f"{found} {reason}" if reason else None
    places = (name.split("/") for name in names if name.startswith("binaries/"))
    others = sorted({place[1] for place in places if len(place) > 2})
    shown = f", only for {', '.join(others)}" if others else f" ({binaries(interface)[0]})"
    return f"it holds no binary for this platform{shown}"


def units_agree(a: str | None, b: str | None) -> bool:
    """Units are equal, or one end declares none; systems of the project want that, files of other
    tools need not.
    """
    return a is None or b is None or a == b
