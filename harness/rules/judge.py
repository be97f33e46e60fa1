# SPDX-License-Identifier: BSD-2-Clause
"""Everything that is wrong with a .fmu: its archive, the schemas of its XML files, the rules."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import fmpy
from lxml import etree

from harness.errors import ArchiveError
from harness.files.archive import UnsafeXmlError, XmlElement, inspect, parsed, read_entry
from harness.rules.description import TYPES, Description
from harness.rules.errors import errors
from harness.rules.oddities import oddities

FILE = "modelDescription.xml"
OTHER_KINDS = {"ModelExchange": "model exchange", "ScheduledExecution": "scheduled execution"}
FURTHER = {
    "sources/buildDescription.xml": "fmi3BuildDescription",
    "terminalsAndIcons/terminalsAndIcons.xml": "fmi3TerminalsAndIcons",
}
"""Further XML files of an FMU of FMI 3.0, and their schemas."""


@dataclass(frozen=True)
class Verdict:
    """Errors and warnings, one line each; description: what was judged, None if there is none to
    read.
    """

    errors: tuple[str, ...]
    warnings: tuple[str, ...] = ()
    description: Description | None = None


def judge(path: Path) -> Verdict:
    """Verdict on an FMU; all errors and warnings at once, as far as it can be read."""
    try:
        names = inspect(path)
        root = parsed(read_entry(path, FILE))
    except ArchiveError as error:
        return Verdict((_reason(path, error),))
    except UnsafeXmlError as error:
        return Verdict((f"{FILE}: {error}",))
    if problem := _other_kind(root):
        return Verdict((problem,))
    if violations := _violations(root):
        return Verdict(violations)
    version3 = root.get("fmiVersion").startswith("3.")
    there = {name: schema for name, schema in FURTHER.items() if version3 and name in names}
    read = {name: _further(path, name, schema) for name, schema in there.items()}
    build, terminals = (read.get(name, (None, ())) for name in FURTHER)
    d = Description(root, names, build[0], terminals[0])
    return Verdict(_lines(errors(d)), _lines((*build[1], *terminals[1], *oddities(d))), d)


def _further(path: Path, name: str, schema: str) -> tuple[XmlElement, tuple[str, ...]]:
    """Root of another XML file of the archive, None if it cannot be read, and its violations."""
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
    """What an FMU is that is not for co-simulation, or of no version that can be run."""
    version = root.get("fmiVersion", "").strip()
    if root.tag != "fmiModelDescription" or not version:
        return f"{FILE}: not the description of an FMU, fmiVersion is missing"
    if version != "2.0" and not re.fullmatch(r"3\.\d+(\.\d+)?(-.+)?", version):
        return f"only FMUs of FMI 2.0 and FMI 3.0 can be run, this one is FMI {version}"
    if root.find("CoSimulation") is not None:
        return None
    for kind, name in OTHER_KINDS.items():
        if root.find(kind) is not None:
            return f"is for {name} only, co-simulation is needed"
    return None if version == "2.0" else f"{FILE}: it has no element CoSimulation"


def _violations(root: XmlElement) -> tuple[str, ...]:
    """Violations of the schema of its version; in FMI 2.0 variables without a value as well."""
    if root.get("fmiVersion").startswith("3."):
        return _schema_violations(root, "fmi3ModelDescription", FILE)
    return _schema_violations(root, "fmi2ModelDescription", FILE) or tuple(
        f"{FILE}, line {e.sourceline}: {e.get('name')} has no type"
        for e in root.iterfind("ModelVariables/ScalarVariable")
        if not any(child.tag in TYPES for child in e)
    )


def _schema_violations(root: XmlElement, name: str, file: str) -> tuple[str, ...]:
    schema = _schema(name)
    schema.validate(root)
    return _lines(f"{file}, line {e.line}: {' '.join(e.message.split())}" for e in schema.error_log)


@lru_cache
def _schema(name: str) -> Any:
    return etree.XMLSchema(
        file=str(Path(fmpy.__file__).parent / "schema" / name[:4] / f"{name}.xsd")
    )


def _lines(said: Iterable[str]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(said))
