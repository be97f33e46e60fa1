# SPDX-License-Identifier: BSD-2-Clause
"""What FMI 3.0 demands and FMI 2.0 does not know: arrays, clocks, references, build descriptions
and terminals (FMI 3.0, 2.4.7, 2.4.8, 2.4.9, 2.5.1).
"""

from __future__ import annotations

from collections.abc import Iterator

from harness.rules.description import Description3, twice
from harness.spelling import some

MOST = 10**6
"""Elements of one array; more are taken for a mistake."""


def independent_variable(d: Description3) -> Iterator[str]:
    """There is one independent variable."""
    found = [v.name for v in d.variables if v.causality == "independent"]
    if not found:
        yield "there is no independent variable (usually time), which FMI 3.0 demands"
    if len(found) > 1:
        yield f"{some(found)}: are independent variables, only one is allowed"


def repeated_references(d: Description3) -> Iterator[str]:
    """A value reference is that of one variable."""
    for reference in twice(v.reference for v in d.variables):
        names = [v.name for v in d.variables if v.reference == reference]
        yield f"{some(names)}: share the value reference {reference}"


def unknown_dimensions(d: Description3) -> Iterator[str]:
    """The size of an array is a number, or a structural parameter."""
    for v in d.variables:
        for e in v.dimensions:
            given = [name for name in ("start", "valueReference") if e.get(name) is not None]
            if len(given) != 1:
                yield f"{v}: a Dimension has either a start or a valueReference"
            elif given == ["valueReference"] and d.shape(v) is None:
                number = e.get("valueReference")
                yield f"{v}: its size is variable {number}, which is no structural parameter"


def impossible_sizes(d: Description3) -> Iterator[str]:
    """Arrays have elements, and not too many."""
    for v in d.variables:
        count = d.count(v)
        if count is not None and not 0 < count <= MOST:
            yield f"{v}: has {count} elements"


def wrong_numbers_of_starts(d: Description3) -> Iterator[str]:
    """An array has a start value for every element, or one for all."""
    for v in d.variables:
        count, given = d.count(v), len(v.starts)
        if v.type != "Clock" and count is not None and given not in (0, 1, count):
            yield f"{v}: has {count} elements and {given} start values"


def unknown_clocks(d: Description3) -> Iterator[str]:
    """The clocks of a variable are variables."""
    for v in d.variables:
        for number in v.clocks:
            if number not in d.by_reference:
                yield f"{v}: its clock is variable {number}, which does not exist"


def clocks_that_are_none(d: Description3) -> Iterator[str]:
    """The clocks of a variable are of type Clock."""
    for v in d.variables:
        for number in v.clocks:
            found = d.by_reference.get(number)
            if found is not None and found.type != "Clock":
                yield f"{v}: its clock is {found.name}, which is {found.element.tag}"


def repeated_alias_names(d: Description3) -> Iterator[str]:
    """Aliases have names of their own."""
    names = [v.name for v in d.variables]
    names += [e.get("name") for v in d.variables for e in v.element.iterfind("Alias")]
    plain = [v.name for v in d.variables]
    for name in twice(names):
        if name not in twice(plain):
            what = "a variable" if name in plain else "an alias"
            yield f"{name}: is the name of an alias, and of {what}"


def repeated_annotations(d: Description3) -> Iterator[str]:
    """The model, or one variable, is annotated once by everybody."""
    for owner in (d.root, *(v.element for v in d.variables)):
        types = [e.get("type") for e in owner.iterfind("Annotations/Annotation")]
        place = owner.get("name") or "the model"
        yield from (f"{place}: the annotation {name} is given twice" for name in twice(types))


def other_identifiers_of_builds(d: Description3) -> Iterator[str]:
    """A build description is that of one of the interfaces."""
    known = {e.get("modelIdentifier") for e in d.root if e.get("modelIdentifier") is not None}
    for e in () if d.build is None else d.build.iterfind("BuildConfiguration"):
        if e.get("modelIdentifier") not in known:
            yield f"buildDescription.xml: {e.get('modelIdentifier')} is no modelIdentifier"


def options_without_compiler(d: Description3) -> Iterator[str]:
    """Options are those of a compiler."""
    for e in () if d.build is None else d.build.iter("SourceFileSet"):
        if e.get("compilerOptions") is not None and e.get("compiler") is None:
            yield f"buildDescription.xml, line {e.sourceline}: compilerOptions without compiler"


def missing_build_description(d: Description3) -> Iterator[str]:
    """Source files come with a build description."""
    there = any(name.startswith("sources/") and name.endswith(".c") for name in d.files)
    if there and d.build is None:
        yield "sources/buildDescription.xml is missing, which has the compiler and its options"


def empty_terminals(d: Description3) -> Iterator[str]:
    """A list of terminals is not empty."""
    for e in () if d.terminals is None else d.terminals.iter("Terminals"):
        if len(e) == 0:
            yield "terminalsAndIcons.xml: Terminals is empty"


def terminal_members(d: Description3) -> Iterator[str]:
    """Members of terminals are variables."""
    names = {v.name for v in d.variables}
    names |= {e.get("name") for v in d.variables for e in v.element.iterfind("Alias")}
    for e in () if d.terminals is None else d.terminals.iter("TerminalMemberVariable"):
        if e.get("variableName") not in names:
            place = f"terminalsAndIcons.xml, line {e.sourceline}"
            yield f"{place}: {e.get('variableName')} is no variable"


def repeated_terminals(d: Description3) -> Iterator[str]:
    """Terminals beside each other have names of their own."""
    for owner in () if d.terminals is None else d.terminals.iter("Terminals", "Terminal"):
        for name in twice(e.get("name") for e in owner.iterfind("Terminal")):
            yield f"terminalsAndIcons.xml: there are two terminals {name}"


def clocks_as_unknowns(d: Description3) -> Iterator[str]:
    """Clocks are no unknowns of initialization."""
    for e in d.all("ModelStructure/InitialUnknown"):
        found = d.numbered(d.number(e))
        if found is not None and found.type == "Clock":
            yield f"ModelStructure/InitialUnknown (line {e.sourceline}): {found.name} is a clock"


def unknown_previous(d: Description3) -> Iterator[str]:
    """The previous value of a variable is that of a variable."""
    for v in d.variables:
        number = v.element.get("previous")
        if number is not None and int(number) not in d.by_reference:
            yield f"{v}: its previous value is variable {number}, which does not exist"


def repeated_sources(d: Description3) -> Iterator[str]:
    """Source files are listed once."""
    for name in twice(d.sources):
        yield f"buildDescription.xml: the source file {name} is listed twice"
