# SPDX-License-Identifier: BSD-2-Clause
"""Runs in a child process, so that a crash of a third-party FMU is reported and loses no rows.

The recorded rows are in memory that both processes share, so every complete macro step remains
however the child ends. simulate() needs no child if all FMUs belong to the project.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.errors import FmuError, InterruptionError, RunError
from harness.files import signals
from harness.files.paths import is_ours
from harness.master import child
from harness.master.child import GRACE_SECONDS, OUTCOME, Block, Child, Send, array, block
from harness.master.messages import noted
from harness.master.progress import Show, progress_bar
from harness.master.simulation import Simulation
from harness.results.result import Result
from harness.system.model import System

_log = logging.getLogger("harness")

PATIENCE = 60.0
"""Largest duration of one call into a third-party FMU in campaigns and comparisons [s]; a longer
call would delay all later runs.
"""

BEGUN, OVER = "begun", "over"
"""Kinds of messages from the child. BEGUN: the initial row is recorded; content: the FMI calls of a
macro step, from Simulation.calls(). OVER: the last row is recorded, or the run has ended with an
error; content: the error or None, and the computing time per macro step [s].
"""


def simulate(  # noqa: PLR0913 - every one is an option of the command line
    system: System,
    *,
    executor: str = "c",
    every: int | None = None,
    progress: bool = False,
    in_process: bool = False,
    patience: float = math.inf,
) -> Result:
    """Run a system to which all changes have been applied; third-party FMUs run in a child process
    unless in_process. executor, every, progress: as for run(); patience: largest duration of one
    FMI call [s], after which the child is killed.
    """
    how: Any = {"executor": executor, "every": every}
    if not (in_process or all_ours(system)):
        return _Run(system, how, patience).result(progress)
    with Simulation(system, **how) as simulation:
        with progress_bar(system.name, simulation.steps, progress) as show:
            simulation.advance(progress=show)
        return simulation.result()


def all_ours(system: System) -> bool:
    """Return whether every FMU of a system belongs to the project."""
    return all(is_ours(c.fmu) for c in system.components)


def timed(
    system: System, every: int | None = 1, patience: float = math.inf, executor: str = "c"
) -> tuple[Result, float]:
    """Return the result of a run in a child process, and the computing time per macro step [s],
    averaged over the fastest part of the run.

    every: macro steps per recorded row; patience: largest duration of one FMI call [s], after which
    the child is killed.
    """
    run = _Run(system, {"executor": executor, "every": every}, patience)
    return run.result(progress=False), run.simulation.pace


def guarded(fmus: Iterable[Path], function: Callable[..., Any], *arguments: Any) -> Any:
    """Return function(*arguments), which calls the FMUs in `fmus`; it runs in a child process if
    one of them is third-party.

    Raises the errors of the function, and FmuError if the child process ends before the function
    has returned.
    """
    if all(map(is_ours, fmus)):
        return function(*arguments)
    return in_child(function, *arguments)


def in_child(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return function(*arguments), called in a child process; raise the errors of the function, and
    FmuError if the child process ends before the function has returned.
    """
    with Child(_call, function, *arguments) as process:
        for kind, content in process.messages():
            if kind == OUTCOME:
                error, value = content
                process.report_output()
                if error is not None:
                    raise error
                return value
    instance, call = process.place
    place = f"{instance}: {call}" if instance else "the process of third-party FMUs"
    raise FmuError(f"{place} {process.end()}")


def _call(_send: Send, function: Callable[..., Any], *arguments: Any) -> Any:
    return function(*arguments)


class _Memory(NamedTuple):
    """Shared memory in which parent and child see the rows and the progress of a run."""

    table: Block
    progress: Block

    def share(self, simulation: Simulation) -> None:
        """Make a simulation record its rows and progress in this memory."""
        recorder = simulation.recorder
        recorder.table = array(self.table, recorder.table.shape, np.float64)
        recorder.progress = array(self.progress, recorder.progress.shape, np.int64)


class _Run:
    """Run in a child process, as the parent sees it: `simulation` in the parent loads no FMUs, and
    the child records the rows into shared memory.

    over: whether the run has ended in the child; closed: whether the FMUs are freed; verdict:
    reason why the parent killed the child, "" if the parent did not kill it.
    """

    def __init__(self, system: System, how: Any, patience: float) -> None:
        self.simulation = Simulation(system, **how)
        recorder = self.simulation.recorder
        memory = _Memory(block(recorder.table.nbytes), block(recorder.progress.nbytes))
        memory.share(self.simulation)
        ready = self.simulation if child.FORK else None  # None: the child creates a simulation
        self._order = system, how, memory, ready
        self.calls: list[tuple[str, str]] | None = None
        self.error: Exception | None = None
        self.over = self.closed = False
        self.patience, self.verdict = patience, ""
        self._seen: tuple[object, float] = None, 0.0

    def result(self, progress: bool) -> Result:
        """Wait until the child has ended and return the result; progress: show a progress bar.

        Raises RunError, with the rows recorded so far, if an FMU fails, the child crashes or the
        user stops the run, and FmuError if an FMU cannot be loaded.
        """
        name, steps = self.simulation.system.name, self.simulation.steps
        with Child(_run, *self._order) as self.child:
            try:
                with progress_bar(name, steps, progress) as show:
                    self._follow(show)
            except KeyboardInterrupt:
                self._interrupt()
            self._raise_failure()
            return self.simulation.result()

    def _follow(self, show: Show | None, seconds: float = math.inf) -> None:
        for kind, content in self.child.messages(seconds):
            if kind == BEGUN:
                self.calls = content
            elif kind == OVER:
                self.over = True
                self.error, self.simulation.pace = content
            elif kind == OUTCOME:
                self.error = self.error or content[0]
                self.over = self.closed = True
            if show is not None and self.calls is not None:
                show(self.simulation.step)
            signals.check()
            self._look()

    def _look(self) -> None:
        """Kill the child if the number of completed macro steps and the present FMI call have not
        changed for `patience` seconds.
        """
        state, now = (
            (self.simulation.recorder.progress.tobytes(), self.child.place),
            time.monotonic(),
        )
        if state != self._seen[0]:
            self._seen = state, now
        elif now - self._seen[1] > self.patience:
            self.verdict = f"has not returned for {self.patience:g} s"
            self.child.kill()

    def _interrupt(self) -> None:
        """Request a stop from the child after Ctrl-C, and kill the child if it does not react in
        time or the user repeats Ctrl-C.
        """
        simulation = self.simulation
        if not self.over:
            simulation.recorder.stop()
            try:
                self._follow(None, GRACE_SECONDS)
            except KeyboardInterrupt:
                _log.debug("interrupted again")
        self.child.kill()
        self.closed = True
        if not self.over:
            self.error = InterruptionError(simulation.system.name, simulation.time)

    def _raise_failure(self) -> None:
        """Raise the error that ended the run early. If the child failed after the last row, the run
        is valid and the failure is only logged.
        """
        simulation, recorder = self.simulation, self.simulation.recorder
        recorder.mend()
        complete = self.calls is not None and simulation.step == simulation.steps
        (instance, call), end = self.child.place, self.verdict or self.child.end()
        if self.closed:
            self.child.report_output()
        elif self.over or complete:
            _log.warning("%s: %s %s after the end of the run", instance, call, end)
        else:
            if self.calls is not None and 0 <= recorder.call < len(self.calls):
                instance, call = self.calls[recorder.call]
            name = instance or simulation.system.name
            self.error = RunError(name, simulation.time, f"{call} {end}")
        if isinstance(self.error, RunError) and self.calls is not None:
            self.error.partial = simulation.result(str(self.error))
        if self.error is not None:
            raise self.error


# ---- in the child


def _run(
    send: Send, system: System, how: Any, memory: _Memory, simulation: Simulation | None
) -> None:
    """Run the system and record into shared memory. The end of the run is reported before the FMUs
    are freed, because freeing may crash.
    """
    if simulation is None:
        with noted():  # log no notes: the parent has already logged them
            simulation = Simulation(system, **how)
        memory.share(simulation)
    recorder, error = simulation.recorder, None

    def obey(_: int) -> None:
        if recorder.stopped:
            raise KeyboardInterrupt

    with simulation:
        try:
            simulation.advance(to=0)
            send(BEGUN, simulation.calls())
            simulation.advance(progress=obey)
        except RunError as ended:
            error = ended
        send(OVER, (error, simulation.pace))
