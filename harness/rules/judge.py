# SPDX-License-Identifier: BSD-2-Clause
"""Everything that is wrong with a .fmu, by the tables of rules below."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import fmpy
from lxml import etree

from harness.errors import ArchiveError
from harness.files.archive import UnsafeXmlError, XmlElement, inspect, parsed, read_entry
from harness.rules import header, variables, version3
from harness.rules.description import TYPES, Description, Description3, Rule

FILE = "modelDescription.xml"
BUILD, TERMINALS = "sources/buildDescription.xml", "terminalsAndIcons/terminalsAndIcons.xml"

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

WARNINGS: tuple[Rule, ...] = (
    header.stray_files,
    header.missing_sources,
    header.odd_identifier,
    header.empty_name,
    header.empty_guid,
    header.bare_guid,
    header.stop_before_start,
    header.step_not_positive,
    header.tolerance_not_positive,
    header.time_not_finite,
    header.repeated_log_categories,
    header.repeated_vendor_tools,
    variables.repeated_units,
    variables.repeated_display_units,
    variables.zero_factors,
    variables.repeated_types,
    variables.types_called_like_variables,
    variables.equal_items,
    variables.limits_of_types,
    variables.undefined_units_of_types,
    variables.other_types,
    variables.derivatives_not_continuous,
    variables.unstructured_names,
    variables.discrete_kinds,
    variables.impossible_causalities,
    variables.initials_that_are_not_given,
    variables.impossible_initials,
    variables.missing_starts,
    variables.starts_of_calculated,
    variables.starts_of_independent,
    variables.several_independent,
    variables.independent_not_real,
    variables.limits_crossed,
    variables.starts_outside,
    variables.starts_that_are_no_item,
    variables.starts_not_finite,
    variables.zero_nominals,
    variables.undefined_units,
    variables.undefined_display_units,
    variables.reinit_in_co_simulation,
    variables.several_sets_in_co_simulation,
    variables.shared_references,
    variables.mixed_aliases,
    header.repeated_entries,
    header.kinds_without_dependencies,
    header.kinds_and_dependencies,
    header.initial_kinds,
    header.outputs,
    header.derivatives,
    header.initial_unknowns,
)
"""Broken, they may puzzle another tool; the FMU can be run."""

ERRORS_3: tuple[Callable[[Description3], Iterator[str]], ...] = (
    header.bad_identifier,
    variables.repeated_names,
    variables.empty_names,
    variables.undefined_types,
    variables.unknown_states,
    header.unknown_indices,
    variables.repeated_items,
    version3.independent_variable,
    version3.repeated_references,
    version3.unknown_dimensions,
    version3.impossible_sizes,
    version3.wrong_numbers_of_starts,
    version3.unknown_clocks,
    version3.repeated_alias_names,
)
"""The same for FMI 3.0."""

_ONLY_2 = {
    header.bare_guid,
    header.repeated_vendor_tools,
    variables.several_independent,
    variables.several_sets_in_co_simulation,
    variables.shared_references,
    variables.mixed_aliases,
    header.initial_kinds,
}

WARNINGS_3: tuple[Callable[[Description3], Iterator[str]], ...] = (
    *(rule for rule in WARNINGS if rule not in _ONLY_2),
    version3.clocks_that_are_none,
    version3.clocks_as_unknowns,
    version3.repeated_annotations,
    version3.unknown_previous,
    version3.missing_build_description,
    version3.repeated_sources,
    version3.options_without_compiler,
    version3.other_identifiers_of_builds,
    version3.empty_terminals,
    version3.terminal_members,
    version3.repeated_terminals,
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
    warnings: list[str] = []
    others: list[XmlElement] = []
    for name, schema in ((BUILD, "fmi3BuildDescription"), (TERMINALS, "fmi3TerminalsAndIcons")):
        others.append(None)
        if name in names:
            try:
                others[-1] = parsed(read_entry(path, name))
                warnings += _schema_violations(others[-1], schema, name)
            except (ArchiveError, UnsafeXmlError) as error:
                warnings.append(f"{name}: {error}")
    description = Description3(root, names, *others)
    errors = _broken(ERRORS_3, description)
    if errors:
        return Verdict(errors, tuple(warnings), description)
    return Verdict((), (*warnings, *_broken(WARNINGS_3, description)), description)


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
    for kind, name in (
        ("ModelExchange", "model exchange"),
        ("ScheduledExecution", "scheduled execution"),
    ):
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


def _broken(
    rules: Iterable[Callable[[Any], Iterator[str]]], description: Description
) -> tuple[str, ...]:
    return tuple(dict.fromkeys(line for rule in rules for line in rule(description)))
