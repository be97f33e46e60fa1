# SPDX-License-Identifier: BSD-2-Clause
"""Runs in one child process, so that an FMU that is not ours costs one line and no rows.

The rows stand in memory that both processes share: whatever ends the child, every macro step that
was complete is kept. Systems of our own FMUs run in this process.
"""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.errors import FmuError, HarnessError, InterruptionError, RunError
from harness.files import signals
from harness.files.paths import is_ours
from harness.master import simulation as here
from harness.master.child import GRACE_SECONDS, OUTCOME, Block, Child, Send, array, block, context
from harness.master.pacer import Pacer
from harness.master.progress import Watch, shown
from harness.master.simulation import Simulation
from harness.results.result import Result
from harness.system.model import System

_log = logging.getLogger("harness")

PATIENCE = 60.0
"""How long an FMU that is not ours may take for one call where many runs wait for it [s]."""

BEGUN, PACE, OVER = "begun", "pace", "over"
"""Messages: the initial row stands, with the names of the calls of a macro step; the time of one
[s] and how well the pacer was followed; the last row stands, or the error that has ended the run.
"""


def simulate(  # noqa: PLR0913 - every one is an option of the command line
    system: System,
    *,
    executor: str = "c",
    every: int | None = None,
    progress: bool | Watch = False,
    in_process: bool = False,
    patience: float = math.inf,
    pacer: Pacer | None = None,
) -> Result:
    """Run a system as it is, with foreign FMUs in a child process unless in_process; the arguments
    are those of run().
    """
    if in_process or all_ours(system):
        how: Any = {"executor": executor, "every": every, "progress": progress}
        return here.simulate(system, pacer=pacer, **how)
    with _Run(system, executor, every, patience, pacer) as run:
        return run.result(progress)


def all_ours(system: System) -> bool:
    """Whether every FMU of a system is one of the project."""
    return all(is_ours(c.fmu) for c in system.components)


def timed(
    system: System, every: int | None = 1, patience: float = math.inf, executor: str = "c"
) -> tuple[Result, float]:
    """The result of a run in a child process, and the time of a macro step of its quickest stretch
    [s].

    patience: how long one FMI call may take; then the process is ended [s].
    """
    with _Run(system, executor, every, patience) as run:
        return run.result(progress=False), run.simulation.pace


def guarded(fmus: Iterable[Path], function: Callable[..., Any], *arguments: Any) -> Any:
    """The value of a function that calls these FMUs, in a child process if one is not ours.

    Raises what the function raises, and FmuError if its process ends.
    """
    if all(map(is_ours, fmus)):
        return function(*arguments)
    return in_child(function, *arguments)


def in_child(function: Callable[..., Any], *arguments: Any) -> Any:
    """The value of a function that is called in a child process; FmuError if that ends."""
    with Child(_call, function, *arguments) as child:
        for kind, content in child.messages():
            if kind == OUTCOME:
                error, value = content
                child.report_output()
                if error is not None:
                    raise error
                return value
    instance, call = child.place
    raise FmuError(f"{instance}: {call} {child.end()}")


def _call(_send: Send, function: Callable[..., Any], *arguments: Any) -> Any:
    return function(*arguments)


class _Order(NamedTuple):
    """What the child is to run, and the memory for its rows."""

    system: System
    how: dict[str, Any]
    table: Block
    marks: Block

    def simulation(self) -> Simulation:
        """One that fills this memory."""
        with silence():  # the parent has said it already
            made = Simulation(self.system, **self.how)
        self.share(made)
        return made

    def share(self, simulation: Simulation) -> None:
        """Let a simulation record there."""
        recorder = simulation.recorder
        recorder.keep_in(
            array(self.table, recorder.table.shape, np.float64),
            array(self.marks, recorder.marks.shape, np.int64),
        )


class _Run:
    """The run as seen from here: a Simulation that is never entered, whose rows a child fills."""

    def __init__(
        self,
        system: System,
        executor: str,
        every: int | None,
        patience: float = math.inf,
        pacer: Pacer | None = None,
    ) -> None:
        how: Any = {"executor": executor, "every": every, "pacer": pacer}
        self.simulation = Simulation(system, **how)
        recorder = self.simulation.recorder
        memory = block(recorder.table.nbytes), block(recorder.marks.nbytes)
        self._order = _Order(system, how, *memory)
        self._order.share(self.simulation)
        self.calls: list[tuple[str, str]] | None = None
        self.error: Exception | None = None
        self.over = self.closed = False
        self.watch = _Watch(patience)

    def __enter__(self) -> _Run:
        forked = context().get_start_method() == "fork"
        ready = self.simulation if forked else None  # a fork needs no second one
        self.child = Child(_run, self._order, ready)
        return self

    def __exit__(self, *_: object) -> None:
        self.child.__exit__()

    def result(self, progress: bool | Watch) -> Result:
        """The rows when the child has ended; RunError with the rows so far, FmuError."""
        simulation = self.simulation
        try:
            with shown(simulation, progress) as show:
                self._follow(show)
        except KeyboardInterrupt:
            self._interrupt()
        self._judge()
        return simulation.result()

    def _follow(self, show: Callable[[int], None] | None, seconds: float = float("inf")) -> None:
        for kind, content in self.child.messages(seconds):
            if kind == BEGUN:
                self.calls = content
            elif kind == PACE:
                self.simulation.pace, self.simulation.timing = content
            elif kind == OVER:
                self.over, self.error = True, content
            elif kind == OUTCOME:
                self.error = self.error or content[0]
                self.over = self.closed = True
            if show is not None and self.calls is not None:
                show(self.simulation.step)
            signals.check()
            if self.watch.is_stuck((self.simulation.recorder.marks.tobytes(), self.child.place)):
                self.child.kill()

    def _interrupt(self) -> None:
        """Ask the child to stop, and end it if it does not or the user insists."""
        if not self.over:
            self.simulation.recorder.stop()
            try:
                self._follow(None, GRACE_SECONDS)
            except KeyboardInterrupt:
                _log.debug("interrupted again")
        self.child.kill()
        self.closed = True
        if not self.over:
            simulation = self.simulation
            self.error = InterruptionError(simulation.system.name, simulation.time)

    def _judge(self) -> None:
        """Raise what has ended the run early; a complete run is not lost to what came after it."""
        self.simulation.recorder.mend()
        complete = self.calls is not None and self.simulation.step == self.simulation.steps
        if self.closed:
            self.child.report_output()
        elif self.over or complete:
            instance, call = self.child.place
            _log.warning("%s: %s %s; the run was over", instance, call, self._end())
        else:
            self.error = self._crash()
        if isinstance(self.error, RunError) and self.calls is not None:
            self.error.partial = self.simulation.result(str(self.error))
        if self.error is not None:
            raise self.error

    def _crash(self) -> HarnessError:
        simulation = self.simulation
        instance, call = self.child.place
        if self.calls is not None and 0 <= simulation.recorder.call < len(self.calls):
            instance, call = self.calls[simulation.recorder.call]
        return RunError(
            instance or simulation.system.name, simulation.time, f"{call} {self._end()}"
        )

    def _end(self) -> str:
        """In what way the child has ended."""
        return self.watch.verdict or self.child.end()


class _Watch:
    """Looks whether anything changes; patience: for how long nothing may [s]."""

    def __init__(self, patience: float) -> None:
        self.patience, self.verdict = patience, ""
        self._seen: object = None
        self._since = time.monotonic()

    def is_stuck(self, state: object) -> bool:
        """Whether the state has been the same for too long; the verdict says so."""
        now = time.monotonic()
        if state != self._seen:
            self._seen, self._since = state, now
        elif now - self._since > self.patience:
            self.verdict = f"has not returned for {self.patience:g} s"
        return bool(self.verdict)


# ---- in the child


def _run(send: Send, order: _Order, ready: Simulation | None) -> None:
    """Run the system into shared memory; the outcome is sent before the FMUs are freed."""
    simulation = order.simulation() if ready is None else ready
    recorder = simulation.recorder

    def obey(_: int) -> None:
        if recorder.stopped:
            raise KeyboardInterrupt

    with simulation:
        try:
            simulation.advance(to=0)
            send(BEGUN, simulation.calls())
            simulation.advance(progress=obey)
        except RunError as error:
            send(OVER, error)
        else:
            send(PACE, (simulation.pace, simulation.timing))
            send(OVER, None)


@contextmanager
def silence() -> Iterator[None]:
    """Say nothing of what there is to note."""
    disabled, _log.disabled = _log.disabled, True
    try:
        yield
    finally:
        _log.disabled = disabled
