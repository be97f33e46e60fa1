# SPDX-License-Identifier: BSD-2-Clause
"""The one simulation of a process that runs a system again and again."""

from __future__ import annotations

import math
from contextlib import ExitStack
from pathlib import Path

from harness.master.changes import Changes
from harness.master.simulation import Simulation
from harness.results.result import Result
from harness.ssp.library import load


class Warm:
    """A system with a simulation that is made for its first run and then stays."""

    def __init__(self, system: str | Path) -> None:
        self._life = ExitStack()
        self.system = self._life.enter_context(load(system))
        self._simulation: Simulation | None = None

    def fly(self, changes: Changes, every: int = 1) -> Result:
        """One run; raises what run() raises."""
        if self._simulation is None:
            simulation = Simulation(self.system, **changes)
            self._simulation = self._life.enter_context(simulation)
        return self._simulation.fly(every=every, **changes)

    @property
    def pace(self) -> float:
        """Time of a macro step of the last run [us]."""
        return math.nan if self._simulation is None else 1e6 * self._simulation.pace

    def close(self) -> None:
        """End the simulation and remove what was unpacked for it."""
        self._life.close()
