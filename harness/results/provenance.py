# SPDX-License-Identifier: BSD-2-Clause
"""Provenance of a result: everything that is needed to repeat its run, as plain data.

A provenance is made from the System of the run, stored with the Result in its files, and compared
with the provenance of another run.
"""

from __future__ import annotations

import json
import os
import platform
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache
from hashlib import sha256
from typing import Any, NamedTuple, get_origin, get_type_hints

import msgspec

from harness import __version__
from harness.errors import UsageError
from harness.files.output import command_line
from harness.system.interface import Interface
from harness.system.model import Swap, System
from harness.system.tables import Count, Number, problems
from harness.system.values import parse, too_deep

SCHEMA = 1
"""Version of the content of results files, see docs/release.md; files without a number have 1."""
OF_A_RUN = ("command", "date", "executor", "platform")
"""Fields of a Provenance that describe a run and not its system."""
LAST_SECOND = 253402300799
"""Last second of the year 9999, in seconds since 1970."""


class Slot(NamedTuple):
    """Component with the name of its FMU, its period (macro steps per step), and its latency in
    macro steps.
    """

    component: str
    fmu: str
    every: int
    latency: int


@dataclass(frozen=True)
class Provenance:
    """Settings of a run.

    version: of this package; system: name of the system; mission: name of its mission; source: name
    or path of the system as the user gave it; sha256: of the .ssp ("": the system was made in
    Python); params: parameter set or file; params_sha256: of the file; set: (`component.variable`,
    value), the value as the user gave it, a text or of another type; swaps: FMUs that replaced the
    FMU of a component; on: (component, place) as in the option --on, for moved components;
    maps: (name in the FMU, name in the system) of mapped ports; latency: (component, macro steps)
    as given; algorithm, step [s], stop [s], epoch (UTC of t = 0, "": none), schedule, executor,
    every (macro steps per recorded row): values in the run; requirements: (name, text); command:
    command line (None: run from Python); date: UTC at which the result was made; platform: of the
    host; schema: version of the content of the file.
    """

    version: str = ""
    system: str = ""
    mission: str = ""
    source: str = ""
    sha256: str = ""
    params: str | None = None
    params_sha256: str = ""
    set: tuple[tuple[str, Any], ...] = ()
    swaps: tuple[Swap, ...] = ()
    on: tuple[tuple[str, str], ...] = ()
    maps: tuple[tuple[str, str], ...] = ()
    latency: tuple[tuple[str, int], ...] = ()
    algorithm: str = ""
    step: Number | None = None
    stop: Number | None = None
    epoch: str = ""
    schedule: tuple[Slot, ...] = ()
    requirements: tuple[tuple[str, str], ...] = ()
    executor: str = ""
    every: Count = 1
    command: str | None = None
    date: str = ""
    platform: str = ""
    schema: Count = SCHEMA

    def changes(self) -> dict[str, Any]:
        """Return the keyword arguments of run() that, with the same system, repeat the run."""
        changes: dict[str, Any] = {
            "params": self.params,
            "set": dict(self.set),
            "swap": {swap.component: swap.fmu for swap in self.swaps},
            "map": dict(self.maps),
            "on": dict(self.on),
            "latency": dict(self.latency),
            "step": self.step,
            "stop": self.stop,
            "algorithm": self.algorithm or None,
            "epoch": self.epoch or None,
        }
        return {name: value for name, value in changes.items() if value not in (None, {})}

    @property
    def time_units(self) -> str:
        """Return the units of the time by the CF conventions: seconds, with the date of t = 0 if
        the run has an epoch.
        """
        return f"seconds since {self.epoch}" if self.epoch else "s"

    def lines(self) -> Iterator[str]:
        """Yield the settings of the run as lines of text."""
        source = f" from {self.source}" if self.source not in ("", self.system) else ""
        digest = f", sha256 {self.sha256[:12]}" if self.sha256 else ", made in Python"
        yield f"system {self.system}{source}{digest}"
        yield f"changed: {'; '.join(_changed(self)) or 'nothing'}"
        thinned = f", every {self.every} steps recorded" if self.every > 1 else ""
        span = f"stop {_g(self.stop)} s, macro step {_g(self.step)} s"
        yield f"{span}, {self.algorithm}{thinned}"
        if self.epoch:
            yield f"t = 0 is {self.epoch} UTC"
        yield f"harness {self.version}, {self.date}, {self.platform}"
        if self.command:
            yield f"command: {self.command}"


def run_provenance(system: System, executor: str, every: int) -> Provenance:
    """Return the provenance of a run of a system, with the present time as its date. every: macro
    steps per recorded row.
    """
    origin, experiment = system.origin, system.experiment
    given = {
        name: getattr(origin, name) for name in ("source", "sha256", "params", "params_sha256")
    }
    given |= {
        name: tuple(getattr(origin, name).items()) for name in ("set", "maps", "on", "latency")
    }
    given |= {name: getattr(experiment, name) for name in ("algorithm", "step", "stop", "epoch")}
    return Provenance(
        **given,
        version=__version__,
        system=system.name,
        mission=system.mission,
        swaps=tuple(origin.swaps.values()),
        schedule=tuple(Slot(c.name, c.fmu.stem, c.every, c.latency) for c in system.components),
        requirements=tuple(system.requirements.items()),
        executor=executor,
        every=every,
        command=command_line(),
        date=now(),
        platform=_platform(),
    )


def whole_provenance(system: System, interfaces: Mapping[str, Interface]) -> dict[str, Any]:
    """Return a dict with the provenance of a system that is written as one FMU: version of this
    package; date of the newest of its FMUs (or SOURCE_DATE_EPOCH); provenance, a dict with
    parameter set, changes, schedule and FMUs. interfaces: interface by name of the component.
    """
    settings = table(run_provenance(system, "", system.experiment.every))
    fixed = {k: v for k, v in settings.items() if k not in OF_A_RUN and v not in ("", [])}
    models = [interfaces[c.name].model for c in system.components]
    fmus = [
        {
            "component": component.name,
            "fmu": component.fmu.name,
            "guid": model.guid,
            "version": model.version,
            "sha256": sha256(component.fmu.read_bytes()).hexdigest(),
        }
        for component, model in zip(system.components, models, strict=True)
    ]
    newest = max(model.generationDateAndTime or "" for model in models)
    date = now() if os.environ.get("SOURCE_DATE_EPOCH") or not newest else newest
    return {"version": __version__, "date": date, "provenance": {**fixed, "fmus": fmus}}


@lru_cache
def _platform() -> str:
    return f"{platform.platform()}, Python {platform.python_version()}"


def now() -> str:
    """Return the current date and time in UTC, or the instant in SOURCE_DATE_EPOCH for reproducible
    files; raise UsageError if its value is not a second of the years 1970 to 9999.
    """
    if not (given := os.environ.get("SOURCE_DATE_EPOCH", "")):
        moment = datetime.now(UTC)
    elif re.fullmatch(r"\d{1,12}", given, re.ASCII) and int(given) <= LAST_SECOND:
        moment = datetime.fromtimestamp(int(given), UTC)
    else:
        raise UsageError(
            f"SOURCE_DATE_EPOCH={given[:40]}: expected whole seconds since 1970, at most "
            f"{LAST_SECOND}"
        )
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


# ---- as a table


KINDS = get_type_hints(Provenance, include_extras=True)
"""Types of the fields of a Provenance by name."""
PLAIN = {name for name, kind in KINDS.items() if get_origin(kind) is not tuple}
"""Names of the fields of a Provenance that are a text or a number; all other fields are tuples."""


def table(provenance: Provenance) -> dict[str, Any]:
    """Return the fields of a provenance by name, as texts, numbers and lists of lists; fields that
    are None are omitted.
    """
    found = {name: getattr(provenance, name) for name in KINDS}
    return {
        name: value if name in PLAIN else [list(row) for row in value]
        for name, value in found.items()
        if value is not None
    }


def from_table(given: Mapping[str, Any]) -> Provenance:
    """Return the provenance for a dict that table() made; raise ValueError if its schema is newer
    than SCHEMA or a field has a wrong type. Fields may be added without a new schema, so unknown
    fields are ignored.
    """
    if _field("schema", given.get("schema", SCHEMA)) > SCHEMA:
        raise ValueError(
            f"schema {given['schema']} is newer than {SCHEMA}, the newest that servicing-fmus "
            f"{__version__} reads: install a newer version"
        )
    return Provenance(**{name: _field(name, given[name]) for name in KINDS.keys() & given.keys()})


def _field(name: str, value: Any) -> Any:
    """Return the value of a field, as read from a file, in the type of this field in Provenance;
    raise ValueError if it has another type.
    """
    if too_deep(value):
        raise ValueError(f"{name}: lists are nested too deeply")
    for problem in problems(value, KINDS[name], name):
        raise ValueError(problem)
    return msgspec.convert(value, KINDS[name])


def flat(provenance: Provenance) -> dict[str, str | float]:
    """Return table(provenance) with lists replaced by JSON texts, for files that store only texts
    and numbers.
    """
    return {
        name: value if name in PLAIN else json.dumps(value)
        for name, value in table(provenance).items()
    }


def from_flat(given: Mapping[str, Any]) -> Provenance:
    """Return the provenance for a dict that flat() made."""
    return from_table({name: _unpacked(name, value) for name, value in given.items()})


def _unpacked(name: str, value: Any) -> Any:
    """Convert a field of a results file to its Python value: JSON text to a list, a number of numpy
    to a number of Python.
    """
    if name in KINDS.keys() - PLAIN:
        try:
            return json.loads(value)
        except (TypeError, ValueError, RecursionError) as error:
            raise ValueError(f"{name}: expected a list as JSON ({error})") from error
    if hasattr(value, "item"):
        value = value.item()
    return int(value) if isinstance(value, float) and value.is_integer() else value


# ---- as text


def _changed(p: Provenance) -> Iterator[str]:
    if p.params is not None:
        yield f"params {p.params}"
    yield from (f"{s.component} swapped for {s.fmu} ({s.sha256[:12]})" for s in p.swaps)
    yield from (f"{component} on {place}" for component, place in p.on)
    yield from (f"{name} = {value}" for name, value in p.set)
    yield from (f"{component} {steps} macro steps late" for component, steps in p.latency)
    yield from (f"port {a} mapped to {b}" for a, b in p.maps)


def _g(value: float | None) -> str:
    return "?" if value is None else f"{value:g}"


# ---- comparison


def differences(ours: Provenance | None, theirs: Provenance | None) -> list[str]:
    """Return the names of the settings that differ between two runs and influence the recorded
    values; [] if a run has no provenance. Hashes are not compared.
    """
    if ours is None or theirs is None:
        return []
    names = ("system", "params", "algorithm", "step", "stop", "epoch", "every", "maps", "schedule")
    found = [name for name in names if getattr(ours, name) != getattr(theirs, name)]
    if _values(ours) != _values(theirs):
        found.append("set")
    if [s[0] for s in ours.swaps] != [s[0] for s in theirs.swaps]:
        found.append("swap")
    return found


def _values(p: Provenance) -> dict[str, Any]:
    return {name: parse(v) if isinstance(v, str) else v for name, v in p.set}
