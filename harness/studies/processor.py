# SPDX-License-Identifier: BSD-2-Clause
"""Computing cost of FMUs on emulated flight processors, and bitwise comparison of their outputs
with the outputs on this machine.

The FMUs that belong to one system run together in the default run of this system, each on its own
emulated processor. All recorded variables are compared with a run on this machine alone. The
outcome of every completed run is stored in the cache, so that an interrupted command does not
repeat completed runs.
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
"""Limit for one answer of an emulator [s]. Guidance that plans a trajectory takes longest; the
limit is long enough for this on a busy machine.
"""


class Place(NamedTuple):
    """Place of an FMU in a system, as the component `component`; swapped: whether the FMU
    replaces another FMU, which the system has for this component.
    """

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
    """Run every FMU on every processor, and return a row with its cost for each combination.

    fmus: names or paths; processors: names; place: `SYSTEM.COMPONENT` in whose place the FMU runs
    (default: a component with this FMU or this alternative); stop: end of the run [s] (default:
    of the system); clock: frequency of the processors [Hz] (default: of each processor); notify:
    called with every row when it is complete. Raises UsageError, FmuError, RunError.
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
    """Run components of a system on emulated processors and compare the run with a run on this
    machine alone. If the cache has the outcome for the same files and emulator, no run is made.

    here: function that returns the result of the run on this machine. Returns the number of
    compared rows, the first difference ("": none), and by component a pair (sizes, cost).
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
    """Run a system; return its result, and by component the computing cost of the steps of the
    components in `linked`, which run on processors.
    """
    with Simulation(system) as simulation:
        simulation.advance()
        costs = {i.name: cost(i.calls) for i in simulation.instances if i.name in linked}
        return simulation.result(), costs


def _difference(needed: Result, result: Result) -> str:
    """Return a text with the variable and the time at which two results first differ in a bit; ""
    if they are equal.
    """
    unlike = needed.values.view(np.uint64) != result.values.view(np.uint64)
    if not unlike.any():
        return ""
    row = int(unlike.any(axis=1).argmax())
    return f"{needed.columns[int(unlike[row].argmax())]} at {needed.time[row]:g} s"


def _mark(system: System) -> bytes:
    """Return a cache key of all data that determine a run: the description of the system and the
    contents of its FMUs, but not the folders of the files.
    """
    files = [component.fmu.read_bytes() for component in system.components]
    parts = tuple(replace(c, fmu=Path(c.fmu.name)) for c in system.components)
    text = repr(replace(system, components=parts, declared={}, origin=Origin()))
    return b"\0".join([text.encode(), *files])


def digest(fmu: Path) -> str:
    """Return the first twelve hexadecimal digits of the SHA-256 of the C code of an FMU. Comments
    and repeated blanks do not count.
    """
    about = hashlib.sha256()
    for name, content in sorted(read_all(fmu).items()):
        if name.startswith("sources/") and name.endswith((".c", ".h")):
            code = re.sub(rb"/\*.*?\*/", b" ", content, flags=re.DOTALL)
            about.update(b"\0".join([name.encode(), b" ".join(code.split())]))
    return about.hexdigest()[:12]


# ---- places


def groups(fmus: Sequence[str], place: str | None) -> list[list[Place]]:
    """Return the place of every FMU, in groups that share one run: the FMUs of one system form a
    group, but an FMU that replaces another FMU is a group by itself.

    fmus: names or paths; place: `SYSTEM.COMPONENT` (default: a component with this FMU or this
    alternative). Raises UsageError.
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
                raise UsageError(
                    f"--as {place}: {found.name} has only the components {', '.join(there)}"
                )
            yield Place(system, component, path, there[component].read_bytes() != path.read_bytes())


def _homes() -> dict[str, tuple[str, str]]:
    """Return for every FMU, by name, the system and component in whose place it runs by default: a
    component that has the FMU, or else a component that lists the FMU as an alternative. Of several
    systems, the one with the fewest components is chosen, then the first in the alphabet.
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
    """Cost of an FMU on a processor, and the comparison of its outputs with this machine.

    place: `SYSTEM.COMPONENT` in whose place the FMU ran; sizes: sizes of its program; cost:
    instructions and memory of its steps; period: time between two steps [s]; clock: frequency of
    the processor [Hz]; rows: number of compared rows; until: end of the run [s] (None: of the
    default run); difference: variable and time at which the bits first differ ("": nowhere);
    sources: digest of the C code.
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
        """Return the share of the period that the longest step takes, if the processor executes one
        instruction per clock cycle.
        """
        return self.cost.largest / self.clock / self.period

    def cells(self) -> Iterator[str]:
        """Yield the cells of this row of the table, in the order of HEAD."""
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
        """Return as text whether all bits are equal, with the number of compared rows, or where
        they first differ.
        """
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
    """Return the rows as a table of text with the headings HEAD."""
    return "\n".join(columns([HEAD, *(tuple(row.cells()) for row in rows)]))
