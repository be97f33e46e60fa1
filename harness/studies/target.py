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
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from harness.errors import UsageError
from harness.files import cache, paths
from harness.files.output import written
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
    for flight in _flights(list(_places(fmus, place))):
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
        comparison = Comparison(apply(found, swap=swap, stop=stop), [p.component for p in flight])
        for target in targets:
            outcome = comparison.on(target)
            for part in flight:
                yield Row(
                    part.fmu.stem,
                    target.name,
                    f"{found.name}.{part.component}",
                    outcome.sizes[part.component],
                    outcome.costs[part.component],
                    comparison.period(part.component),
                    clock or target.clock,
                    outcome.rows,
                    until,
                    outcome.difference,
                )


# ---- flights
class Outcome(NamedTuple):
    """Of a flight: rows compared, where they first differ ("": nowhere), and by component what it
    takes.
    """

    rows: int
    difference: str
    sizes: Mapping[str, Sizes]
    costs: Mapping[str, Cost]


@dataclass(frozen=True)
class Comparison:
    """Runs of a system with some components on processors, and one without."""

    system: System
    components: Sequence[str]

    def period(self, component: str) -> float:
        """Of its steps [s]."""
        return self.system.component(component).every * (self.system.experiment.step or 0.0)

    @cached_property
    def wanted(self) -> Result:
        """What this machine says."""
        return _flown(self.system)[0]

    def on(self, target: Target) -> Outcome:
        """Flown, or kept of an earlier flight of the same files by the same emulator."""
        place = f"{target.name}?timeout={PATIENCE:g}"
        moved = apply(self.system, on=dict.fromkeys(self.components, place))
        key = b"\0".join([_mark(self.system), _mark(moved), _version(target.emulator[0])])

        def make(path: Path) -> None:
            path.write_text(json.dumps(self._fly(moved, target)), encoding="utf-8")

        kept = cache.made("flight.json", key, make).read_text(encoding="utf-8")
        rows, difference, bytes_of, costs = json.loads(kept)
        return Outcome(
            rows,
            difference,
            {name: Sizes(*numbers) for name, numbers in bytes_of.items()},
            {name: Cost(*numbers) for name, numbers in costs.items()},
        )

    def _fly(self, moved: System, target: Target) -> Outcome:
        result, costs = _flown(moved, self.components)
        taken = {c: sizes(self.system.component(c).fmu, target) for c in self.components}
        return Outcome(len(result.time), _difference(self.wanted, result), taken, costs)


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
def _flights(places: Sequence[Place]) -> list[list[Place]]:
    """Places that are flown together: those of a system as it is; who is swapped flies alone."""
    found: dict[object, list[Place]] = {}
    for i, place in enumerate(places):
        found.setdefault(i if place.swapped else place.system, []).append(place)
    return list(found.values())


def _places(fmus: Sequence[str], place: str | None) -> Iterator[Place]:
    homes = {} if place else _homes()
    for name in fmus:
        path = find_fmu(name)
        if not place and path.stem not in homes:
            raise UsageError(
                f"{path.stem}: no system has this FMU; name its place with --as SYSTEM.COMPONENT"
            )
        system, component = _place(place) if place else homes[path.stem]
        with load(system) as found:
            there = found.component(component).fmu.read_bytes()
        yield Place(system, component, path, there != path.read_bytes())


def _place(text: str) -> tuple[str, str]:
    system, dot, component = text.rpartition(".")
    if not dot:
        raise UsageError(f"--as {text}: expected SYSTEM.COMPONENT")
    with load(system) as found:
        if component not in (names := [c.name for c in found.components]):
            raise UsageError(f"--as {text}: {found.name} has only {', '.join(names)}")
    return system, component


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


def known_targets() -> list[str]:
    """Names of all processors."""
    return list(TARGETS)


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

PAGE = """# Flight software on flight processors

`harness target` writes this page from its runs (`make targets`: all processors). Each FMU executes
the default run of the system named, on the emulated processor and in the simulation on this
machine, up to the end unless the row names a time. FMUs of one system run together, each on its own
processor.

* Code and constants [bytes]: with the FMI adapter, without the C library.
* Data [bytes]: variables and the instance. Stack [bytes]: of the steps.
* Instructions of a step: on average, at most, and at what time.
* Share: part of the sample period, at one instruction per cycle of the clock.
* Equal bits: every value of every row of the whole system.

How to repeat it: [processors.md](processors.md).

"""


def _grouped(number: int) -> str:
    return f"{number:,}".replace(",", " ")


def table(rows: Sequence[Row]) -> str:
    """The rows for reading."""
    return "\n".join(columns([HEAD, *(tuple(row.cells()) for row in rows)]))


def markdown(rows: Iterable[Row], earlier: str = "") -> str:
    """The page of the rows, and of those of an earlier page that were not flown anew."""
    lines = {tuple(cells[:2]): cells for cells in _cells(earlier)}
    lines |= {(row.fmu, row.target): list(row.cells()) for row in rows}
    named = list(TARGETS)
    order = sorted(lines, key=lambda key: (key[0], named.index(key[1])))
    body = [HEAD, ("---",) * len(HEAD), *(lines[key] for key in order)]
    return PAGE + "".join(f"| {' | '.join(cells)} |\n" for cells in body)


def _cells(page: str) -> Iterator[list[str]]:
    """Of the rows of a page, if its columns are those of now."""
    table = [line.strip("| \n").split(" | ") for line in page.splitlines() if line[:1] == "|"]
    if table and tuple(table[0]) == HEAD:
        yield from table[2:]


def write(path: Path, rows: Iterable[Row]) -> None:
    """Write the page; what stands in it of other FMUs and processors stays. ResultsError."""
    earlier = path.read_text(encoding="utf-8") if path.is_file() else ""
    with written(path) as page:
        page.write_text(markdown(rows, earlier), encoding="utf-8")
