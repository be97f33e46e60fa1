# SPDX-License-Identifier: BSD-2-Clause
"""The model structure: outputs, derivatives, initial unknowns (FMI 2.0, 2.2.8)."""

from __future__ import annotations

from collections.abc import Iterator

from harness.files.safe_xml import XmlElement
from harness.rules.description import Declared, Description, some, twice

LISTS = ("Outputs", "Derivatives", "InitialUnknowns")


def unknown_indices(d: Description) -> Iterator[str]:
    """Every index is that of a variable."""
    for kind, e in _entries(d):
        numbers = [int(e.get("index")), *map(int, e.get("dependencies", "").split())]
        for number in numbers:
            if not 1 <= number <= len(d.variables):
                yield f"{_place(kind, e)}: there is no variable {number}"


def repeated_entries(d: Description) -> Iterator[str]:
    """A list names a variable once."""
    for kind in LISTS:
        for v in twice(_listed(d, kind)):
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
    for e in d.all("ModelStructure/InitialUnknowns/Unknown"):
        odd = set(e.get("dependenciesKind", "").split()) - {"dependent", "constant"}
        if odd:
            kinds = ", ".join(sorted(odd))
            yield f"{_place('InitialUnknowns', e)}: dependenciesKind {kinds} is for steps only"


def outputs(d: Description) -> Iterator[str]:
    """The outputs are listed, and nothing else."""
    wanted = {v for v in d.variables if v.causality == "output"}
    yield from _difference("Outputs", wanted, set(_listed(d, "Outputs")))


def derivatives(d: Description) -> Iterator[str]:
    """What is listed as a derivative says of which state."""
    for v in _listed(d, "Derivatives"):
        if v.value.get("derivative") is None:
            yield f"ModelStructure/Derivatives: {v} does not say of which variable it is one"


def initial_unknowns(d: Description) -> Iterator[str]:
    """Listed are calculated outputs, calculated parameters, states and derivatives."""
    wanted = {v for v in d.variables if _calculated(v) and v.causality == "output"}
    wanted |= {v for v in d.variables if v.causality == "calculatedParameter"}
    for v in _listed(d, "Derivatives"):
        index = int(v.value.get("derivative", "0"))
        pair = (v, d.variables[index - 1]) if 1 <= index <= len(d.variables) else (v,)
        wanted |= {each for each in pair if _calculated(each)}
    yield from _difference("InitialUnknowns", wanted, set(_listed(d, "InitialUnknowns")))


def _calculated(v: Declared) -> bool:
    return v.initial in ("approx", "calculated")


def _difference(kind: str, wanted: set[Declared], listed: set[Declared]) -> Iterator[str]:
    for names, what in ((wanted - listed, "does not list"), (listed - wanted, "lists, wrongly,")):
        if names:
            yield f"ModelStructure/{kind}: {what} {some(sorted(v.name for v in names))}"


def _entries(d: Description) -> Iterator[tuple[str, XmlElement]]:
    for kind in LISTS:
        yield from ((kind, e) for e in d.all(f"ModelStructure/{kind}/Unknown"))


def _listed(d: Description, kind: str) -> Iterator[Declared]:
    """Variables of a list; those that do not exist are left out."""
    for e in d.all(f"ModelStructure/{kind}/Unknown"):
        if 1 <= int(e.get("index")) <= len(d.variables):
            yield d.variables[int(e.get("index")) - 1]


def _place(kind: str, e: XmlElement) -> str:
    return f"ModelStructure/{kind} (line {e.sourceline})"
