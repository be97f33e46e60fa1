# SPDX-License-Identifier: BSD-2-Clause
"""Everything that is wrong with a .fmu, by the tables of rules below."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from inspect import isfunction
from pathlib import Path
from types import ModuleType
from typing import Any

import fmpy
from lxml import etree

from harness.errors import ArchiveError
from harness.files.archive import UnsafeXmlError, XmlElement, inspect, parsed, read_entry
from harness.rules import header, variables, version3
from harness.rules.description import TYPES, Description, Description3

FILE = "modelDescription.xml"
OTHER_KINDS = {"ModelExchange": "model exchange", "ScheduledExecution": "scheduled execution"}
BUILD, TERMINALS = "sources/buildDescription.xml", "terminalsAndIcons/terminalsAndIcons.xml"

Rule = Callable[[Any], Iterator[str]]
"""Gives one line per fault of a description."""


def _rules(*modules: ModuleType) -> tuple[Rule, ...]:
    """The rules of modules in their order: each public function is one."""
    return tuple(
        each
        for module in modules
        for name, each in vars(module).items()
        if isfunction(each) and each.__module__ == module.__name__ and not name.startswith("_")
    )


ERRORS: tuple[Rule, ...] = (
    header.bad_identifier,
    header.repeated_interface,
    variables.repeated_names,
    variables.empty_names,
    variables.undefined_types,
    variables.unknown_states,
    header.unknown_indices,
    variables.repeated_items,
)
"""Broken, they leave open what would be run."""

WARNINGS = tuple(rule for rule in _rules(header, variables) if rule not in ERRORS)
"""Broken, they may puzzle another tool; the FMU can be run."""

_ONLY_2 = {
    header.repeated_interface,
    header.bare_guid,
    header.repeated_vendor_tools,
    header.initial_kinds,
    variables.several_independent,
    variables.several_sets_in_co_simulation,
    variables.shared_references,
    variables.mixed_aliases,
}

ERRORS_3: tuple[Rule, ...] = (
    *(rule for rule in ERRORS if rule not in _ONLY_2),
    version3.independent_variable,
    version3.repeated_references,
    version3.unknown_dimensions,
    version3.impossible_sizes,
    version3.wrong_numbers_of_starts,
    version3.unknown_clocks,
    version3.repeated_alias_names,
)
"""The same for FMI 3.0."""

WARNINGS_3 = (
    *(rule for rule in WARNINGS if rule not in _ONLY_2),
    *(rule for rule in _rules(version3) if rule not in ERRORS_3),
)
"""The same for FMI 3.0."""


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
    if root.get("fmiVersion").startswith("3."):
        return _judge_3(path, names, root)
    if violations := _violations(root):
        return Verdict(violations)
    description = Description(root, names)
    return Verdict(_broken(ERRORS, description), _broken(WARNINGS, description), description)


def _judge_3(path: Path, names: tuple[str, ...], root: XmlElement) -> Verdict:
    if violations := _schema_violations(root, "fmi3ModelDescription", FILE):
        return Verdict(violations)
    build, builds = _further(path, names, BUILD, "fmi3BuildDescription")
    terminals, odd = _further(path, names, TERMINALS, "fmi3TerminalsAndIcons")
    description = Description3(root, names, build, terminals)
    errors = _broken(ERRORS_3, description)
    rest = () if errors else _broken(WARNINGS_3, description)
    return Verdict(errors, (*builds, *odd, *rest), description)


def _further(
    path: Path, names: tuple[str, ...], name: str, schema: str
) -> tuple[XmlElement, tuple[str, ...]]:
    """Root of another XML file of the archive, None if it is not there, and its violations."""
    root = None
    try:
        if name in names:
            root = parsed(read_entry(path, name))
            return root, _schema_violations(root, schema, name)
    except (ArchiveError, UnsafeXmlError) as error:
        return root, (f"{name}: {error}",)
    return None, ()


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
    """Violations of the schema of FMI 2.0; variables without a value as well."""
    if found := _schema_violations(root, "fmi2ModelDescription", FILE):
        return found
    bare = (e for e in root.iterfind("ModelVariables/ScalarVariable"))
    return tuple(
        f"{FILE}, line {e.sourceline}: {e.get('name')} has no type"
        for e in bare
        if not any(child.tag in TYPES for child in e)
    )


def _schema_violations(root: XmlElement, name: str, file: str) -> tuple[str, ...]:
    schema = _schema(name)
    if schema.validate(root):
        return ()
    found = (f"{file}, line {e.line}: {' '.join(e.message.split())}" for e in schema.error_log)
    return tuple(dict.fromkeys(found))


@lru_cache
def _schema(name: str) -> Any:
    return etree.XMLSchema(
        file=str(Path(fmpy.__file__).parent / "schema" / name[:4] / f"{name}.xsd")
    )


def _broken(rules: Iterable[Rule], description: Description) -> tuple[str, ...]:
    return tuple(dict.fromkeys(line for rule in rules for line in rule(description)))
