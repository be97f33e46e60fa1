# SPDX-License-Identifier: BSD-2-Clause
"""What is kept of a run: the bus at t = 0, after every N-th macro step, and at the end."""

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
"""References to a table that only its recorder holds, as this interpreter counts them."""


def recorded(steps: int, every: int) -> NDArray[np.int64]:
    """Macro steps before each row of a run: 0, every, 2 every, ..., and all of them."""
    regular = np.arange(0, steps + 1, every)
    return regular if steps % every == 0 else np.append(regular, steps)


class Recorder:
    """Table of rows x slots; row r is the bus after r * every macro steps, the last one after all.
    Thinning does not change the physics.
    """

    def __init__(
        self, steps: int, slots: int, every: int = 1, earlier: Recorder | None = None
    ) -> None:
        """Reserve room for `steps` macro steps; UsageError if every < 1 or the table does not fit
        into memory. earlier: a recorder of a run that is over, whose table is taken if it has the
        shape and nobody looks at it any more: fresh memory costs as much as many steps.
        """
        if every < 1:
            raise UsageError(f"--every must be at least 1, not {every}")
        self.steps = steps
        self.every = min(every, steps + 1)  # more means the first and the last row
        self.marks: NDArray[np.int64] = np.zeros(3, dtype=np.int64)
        rows = -(-steps // every) + 1
        self.table: NDArray[np.float64]
        if earlier is not None and earlier.table.shape == (rows, slots) and earlier.unseen:
            self.table, self.marks = earlier.table, earlier.marks
            self.done = 0
            return
        try:
            self.table = np.empty((rows, slots))
        except (MemoryError, ValueError, OverflowError) as error:
            raise UsageError(
                f"{rows} rows of {slots} values do not fit into memory: record fewer with --every"
            ) from error

    @property
    def unseen(self) -> bool:
        """Whether no result and no view shows the table."""
        return _references(self) == ALONE

    @property
    def done(self) -> int:
        """Macro steps completed."""
        return int(self.marks[0])

    @done.setter
    def done(self, steps: int) -> None:
        self.marks[0] = steps

    def mend(self) -> None:
        """Make the marks possible again, whatever foreign code has written over them."""
        self.done = min(max(self.done, 0), self.steps)

    @property
    def call(self) -> int:
        """Which call of a macro step is being made."""
        return int(self.marks[1])

    @property
    def stopped(self) -> bool:
        """Whether stop() was called, in whatever process."""
        return bool(self.marks[2])

    def stop(self) -> None:
        """Ask whoever fills the table to stop."""
        self.marks[2] = 1

    def record(self, done: int, bus: NDArray[np.float64]) -> None:
        """Note that `done` macro steps are complete and keep the bus if its row is due."""
        if done % self.every == 0 or done == self.steps:
            self.table[-(-done // self.every)] = bus
        self.done = done

    @property
    def rows(self) -> NDArray[np.float64]:
        """Everything recorded so far, shape (rows, slots)."""
        return self.table[: self._whole if self.done < self.steps else None]

    @property
    def _whole(self) -> int:
        return self.done // self.every + 1

    @property
    def macro_steps(self) -> NDArray[np.int64]:
        """Number of macro steps before each row."""
        return recorded(self.steps, self.every)[: len(self.rows)]
