# SPDX-License-Identifier: BSD-2-Clause
"""Rules of the standard that an FMU may break and still be run here, although another tool may
reject it (FMI 2.0, sections 2.2 and 2.3; FMI 3.0, sections 2.4 and 2.5).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from harness.conformance.description import Declared, Description, repeated
from harness.spelling import some

_BARE_GUID = re.compile(r"[0-9a-fA-F]{8}(-[0-9a-fA-F]{4}){3}-[0-9a-fA-F]{12}")

_WORD = r"(?:[A-Za-z_]\w*|'(?:[^'\\]|\\.)+')"
_ARRAY = r"(?:\[\d+(?:,\d+)*\])?"
_PLAIN = rf"{_WORD}{_ARRAY}(?:\.{_WORD}{_ARRAY})*"
_STRUCTURED = re.compile(rf"{_PLAIN}|der\({_PLAIN}(?:,\d+)?\)", re.ASCII)

UNIQUE = {
    "LogCategories/Category": "name",
    "UnitDefinitions/Unit": "name",
    "UnitDefinitions/Unit/DisplayUnit": "name",
    "TypeDefinitions/*": "name",
    "TypeDefinitions//Item": "value",
    "VendorAnnotations/Tool": "name",
    "ModelVariables/*/Annotations/Tool": "name",
    "Annotations/Annotation": "type",
    "ModelVariables/*/Annotations/Annotation": "type",
}
"""Attribute that must differ between sibling elements, by the XML path of the elements."""

TOP = (
    *("modelDescription.xml", "documentation", "sources", "binaries", "resources", "extra"),
    "terminalsAndIcons",
)
TOP_2 = (*TOP, "model.png", "licenses")
"""Permitted entries at the top of the archive: TOP in FMI 3.0, TOP_2 in FMI 2.0."""


def deviations(d: Description) -> Iterator[str]:
    """Yield a line per deviation from the standard."""
    own = (_build, _terminals) if d.fmi == 3 else (_aliases,)
    for rule in (_identity, _experiment, _archive, _units, _dependencies, _structure, *own):
        yield from rule(d)
    for v in d.variables:
        for rule_of_variable in OF_VARIABLES:
            yield from (f"{v}: {text}" for text in rule_of_variable(d, v))


def _identity(d: Description) -> Iterator[str]:
    """Check that model identifiers are C identifiers, that modelName and guid are not empty, that a
    guid is in braces, that at most one variable is independent (FMI 2.0), and that sibling elements
    differ in the attributes of UNIQUE.
    """
    for name in d.identifiers:
        if not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
            yield f"modelIdentifier '{name}' must be a C identifier"
    for name in ("modelName", "guid", "instantiationToken"):
        if not d.root.get(name, "given").strip():
            yield f"{name} is empty"
    if _BARE_GUID.fullmatch(d.root.get("guid", "")):
        yield f"guid {d.root.get('guid')} must be enclosed in braces"
    if d.fmi == 2 and sum(v.causality == "independent" for v in d.variables) > 1:
        yield "more than one variable is independent"
    number = "valueReference" if d.fmi == 3 else "index"
    yield from repeated(d.root, {**UNIQUE, **dict.fromkeys(d.lists.values(), number)})


def _experiment(d: Description) -> Iterator[str]:
    """Check that the default experiment has finite times, a positive step and tolerance, and a stop
    time after its start time.
    """
    for e in d.every("DefaultExperiment"):
        for name, text in e.attrib.items():
            positive = name in ("stepSize", "tolerance")
            if not math.isfinite(float(text)) or (positive and not float(text) > 0):
                range_ = "positive and finite" if positive else "finite"
                yield f"DefaultExperiment: {name} {text} must be {range_}"
        start, stop = e.get("startTime", "0"), e.get("stopTime", "INF")
        if not float(stop) > float(start):
            yield f"DefaultExperiment: stopTime {stop} must lie after startTime {start}"


def _archive(d: Description) -> Iterator[str]:
    """Check that the top level of the archive contains only standard entries and that listed source
    files exist.
    """
    for top in dict.fromkeys(name.partition("/")[0] for name in d.files):
        if top not in (TOP if d.fmi == 3 else TOP_2):
            yield f"{top}: not permitted at the top of the archive; move it to extra/"
    for name in dict.fromkeys(d.sources):
        if f"sources/{name}" not in d.files:
            yield f"the source file sources/{name} is listed, but not in the archive"


def _units(d: Description) -> Iterator[str]:
    """Check that factors of units are not zero and that units of types are defined."""
    for e in d.every("UnitDefinitions/Unit/*"):
        if float(e.get("factor", "1")) == 0:
            name = e.getparent().get("name")
            yield f"the factor of unit {name} (line {e.sourceline}) must not be 0"
    for name, e in d.types.items():
        if e.get("unit") not in (None, *d.units):
            yield f"the type {name}: its unit {e.get('unit')} is not defined"


# ---- the model structure


def _dependencies(d: Description) -> Iterator[str]:
    """Check that either every or no dependency has a kind, that initial unknowns of FMI 2.0 have
    only the kinds dependent and constant, and that no initial unknown is a clock.
    """
    for kind, e, number in d.entries():
        place = f"ModelStructure/{kind} (line {e.sourceline})"
        numbers, kinds = (e.get(f"dependencies{k}", "").split() for k in ("", "Kind"))
        if kinds and len(numbers) != len(kinds):
            yield f"{place}: expected {len(numbers)} dependency kinds, got {len(kinds)}"
        others = set(kinds) - {"dependent", "constant"}
        if kind == "InitialUnknowns" and others:
            kinds = ", ".join(sorted(others))
            yield f"{place}: dependenciesKind is {kinds}, expected dependent or constant"
        v = d.numbered(number)
        if kind == "InitialUnknown" and v and v.type == "Clock":
            yield f"{place}: {v.name} is a clock, which has no initial value"


def _structure(d: Description) -> Iterator[str]:
    """Check that the model structure lists all outputs, that every listed derivative has a state,
    and that the initial unknowns are all calculated outputs, parameters, states and derivatives.
    """
    outputs, derivatives, unknowns, *_ = d.lists
    expected = {v for v in d.variables if v.causality == "output"}
    yield from _difference(outputs, expected, set(d.listed(outputs)))
    expected = {v for v in expected if _calculated(v)}
    expected |= {v for v in d.variables if v.causality == "calculatedParameter"}
    for v in d.listed(derivatives):
        if v.derivative is None:
            yield f"ModelStructure/{derivatives}: the attribute derivative of {v} is missing"
            continue
        expected |= {each for each in (v, d.numbered(v.derivative)) if each and _calculated(each)}
    yield from _difference(unknowns, expected, set(d.listed(unknowns)))


def _calculated(v: Declared) -> bool:
    return v.initial in ("approx", "calculated")


def _difference(kind: str, expected: set[Declared], listed: set[Declared]) -> Iterator[str]:
    differences = {"must list": expected - listed, "must not list": listed - expected}
    for rule, names in differences.items():
        if names:
            yield f"ModelStructure/{kind}: {rule} {some(sorted(v.name for v in names))}"


# ---- variables


def _aliases(d: Description) -> Iterator[str]:
    """Check variables with equal value references: at most one of them may be settable, either
    all or none must be constants, and all must have the same unit.
    """
    for group in d.aliases():
        free = [v for v in group if _settable(v)]
        if len(free) > 1:
            yield f"{some(free)}: share a value reference, so at most one of them may be settable"
        if len({v.variability == "constant" for v in group}) > 1:
            yield f"{some(group)}: share a value reference, so all or none must be constant"
        if len({v.all.get("unit") for v in group}) > 1:
            yield f"{some(group)}: share a value reference, so their units must be equal"


def _settable(v: Declared) -> bool:
    given = v.causality in ("parameter", "input") or (v.starts and v.initial != "calculated")
    return bool(given) and v.variability != "constant"


def _naming(d: Description, v: Declared) -> Iterator[str]:
    """Check that a name follows the declared naming convention and is not the name of a type."""
    structured = d.root.get("variableNamingConvention") == "structured"
    if structured and not _STRUCTURED.fullmatch(v.name):
        yield "does not follow the naming convention 'structured'"
    if not structured and set(v.name) & set("\r\n\t"):
        yield "its name must not contain a line break or tab"
    if v.name in d.types:
        yield "a type has the same name"


def _kind(d: Description, v: Declared) -> Iterator[str]:
    """Check that type, causality, variability and `initial` are compatible."""
    definition = d.types.get(v.type_name)
    if definition is not None and definition.tag.removesuffix("Type") != v.written:
        declared = definition.tag.removesuffix("Type")
        yield f"is {v.written}, but its declared type is {declared}"
    if v.type != "Real" and v.variability == "continuous":
        yield f"is {v.type}, which cannot be continuous"
    if v.type != "Real" and v.causality == "independent":
        yield f"is the independent variable, but {v.type}; use Real (FMI 3.0: Float64)"
    if not v.initials:
        yield f"a {v.causality} cannot be {v.variability}"
    elif v.initial not in v.initials:
        yield f"a {v.variability} {v.causality} cannot have initial='{v.initial}'"


def _roles(d: Description, v: Declared) -> Iterator[str]:
    """Check that derivatives are continuous, clocks have type Clock and previous values exist."""
    state = None if v.derivative is None else d.numbered(v.derivative)
    if state and any(e.type != "Real" or e.variability != "continuous" for e in (v, state)):
        yield f"is the derivative of {state.name}, so both must be continuous"
    for clock in filter(None, map(d.numbered, v.clocks)):
        if clock.type != "Clock":
            yield f"its clock {clock.name} must have type Clock, not {clock.written}"
    if "previous" in v.own and d.numbered(int(v.own["previous"])) is None:
        yield f"its previous value has the reference {v.own['previous']}, which no variable has"


def _exchanged(d: Description, v: Declared) -> Iterator[str]:
    """Check that attributes of model exchange are used only by FMUs that support it."""
    exchange = bool(d.every("ModelExchange"))
    if v.own.get("reinit", "false") in ("true", "1") and not exchange:
        yield "reinit is valid only in model exchange"
    several = "canHandleMultipleSetPerTimeInstant" in v.own and d.fmi == 2
    if several and (v.causality != "input" or not exchange):
        yield "canHandleMultipleSetPerTimeInstant is valid only for inputs in model exchange"


def _starts(d: Description, v: Declared) -> Iterator[str]:
    """Check that a variable has a start value exactly if it must, and that the value is valid."""
    needed = v.initial in ("exact", "approx")
    needed |= v.causality == "input" and v.type not in ("Clock", "Binary")
    if needed and not v.starts:
        yield "has no start value"
    if v.starts and v.initial == "calculated":
        yield "is calculated, but has a start value"
    if v.starts and v.causality == "independent":
        yield "is the independent variable, but has a start value"
    if v.type == "Real" and not all(map(math.isfinite, map(float, v.starts))):
        yield f"start {some(v.starts)} must be finite"
    items = [int(item.get("value")) for item in d.enumerations.get(v.type_name, ())]
    if items and not {*map(int, v.starts)} <= {*items}:
        yield f"start {some(v.starts)} is not an item of its type"


def _limits(d: Description, v: Declared) -> Iterator[str]:
    """Check that start values are within the limits, that nominal is not zero and that units are
    defined.
    """
    low, high = (float(v.all.get(name, end)) for name, end in (("min", "-inf"), ("max", "inf")))
    if low > high:
        yield f"min {low:g} exceeds max {high:g}"
    for start in map(float, v.starts if v.type in ("Real", "Integer", "Enumeration") else ()):
        if start < low or start > high:
            yield f"start {start:g} lies outside [{low:g}, {high:g}]"
    if v.number("nominal") == 0:
        yield "nominal must not be 0"
    if v.own.get("unit") not in (None, *d.units):
        yield f"its unit {v.own['unit']} is not defined"
    shown = v.own.get("displayUnit")
    if shown not in (None, *d.units.get(v.all.get("unit", ""), ())):
        yield f"its display unit {shown} is not defined"


OF_VARIABLES = (_naming, _kind, _roles, _exchanged, _starts, _limits)


# ---- further files of FMI 3.0


def _build(d: Description) -> Iterator[str]:
    """Check that an FMU with C files has a build description, which refers to existing interfaces,
    names the compiler if it states compiler options, and lists no file of a set twice.
    """
    if d.build is None:
        if any(name.startswith("sources/") and name.endswith(".c") for name in d.files):
            yield "sources/buildDescription.xml is missing; source files need it"
        return
    for e in d.build.iterfind("BuildConfiguration"):
        if e.get("modelIdentifier") not in d.identifiers:
            name = e.get("modelIdentifier")
            yield f"buildDescription.xml: no interface has the modelIdentifier {name}"
    for e in d.build.iter("SourceFileSet"):
        if "compilerOptions" in e.attrib and "compiler" not in e.attrib:
            yield f"buildDescription.xml, line {e.sourceline}: compilerOptions without compiler"
    yield from repeated(d.build, {".//SourceFile": "name"})


def _terminals(d: Description) -> Iterator[str]:
    """Check that the list of terminals is not empty, that terminals have unique names, and that
    their members are existing variables.
    """
    if d.terminals is None:
        return
    file = "terminalsAndIcons.xml"
    names = {e.get("name") for e in (*d.every("ModelVariables/*"), *d.every(".//Alias"))}
    for e in d.terminals.iter("Terminals"):
        if not len(e):
            yield f"{file}: the element Terminals is empty; add a terminal"
    for e in d.terminals.iter("TerminalMemberVariable"):
        if e.get("variableName") not in names:
            yield f"{file}, line {e.sourceline}: variable {e.get('variableName')} does not exist"
    yield from repeated(d.terminals, {".//Terminal": "name"})
