# SPDX-License-Identifier: BSD-2-Clause
"""What an FMU takes of a flight processor, and whether it gives the same bits there.

FMUs of one system fly its default run together, each on an emulated processor of its own; all that
the system publishes is compared with the run in the simulation. A flight that has ended is kept in
the cache, so that a long list goes on where it was interrupted.
"""

from __future__ import annotations

import json
import math
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
from harness.master.calls import Cost, cost
from harness.master.changes import apply
from harness.master.simulation import Simulation
from harness.remote.firmware import Sizes, sizes
from harness.remote.targets import TARGETS, Target, find_target
from harness.results.result import Result
from harness.spelling import columns
from harness.ssp.library import load
from harness.system.model import Origin, System
from harness.system.swap import find_fmu

PATIENCE = 600.0
"""For an answer [s]: an emulator on a busy machine is slow, above all with a plan, not silent."""


class Place(NamedTuple):
    """What an FMU flies as; swapped: it takes the place of the FMU that is there."""

    system: str
    component: str
    fmu: Path
    swapped: bool


def measure(  # noqa: PLR0913 - every one is an option of the command line
    fmus: Sequence[str],
    targets: Sequence[str],
    *,
    place: str | None = None,
    stop: float | None = None,
    clock: float | None = None,
    said: Callable[[Row], object] = lambda row: None,
) -> list[Row]:
    """A row for every FMU, given by name or path, on every processor.

    place: `SYSTEM.COMPONENT` to fly it as (default: found by its name); stop [s]: of the run; clock
    [Hz]: of the processors; said: hears every row as it comes. Raises UsageError, FmuError,
    RunError.
    """
    if clock is not None and not 0 < clock < math.inf:
        raise UsageError(f"--clock {clock:g}: expected a frequency above 0 [Hz]")
    chosen = [find_target(name) for name in targets]
    rows = []
    # FMUs of a system as it is fly together; who is swapped flies alone
    flights: dict[object, list[Place]] = {}
    for each in _places(fmus, place):
        flights.setdefault(each.fmu if each.swapped else each.system, []).append(each)
    for flight in flights.values():
        for row in _rows(flight, chosen, stop, clock):
            rows.append(row)
            said(row)
    order = [(find_fmu(name).stem, target.name) for name in fmus for target in chosen]
    return sorted(rows, key=lambda row: order.index((row.fmu, row.target)))


def _rows(
    flight: Sequence[Place], targets: Iterable[Target], stop: float | None, clock: float | None
) -> Iterator[Row]:
    with load(flight[0].system) as found:
        swap = {p.component: p.fmu for p in flight if p.swapped}
        until = None if stop == found.experiment.stop else stop
        system, names = apply(found, swap=swap, stop=stop), [p.component for p in flight]
        here = once(lambda: _flown(system)[0])
        for target in targets:
            rows, difference, taken = _compared(system, names, target, here)
            for part in flight:
                bytes_of, costs = taken[part.component]
                step = system.component(part.component).every * (system.experiment.step or 0.0)
                place = f"{found.name}.{part.component}"
                taking = Sizes(*bytes_of), Cost(*costs), step, clock or target.clock
                yield Row(part.fmu.stem, target.name, place, *taking, rows, until, difference)


# ---- flights


def _compared(
    system: System, components: Sequence[str], target: Target, here: Callable[[], Result]
) -> Any:
    """Of a flight with these components on processors, or kept of an earlier one of the same files
    by the same emulator: rows compared with the flight here, where they first differ, and by
    component its sizes and costs.
    """
    place = f"{target.name}?timeout={PATIENCE:g}"
    moved = apply(system, on=dict.fromkeys(components, place))
    key = b"\0".join([_mark(system), _mark(moved), _version(target.emulator[0])])

    def make(path: Path) -> None:
        result, costs = _flown(moved, components)
        taken = {c: (sizes(system.component(c).fmu, target), costs[c]) for c in components}
        found = len(result.time), _difference(here(), result), taken
        path.write_text(json.dumps(found), encoding="utf-8")

    return json.loads(cache.made("flown.json", key, make).read_text(encoding="utf-8"))


def _flown(system: System, linked: Sequence[str] = ()) -> tuple[Result, dict[str, Cost]]:
    """Result of a run, and what the steps of these components have cost."""
    with Simulation(system) as simulation:
        simulation.advance()
        costs = {i.name: cost(i.calls) for i in simulation.instances if i.name in linked}
        return simulation.result(), costs


def _difference(wanted: Result, result: Result) -> str:
    """Where two tables differ first; "" if all bits are equal."""
    unlike = wanted.values.view(np.uint64) != result.values.view(np.uint64)
    if not unlike.any():
        return ""
    row = int(unlike.any(axis=1).argmax())
    return f"{wanted.columns[int(unlike[row].argmax())]} at {wanted.time[row]:g} s"


def _mark(system: System) -> bytes:
    """All that a run depends on, wherever its files are."""
    files = [component.fmu.read_bytes() for component in system.components]
    parts = tuple(replace(c, fmu=Path(c.fmu.name)) for c in system.components)
    said = repr(replace(system, components=parts, declared={}, origin=Origin()))
    return b"\0".join([said.encode(), *files])


def _version(program: str) -> bytes:
    return subprocess.run([program, "--version"], capture_output=True, check=True).stdout


# ---- places
def _places(fmus: Sequence[str], place: str | None) -> Iterator[Place]:
    homes = {} if place else _homes()
    for name in fmus:
        path = find_fmu(name)
        if not place and path.stem not in homes:
            raise UsageError(f"{path.stem}: no system has this FMU; name --as SYSTEM.COMPONENT")
        system, component = homes[path.stem] if not place else place.rpartition(".")[::2]
        if not system:
            raise UsageError(f"--as {place}: expected SYSTEM.COMPONENT")
        with load(system) as found:
            there = {c.name: c.fmu for c in found.components}
            if component not in there:
                raise UsageError(f"--as {place}: {found.name} has only {', '.join(there)}")
            yield Place(system, component, path, there[component].read_bytes() != path.read_bytes())


def _homes() -> dict[str, tuple[str, str]]:
    """System and component that an FMU flies as, else may take the place of, by its name: of the
    systems that have it the one of fewest components, the first of them by name.
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


# ---- the table, for reading and as a page


class Row(NamedTuple):
    """One FMU on one processor.

    place: system.component that it flew as; period: of its steps [s]; clock: of the processor
    [Hz]; rows: that were compared; until: end of the flight [s] (None: of the default run);
    difference: where the bits first differ from those of this machine ("": nowhere).
    """

    fmu: str
    target: str
    place: str
    sizes: Sizes
    cost: Cost
    period: float
    clock: float
    rows: int
    until: float | None
    difference: str

    @property
    def share(self) -> float:
        """Part of a period that the dearest step takes, at one instruction per cycle."""
        return self.cost.largest / self.clock / self.period

    def cells(self) -> Iterator[str]:
        """What the table says of it."""
        s, c = self.sizes, self.cost
        yield from (self.fmu, self.target, self.place)
        yield from map(_grouped, (s.code, s.constants, s.data + c.memory, c.stack))
        yield from map(_grouped, (round(c.mean), c.largest))
        yield f"{c.when:g}"
        yield f"{self.clock / 1e6:g}"
        yield f"{float(f'{100 * self.share:.2g}'):g}"
        yield self.verdict()

    def verdict(self) -> str:
        """Whether the bits are equal, and of how much of the run that is said."""
        if self.difference:
            return f"no: {self.difference}"
        span = "" if self.until is None else f" (to {self.until:g} s)"
        return f"yes, {_grouped(self.rows)} rows{span}"


HEAD = (
    *("FMU", "processor", "runs as", "code", "constants", "data", "stack"),
    *("instructions", "at most", "at t [s]", "clock [MHz]", "share [%]", "equal bits"),
)


def _grouped(number: int) -> str:
    return f"{number:,}".replace(",", " ")


def table(rows: Sequence[Row]) -> str:
    """The rows for reading."""
    return "\n".join(columns([HEAD, *(tuple(row.cells()) for row in rows)]))


def markdown(rows: Iterable[Row]) -> str:
    """The page of the rows."""
    named = list(TARGETS)
    order = sorted(rows, key=lambda row: (row.fmu, named.index(row.target)))
    body = [HEAD, ("---",) * len(HEAD), *(tuple(row.cells()) for row in order)]
    head = Path(__file__).with_suffix(".md").read_text(encoding="utf-8")
    return head + "".join(f"| {' | '.join(cells)} |\n" for cells in body)
