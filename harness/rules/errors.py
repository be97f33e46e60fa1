# SPDX-License-Identifier: BSD-2-Clause
"""What a description must not have to be run: broken, these rules leave open what would be run
(FMI 2.0, 2.2; FMI 3.0, 2.4).
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

from harness.rules.description import Declared, Description, repeated, twice
from harness.spelling import some

MOST = 10**6
"""Elements of one array; more are taken for a mistake."""


def errors(d: Description) -> Iterator[str]:
    """A line for each."""
    return chain(_interfaces(d), _names(d), _definitions(d), _arrays(d), _identities(d))


def _interfaces(d: Description) -> Iterator[str]:
    """The library has a name, not a path; each interface is described once."""
    for name in d.identifiers:
        if not name or set(name) & set("/\\:\0") or name in (".", ".."):
            yield f"modelIdentifier '{name}' is not the name of a library"
    for kind in twice(e.tag for e in d.root if "modelIdentifier" in e.attrib):
        yield f"there are two elements {kind}"


def _names(d: Description) -> Iterator[str]:
    """Variables, their aliases and the items of a type have names of their own."""
    aliases = [e.get("name") for e in d.every("ModelVariables/*/Alias")]
    for name in twice((*(v.name for v in d.variables), *aliases)):
        yield f"{name}: there are two variables of this name"
    for v in d.variables:
        if not v.name.strip():
            yield f"line {v.element.sourceline}: a variable has no name"
    yield from repeated(d.root, {"TypeDefinitions//Item": "name"})


def _definitions(d: Description) -> Iterator[str]:
    """Types and variables that are named are there."""
    for v in d.variables:
        if v.type_name and v.type_name not in d.types:
            yield f"{v}: its type {v.type_name} is not defined"
        for number in (*([] if v.derivative is None else [v.derivative]), *v.clocks):
            if d.numbered(number) is None:
                yield f"{v}: its state or clock is variable {number}, which does not exist"
    for kind, e, number in d.entries():
        for each in (number, *map(int, e.get("dependencies", "").split())):
            if d.numbered(each) is None:
                place = f"ModelStructure/{kind} (line {e.sourceline})"
                yield f"{place}: there is no variable {each}"


def _arrays(d: Description) -> Iterator[str]:
    """The size of an array is a number, or a structural parameter; it has a start value for every
    element, or one for all.
    """
    for v in d.variables:
        yield from (f"{v}: {said}" for said in _array(d, v))


def _array(d: Description, v: Declared) -> Iterator[str]:
    for e in v.element.iterfind("Dimension"):
        if ("start" in e.attrib) == ("valueReference" in e.attrib):
            yield "a Dimension has either a start or a valueReference"
    count, given = d.count(v), len(v.starts)
    if count is None:
        yield "its size is a variable which is no structural parameter"
    elif not 0 < count <= MOST:
        yield f"has {count} elements"
    elif given not in (0, 1, count) and v.type != "Clock":
        yield f"has {count} elements and {given} start values"


def _identities(d: Description) -> Iterator[str]:
    """In FMI 3.0 one variable is independent, and a value reference is that of one variable."""
    if d.fmi != 3:
        return
    times = [v.name for v in d.variables if v.causality == "independent"]
    if len(times) != 1:
        yield f"there must be one independent variable (usually time), not {some(times) or 'none'}"
    for group in d.aliases():
        yield f"{some([v.name for v in group])}: share the value reference {group[0].reference}"
