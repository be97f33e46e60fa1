# SPDX-License-Identifier: BSD-2-Clause
"""The FMU as a whole: identity, default experiment, log categories, annotations, and what lies
where in its archive (FMI 2.0, 2.3).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

from harness.files.safe_xml import XmlElement
from harness.rules.description import Description, twice

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
    tops = dict.fromkeys(name.partition("/")[0] for name in d.files)
    yield from (
        f"{top}: has no place at the top of the archive" for top in tops if top not in d.ROOT
    )


def missing_sources(d: Description) -> Iterator[str]:
    """Every source file that is listed is there."""
    there = set(d.files)
    for name in dict.fromkeys(d.sources):
        if f"sources/{name}" not in there:
            yield f"the source file sources/{name} is listed, but not in the archive"
