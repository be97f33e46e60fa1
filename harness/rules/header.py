# SPDX-License-Identifier: BSD-2-Clause
"""The FMU as a whole: identity, default experiment, log categories, annotations, what lies where in
its archive (FMI 2.0, 2.3), and the model structure: outputs, derivatives, initial unknowns (2.2.8).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from harness.files.archive import XmlElement
from harness.rules.description import Declared, Description, twice
from harness.spelling import some

_BARE_GUID = re.compile(r"[0-9a-fA-F]{8}(-[0-9a-fA-F]{4}){3}-[0-9a-fA-F]{12}")


def bad_identifier(d: Description) -> Iterator[str]:
    """The name of the library is one, not a path."""
    for name in _identifiers(d):
        if not name or set(name) & set("/\\:\0") or name in (".", ".."):
            yield f"modelIdentifier '{name}' is not the name of a library"


def odd_identifier(d: Description) -> Iterator[str]:
    """The model identifier is a C identifier, since functions are named by it."""
    for name in _identifiers(d):
        if name and not re.fullmatch(r"[A-Za-z_]\w*", name, re.ASCII):
            yield f"modelIdentifier '{name}' is not a C identifier"


def _identifiers(d: Description) -> Iterator[str]:
    for kind in ("CoSimulation", "ModelExchange", "ScheduledExecution"):
        yield from (e.get("modelIdentifier") for e in d.all(kind))


def empty_name(d: Description) -> Iterator[str]:
    """The model has a name."""
    if not d.root.get("modelName", "").strip():
        yield "modelName is empty"


def empty_guid(d: Description) -> Iterator[str]:
    """There is a guid, by which binary and description recognise each other."""
    if not d.guid.strip():
        yield f"{d.GUID} is empty"


def bare_guid(d: Description) -> Iterator[str]:
    """A guid that is a UUID stands in braces."""
    if _BARE_GUID.fullmatch(d.root.get("guid", "")):
        yield f"guid {d.root.get('guid')} has no braces"


def repeated_interface(d: Description) -> Iterator[str]:
    """Co-simulation and model exchange are described once each."""
    for kind in ("CoSimulation", "ModelExchange"):
        if len(d.all(kind)) > 1:
            yield f"there are {len(d.all(kind))} elements {kind}"


def stop_before_start(d: Description) -> Iterator[str]:
    """The default experiment ends after it begins."""
    start, stop = float(d.experiment.get("startTime", "0")), d.experiment.get("stopTime")
    if stop is not None and not float(stop) > start:
        yield f"DefaultExperiment: stopTime {stop} does not lie after startTime {start:g}"


def step_not_positive(d: Description) -> Iterator[str]:
    """The step of the default experiment is positive."""
    yield from _not_positive(d, "stepSize")


def tolerance_not_positive(d: Description) -> Iterator[str]:
    """The tolerance of the default experiment is positive."""
    yield from _not_positive(d, "tolerance")


def _not_positive(d: Description, name: str) -> Iterator[str]:
    text = d.experiment.get(name)
    if text is not None and not 0 < float(text) < math.inf:
        yield f"DefaultExperiment: {name} {text} is not a positive number"


def time_not_finite(d: Description) -> Iterator[str]:
    """Start and stop of the default experiment are finite."""
    for name in ("startTime", "stopTime"):
        if not math.isfinite(float(d.experiment.get(name, "0"))):
            yield f"DefaultExperiment: {name} {d.experiment.get(name)} is not finite"


def repeated_log_categories(d: Description) -> Iterator[str]:
    """Log categories have names of their own."""
    names = [e.get("name") for e in d.all("LogCategories/Category")]
    yield from (f"the log category {name} is listed twice" for name in twice(names))


def repeated_vendor_tools(d: Description) -> Iterator[str]:
    """A tool annotates the model, or one variable, once."""
    for place, owner in _annotated(d):
        tools = [e.get("name") for e in owner.iterfind("Tool")]
        yield from (f"{place}: the tool {name} is listed twice" for name in twice(tools))


def _annotated(d: Description) -> Iterator[tuple[str, XmlElement]]:
    yield from (("VendorAnnotations", e) for e in d.all("VendorAnnotations"))
    for variable in d.variables:
        yield from ((str(variable), e) for e in variable.element.iterfind("Annotations"))


def stray_files(d: Description) -> Iterator[str]:
    """Nothing but what the standard names lies at the top."""
    for top in dict.fromkeys(name.partition("/")[0] for name in d.files):
        if top not in d.ROOT:
            yield f"{top}: has no place at the top of the archive"


def missing_sources(d: Description) -> Iterator[str]:
    """Every source file that is listed is there."""
    there = set(d.files)
    for name in dict.fromkeys(d.sources):
        if f"sources/{name}" not in there:
            yield f"the source file sources/{name} is listed, but not in the archive"


# ---- model structure

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
