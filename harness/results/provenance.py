# SPDX-License-Identifier: BSD-2-Clause
"""Where a result comes from: all that is needed to make it again, as plain data.

A provenance is filled from the System as it was run, travels with the Result through its files, and
is compared with that of another run.
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
from importlib.metadata import version
from typing import Any, NamedTuple, get_origin, get_type_hints

import msgspec

from harness.errors import UsageError
from harness.files.output import command_line
from harness.system.model import Swap, System
from harness.system.schema import Count, Number, problems
from harness.system.values import parse, too_deep

SCHEMA = 1
"""Version of what results files hold, see docs/release.md; files without a number have 1."""
LAST_SECOND = 253402300799
"""Of the year 9999, in seconds since 1970."""


class Slot(NamedTuple):
    """A component in its place: its FMU by name, macro steps per step, macro steps of latency."""

    component: str
    fmu: str
    every: int
    latency: int


@dataclass(frozen=True)
class Provenance:
    """What was flown.

    version: of this package; system: its name; mission: the one it belongs to; source: name or path
    as the user gave it; sha256: of the .ssp ("": the system was made in Python); params: named set
    or file, params_sha256: of the file; set: (`component.variable`, value) as given, text or value;
    swaps: other FMUs; on: (component, place) on other processors; maps: (their port, our name);
    latency: (component, macro steps) as given; algorithm, step [s], stop [s], epoch (UTC of t
    = 0, "": none), schedule, executor, every: as run; timing: how well the pace of a clock was kept
    ("": there was none); requirements: (name, text); command: command line (None: from Python);
    date: when the result was taken, UTC; platform: of the host; schema:
    version of the file's content.
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
    timing: str = ""
    command: str | None = None
    date: str = ""
    platform: str = ""
    schema: Count = SCHEMA

    def changes(self) -> dict[str, Any]:
        """The changes that make the same run of the same source, for run()."""
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
        """CF units of the time: with the date of t = 0 if there is one."""
        return f"seconds since {self.epoch}" if self.epoch else "s"

    def lines(self) -> list[str]:
        """What was flown, for reading: one fact per line."""
        return list(_lines(self))


def flown(system: System, executor: str, every: int, timing: str = "") -> Provenance:
    """Provenance of a run of a system that begins or ends now."""
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
        version=_version(),
        system=system.name,
        mission=system.mission,
        swaps=tuple(origin.swaps.values()),
        schedule=tuple(Slot(c.name, c.fmu.stem, c.every, c.latency) for c in system.components),
        requirements=tuple(system.requirements.items()),
        executor=executor,
        every=every,
        timing=timing,
        command=command_line(),
        date=now(),
        platform=_platform(),
    )


@lru_cache
def _version() -> str:
    return version("servicing-fmus")


@lru_cache
def _platform() -> str:
    return f"{platform.platform()}, Python {platform.python_version()}"


def now() -> str:
    """Date and time, or that of SOURCE_DATE_EPOCH, for files that shall be the same again;
    UsageError if that is no second of the years 1970 to 9999.
    """
    if not (given := os.environ.get("SOURCE_DATE_EPOCH", "")):
        moment = datetime.now(UTC)
    elif re.fullmatch(r"\d{1,12}", given, re.ASCII) and int(given) <= LAST_SECOND:
        moment = datetime.fromtimestamp(int(given), UTC)
    else:
        raise UsageError(
            f"SOURCE_DATE_EPOCH={given[:40]}: expected seconds since 1970, at most {LAST_SECOND}"
        )
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


# ---- as a table


KINDS = get_type_hints(Provenance, include_extras=True)
"""Fields with what stands in them."""
PLAIN = {name for name, kind in KINDS.items() if get_origin(kind) is not tuple}
"""Fields that are a text or a number; the others are lists."""


def table(provenance: Provenance) -> dict[str, Any]:
    """Fields by name with texts, numbers and lists of lists; what is None is left out."""
    found = {name: getattr(provenance, name) for name in KINDS}
    return {
        name: value if name in PLAIN else [list(row) for row in value]
        for name, value in found.items()
        if value is not None
    }


def from_table(given: Mapping[str, Any]) -> Provenance:
    """The inverse of table(); ValueError for a schema that is newer than ours. A schema stays the
    same if fields are added: those that are not known are passed over.
    """
    if _field("schema", given.get("schema", SCHEMA)) > SCHEMA:
        raise ValueError(
            f"schema {given['schema']} is newer than {SCHEMA}, the newest that servicing-fmus "
            f"{_version()} reads: install a newer version"
        )
    return Provenance(**{name: _field(name, given[name]) for name in KINDS.keys() & given.keys()})


def _field(name: str, value: Any) -> Any:
    """A field of a file; ValueError if it is not what a run has there."""
    if too_deep(value):
        raise ValueError(f"{name}: too many lists within each other")
    for problem in problems(value, KINDS[name], name):
        raise ValueError(problem)
    return msgspec.convert(value, KINDS[name])


def flat(provenance: Provenance) -> dict[str, str | float]:
    """The table with lists as JSON, for files that have texts and numbers only."""
    return {
        name: value if name in PLAIN else json.dumps(value)
        for name, value in table(provenance).items()
    }


def from_flat(given: Mapping[str, Any]) -> Provenance:
    """The inverse of flat()."""
    return from_table({name: _unpacked(name, value) for name, value in given.items()})


def _unpacked(name: str, value: Any) -> Any:
    """A list of its JSON; a number of an array of one, and as a .mat has an empty text."""
    if name in KINDS.keys() - PLAIN:
        try:
            return json.loads(value)
        except (TypeError, ValueError, RecursionError) as error:
            raise ValueError(f"{name}: expected a list as JSON ({error})") from error
    if hasattr(value, "item"):
        value = value.item() if value.size else ""
    return int(value) if isinstance(value, float) and value.is_integer() else value


# ---- for reading


def _lines(p: Provenance) -> Iterator[str]:
    source = f" from {p.source}" if p.source and p.source != p.system else ""
    digest = f", sha256 {p.sha256[:12]}" if p.sha256 else ", made in Python"
    yield f"system {p.system}{source}{digest}"
    yield f"changed: {'; '.join(_changed(p)) or 'nothing'}"
    thinned = f", every {p.every} steps recorded" if p.every > 1 else ""
    yield f"stop {_g(p.stop)} s, macro step {_g(p.step)} s, {p.algorithm}{thinned}"
    if p.epoch:
        yield f"t = 0 is {p.epoch} UTC"
    if p.timing:
        yield f"paced: {p.timing}"
    yield f"harness {p.version}, {p.date}, {p.platform}"
    if p.command:
        yield f"command: {p.command}"


def _changed(p: Provenance) -> Iterator[str]:
    if p.params is not None:
        yield f"params {p.params}"
    yield from (f"{s.component} swapped for {s.fmu} ({s.sha256[:12]})" for s in p.swaps)
    yield from (f"{component} on {place}" for component, place in p.on)
    yield from (f"{name} = {value}" for name, value in p.set)
    yield from (f"{component} {steps} macro steps late" for component, steps in p.latency)
    yield from (f"port {a} taken for {b}" for a, b in p.maps)


def _g(value: float | None) -> str:
    return "?" if value is None else f"{value:g}"


# ---- two of them


def differences(ours: Provenance | None, theirs: Provenance | None) -> list[str]:
    """What was asked for differently, by name: fields that decide on the numbers, no hashes."""
    if ours is None or theirs is None:
        return []
    names = ("system", "params", "algorithm", "step", "stop", "every", "maps", "schedule")
    found = [name for name in names if getattr(ours, name) != getattr(theirs, name)]
    if _values(ours) != _values(theirs):
        found.append("set")
    if [s[0] for s in ours.swaps] != [s[0] for s in theirs.swaps]:
        found.append("swap")
    return found


def _values(p: Provenance) -> dict[str, Any]:
    return {name: parse(v) if isinstance(v, str) else v for name, v in p.set}
