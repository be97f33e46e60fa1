# SPDX-License-Identifier: BSD-2-Clause
"""Recorder of a run: rows with the values of all signals (the bus) at the start, after every N-th
macro step, and at the end.
"""

from __future__ import annotations

import sys
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError


def _references(holder: Any) -> int:
    return sys.getrefcount(holder.table)


ALONE = _references(SimpleNamespace(table=np.empty(0)))
"""Value of sys.getrefcount() for the table of a recorder if no other object refers to the table."""


def recorded(steps: int, every: int) -> NDArray[np.int64]:
    """Return the number of macro steps before each row of a run: 0, every, 2 every, ..., steps."""
    regular = np.arange(0, steps + 1, every)
    return regular if steps % every == 0 else np.append(regular, steps)


class Recorder:
    """Table (rows, slots) of the values of all signals. Row r is recorded after r * every macro
    steps, the last row at the end of the run. Recording fewer rows does not change the simulation.

    temporary: whether the results of the run are valid only until the next run, which may then
    overwrite the table.
    """

    temporary = False

    def __init__(
        self, steps: int, slots: int, every: int = 1, earlier: Recorder | None = None
    ) -> None:
        """Allocate a table for a run of `steps` macro steps with a row per `every` macro steps;
        raise UsageError if every < 1 or the table does not fit into memory.

        earlier: recorder of a completed run, whose table is reused if it has the same shape and
        nothing else refers to it. First use of new memory takes as long as the steps themselves.
        """
        if every < 1:
            raise UsageError(f"--every must be at least 1, not {every}")
        self.steps = steps
        self.every = min(every, steps + 1)  # all larger values give the same two rows
        self.progress: NDArray[np.int64] = np.zeros(3, dtype=np.int64)
        rows = -(-steps // every) + 1
        self.table: NDArray[np.float64]
        if earlier is not None and earlier.table.shape == (rows, slots) and earlier.unseen:
            self.table, self.progress = earlier.table, earlier.progress
            self.done = 0
            return
        try:
            self.table = np.empty((rows, slots))
        except (MemoryError, ValueError, OverflowError) as error:
            raise UsageError(
                f"{rows} rows of {slots} values do not fit into memory: record fewer "
                "rows with --every"
            ) from error

    @property
    def unseen(self) -> bool:
        """Return whether the next run may overwrite the table: no object except this recorder
        refers to it, or the results that refer to it are temporary.
        """
        return self.temporary or _references(self) == ALONE

    @property
    def done(self) -> int:
        """Return the number of completed macro steps."""
        return int(self.progress[0])

    @done.setter
    def done(self, steps: int) -> None:
        self.progress[0] = steps

    def mend(self) -> None:
        """Limit the number of completed macro steps to 0 .. steps, in case third-party code has
        overwritten the shared memory.
        """
        self.done = min(max(self.done, 0), self.steps)

    @property
    def call(self) -> int:
        """Return the index of the present FMI call among the calls of a macro step."""
        return int(self.progress[1])

    @property
    def stopped(self) -> bool:
        """Return whether stop() was called, in any process."""
        return bool(self.progress[2])

    def stop(self) -> None:
        """Request a stop from the process that fills the table."""
        self.progress[2] = 1

    def record(self, done: int, bus: NDArray[np.float64]) -> None:
        """Store the number of completed macro steps, and copy the bus into the table if a row is
        due.
        """
        if done % self.every == 0 or done == self.steps:
            self.table[-(-done // self.every)] = bus
        self.done = done

    @property
    def rows(self) -> NDArray[np.float64]:
        """Return the rows recorded so far, (rows, slots)."""
        whole = self.done // self.every + 1
        return self.table[: whole if self.done < self.steps else None]

    @property
    def macro_steps(self) -> NDArray[np.int64]:
        """Return the number of macro steps before each row."""
        return recorded(self.steps, self.every)[: len(self.rows)]
