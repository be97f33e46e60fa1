# SPDX-License-Identifier: BSD-2-Clause
"""Definitions of units and types (FMI 2.0, 2.2.2 and 2.2.3)."""

from __future__ import annotations

from collections.abc import Iterator

from harness.rules.description import Description, twice


def repeated_units(d: Description) -> Iterator[str]:
    """Units have names of their own."""
    names = [e.get("name") for e in d.all("UnitDefinitions/Unit")]
    yield from (f"the unit {name} is defined twice" for name in twice(names))


def repeated_display_units(d: Description) -> Iterator[str]:
    """Display units of one unit have names of their own."""
    for unit in d.all("UnitDefinitions/Unit"):
        names = [e.get("name") for e in unit.iterfind("DisplayUnit")]
        for name in twice(names):
            yield f"the display unit {name} of {unit.get('name')} is defined twice"


def zero_factors(d: Description) -> Iterator[str]:
    """Factors of units are not zero, since one divides by them."""
    for path in ("UnitDefinitions/Unit/BaseUnit", "UnitDefinitions/Unit/DisplayUnit"):
        for e in d.all(path):
            if float(e.get("factor", "1")) == 0:
                yield f"the unit {e.getparent().get('name')} (line {e.sourceline}) has the factor 0"


def repeated_types(d: Description) -> Iterator[str]:
    """Types have names of their own."""
    yield from (f"the type {name} is defined twice" for name in twice(d.type_names))


def types_called_like_variables(d: Description) -> Iterator[str]:
    """No variable has the name of a type."""
    for variable in d.variables:
        if variable.name in d.types:
            yield f"{variable}: has the name of a type"


def repeated_items(d: Description) -> Iterator[str]:
    """Items of an enumeration have names of their own."""
    for name, items in d.enumerations:
        for item in twice(e.get("name") for e in items):
            yield f"the type {name}: the item {item} is listed twice"


def equal_items(d: Description) -> Iterator[str]:
    """Items of an enumeration have values of their own."""
    for name, items in d.enumerations:
        for value in twice(int(e.get("value")) for e in items):
            yield f"the type {name}: two items have the value {value}"


def limits_of_types(d: Description) -> Iterator[str]:
    """The least value of a type does not exceed its largest."""
    for name, e in d.types.items():
        if "min" in e.attrib and "max" in e.attrib and float(e.get("min")) > float(e.get("max")):
            yield f"the type {name}: min {e.get('min')} exceeds max {e.get('max')}"


def undefined_units_of_types(d: Description) -> Iterator[str]:
    """The unit of a type is defined."""
    for name, e in d.types.items():
        if e.get("unit") is not None and e.get("unit") not in d.units:
            yield f"the type {name}: its unit {e.get('unit')} is not defined"
