# SPDX-License-Identifier: BSD-2-Clause
"""What a process has that runs a system again and again: one simulation for our own FMUs, which
stays; a run with others is flown in a process of its own, which does not.
"""

from __future__ import annotations

import atexit
import logging
import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import HarnessError
from harness.master import isolated
from harness.master.changes import Changes, apply
from harness.master.executors import FUSED
from harness.master.fused import Whole, compiled
from harness.master.simulation import Simulation
from harness.master.trial import always_refused
from harness.results.requirements import say_inconsistencies
from harness.results.result import Result
from harness.ssp.library import load
from harness.system.graph import Checked, Slot, columns, say_warnings
from harness.system.model import System
from harness.system.values import base

_log = logging.getLogger("harness")
_kept: dict[Any, Warm] = {}


def kept(key: object, make: Callable[[], Any]) -> Any:
    """What this process keeps for all runs of one task; that of an earlier task is closed."""
    if key not in _kept:
        close()
        _kept[key] = make()
    return _kept[key]


@atexit.register
def close() -> None:
    """End the simulation that this process keeps."""
    while _kept:
        _kept.popitem()[1].close()


@contextmanager
def at_work() -> Iterator[None]:
    """What a process is in while it flies one run after the other."""
    try:
        yield
    finally:
        close()


@contextmanager
def quietly() -> Iterator[None]:
    """Without warnings: what there is to say was said before the first run."""
    level = _log.level
    _log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        _log.setLevel(level)


def refused_before(
    ready: Sequence[tuple[System, Checked]],
    fixed: Mapping[str, Any],
    varied: Collection[str],
    patience: float,
    executor: str,
) -> list[HarnessError]:
    """What FMUs refuse in every run of these systems; if nothing, what there is to say of them is
    said. fixed, varied: as of always_refused().
    """
    systems = [system for system, _ in ready]
    kinds = {(s.origin.params, *s.origin.swaps.values()): s for s in reversed(systems)}
    found = list(always_refused(kinds.values(), fixed, varied, patience))
    if not found:
        say_warnings(*systems)
        say_inconsistencies(*systems)
        wholes: list[Whole | None] = []
        for system, each in ready if executor == FUSED else ():
            if not any(whole and whole.fits(system, each.graph) for whole in wholes):
                wholes.append(compiled(system, each.graph))  # said here if it cannot be
    return found


class Warm:
    """A system with its simulation, which is made for the first run that needs it.

    pace: time of a macro step of the last run, of its quickest stretch [us].
    """

    def __init__(self, system: str | Path, executor: str = "c") -> None:
        self._life = ExitStack()
        self._executor = executor
        self.system = self._life.enter_context(load(system))
        self._simulation: Simulation | None = None
        self._required: tuple[Any, System] | None = None
        self.pace = math.nan

    def fly(
        self,
        changes: Changes,
        every: int = 1,
        patience: float = math.inf,
        wanted: Collection[str] | None = None,
    ) -> Result:
        """One run; raises what run() raises.

        patience: how long an FMU that is not ours may take for one call [s]; wanted: variables that
        are to be recorded (None: all), see Simulation.fly_system(). With the executor `fused` it is
        a Reading.
        """
        changed = self._changed(changes)
        if isolated.all_ours(changed):
            result, pace = self._here(changed, every, wanted)
        else:
            result, pace = isolated.timed(changed, every, patience, self._executor)
        self.pace = 1e6 * pace
        return result

    def _changed(self, changes: Changes) -> System:
        """The system of a run; requirements that all runs are given are looked at once, unless a
        swap takes what they need.
        """
        given = changes.get("require", ())
        if not given or changes.get("swap"):
            return apply(self.system, **changes)
        if self._required is None or self._required[0] != given:
            self._required = given, apply(self.system, require=given)
        others: Any = {name: value for name, value in changes.items() if name != "require"}
        return apply(self._required[1], **others)

    def _here(
        self, system: System, every: int, wanted: Collection[str] | None
    ) -> tuple[Result, float]:
        if self._simulation is None:
            made = Simulation(system, executor=self._executor)
            self._simulation = self._life.enter_context(made)
        simulation = self._simulation
        result = simulation.fly_system(system, every=every, wanted=wanted)
        if self._executor == FUSED:
            result = Reading(result, simulation.graph.slots, simulation.last())
        return result, simulation.pace

    def close(self) -> None:
        """End the simulation and remove what was unpacked for it."""
        self._life.close()


class Reading(Result):
    """A run that notes what is read of it, where not every variable needs to be recorded.

    recorded: what there is; columns, units and descriptions are those of the whole run, `last` are
    the last values of all of them; asked: variables that somebody has read, all of them where
    somebody has wanted the table itself.
    """

    recorded: Result
    last: NDArray[np.float64]
    asked: set[str]

    def __init__(self, recorded: Result, slots: Sequence[Slot], last: NDArray[np.float64]) -> None:
        self.__dict__.update(recorded=recorded, last=last, asked=set())
        names, units, texts = columns(slots)
        r = recorded
        super().__init__(
            r.system, r.time, names, units, r.values, texts, r.complete, r.message,
            r.parameters, r.provenance,
        )  # fmt: skip
        self.asked.clear()

    @property
    def missed(self) -> bool:
        """Whether something was read that is not recorded."""
        return not self.asked.issubset(map(base, self.recorded.columns))

    def __getitem__(self, name: str) -> NDArray[np.float64]:
        if name not in self:
            return super().__getitem__(name)
        self.asked.add(base(name))
        return self.recorded[name]

    @property
    def values(self) -> Any:
        """The table, of which not all may be there."""
        self.asked.update(map(base, self.columns))
        return self.recorded.values

    @values.setter
    def values(self, _: Any) -> None:
        """It is that of what was recorded."""
