# SPDX-License-Identifier: BSD-2-Clause
"""Macro steps at the pace of a clock. Each step begins at an absolute deadline, so that delays do
not add up.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from harness.errors import UsageError

SLICE = 0.1
"""Longest sleep between two checks for Ctrl-C [s]."""


class Timing(NamedTuple):
    """Timing of the macro steps of a paced run.

    factor: simulated seconds per second; steps: macro steps begun; mean, p99, largest: delay of the
    begin of a step after its deadline, over the steps for which the pacer had to wait [s];
    overruns: number of steps that began late because the previous step took too long; longest:
    largest delay of such a step [s]; drift: delay of the last step [s].
    """

    factor: float
    steps: int
    mean: float
    p99: float
    largest: float
    overruns: int
    longest: float
    drift: float

    def __str__(self) -> str:
        jitter = f"{1e3 * self.mean:.3g}, {1e3 * self.p99:.3g}, {1e3 * self.largest:.3g} ms"
        overruns = f"{self.overruns} overruns"
        if self.overruns:
            overruns += f", the longest {1e3 * self.longest:.3g} ms"
        return (
            f"{self.factor:g} times real time, {self.steps} steps, jitter {jitter} (mean, p99, "
            f"largest), {overruns}, the last step {1e3 * self.drift:.3g} ms late"
        )


class Pacer:
    """Pacer that delays the beginning of every macro step until the step is due by a clock."""

    def __init__(
        self,
        factor: float,
        clock: Callable[[], float] = time.perf_counter,
        sleep: Callable[[float], object] = time.sleep,
    ) -> None:
        """Set the pace. factor: simulated seconds per second, above 0; clock: function that returns
        the time [s]; sleep: function that waits for some seconds. Raise UsageError for another
        factor.
        """
        if not 0 < factor < math.inf:
            raise UsageError(f"--realtime {factor:g}: expected a factor above 0")
        self.factor, self._clock, self._sleep = factor, clock, sleep
        self._origin: float | None = None
        self._late: list[float] = []
        self._waited: list[bool] = []

    def wait(self, seconds: float, look: Callable[[], object]) -> None:
        """Wait until the clock has advanced by `seconds` of simulated time since the start of the
        run, which the first call defines. look: called about every SLICE seconds, to check for
        Ctrl-C.
        """
        if self._origin is None:
            self._origin = self._clock() - seconds / self.factor
        due = self._origin + seconds / self.factor
        early = self._clock() < due
        while (left := due - self._clock()) > 0:
            self._sleep(min(left, SLICE))
            look()
        self._late.append(self._clock() - due)
        self._waited.append(early)

    def timing(self) -> Timing:
        """Return the timing of the macro steps so far."""
        late, waited = np.array(self._late), np.array(self._waited, dtype=bool)
        waited[:1] = True  # the first step defines the start, so it is no overrun
        jitter = late[waited] if waited.any() else np.zeros(1)
        mean, p99, largest = map(float, (jitter.mean(), np.percentile(jitter, 99), jitter.max()))
        over, drift = late[~waited], float(late[-1]) if len(late) else 0.0
        overruns, longest = len(over), float(over.max(initial=0.0))
        steps = len(late)
        return Timing(self.factor, steps, mean, p99, largest, overruns, longest, drift)
