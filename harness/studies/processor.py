# SPDX-License-Identifier: BSD-2-Clause
"""Cost of an FMU on a flight processor, and comparison of its bits.

FMUs of one system perform its default run together, each on an emulated processor of its own. All
published signals are compared with the run in the simulation. A completed run is stored in the
cache, so that an interrupted long list can be continued.
"""

from __future__ import annotations

import hashlib
import json
import math
import re
import subprocess
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from functools import cache as once
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.errors import UsageError
from harness.files import cache, paths
from harness.files.archive import read_all
from harness.master.calls import Cost, cost
from harness.master.changes import apply
from harness.master.simulation import Simulation
from harness.remote.firmware import Processor, Sizes, find_processor, sizes
from harness.results.result import Result
from harness.spelling import columns
from harness.ssp.library import load
from harness.system.model import Origin, System
from harness.system.swap import find_fmu

PATIENCE = 600.0
"""Limit for an answer [s]: an emulator on a busy machine is slow, above all while it plans."""


class Place(NamedTuple):
    """Component as which an FMU is run; swapped: it replaces the FMU of the system."""

    system: str
    component: str
    fmu: Path
    swapped: bool


def compute_costs(  # noqa: PLR0913 - every one is an option of the command line
    fmus: Sequence[str],
    processors: Sequence[str],
    *,
    place: str | None = None,
    stop: float | None = None,
    clock: float | None = None,
    notify: Callable[[Row], object] = lambda row: None,
) -> list[Row]:
    """Return a row for every FMU, given by name or path, on every processor.

    place: `SYSTEM.COMPONENT` to replace (default: found by its name); stop [s]: of the run; clock
    [Hz]: of the processors; notify: receives every row when it is complete. Raises UsageError,
    FmuError, RunError.
    """
    if clock is not None and not 0 < clock < math.inf:
        raise UsageError(f"--clock {clock:g}: expected a frequency above 0 [Hz]")
    chosen = [find_processor(name) for name in processors]
    rows = []
    for group in groups(fmus, place):
        for row in _rows(group, chosen, stop, clock):
            rows.append(row)
            notify(row)
    order = [(find_fmu(name).stem, processor.name) for name in fmus for processor in chosen]
    return sorted(rows, key=lambda row: order.index((row.fmu, row.processor)))


def _rows(
    group: Sequence[Place], processors: Iterable[Processor], stop: float | None, clock: float | None
) -> Iterator[Row]:
    with load(group[0].system) as found:
        swap = {p.component: p.fmu for p in group if p.swapped}
        until = None if stop == found.experiment.stop else stop
        system, names = apply(found, swap=swap, stop=stop), [p.component for p in group]
        here = once(lambda: _costed_run(system)[0])
        for processor in processors:
            rows, difference, taken = _compared(system, names, processor, here)
            for part in group:
                bytes_of, costs = taken[part.component]
                step = system.component(part.component).every * (system.experiment.step or 0.0)
                place = f"{found.name}.{part.component}"
                taking = Sizes(*bytes_of), Cost(*costs), step, clock or processor.clock
                found_bits = (rows, until, difference)
                yield Row(
                    part.fmu.stem, processor.name, place, *taking, *found_bits, digest(part.fmu)
                )


# ---- groups of components


def _compared(
    system: System, components: Sequence[str], processor: Processor, here: Callable[[], Result]
) -> Any:
    """Return the comparison of a run with these components on processors, or the stored one of an
    earlier run with the same files and emulator: compared rows, the first difference, and by
    component its sizes and costs.
    """
    place = f"{processor.name}?timeout={PATIENCE:g}"
    moved = apply(system, on=dict.fromkeys(components, place))
    command = [processor.emulator[0], "--version"]
    version = subprocess.run(command, capture_output=True, check=True).stdout
    key = b"\0".join([_mark(system), _mark(moved), version])

    def make(path: Path) -> None:
        result, costs = _costed_run(moved, components)
        taken = {c: (sizes(system.component(c).fmu, processor), costs[c]) for c in components}
        found = len(result.time), _difference(here(), result), taken
        path.write_text(json.dumps(found), encoding="utf-8")

    return json.loads(cache.made("costs.json", key, make).read_text(encoding="utf-8"))


def _costed_run(system: System, linked: Sequence[str] = ()) -> tuple[Result, dict[str, Cost]]:
    """Return the result of a run, and the cost of the steps of these components."""
    with Simulation(system) as simulation:
        simulation.advance()
        costs = {i.name: cost(i.calls) for i in simulation.instances if i.name in linked}
        return simulation.result(), costs


def _difference(needed: Result, result: Result) -> str:
    """Return the first difference of two tables; "" if all bits are equal."""
    unlike = needed.values.view(np.uint64) != result.values.view(np.uint64)
    if not unlike.any():
        return ""
    row = int(unlike.any(axis=1).argmax())
    return f"{needed.columns[int(unlike[row].argmax())]} at {needed.time[row]:g} s"


def _mark(system: System) -> bytes:
    """Return a key of everything that a run depends on, without the places of files."""
    files = [component.fmu.read_bytes() for component in system.components]
    parts = tuple(replace(c, fmu=Path(c.fmu.name)) for c in system.components)
    text = repr(replace(system, components=parts, declared={}, origin=Origin()))
    return b"\0".join([text.encode(), *files])


def digest(fmu: Path) -> str:
    """Return the first digits of the hash of the C code of an FMU, without comments."""
    about = hashlib.sha256()
    for name, content in sorted(read_all(fmu).items()):
        if name.startswith("sources/") and name.endswith((".c", ".h")):
            code = re.sub(rb"/\*.*?\*/", b" ", content, flags=re.DOTALL)
            about.update(b"\0".join([name.encode(), b" ".join(code.split())]))
    return about.hexdigest()[:12]


# ---- places


def groups(fmus: Sequence[str], place: str | None) -> list[list[Place]]:
    """Return the places for FMUs, by name or path, that one run serves: FMUs of a system run
    together, an FMU that replaces another one runs alone.

    place: `SYSTEM.COMPONENT` (default: found by the name of the FMU). Raises UsageError.
    """
    found: dict[object, list[Place]] = {}
    for each in _places(fmus, place):
        found.setdefault(each.fmu if each.swapped else each.system, []).append(each)
    return list(found.values())


def _places(fmus: Sequence[str], place: str | None) -> Iterator[Place]:
    homes = {} if place else _homes()
    for name in fmus:
        path = find_fmu(name)
        if not place and path.stem not in homes:
            raise UsageError(f"{path.stem}: no system contains this FMU; add --as SYSTEM.COMPONENT")
        system, component = homes[path.stem] if not place else place.rpartition(".")[::2]
        if not system:
            raise UsageError(f"--as {place}: expected SYSTEM.COMPONENT")
        with load(system) as found:
            there = {c.name: c.fmu for c in found.components}
            if component not in there:
                raise UsageError(f"--as {place}: {found.name} has only {', '.join(there)}")
            yield Place(system, component, path, there[component].read_bytes() != path.read_bytes())


def _homes() -> dict[str, tuple[str, str]]:
    """Return the system and component for an FMU by its name. A component with this FMU is
    preferred to one that it can replace, then the system with the fewest components, then the first
    name.
    """
    own: dict[str, tuple[str, str]] = {}
    others: dict[str, tuple[str, str]] = {}
    with ExitStack() as opened:
        systems = [(name, opened.enter_context(load(name))) for name in paths.systems()]
        for name, system in sorted(systems, key=lambda each: (len(each[1].components), each[0])):
            for component in system.components:
                own.setdefault(component.fmu.stem, (name, component.name))
            for alternative in system.alternatives:
                others.setdefault(alternative.fmu, (name, alternative.component))
    return others | own


# ---- table as text


class Row(NamedTuple):
    """FMU on a processor.

    place: its system.component; period: of its steps [s]; clock: of the processor [Hz]; rows:
    number of compared rows; until: end of the run [s] (None: of the default run); difference: where
    the bits first differ from this machine ("": nowhere); sources: digest of the C code.
    """

    fmu: str
    processor: str
    place: str
    sizes: Sizes
    cost: Cost
    period: float
    clock: float
    rows: int
    until: float | None
    difference: str
    sources: str

    @property
    def share(self) -> float:
        """Return the share of a period that the longest step takes, at one instruction per
        cycle.
        """
        return self.cost.largest / self.clock / self.period

    def cells(self) -> Iterator[str]:
        """Yield the cells of the table."""
        s, c = self.sizes, self.cost
        yield from (self.fmu, self.processor, self.place)
        yield from map(_grouped, (s.code, s.constants, s.data + c.memory, c.stack))
        yield from map(_grouped, (round(c.mean), c.largest))
        yield f"{c.when:g}"
        yield f"{self.clock / 1e6:g}"
        yield f"{float(f'{100 * self.share:.2g}'):g}"
        yield self.verdict()
        yield self.sources

    def verdict(self) -> str:
        """Return whether the bits are equal, and for what part of the run."""
        if self.difference:
            return f"no: {self.difference}"
        span = "" if self.until is None else f" (to {self.until:g} s)"
        return f"yes, {_grouped(self.rows)} rows{span}"


HEAD = (
    *("FMU", "processor", "runs as", "code", "constants", "data", "stack"),
    *("instructions", "at most", "at t [s]", "clock [MHz]", "share [%]", "equal bits", "sources"),
)


def _grouped(number: int) -> str:
    return f"{number:,}".replace(",", " ")


def table(rows: Sequence[Row]) -> str:
    """Return the rows as text."""
    return "\n".join(columns([HEAD, *(tuple(row.cells()) for row in rows)]))
