# SPDX-License-Identifier: BSD-2-Clause
"""What is not by the book, yet can be run: broken, these rules may puzzle another tool (FMI 2.0,
2.2 and 2.3; FMI 3.0, 2.4 and 2.5).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator

from harness.rules.description import Declared, Description, repeated
from harness.spelling import some

_BARE_GUID = re.compile(r"[0-9a-fA-F]{8}(-[0-9a-fA-F]{4}){3}-[0-9a-fA-F]{12}")

_WORD = r"(?:[A-Za-z_]\w*|'(?:[^'\\]|\\.)+')"
_ARRAY = r"(?:\[\d+(?:,\d+)*\])?"
_PLAIN = rf"{_WORD}{_ARRAY}(?:\.{_WORD}{_ARRAY})*"
_STRUCTURED = re.compile(rf"{_PLAIN}|der\({_PLAIN}(?:,\d+)?\)", re.ASCII)

OWN = {
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
"""Elements that differ from those beside them in an attribute."""

TOP = (
    *("modelDescription.xml", "documentation", "sources", "binaries", "resources", "extra"),
    "terminalsAndIcons",
)
TOP_2 = (*TOP, "model.png", "licenses")
"""What may lie at the top of the archive, in FMI 3.0 and in FMI 2.0."""


def oddities(d: Description) -> Iterator[str]:
    """A line for each."""
    own = (_build, _terminals) if d.fmi == 3 else (_aliases,)
    for rule in (_identity, _experiment, _archive, _units, _dependencies, _structure, *own):
        yield from rule(d)
    for v in d.variables:
        for about in OF_VARIABLES:
            yield from (f"{v}: {said}" for said in about(d, v))


def _identity(d: Description) -> Iterator[str]:
    """Functions are named by the model identifier; binary and description recognise each other by
    the guid; what stands beside each other has a name of its own.
    """
    for name in d.identifiers:
        if not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
            yield f"modelIdentifier '{name}' is not a C identifier"
    for name in ("modelName", "guid", "instantiationToken"):
        if not d.root.get(name, "given").strip():
            yield f"{name} is empty"
    if _BARE_GUID.fullmatch(d.root.get("guid", "")):
        yield f"guid {d.root.get('guid')} has no braces"
    if d.fmi == 2 and sum(v.causality == "independent" for v in d.variables) > 1:
        yield "there are several independent variables"
    number = "valueReference" if d.fmi == 3 else "index"
    yield from repeated(d.root, {**OWN, **dict.fromkeys(d.lists.values(), number)})


def _experiment(d: Description) -> Iterator[str]:
    """The default experiment has finite times and positive steps."""
    for e in d.every("DefaultExperiment"):
        for name, text in e.attrib.items():
            positive = name in ("stepSize", "tolerance")
            if not math.isfinite(float(text)) or (positive and not float(text) > 0):
                wanted = "a positive number" if positive else "finite"
                yield f"DefaultExperiment: {name} {text} is not {wanted}"
        start, stop = e.get("startTime", "0"), e.get("stopTime", "INF")
        if not float(stop) > float(start):
            yield f"DefaultExperiment: stopTime {stop} does not lie after startTime {start}"


def _archive(d: Description) -> Iterator[str]:
    """At the top lies nothing but what the standard names; listed source files are there."""
    for top in dict.fromkeys(name.partition("/")[0] for name in d.files):
        if top not in (TOP if d.fmi == 3 else TOP_2):
            yield f"{top}: has no place at the top of the archive"
    there = set(d.files)
    for name in dict.fromkeys(d.sources):
        if f"sources/{name}" not in there:
            yield f"the source file sources/{name} is listed, but not in the archive"


def _units(d: Description) -> Iterator[str]:
    """One divides by the factors of units; the unit of a type is defined."""
    for e in d.every("UnitDefinitions/Unit/*"):
        if float(e.get("factor", "1")) == 0:
            yield f"the unit {e.getparent().get('name')} (line {e.sourceline}) has the factor 0"
    for name, e in d.types.items():
        if e.get("unit") not in (None, *d.units):
            yield f"the type {name}: its unit {e.get('unit')} is not defined"


# ---- the model structure


def _dependencies(d: Description) -> Iterator[str]:
    """There are as many kinds as dependencies; in initialization one is just there, or constant."""
    for kind, e, number in d.entries():
        place = f"ModelStructure/{kind} (line {e.sourceline})"
        numbers, kinds = (e.get(f"dependencies{k}", "").split() for k in ("", "Kind"))
        if kinds and len(numbers) != len(kinds):
            yield f"{place}: {len(numbers)} dependencies, {len(kinds)} kinds"
        odd = set(kinds) - {"dependent", "constant"}
        if kind == "InitialUnknowns" and odd:
            yield f"{place}: dependenciesKind {', '.join(sorted(odd))} is for steps only"
        v = d.numbered(number)
        if kind == "InitialUnknown" and v and v.type == "Clock":
            yield f"{place}: {v.name} is a clock"


def _structure(d: Description) -> Iterator[str]:
    """Listed are the outputs; derivatives, which say of which state; and as initial unknowns what
    is calculated of outputs, calculated parameters, states and derivatives.
    """
    outputs, derivatives, unknowns, *_ = d.lists
    wanted = {v for v in d.variables if v.causality == "output"}
    yield from _difference(outputs, wanted, set(d.listed(outputs)))
    wanted = {v for v in wanted if _calculated(v)}
    wanted |= {v for v in d.variables if v.causality == "calculatedParameter"}
    for v in d.listed(derivatives):
        if v.derivative is None:
            yield f"ModelStructure/{derivatives}: {v} does not say of which variable it is one"
            continue
        wanted |= {each for each in (v, d.numbered(v.derivative)) if each and _calculated(each)}
    yield from _difference(unknowns, wanted, set(d.listed(unknowns)))


def _calculated(v: Declared) -> bool:
    return v.initial in ("approx", "calculated")


def _difference(kind: str, wanted: set[Declared], listed: set[Declared]) -> Iterator[str]:
    for names, what in ((wanted - listed, "does not list"), (listed - wanted, "lists, wrongly,")):
        if names:
            yield f"ModelStructure/{kind}: {what} {some(sorted(v.name for v in names))}"


# ---- variables


def _aliases(d: Description) -> Iterator[str]:
    """Of the variables that share a value reference at most one can be set, all or none are
    constants, and their unit is one.
    """
    for group in d.aliases():
        free = [v for v in group if _settable(v)]
        if len(free) > 1:
            yield f"{some(free)}: share a value reference, and more than one is set"
        if len({v.variability == "constant" for v in group}) > 1:
            yield f"{some(group)}: share a value reference, but not all are constants"
        if len({v.attribute("unit") for v in group}) > 1:
            yield f"{some(group)}: share a value reference, but not their unit"


def _settable(v: Declared) -> bool:
    given = v.causality in ("parameter", "input") or (v.starts and v.initial != "calculated")
    return bool(given) and v.variability != "constant"


def _naming(d: Description, v: Declared) -> Iterator[str]:
    """Names follow the convention that the FMU declares, and no type has them."""
    structured = d.root.get("variableNamingConvention") == "structured"
    if structured and not _STRUCTURED.fullmatch(v.name):
        yield "does not follow the naming convention 'structured'"
    if not structured and set(v.name) & set("\r\n\t"):
        yield "holds a line break or tab"
    if v.name in d.types:
        yield "has the name of a type"


def _kind(d: Description, v: Declared) -> Iterator[str]:
    """Type, causality, variability and `initial` fit each other."""
    definition = d.types.get(v.type_name)
    if definition is not None and definition.tag.removesuffix("Type") != v.written:
        yield f"is {v.written}, but its type is {definition.tag.removesuffix('Type')}"
    if v.type != "Real" and v.variability == "continuous":
        yield f"is {v.type}, which cannot be continuous"
    if v.type != "Real" and v.causality == "independent":
        yield f"is the independent variable, but {v.type}"
    if not v.initials:
        yield f"a {v.causality} cannot be {v.variability}"
    elif v.initial not in v.initials:
        yield f"a {v.variability} {v.causality} cannot have initial='{v.initial}'"


def _roles(d: Description, v: Declared) -> Iterator[str]:
    """Derivatives are continuous, clocks are of type Clock, previous values are there."""
    state = None if v.derivative is None else d.numbered(v.derivative)
    if state and any(e.type != "Real" or e.variability != "continuous" for e in (v, state)):
        yield f"is the derivative of {state.name}, but not both are continuous"
    for clock in filter(None, map(d.numbered, v.clocks)):
        if clock.type != "Clock":
            yield f"its clock is {clock.name}, which is {clock.written}"
    if "previous" in v.own and d.numbered(int(v.own["previous"])) is None:
        yield f"its previous value is variable {v.own['previous']}, which does not exist"


def _exchanged(d: Description, v: Declared) -> Iterator[str]:
    """What is for model exchange needs that."""
    exchange = bool(d.every("ModelExchange"))
    if v.own.get("reinit", "false") in ("true", "1") and not exchange:
        yield "reinit means nothing in co-simulation"
    several = "canHandleMultipleSetPerTimeInstant" in v.own and d.fmi == 2
    if several and (v.causality != "input" or not exchange):
        yield "canHandleMultipleSetPerTimeInstant is for inputs of model exchange only"


def _starts(d: Description, v: Declared) -> Iterator[str]:
    """What starts exactly or approximately has a start value, what is calculated has none."""
    needed = v.initial in ("exact", "approx")
    needed |= v.causality == "input" and v.type not in ("Clock", "Binary")
    if needed and not v.starts:
        yield "has no start value"
    if v.starts and v.initial == "calculated":
        yield "is calculated, but has a start value"
    if v.starts and v.causality == "independent":
        yield "is the independent variable, but has a start value"
    if v.type == "Real" and not all(map(math.isfinite, map(float, v.starts))):
        yield f"start {some(v.starts)} is not finite"
    items = [int(item.get("value")) for item in d.enumerations.get(v.type_name, ())]
    if items and not {*map(int, v.starts)} <= {*items}:
        yield f"start {some(v.starts)} is not an item of its type"


def _limits(d: Description, v: Declared) -> Iterator[str]:
    """Start values lie between the limits, one divides by nominal values, units are defined."""
    low, high = (float(v.attribute(name) or end) for name, end in (("min", "-inf"), ("max", "inf")))
    if low > high:
        yield f"min {low:g} exceeds max {high:g}"
    for start in map(float, v.starts if v.type in ("Real", "Integer", "Enumeration") else ()):
        if start < low or start > high:
            yield f"start {start:g} lies outside [{low:g}, {high:g}]"
    if v.number("nominal") == 0:
        yield "nominal is 0"
    if v.own.get("unit") not in (None, *d.units):
        yield f"its unit {v.own['unit']} is not defined"
    shown = v.own.get("displayUnit")
    if shown not in (None, *d.units.get(v.attribute("unit") or "", ())):
        yield f"its display unit {shown} is not defined"


OF_VARIABLES: tuple[Callable[[Description, Declared], Iterator[str]], ...] = (
    *(_naming, _kind, _roles, _exchanged, _starts, _limits),
)


# ---- further files of FMI 3.0


def _build(d: Description) -> Iterator[str]:
    """Source files come with a build description of one of the interfaces."""
    if d.build is None:
        if any(name.startswith("sources/") and name.endswith(".c") for name in d.files):
            yield "sources/buildDescription.xml is missing, which has the compiler and its options"
        return
    for e in d.build.iterfind("BuildConfiguration"):
        if e.get("modelIdentifier") not in d.identifiers:
            yield f"buildDescription.xml: {e.get('modelIdentifier')} is no modelIdentifier"
    for e in d.build.iter("SourceFileSet"):
        if "compilerOptions" in e.attrib and "compiler" not in e.attrib:
            yield f"buildDescription.xml, line {e.sourceline}: compilerOptions without compiler"
    yield from repeated(d.build, {".//SourceFile": "name"})


def _terminals(d: Description) -> Iterator[str]:
    """There are terminals, with names of their own, and their members are variables."""
    if d.terminals is None:
        return
    file = "terminalsAndIcons.xml"
    names = {e.get("name") for e in (*d.every("ModelVariables/*"), *d.every(".//Alias"))}
    for e in d.terminals.iter("Terminals"):
        if not len(e):
            yield f"{file}: Terminals is empty"
    for e in d.terminals.iter("TerminalMemberVariable"):
        if e.get("variableName") not in names:
            yield f"{file}, line {e.sourceline}: {e.get('variableName')} is no variable"
    yield from repeated(d.terminals, {".//Terminal": "name"})
