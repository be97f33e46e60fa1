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
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from harness.errors import UsageError
from harness.files import cache, paths
from harness.master.changes import apply
from harness.master.links import Cost, cost
from harness.master.simulation import Simulation
from harness.remote.firmware import Sizes, sizes
from harness.remote.targets import TARGETS, Target, find_target
from harness.results.result import Result
from harness.ssp.library import load
from harness.studies.target_table import Row
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
        costs = {i.name: cost(i) for i in simulation.instances if i.name in linked}
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
    """System and component that an FMU flies as, else may take the place of, by its name."""
    own: dict[str, tuple[str, str]] = {}
    others: dict[str, tuple[str, str]] = {}
    for name in paths.systems():
        with load(name) as system:
            for component in system.components:
                own.setdefault(component.fmu.stem, (name, component.name))
            for alternative in system.alternatives:
                others.setdefault(alternative.fmu, (name, alternative.component))
    return others | own


def known_targets() -> list[str]:
    """Names of all processors."""
    return list(TARGETS)
