# SPDX-License-Identifier: BSD-2-Clause
"""The model structure: outputs, derivatives, initial unknowns (FMI 2.0, 2.2.8)."""

from __future__ import annotations

from collections.abc import Iterator

from harness.files.safe_xml import XmlElement
from harness.rules.description import Declared, Description, some, twice

OUTPUTS, DERIVATIVES, INITIAL = range(3)
"""Places of the lists in Description.LISTS."""


def unknown_indices(d: Description) -> Iterator[str]:
    """Every index is that of a variable."""
    for kind, e in _entries(d):
        numbers = [d.number(e), *map(int, e.get("dependencies", "").split())]
        for number in numbers:
            if d.numbered(number) is None:
                yield f"{_place(kind, e)}: there is no variable {number}"


def repeated_entries(d: Description) -> Iterator[str]:
    """A list names a variable once."""
    for place, kind in enumerate(d.LISTS):
        for v in twice(_listed(d, place)):
            yield f"ModelStructure/{kind}: {v.name} is listed twice"


def kinds_without_dependencies(d: Description) -> Iterator[str]:
    """Kinds of dependencies come with dependencies."""
    for kind, e in _entries(d):
        if e.get("dependenciesKind") is not None and e.get("dependencies") is None:
            yield f"{_place(kind, e)}: dependenciesKind without dependencies"


def kinds_and_dependencies(d: Description) -> Iterator[str]:
    """There are as many kinds as dependencies."""
    for kind, e in _entries(d):
        given, kinds = e.get("dependencies"), e.get("dependenciesKind")
        if None not in (given, kinds) and len(given.split()) != len(kinds.split()):
            numbers = f"{len(given.split())} dependencies, {len(kinds.split())} kinds"
            yield f"{_place(kind, e)}: {numbers}"


def initial_kinds(d: Description) -> Iterator[str]:
    """In initialization a dependency is just there, or constant."""
    name = _name(d, INITIAL)
    for e in d.all(d.LISTS[name]):
        odd = set(e.get("dependenciesKind", "").split()) - {"dependent", "constant"}
        if odd:
            kinds = ", ".join(sorted(odd))
            yield f"{_place(name, e)}: dependenciesKind {kinds} is for steps only"


def outputs(d: Description) -> Iterator[str]:
    """The outputs are listed, and nothing else."""
    wanted = {v for v in d.variables if v.causality == "output"}
    yield from _difference(_name(d, OUTPUTS), wanted, set(_listed(d, OUTPUTS)))


def derivatives(d: Description) -> Iterator[str]:
    """What is listed as a derivative says of which state."""
    for v in _listed(d, DERIVATIVES):
        if v.derivative is None:
            kind = _name(d, DERIVATIVES)
            yield f"ModelStructure/{kind}: {v} does not say of which variable it is one"


def initial_unknowns(d: Description) -> Iterator[str]:
    """Listed are calculated outputs, calculated parameters, states and derivatives."""
    wanted = {v for v in d.variables if _calculated(v) and v.causality == "output"}
    wanted |= {v for v in d.variables if v.causality == "calculatedParameter"}
    for v in _listed(d, DERIVATIVES):
        state = None if v.derivative is None else d.numbered(v.derivative)
        wanted |= {each for each in (v, state) if each is not None and _calculated(each)}
    yield from _difference(_name(d, INITIAL), wanted, set(_listed(d, INITIAL)))


def _calculated(v: Declared) -> bool:
    return v.initial in ("approx", "calculated")


def _difference(kind: str, wanted: set[Declared], listed: set[Declared]) -> Iterator[str]:
    for names, what in ((wanted - listed, "does not list"), (listed - wanted, "lists, wrongly,")):
        if names:
            yield f"ModelStructure/{kind}: {what} {some(sorted(v.name for v in names))}"


def _name(d: Description, place: int) -> str:
    return list(d.LISTS)[place]


def _entries(d: Description) -> Iterator[tuple[str, XmlElement]]:
    for kind, path in d.LISTS.items():
        yield from ((kind, e) for e in d.all(path))


def _listed(d: Description, place: int) -> Iterator[Declared]:
    """Variables of a list; those that do not exist are left out."""
    for e in d.all(d.LISTS[_name(d, place)]):
        if (found := d.numbered(d.number(e))) is not None:
            yield found


def _place(kind: str, e: XmlElement) -> str:
    return f"ModelStructure/{kind} (line {e.sourceline})"
