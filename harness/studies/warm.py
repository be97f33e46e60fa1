# SPDX-License-Identifier: BSD-2-Clause
"""What a process has that runs a system again and again: one simulation for our own FMUs, which
stays; a run with others is flown in a process of its own, which does not.
"""

from __future__ import annotations

import math
from contextlib import ExitStack
from pathlib import Path

from harness.master import isolated
from harness.master.changes import Changes, apply
from harness.master.simulation import Simulation
from harness.results.result import Result
from harness.ssp.library import load
from harness.system.model import System


class Warm:
    """A system with its simulation, which is made for the first run that needs it.

    pace: time of a macro step of the last run, of its quickest stretch [us].
    """

    def __init__(self, system: str | Path) -> None:
        self._life = ExitStack()
        self.system = self._life.enter_context(load(system))
        self._simulation: Simulation | None = None
        self.pace = math.nan

    def fly(self, changes: Changes, every: int = 1, patience: float = math.inf) -> Result:
        """One run; raises what run() raises.

        patience: how long an FMU that is not ours may take for one call [s].
        """
        changed = apply(self.system, **changes)
        if isolated.all_ours(changed):
            result, pace = self._here(changed, every)
        else:
            result, pace = isolated.timed(changed, every, patience)
        self.pace = 1e6 * pace
        return result

    def _here(self, system: System, every: int) -> tuple[Result, float]:
        if self._simulation is None:
            self._simulation = self._life.enter_context(Simulation(system))
        return self._simulation.fly_system(system, every=every), self._simulation.pace

    def close(self) -> None:
        """End the simulation and remove what was unpacked for it."""
        self._life.close()
