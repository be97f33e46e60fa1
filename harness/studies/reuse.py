# SPDX-License-Identifier: BSD-2-Clause
"""Reuse of one simulation by a process that runs a system many times. The FMUs of this package stay
loaded between runs. A run with third-party FMUs takes place in a separate process, which ends with
the run.
"""

from __future__ import annotations

import atexit
import logging
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from itertools import groupby, islice
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
"""Smallest number of macro steps of all runs together for which it saves time to compile the
library of lanes (several runs at once in vector registers).
"""
ROWS_TOGETHER = 5 * 2**28
"""Limit for the recorded rows of the runs that a process makes at once [bytes]. Up to four runs at
once are always allowed.
"""

_retained: dict[Any, ReusedSimulation] = {}


def retained(key: object, make: Callable[[], Any]) -> Any:
    """Return the object that this process reuses for all runs with the same key. For a new key,
    close the object of the earlier key and create a new one by `make`.
    """
    if key not in _retained:
        close()
        _retained[key] = make()
    return _retained[key]


@atexit.register
def close() -> None:
    """Close the simulation that this process has retained for further runs, if there is one."""
    while _retained:
        _retained.popitem()[1].close()


@contextmanager
def retaining() -> Iterator[None]:
    """Allow runs inside the block to retain a simulation; close it at the end of the block."""
    try:
        yield
    finally:
        close()


@contextmanager
def quietly() -> Iterator[None]:
    """Suppress warnings inside the block, because they were logged once before the first run."""
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
    """Check systems before their runs: return an error for each component whose FMU rejects values
    that are the same in every run. If there is no error, log the warnings about the systems, and
    compile them if the executor is `fused`.

    ready: each system with the outcome of its check; fixed: values that are the same in all runs,
    by parameter, as typed; varied: names of the parameters that vary; patience: limit for one call
    into a third-party FMU [s].
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
    """Compile the library of lanes of a fused system in the background while the `with` block runs.
    Do nothing if the library exists, the system has third-party FMUs, or the runs are short.

    changes: changes of one of the runs; steps: macro steps of all runs together; fewer than LONG
    count as short.
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
    """Return a text that is equal for two runs whose changes differ in parameter values only."""
    return repr({name: value for name, value in changes.items() if name != "set"})


def alike(part: Sequence[Changes], most: Callable[[], int]) -> Iterator[list[int]]:
    """Yield lists of indices of runs whose changes differ in parameter values only.

    part: changes of the runs; most: function that returns the largest length of the next list.
    """
    kinds = [kind(changes) for changes in part]
    for _, same in groupby(sorted(range(len(part)), key=kinds.__getitem__), kinds.__getitem__):
        while group := list(islice(same, most())):
            yield group


class ReusedSimulation:
    """System with a simulation that is created for the first run and reused for all later runs.

    pace: computing time per macro step in the fastest part of the last run [us]; _alone, _in_lanes:
    computing time per macro step of the last single run and of the last run made in a lane [s].
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

        every: macro steps per row; patience: limit for one call into a third-party FMU [s]; needed:
        variables to record (None: all). Only executor `fused` without third-party FMUs omits other
        variables; it gives a Reading.
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
        """Return the system with the changes of a run. Requirements that are the same as in the
        last run are not checked again, unless the run swaps FMUs: a swap may remove variables that
        the requirements need.
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
        """Make several runs at once, one in each lane of vector registers; return for each run a
        result or None. None means that the run must be made alone by run(): a value is rejected,
        the run does not complete in its lane, an FMU is third-party, or the library of lanes is
        missing or slower than single runs.

        part: changes of the runs, which differ in parameter values only; every, needed: as for
        run(). A result is valid until the next call.
        """
        results: list[Result | None] = [None] * len(part)
        if self.width < 2:
            return results
        begun: dict[int, Simulation] = {}
        for place, changes in enumerate(part):
            with suppress(HarnessError):  # the run is then made alone and reports the error
                changed = rest(self._changed(changes))
                if begun or isolated.all_ours(changed):  # checked once: all runs have equal FMUs
                    begun[place] = self._begun(place, changed, every, needed)
        compiled = self._lanes() if begun else None
        complete = [] if compiled is None else compiled.advance([*begun.values()])
        for place, good in zip(begun, complete, strict=False):
            each = begun[place]
            self._in_lanes, self.pace = each.pace, 1e6 * each.pace
            each.recorder.temporary = True
            if good:
                results[place] = Reading(each.result(), each.graph.slots, each.last())
        return results

    @property
    def width(self) -> int:
        """Return the number of runs that together() can make at once; 1 before the first run, and
        if the library of lanes is missing or slower than single runs.
        """
        compiled = None if self._in_lanes > self._alone else self._lanes()
        if compiled is None or self._simulation is None:
            return 1
        fitting = ROWS_TOGETHER // self._simulation.recorder.table.nbytes
        return min(compiled.width, max(4, fitting))

    def _lanes(self) -> Lanes | None:
        """Return the library of lanes for the fused system of the simulation; None if the cache has
        none.
        """
        whole = None if self._simulation is None else self._simulation.fused
        if whole is not None and (self._library is None or self._library[0] is not whole):
            path = library(whole.interface.path)
            self._library = (whole, Lanes(path)) if path else None
        return self._library[1] if whole is not None and self._library else None

    def _begun(
        self, place: int, system: System, every: int, needed: Collection[str] | None
    ) -> Simulation:
        """Return the simulation for the lane `place`, after the first macro step of its run. The
        simulations of all lanes share the compiled system.
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
    """Result of a run that recorded only some variables. It notes which variables are read, so that
    the run can be repeated if a variable that was not recorded is read.

    recorded: result with the recorded variables; slots: all variables of the system; last: last
    values of all variables; read: names of the variables read so far, all names after an access to
    `values`. Columns, units and descriptions include the variables that are not recorded.
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
        """Return whether a variable has been read that the run did not record."""
        return not self.read.issubset(map(base, self.recorded.columns))

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        if name not in self:
            return super().__getitem__(name)
        self.read.add(base(name))
        return self.recorded[name]

    @property
    def values(self) -> Any:
        """Return the rows of the recorded variables, and note that all variables were read."""
        self.read.update(map(base, self.columns))
        return self.recorded.values

    @values.setter
    def values(self, _: Any) -> None:
        """Ignore the assignment by the base class, because `values` returns the recorded rows."""
