# SPDX-License-Identifier: BSD-2-Clause
"""Scalar variables: names, causalities, start values, limits, aliases (FMI 2.0, 2.2.7 to 2.2.9),
and the definitions of their units and types (2.2.2 and 2.2.3).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import groupby

from harness.rules.description import Declared, Description, twice
from harness.spelling import some

_WORD = r"(?:[A-Za-z_]\w*|'(?:[^'\\]|\\.)+')"
_ARRAY = r"(?:\[\d+(?:,\d+)*\])?"
_PLAIN = rf"{_WORD}{_ARRAY}(?:\.{_WORD}{_ARRAY})*"
_STRUCTURED = re.compile(rf"{_PLAIN}|der\({_PLAIN}(?:,\d+)?\)", re.ASCII)


def repeated_names(d: Description) -> Iterator[str]:
    """Variables have names of their own."""
    for name in twice(v.name for v in d.variables):
        yield f"{name}: there are two variables of this name"


def undefined_types(d: Description) -> Iterator[str]:
    """The type of a variable is defined."""
    for v in d.variables:
        if v.value.get("declaredType") is not None and v.definition is None:
            yield f"{v}: its type {v.value.get('declaredType')} is not defined"


def other_types(d: Description) -> Iterator[str]:
    """A variable is of the kind of its type."""
    for v in d.variables:
        kind = None if v.definition is None else str(v.definition.tag).removesuffix("Type")
        if kind is not None and kind != v.value.tag:
            yield f"{v}: is {v.value.tag}, but its type is {kind}"


def unknown_states(d: Description) -> Iterator[str]:
    """A derivative names a variable by its number."""
    for v in d.variables:
        if v.derivative is not None and d.numbered(v.derivative) is None:
            yield f"{v}: is the derivative of variable {v.derivative}, which does not exist"


def derivatives_not_continuous(d: Description) -> Iterator[str]:
    """Derivatives are continuous, and those of continuous variables."""
    for v in d.variables:
        state = None if v.derivative is None else d.numbered(v.derivative)
        if state is None:
            continue
        if any(e.type != "Real" or e.variability != "continuous" for e in (v, state)):
            yield f"{v}: is the derivative of {state.name}, but not both are continuous"


def unstructured_names(d: Description) -> Iterator[str]:
    """Names follow the convention that the FMU declares."""
    structured = d.root.get("variableNamingConvention") == "structured"
    for v in d.variables:
        if structured and not _STRUCTURED.fullmatch(v.name):
            yield f"{v}: does not follow the naming convention 'structured'"
        elif not structured and set(v.name) & set("\r\n\t"):
            yield f"{v}: holds a line break or tab"


def empty_names(d: Description) -> Iterator[str]:
    """Variables have names."""
    for v in d.variables:
        if not v.name.strip():
            yield f"line {v.element.sourceline}: a variable has no name"


def discrete_kinds(d: Description) -> Iterator[str]:
    """Only Reals are continuous."""
    for v in d.variables:
        if v.type != "Real" and v.variability == "continuous":
            yield f"{v}: is {v.type}, which cannot be continuous"


def impossible_causalities(d: Description) -> Iterator[str]:
    """Causality and variability fit each other."""
    for v in d.variables:
        if v.default is None:
            yield f"{v}: a {v.causality} cannot be {v.variability}"


def initials_that_are_not_given(d: Description) -> Iterator[str]:
    """Inputs and the independent variable say nothing of their start value."""
    for v in d.variables:
        if v.causality in v.WITHOUT_INITIAL and v.element.get("initial") is not None:
            yield f"{v}: an {v.causality} must not have initial='{v.initial}'"


def impossible_initials(d: Description) -> Iterator[str]:
    """Constants and parameters start exactly, calculated ones do not."""
    for v in d.variables:
        if v.element.get("initial") is None or v.causality in ("input", "independent"):
            continue
        exactly = v.causality in ("parameter", "structuralParameter") or v.variability == "constant"
        never = v.causality == "calculatedParameter" or (
            v.causality == "local" and v.variability in ("fixed", "tunable")
        )
        if (exactly and v.initial != "exact") or (never and v.initial == "exact"):
            yield f"{v}: a {v.variability} {v.causality} cannot have initial='{v.initial}'"


def missing_starts(d: Description) -> Iterator[str]:
    """What starts exactly or approximately has a start value."""
    for v in d.variables:
        wanted = v.needs_start or v.initial in ("exact", "approx")
        if wanted and v.start is None:
            yield f"{v}: has no start value"


def starts_of_calculated(d: Description) -> Iterator[str]:
    """What is calculated has no start value."""
    for v in d.variables:
        if v.start is not None and v.initial == "calculated":
            yield f"{v}: is calculated, but has a start value"


def starts_of_independent(d: Description) -> Iterator[str]:
    """The independent variable has no start value."""
    for v in d.variables:
        if v.start is not None and v.causality == "independent":
            yield f"{v}: is the independent variable, but has a start value"


def several_independent(d: Description) -> Iterator[str]:
    """There is at most one independent variable."""
    found = [v.name for v in d.variables if v.causality == "independent"]
    if len(found) > 1:
        yield f"{some(found)}: are independent variables, at most one is allowed"


def independent_not_real(d: Description) -> Iterator[str]:
    """The independent variable, usually time, is a Real."""
    for v in d.variables:
        if v.causality == "independent" and v.type != "Real":
            yield f"{v}: is the independent variable, but {v.type}"


def limits_crossed(d: Description) -> Iterator[str]:
    """The least value of a variable does not exceed its largest."""
    for v in d.variables:
        low, high = v.number("min"), v.number("max")
        if low is not None and high is not None and low > high:
            yield f"{v}: min {low:g} exceeds max {high:g}"


def starts_outside(d: Description) -> Iterator[str]:
    """The start value lies between the limits."""
    for v in d.variables:
        low, high = v.number("min"), v.number("max")
        for start in map(float, v.starts if v.type in ("Real", "Integer", "Enumeration") else ()):
            if (low is not None and start < low) or (high is not None and start > high):
                low_text, high_text = ("" if x is None else f"{x:g}" for x in (low, high))
                yield f"{v}: start {start:g} lies outside [{low_text}, {high_text}]"


def starts_that_are_no_item(d: Description) -> Iterator[str]:
    """An enumeration starts with one of its items."""
    for v in d.variables:
        if v.type != "Enumeration" or v.definition is None:
            continue
        for start in v.starts:
            if int(start) not in d.items[v.value.get("declaredType")]:
                yield f"{v}: start {start} is not an item of its type"


def starts_not_finite(d: Description) -> Iterator[str]:
    """Start values are numbers."""
    for v in d.variables:
        for start in v.starts if v.type == "Real" else ():
            if start.strip() in ("NaN", "INF", "-INF"):
                yield f"{v}: start {start} is not finite"


def zero_nominals(d: Description) -> Iterator[str]:
    """A nominal value is not zero, since one divides by it."""
    for v in d.variables:
        if v.number("nominal") == 0:
            yield f"{v}: nominal is 0"


def undefined_units(d: Description) -> Iterator[str]:
    """The unit of a variable is defined."""
    for v in d.variables:
        unit = v.value.get("unit")
        if unit is not None and unit not in d.units:
            yield f"{v}: its unit {unit} is not defined"


def undefined_display_units(d: Description) -> Iterator[str]:
    """The display unit of a variable is defined with its unit."""
    for v in d.variables:
        shown, unit = v.value.get("displayUnit"), v.attribute("unit")
        if shown is not None and shown not in d.units.get(unit or "", ()):
            yield f"{v}: its display unit {shown} is not defined"


def reinit_in_co_simulation(d: Description) -> Iterator[str]:
    """Only states of model exchange can be set anew at events."""
    for v in d.variables:
        if v.value.get("reinit", "false") in ("true", "1") and not d.all("ModelExchange"):
            yield f"{v}: reinit means nothing in co-simulation"


def several_sets_in_co_simulation(d: Description) -> Iterator[str]:
    """Only inputs of model exchange are set several times per instant."""
    for v in d.variables:
        given = v.element.get("canHandleMultipleSetPerTimeInstant") is not None
        if given and (v.causality != "input" or not d.all("ModelExchange")):
            yield f"{v}: canHandleMultipleSetPerTimeInstant is for inputs of model exchange only"


def shared_references(d: Description) -> Iterator[str]:
    """Of the variables that share a value reference at most one can be set."""
    for group in _aliases(d):
        free = [v for v in group if _settable(v)]
        if len(free) > 1:
            yield f"{some(free)}: share a value reference, and more than one is set"


def mixed_aliases(d: Description) -> Iterator[str]:
    """Constants share value references with constants only, and aliases have one unit."""
    for group in _aliases(d):
        names = some(group)
        if len({v.variability == "constant" for v in group}) > 1:
            yield f"{names}: share a value reference, but not all are constants"
        if len({v.attribute("unit") for v in group}) > 1:
            yield f"{names}: share a value reference, but not their unit"


def _aliases(d: Description) -> Iterator[list[Declared]]:
    """Variables of one kind that share a value reference."""

    def key(v: Declared) -> tuple[str, int]:
        return "Integer" if v.type == "Enumeration" else v.type, v.reference

    groups = (list(group) for _, group in groupby(sorted(d.variables, key=key), key))
    return (group for group in groups if len(group) > 1)


def _settable(v: Declared) -> bool:
    if v.variability == "constant":
        return False
    return v.causality in ("parameter", "input") or (
        v.start is not None and v.initial != "calculated"
    )


# ---- units and types


def repeated_units(d: Description) -> Iterator[str]:
    """Units have names of their own."""
    for name in twice(e.get("name") for e in d.all("UnitDefinitions/Unit")):
        yield f"the unit {name} is defined twice"


def repeated_display_units(d: Description) -> Iterator[str]:
    """Display units of one unit have names of their own."""
    for unit in d.all("UnitDefinitions/Unit"):
        for name in twice(e.get("name") for e in unit.iterfind("DisplayUnit")):
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
