# SPDX-License-Identifier: BSD-2-Clause
"""Everything that is wrong with a .fmu, by the tables of rules below."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import fmpy
from lxml import etree

from harness.errors import ArchiveError
from harness.files.archive import inspect, read_entry
from harness.files.safe_xml import UnsafeXmlError, XmlElement, parsed
from harness.rules import definitions, header, structure, variables
from harness.rules.description import TYPES, Description, Rule

FILE = "modelDescription.xml"

ERRORS: tuple[Rule, ...] = (
    header.bad_identifier,
    header.repeated_interface,
    variables.repeated_names,
    variables.empty_names,
    variables.undefined_types,
    variables.unknown_states,
    structure.unknown_indices,
    definitions.repeated_items,
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
    definitions.repeated_units,
    definitions.repeated_display_units,
    definitions.zero_factors,
    definitions.repeated_types,
    definitions.types_called_like_variables,
    definitions.equal_items,
    definitions.limits_of_types,
    definitions.undefined_units_of_types,
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
    structure.repeated_entries,
    structure.kinds_without_dependencies,
    structure.kinds_and_dependencies,
    structure.initial_kinds,
    structure.outputs,
    structure.derivatives,
    structure.initial_unknowns,
)
"""Broken, they may puzzle another tool; the FMU can be run."""


@dataclass(frozen=True)
class Verdict:
    """Errors and warnings, one line each; root: the description, None if there is none to read."""

    errors: tuple[str, ...]
    warnings: tuple[str, ...] = ()
    root: XmlElement = None


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
    description = Description(root, names)
    return Verdict(_broken(ERRORS, description), _broken(WARNINGS, description), root)


def _reason(path: Path, error: ArchiveError) -> str:
    if error.__cause__ is not None:
        return f"damaged or not a zip archive ({error.__cause__})"
    return str(error).removeprefix(f"{path}: ")


def _other_kind(root: XmlElement) -> str | None:
    """What an FMU is that is not of FMI 2.0 co-simulation."""
    version = root.get("fmiVersion", "").strip()
    if root.tag != "fmiModelDescription" or not version:
        return f"{FILE}: not the description of an FMU, fmiVersion is missing"
    only = "only FMI 2.0 co-simulation FMUs can be run"
    if version != "2.0":
        return f"{only}, this one is FMI {version}"
    if root.find("CoSimulation") is None and root.find("ModelExchange") is not None:
        return f"{only}, this one is FMI 2.0 model exchange: export it for co-simulation"
    return None


def _violations(root: XmlElement) -> tuple[str, ...]:
    """Violations of the schema of FMI 2.0; variables without a value as well."""
    schema = _schema()
    if not schema.validate(root):
        found = (f"{FILE}, line {e.line}: {' '.join(e.message.split())}" for e in schema.error_log)
        return tuple(dict.fromkeys(found))
    bare = (e for e in root.iterfind("ModelVariables/ScalarVariable"))
    return tuple(
        f"{FILE}, line {e.sourceline}: {e.get('name')} has no type"
        for e in bare
        if not any(child.tag in TYPES for child in e)
    )


@lru_cache
def _schema() -> Any:
    folder = Path(fmpy.__file__).parent / "schema" / "fmi2"
    return etree.XMLSchema(file=str(folder / "fmi2ModelDescription.xsd"))


def _broken(rules: Iterable[Rule], description: Description) -> tuple[str, ...]:
    return tuple(dict.fromkeys(line for rule in rules for line in rule(description)))
