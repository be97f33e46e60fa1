# SPDX-License-Identifier: BSD-2-Clause
"""Reuse of a simulation by a process that runs a system again and again. Our own FMUs stay loaded;
a run with third-party FMUs has a process of its own, which ends with the run.
"""

from __future__ import annotations

import atexit
import logging
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.files.cache import with_second_try
from harness.master import fused, isolated, lanes
from harness.master.changes import Changes, apply
from harness.master.executors import FUSED
from harness.master.lanes import Lanes, library
from harness.master.remainder import rest
from harness.master.simulation import Simulation
from harness.results.requirements import log_inconsistencies
from harness.results.result import Result
from harness.ssp.library import load
from harness.studies.check import always_rejected
from harness.system.graph import Checked, Slot, checked, columns, log_warnings
from harness.system.model import System
from harness.system.values import base

_log = logging.getLogger("harness")

LONG = 5_000_000
"""Macro steps of many runs from which the library of lanes is compiled for them."""
ROWS_TOGETHER = 2**30
"""Bytes of the rows that a process records at once; more than four runs must not exceed them."""

_retained: dict[Any, ReusedSimulation] = {}


def retained(key: object, make: Callable[[], Any]) -> Any:
    """Return the object that this process retains for all runs of one task, closing the one of an
    earlier task.
    """
    if key not in _retained:
        close()
        _retained[key] = make()
    return _retained[key]


@atexit.register
def close() -> None:
    """Close the retained simulation of this process."""
    while _retained:
        _retained.popitem()[1].close()


@contextmanager
def retaining() -> Iterator[None]:
    """Close the retained simulation at the end of the block."""
    try:
        yield
    finally:
        close()


@contextmanager
def quietly() -> Iterator[None]:
    """Suppress warnings inside the block; they were logged before the first run."""
    level = _log.level
    _log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        _log.setLevel(level)


def rejected_before(
    ready: Sequence[tuple[System, Checked]],
    fixed: Mapping[str, Any],
    varied: Collection[str],
    patience: float,
    executor: str,
) -> list[HarnessError]:
    """Return the values that FMUs reject in every run of these systems; log the notes on the
    systems if there are none. fixed, varied: as for always_rejected().
    """
    systems = [system for system, _ in ready]
    kinds = {(s.origin.params, *s.origin.swaps.values()): s for s in reversed(systems)}
    found = list(always_rejected(kinds.values(), fixed, varied, patience))
    if not found:
        log_warnings(*systems)
        log_inconsistencies(*systems)
        prepared: list[object] = []
        for system, each in ready if executor == FUSED else ():
            if (structure := fused.structure(system, each.graph)) not in prepared:
                prepared.append(structure)
                fmus = [component.fmu for component in system.components]
                isolated.guarded(fmus, fused.prepare, system, each.graph)
    return found


@contextmanager
def compiling(system: str | Path, changes: Changes, steps: int) -> Iterator[None]:
    """Compile the library of lanes of a fused system in the background for runs of so many macro
    steps together, unless it is there, they are few, or the system has FMUs of third parties.
    """
    if steps < LONG:
        yield
        return
    with quietly(), load(system) as found:
        changed = apply(found, **changes)
        ours = isolated.all_ours(changed)
        whole = fused.compiled(changed, checked(changed).graph) if ours else None
    if whole is None or library(whole.interface.path):
        yield
        return
    with lanes.compiling(whole.interface.path):
        yield


def kind(changes: Changes) -> str:
    """Return a text of the changes of a run that are not values."""
    return repr({name: value for name, value in changes.items() if name != "set"})


class ReusedSimulation:
    """System with its simulation, which is created for the first run that needs it.

    pace: time of a macro step in the quickest stretch of the last run [us]; alone, in_lanes: the
    same of the last run of each kind [s].
    """

    def __init__(self, system: str | Path, executor: str = "c") -> None:
        self._source, self._executor = system, executor
        self.pace = math.nan
        self._open()

    def _open(self) -> None:
        self._life = ExitStack()
        self.system = with_second_try(lambda: self._life.enter_context(load(self._source)))
        self._simulation: Simulation | None = None
        self._others: list[Simulation] = []
        self._library: tuple[fused.Whole, Lanes] | None = None
        self._alone, self._in_lanes = math.inf, 0.0
        self._required: tuple[Any, System] | None = None

    def _reopen(self) -> None:
        self.close()
        self._open()

    def run(
        self,
        changes: Changes,
        every: int = 1,
        patience: float = math.inf,
        needed: Collection[str] | None = None,
    ) -> Result:
        """Return the result of one run; raise the errors of `harness.run`.

        patience: limit for one call into a third-party FMU [s]; needed: variables to record
        (None: all), see Simulation.run_system(). With the executor `fused` the result is a Reading.
        """
        return with_second_try(lambda: self._run(changes, every, patience, needed), self._reopen)

    def _run(
        self, changes: Changes, every: int, patience: float, needed: Collection[str] | None
    ) -> Result:
        changed = rest(self._changed(changes))
        if isolated.all_ours(changed):
            result, pace = self._here(changed, every, needed)
        else:
            result, pace = isolated.timed(changed, every, patience, self._executor)
        self.pace = 1e6 * pace
        return result

    def _changed(self, changes: Changes) -> System:
        """Return the system of a run. Requirements that all runs share are checked once, unless a
        swap removes what they need.
        """
        given = changes.get("require", ())
        if not given or changes.get("swap"):
            return apply(self.system, **changes)
        if self._required is None or self._required[0] != given:
            self._required = given, apply(self.system, require=given)
        others: Any = {name: value for name, value in changes.items() if name != "require"}
        return apply(self._required[1], **others)

    def _here(
        self, system: System, every: int, needed: Collection[str] | None
    ) -> tuple[Result, float]:
        if self._simulation is None:
            made = Simulation(system, executor=self._executor)
            self._simulation = self._life.enter_context(made)
        simulation = self._simulation
        result = simulation.run_system(system, every=every, recorded=needed)
        if self._executor == FUSED:
            result = Reading(result, simulation.graph.slots, simulation.last())
        self._alone = simulation.pace
        return result, simulation.pace

    def together(
        self, part: Sequence[Changes], every: int, needed: Collection[str] | None
    ) -> list[Result | None]:
        """Return the results of runs that differ in values only, in the lanes of vectors; None for
        a run that has to be made alone, as all have with an FMU of third parties, without a library
        or with one that is slower. A result is valid until the next call.

        needed: as for run().
        """
        results: list[Result | None] = [None] * len(part)
        if self.width < 2:
            return results
        begun: dict[int, Simulation] = {}
        for place, changes in enumerate(part):
            with suppress(HarnessError):  # made alone, the run reports it
                changed = rest(self._changed(changes))
                if begun or isolated.all_ours(changed):  # they all have the same FMUs
                    begun[place] = self._begun(place, changed, every, needed)
        compiled, complete = self._lanes(), list[bool]()
        if compiled is not None and begun:
            complete = compiled.advance([*begun.values()])
        for place, good in zip(begun, complete, strict=False):
            each = begun[place]
            self._in_lanes, self.pace = each.pace, 1e6 * each.pace
            if good:
                results[place] = Reading(each.result(), each.graph.slots, each.last())
        return results

    @property
    def width(self) -> int:
        """Return the runs that together() makes at once at present."""
        compiled = None if self._in_lanes > self._alone else self._lanes()
        if compiled is None or self._simulation is None:
            return 1
        fitting = ROWS_TOGETHER // self._simulation.recorder.table.nbytes
        return min(compiled.width, max(4, fitting))

    def _lanes(self) -> Lanes | None:
        """Return the library of the present compiled system, if it is in the cache."""
        whole = None if self._simulation is None else self._simulation.fused
        if whole is not None and (self._library is None or self._library[0] is not whole):
            path = library(whole.interface.path)
            self._library = (whole, Lanes(path)) if path else None
        return self._library[1] if whole is not None and self._library else None

    def _begun(
        self, place: int, system: System, every: int, needed: Collection[str] | None
    ) -> Simulation:
        """Return the simulation of a lane after the first macro step of a run. All simulations
        share the compiled system.
        """
        first = self._simulation
        assert first is not None
        while len(self._others) < place:
            made = Simulation(first.system, executor=FUSED)
            self._others.append(self._life.enter_context(made))
        simulation = self._others[place - 1] if place else first
        simulation.fused = first.fused
        simulation.begin(system, every, needed)
        simulation.advance(to=1)
        return simulation

    def close(self) -> None:
        """End the simulation and remove its unpacked files."""
        self._life.close()


class Reading(Result):
    """Result that notes which variables are read, for runs that record only some.

    recorded: the recorded variables; columns, units and descriptions are complete; `last` has the
    last values of all variables; read: variables that were read, all of them if the whole table was
    requested.
    """

    recorded: Result
    last: NDArray[np.float64]
    read: set[str]

    def __init__(self, recorded: Result, slots: Sequence[Slot], last: NDArray[np.float64]) -> None:
        self.__dict__.update(recorded=recorded, last=last, read=set())
        names, units, texts, modes = columns(slots)
        r = recorded
        super().__init__(
            r.system, r.time, names, units, r.values, texts, r.complete, r.message,
            r.parameters, r.provenance, modes,
        )  # fmt: skip
        self.read.clear()

    @property
    def missed(self) -> bool:
        """Return whether a variable was read that is not recorded."""
        return not self.read.issubset(map(base, self.recorded.columns))

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        if name not in self:
            return super().__getitem__(name)
        self.read.add(base(name))
        return self.recorded[name]

    @property
    def values(self) -> Any:
        """Return the recorded columns, and note that all variables were read."""
        self.read.update(map(base, self.columns))
        return self.recorded.values

    @values.setter
    def values(self, _: Any) -> None:
        """Ignore the assignment; the table is the recorded one."""
