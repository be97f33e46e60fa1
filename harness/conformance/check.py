# SPDX-License-Identifier: BSD-2-Clause
"""Check of a .fmu: its archive, its XML files against their schemas, and the rules of the standard
that an FMU must follow to be run (FMI 2.0, section 2.2; FMI 3.0, section 2.4).

The description of an FMU that breaks one of these rules is ambiguous, so the FMU is rejected. Other
deviations from the standard are warnings (harness.conformance.deviations).
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Any

import fmpy
from lxml import etree

from harness.conformance.description import TYPES, Declared, Description, repeated, twice
from harness.conformance.deviations import deviations
from harness.errors import ArchiveError
from harness.files.archive import UnsafeXmlError, XmlElement, inspect, parsed, read_entry
from harness.spelling import some

FILE = "modelDescription.xml"
OTHER_KINDS = {"ModelExchange": "model exchange", "ScheduledExecution": "scheduled execution"}
FURTHER = {
    "sources/buildDescription.xml": "fmi3BuildDescription",
    "terminalsAndIcons/terminalsAndIcons.xml": "fmi3TerminalsAndIcons",
}
"""Schemas of the further XML files of an FMU of FMI 3.0, by path in the archive."""


@dataclass(frozen=True)
class Findings:
    """Errors and warnings of an FMU, one line each, and its description (None: not examined)."""

    errors: tuple[str, ...]
    warnings: tuple[str, ...] = ()
    description: Description | None = None


def examine(path: Path) -> Findings:
    """Return all errors and warnings of an FMU, as far as it can be read."""
    try:
        names = inspect(path)
        root = parsed(read_entry(path, FILE))
    except ArchiveError as error:
        return Findings((_reason(path, error),))
    except UnsafeXmlError as error:
        return Findings((f"{FILE}: {error}",))
    if problem := _other_kind(root):
        return Findings((problem,))
    if violations := _violations(root):
        return Findings(violations)
    version3 = root.get("fmiVersion").startswith("3.")
    present = {name: schema for name, schema in FURTHER.items() if version3 and name in names}
    read = {name: _further(path, name, schema) for name, schema in present.items()}
    build, terminals = (read.get(name, (None, ())) for name in FURTHER)
    d = Description(root, names, build[0], terminals[0])
    return Findings(_lines(errors(d)), _lines((*build[1], *terminals[1], *deviations(d))), d)


def _further(path: Path, name: str, schema: str) -> tuple[XmlElement, tuple[str, ...]]:
    """Return the root of the further XML file `name` of an FMU (None: unreadable), and one line for
    each violation of its schema, or the reason why it is unreadable.
    """
    try:
        root = parsed(read_entry(path, name))
    except (ArchiveError, UnsafeXmlError) as error:
        return None, (f"{name}: {error}",)
    return root, _schema_violations(root, schema, name)


def _reason(path: Path, error: ArchiveError) -> str:
    if error.__cause__ is not None:
        return f"damaged or not a zip archive ({error.__cause__})"
    return str(error).removeprefix(f"{path}: ")


def _other_kind(root: XmlElement) -> str | None:
    """Return why an FMU is not a co-simulation FMU of a supported version; None if it is."""
    version = root.get("fmiVersion", "").strip()
    if root.tag != "fmiModelDescription" or not version:
        return f"{FILE}: is no fmiModelDescription, or fmiVersion is missing"
    if version != "2.0" and not re.fullmatch(r"3\.\d+(\.\d+)?(-.+)?", version):
        return f"FMI {version} is not supported; use an FMU of FMI 2.0 or FMI 3.0"
    if root.find("CoSimulation") is not None:
        return None
    for kind, name in OTHER_KINDS.items():
        if root.find(kind) is not None:
            return f"supports {name} only; export it for co-simulation"
    return None if version == "2.0" else f"{FILE}: element CoSimulation is missing"


def _violations(root: XmlElement) -> tuple[str, ...]:
    """Return the violations of the schema for the FMI version of a description, one line each; in
    FMI 2.0 also variables without a type, which the schema permits.
    """
    if root.get("fmiVersion").startswith("3."):
        return _schema_violations(root, "fmi3ModelDescription", FILE)
    return _schema_violations(root, "fmi2ModelDescription", FILE) or tuple(
        f"{FILE}, line {e.sourceline}: {e.get('name')} has no type"
        for e in root.iterfind("ModelVariables/ScalarVariable")
        if not any(child.tag in TYPES for child in e)
    )


def _schema_violations(root: XmlElement, name: str, file: str) -> tuple[str, ...]:
    schema = fmpy_schema("schema", name[:4], f"{name}.xsd")
    schema.validate(root)
    return _lines(f"{file}, line {e.line}: {' '.join(e.message.split())}" for e in schema.error_log)


@lru_cache
def fmpy_schema(*place: str) -> Any:
    """Return a schema of FMI or SSP from FMPy; place: its path inside the package, part by part."""
    return etree.XMLSchema(file=str(Path(fmpy.__file__).parent.joinpath(*place)))


def _lines(texts: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(texts))


# ---- rules


MOST = 10**6
"""Largest number of elements of one array; a larger one is rejected as a mistake."""


def errors(d: Description) -> Iterator[str]:
    """Yield an error message for every broken rule of a description that prevents the FMU from
    being run.
    """
    return chain(_interfaces(d), _names(d), _definitions(d), _arrays(d), _identities(d))


def _interfaces(d: Description) -> Iterator[str]:
    """Check that the library of each interface has a name that is no path, and that each kind of
    interface (such as CoSimulation) occurs once.
    """
    for name in d.identifiers:
        if not name or set(name) & set("/\\:\0") or name in (".", ".."):
            yield f"modelIdentifier '{name}' is not the name of a library (without a path)"
    for kind in twice(e.tag for e in d.root if "modelIdentifier" in e.attrib):
        yield f"element {kind} is given twice"


def _names(d: Description) -> Iterator[str]:
    """Check that variables, their aliases and the items of each enumeration have unique names."""
    aliases = [e.get("name") for e in d.every("ModelVariables/*/Alias")]
    for name in twice((*(v.name for v in d.variables), *aliases)):
        yield f"{name}: two variables have this name"
    for v in d.variables:
        if not v.name.strip():
            yield f"line {v.element.sourceline}: a variable has no name"
    yield from repeated(d.root, {"TypeDefinitions//Item": "name"})


def _definitions(d: Description) -> Iterator[str]:
    """Check that the types of variables exist, and the variables to which the attributes derivative
    and clocks and the model structure refer.
    """
    for v in d.variables:
        if v.type_name and v.type_name not in d.types:
            yield f"{v}: its type {v.type_name} is not defined"
        for number in (*([] if v.derivative is None else [v.derivative]), *v.clocks):
            if d.numbered(number) is None:
                yield f"{v}: attribute derivative or clocks: variable {number} does not exist"
    for kind, e, number in d.entries():
        for each in (number, *map(int, e.get("dependencies", "").split())):
            if d.numbered(each) is None:
                place = f"ModelStructure/{kind} (line {e.sourceline})"
                yield f"{place}: variable {each} does not exist"


def _arrays(d: Description) -> Iterator[str]:
    """Check that the size of every array is a number or a structural parameter, from 1 to MOST, and
    that the array has one start value per element, one for all elements, or none.
    """
    for v in d.variables:
        yield from (f"{v}: {text}" for text in _array(d, v))


def _array(d: Description, v: Declared) -> Iterator[str]:
    for e in v.element.iterfind("Dimension"):
        if ("start" in e.attrib) == ("valueReference" in e.attrib):
            yield "a Dimension needs a start or a valueReference, and not both"
    count, given = d.count(v), len(v.starts)
    if count is None:
        yield "its size must be a number or a structural parameter with one start value"
    elif not 0 < count <= MOST:
        yield f"has {count} elements, expected 1 to {MOST}"
    elif given not in (0, 1, count) and v.type != "Clock":
        yield f"has {count} elements and {given} start values"


def _identities(d: Description) -> Iterator[str]:
    """Check that an FMU of FMI 3.0 has one independent variable and unique value references."""
    if d.fmi != 3:
        return
    times = [v.name for v in d.variables if v.causality == "independent"]
    if len(times) != 1:
        yield f"expected one independent variable (usually time), got {some(times) or 'none'}"
    for group in d.aliases():
        yield f"{some([v.name for v in group])}: share the value reference {group[0].reference}"
