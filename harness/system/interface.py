# SPDX-License-Identifier: BSD-2-Clause
"""Interface of an FMU: its variables and units, read from modelDescription.xml without an FMI call.
FMPy reads the units, this module reads the variables.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any

import fmpy
from fmpy import platform, platform_tuple, read_model_description, sharedLibraryExtension

from harness.conformance.check import examine
from harness.conformance.description import NUMBERS, Declared, Description, without_variables
from harness.errors import FmuError
from harness.files import cache, machine
from harness.files.archive import (
    UnsafeXmlError,
    head,
    inspect,
    parsed,
    read_entry,
    unpack,
    unpacked_size,
)
from harness.files.checksums import sha256
from harness.files.paths import Stamp, is_file, stamp
from harness.system.units import Unit
from harness.system.values import Variable

FmpyObject = Any
"""Object of FMPy's model description, whose classes have no type annotations."""

NO_NUMBERS = ("String", "Binary")
"""Types that no connection can carry."""

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad", "factor", "offset")
"""Attributes of a BaseUnit in FMI and SSP: exponents of the SI units, then factor and offset."""

OPTIONAL = (
    "ModelVariables/ScalarVariable[Annotations/Tool/OptionalInput]/@name"
    "|ModelVariables/*[Annotations/Annotation/OptionalInput]/@name"
)
"""XPath to the names of inputs that a model description (FMI 2.0 or 3.0) declares as optional. A
system may leave these inputs unconnected.
"""

MODES = "Annotations/Tool/Modes|Annotations/Annotation/Modes"
"""XPath from a variable whose values 0, 1, .. have names (a mode) to the element with the names."""


@dataclass(frozen=True)
class Interface:
    """Interface of an FMU. variables: by name, in the order of the file; units: definitions of
    units by name; model: model description as an object of FMPy; warnings: deviations from the
    standard, one line each, and the lines of left_out; size: size of the unpacked FMU [bytes];
    left_out: a line, with the reason, per variable that no system can use.
    """

    path: Path
    variables: Mapping[str, Variable]
    units: Mapping[str, Mapping[str, float]]
    model: FmpyObject
    warnings: tuple[str, ...] = ()
    size: int = 0
    left_out: tuple[str, ...] = ()

    @property
    def fmi(self) -> int:
        """Return the major version of FMI, 2 or 3."""
        return 3 if str(self.model.fmiVersion).startswith("3.") else 2

    def row(self, variable: Variable) -> tuple[Variable, ...]:
        """Return all elements, in order, of the array to which a variable belongs."""
        return self._rows[variable.reference, variable.access]

    @cached_property
    def _rows(self) -> dict[tuple[int, str], tuple[Variable, ...]]:
        found: dict[tuple[int, str], dict[int, Variable]] = {}
        for v in self.variables.values():
            # of variables that share a reference (aliases), only the first is an element
            found.setdefault((v.reference, v.access), {}).setdefault(v.element, v)
        return {key: tuple(row[k] for k in sorted(row)) for key, row in found.items()}

    def named(self, causality: str) -> Mapping[str, Variable]:
        """Return the variables of one causality (input, output, parameter, ...) by name."""
        return self._by_causality.get(causality, {})

    @cached_property
    def _by_causality(self) -> dict[str, dict[str, Variable]]:
        found: dict[str, dict[str, Variable]] = {}
        for name, variable in self.variables.items():
            found.setdefault(variable.causality, {})[name] = variable
        return found

    def unit(self, variable: Variable) -> Unit | None:
        """Return the unit of a variable, with its definition if the FMU contains one; None if the
        variable has no unit.
        """
        return None if variable.unit is None else Unit(variable.unit, self.units.get(variable.unit))

    def outputs(self) -> Mapping[str, Variable]:
        """Return the outputs that a connection can carry (numbers) by name."""
        return self._outputs

    @cached_property
    def _outputs(self) -> dict[str, Variable]:
        return {name: v for name, v in self.named("output").items() if v.type not in NO_NUMBERS}

    def settable(self) -> Mapping[str, Variable]:
        """Return the variables that may be set before initialization, by name: parameters, inputs,
        start values of states.
        """
        return self._settable

    @cached_property
    def _settable(self) -> dict[str, Variable]:
        return {name: v for name, v in self.variables.items() if v.settable}


Interfaces = Mapping[str, Interface]
"""Interfaces by the name of the component."""


def read_interface(path: Path) -> Interface:
    """Return the interface of a .fmu; raise FmuError if it is missing, damaged, invalid, or not for
    co-simulation by FMI 2.0 or FMI 3.0.
    """
    if not is_file(path):
        raise FmuError(f"{path.name}: no such FMU")
    return _read(path, stamp(path))


@lru_cache(maxsize=128)
def _read(path: Path, _: Stamp) -> Interface:
    path = path.resolve()
    try:
        key = f"{path} {sha256(path)} {fmpy.__version__}".encode()
    except OSError as error:
        raise FmuError(f"{path.name}: cannot be read ({error.strerror})") from error
    return cache.computed("interface", key, lambda: _examined(path))


def _examined(path: Path) -> Interface:
    """Return the interface of a .fmu, without a cache; raise FmuError with all problems of the
    FMU.
    """
    found = examine(path)
    if found.errors:
        raise FmuError("\n".join(f"{path.name}: {problem}" for problem in found.errors))
    assert found.description is not None
    model = _description(path, found.description)
    variables, left_out = _variables(path, found.description)
    defined = [u for u in model.unitDefinitions if u.baseUnit is not None]
    units = {u.name: {n: getattr(u.baseUnit, n) for n in BASE_UNITS} for u in defined}
    named, warnings = {v.name: v for v in variables}, (*found.warnings, *left_out)
    return Interface(path, named, units, model, warnings, unpacked_size(path), left_out)


def _description(path: Path, description: Description) -> FmpyObject:
    """Return FMPy's description of an FMU without its variables, which this module reads itself.
    FMPy reads the same bytes that passed the checks.
    """
    bare = io.BytesIO()
    with zipfile.ZipFile(bare, "w") as archive:
        archive.writestr("modelDescription.xml", without_variables(description))
    try:
        return read_model_description(bare, validate=False)
    except Exception as error:  # FMPy raises bare Exceptions
        raise FmuError(f"{path.name}: cannot be read ({' '.join(str(error).split())})") from error


def unpacked_sources(fmu: Path, folder: Path) -> list[Path]:
    """Unpack an FMU into a folder and return the C files that it lists, in the order of its list;
    [] if it lists none.

    Raises ArchiveError, and FmuError if a file that the FMU lists is not in the archive.
    """
    unpack(fmu, folder)
    place, root = folder / "sources", folder.resolve()
    name, files = "sources/buildDescription.xml", "BuildConfiguration/SourceFileSet/SourceFile"
    if name not in inspect(fmu):
        name, files = "modelDescription.xml", "CoSimulation/SourceFiles/File"
    try:
        listed = [file.get("name", "") for file in parsed(read_entry(fmu, name)).findall(files)]
    except UnsafeXmlError as error:
        raise FmuError(f"{fmu.name}: {name}: {error}") from error
    found = [(place / each).resolve() for each in listed]
    for each, path in zip(listed, found, strict=True):
        if not (path.is_relative_to(root) and is_file(path)):
            raise FmuError(f"{fmu.name}: {name} lists the source {each!r}, which the FMU lacks")
    return found


def binaries(interface: Interface) -> tuple[str, ...]:
    """Return the paths inside the archive at which FMI expects the binary for this platform: for
    FMI 2.0 the folder of FMI 2.0 and then the folder of FMI 3.0 (permitted from 2.0.5 on), for FMI
    3.0 only the folder of FMI 3.0.
    """
    file = interface.model.coSimulation.modelIdentifier + sharedLibraryExtension
    both = f"binaries/{platform}/{file}", f"binaries/{platform_tuple}/{file}"
    return both if interface.fmi == 2 else both[1:]


def binary_problem(interface: Interface) -> str | None:
    """Return why the archive contains no binary that this machine can load; None if it contains
    one.
    """
    names = inspect(interface.path)
    found = next((name for name in binaries(interface) if name in names), None)
    if found is not None:
        reason = machine.other_platform(head(interface.path, found, machine.HEAD))
        return f"{found} {reason}" if reason else None
    places = (name.split("/") for name in names if name.startswith("binaries/"))
    others = sorted({place[1] for place in places if len(place) > 2})
    shown = f", only for {', '.join(others)}" if others else f" ({binaries(interface)[0]})"
    return f"it holds no binary for this platform{shown}"


def units_agree(a: str | None, b: str | None) -> bool:
    """Return whether units a and b have the same name, or at least one is not declared (None). The
    ends of a connection without conversions must agree in this way in a `strict` system, such as
    the systems of the project, but not in files of other tools.
    """
    return a is None or b is None or a == b


# ---- variables: every element of an FMI 3.0 array is a variable, `r[2]`, `J[1,3]`, as in FMI 2.0


def _variables(path: Path, description: Description) -> tuple[list[Variable], tuple[str, ...]]:
    """Return the variables in the order of the file, and a line per clock, which is omitted;
    raise FmuError if an input or output has a clock.
    """
    found, left_out = list[Variable](), list[str]()
    optional = set(description.root.xpath(OPTIONAL))
    for v in description.variables:
        if v.type == "Clock":
            left_out.append(f"{v.name}: clocks are not supported; the variable is omitted")
            continue
        if v.clocks and v.causality in ("input", "output"):
            raise FmuError(f"{path.name}: {_clocked(description, v)}")
        elements = list(_elements(description, v, v.name in optional))
        found += elements
        for alias in v.element.iterfind("Alias"):
            found += _renamed(elements, v.name, str(alias.get("name")))
    return found, tuple(left_out)


def _clocked(description: Description, v: Declared) -> str:
    clock = description.numbered(v.clocks[0])
    assert clock is not None  # the conformance checks reject a missing clock
    return f"{clock.name}: clocks are not supported, but {v.name} has this clock"


def _renamed(elements: list[Variable], name: str, alias: str) -> Iterator[Variable]:
    """Yield the elements of a variable under its alias, as local variables."""
    for each in elements:
        called = alias + each.name.removeprefix(name)
        yield replace(each, name=called, causality="local", settable=False, optional=False)


def _elements(d: Description, v: Declared, optional: bool) -> Iterator[Variable]:
    indices, whole = d.elements(v), _whole(d, v, optional)
    starts = v.starts * len(indices) if len(v.starts) == 1 else v.starts
    for place, index in enumerate(indices):
        begin = _begin(v.type, starts[place]) if starts else None
        name = v.name + (f"[{','.join(map(str, index))}]" if index else "")
        start = float(begin) if begin is not None and v.type in NUMBERS.values() else None
        yield replace(whole, name=name, element=place, begin=begin, start=start)


def _whole(d: Description, v: Declared, optional: bool) -> Variable:
    """Return a Variable with the properties that all elements of the array `v` share; optional:
    whether the FMU declares `v` as an optional input.
    """
    items = dict(d.enumerations).get(v.type_name, [])
    is_fixed = v.variability == "constant" or v.causality in ("structuralParameter", "independent")
    has_limits = v.type in ("Real", "Integer")
    return Variable(
        v.name, v.reference, v.type, v.causality, v.all.get("unit"),
        str(v.element.get("description", "")),
        settable=bool(v.starts) and v.type != "Binary" and not is_fixed,
        items={str(item.get("name")): int(item.get("value")) for item in items},
        type_name=v.type_name, low=v.number("min") if has_limits else None,
        high=v.number("max") if has_limits else None,
        optional=v.type == "Binary" or (optional and v.causality == "input" and bool(v.starts)),
        access=v.access, size=len(d.elements(v)),
        modes="".join(str(each.get("names", "")) for each in v.element.xpath(MODES)),
    )  # fmt: skip


def _begin(kind: str, text: str) -> float | str | None:
    """Return a start value, given as text, in the type of its variable."""
    if kind == "Boolean":
        return float(text.strip() in ("true", "1"))
    if kind in ("Integer", "Enumeration"):
        return int(text)
    return float(text) if kind == "Real" else text
