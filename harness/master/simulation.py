# SPDX-License-Identifier: BSD-2-Clause
"""Simulation of a system: load, initialise, step, roll back, and return the recorded rows."""

from __future__ import annotations

import ctypes
import logging
import math
from collections.abc import Collection
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, Self, Unpack

import numpy as np
from numpy.typing import NDArray

from harness.errors import InterruptionError, RejectedValueError, RunError, UsageError
from harness.files import signals
from harness.files.output import PrivateFolder
from harness.master import messages
from harness.master.changes import Changes, apply
from harness.master.executors import (
    EXECUTORS,
    FUSED,
    CExecutor,
    Clock,
    Loop,
    Stretch,
    known_executor,
)
from harness.master.fmu import Instance
from harness.master.fused import Whole, WholeInstance, compiled, slots_of
from harness.master.messages import as_typed
from harness.master.progress import Show
from harness.master.recorder import Recorder
from harness.master.steering import Ports, steered
from harness.results.provenance import now, run_provenance
from harness.results.result import Result, parameters_of
from harness.spelling import some
from harness.system.graph import Checked, Node, checked, columns, rechecked
from harness.system.model import System
from harness.system.schedule import Verb

CHUNK_SECONDS = 0.1
"""Wall-clock time between two checks for Ctrl-C and two updates of the progress bar [s]."""

MAX_ROUNDS = 200
"""Largest number of rounds in which initial values are propagated. A loop of two components with
loop gain 1/2 settles to the last bit in about half as many rounds.
"""

_log = logging.getLogger("harness")

Slots = tuple[int, ...] | None
"""Indices of the recorded slots (places of single values on the bus), in order; None: all slots."""


@dataclass(frozen=True)
class Snapshot:
    """State of the whole system after `step` macro steps: values of the bus, and one FMU state per
    instance.
    """

    step: int
    bus: NDArray[np.float64]
    states: tuple[Any, ...]
    held: tuple[bytes, ...] = ()
    """Buffers of open components (components whose outputs the user sets), with the outputs that
    they publish next.
    """


class Simulation:
    """FMUs of a system, the bus between them and the recorded rows; a context manager.

        with Simulation(system) as simulation:
            simulation.advance()
            result = simulation.result()
            other = simulation.run(set={"servicer.mass_0": 120})

    A further run resets the loaded FMUs of the project instead of loading them again; its results
    are bit-identical.
    """

    def __init__(
        self,
        system: System,
        *,
        executor: str = "c",
        every: int | None = None,
        **changes: Unpack[Changes],
    ) -> None:
        """Check the system with these changes. FMUs are loaded when the `with` block begins.

        every: record every N-th macro step (None: defined by the system). Raises StructureError,
        FmuError or UsageError.
        """
        now()  # raises UsageError for an invalid SOURCE_DATE_EPOCH before the run, not after it
        self.base = system
        self.every = every
        self.instances: list[Instance] = []
        self._executor_name = known_executor(executor)
        self.fused: Whole | None = None
        """System compiled to one FMU; None if it is not compiled."""
        self._apart = executor != FUSED
        """True if every component has an FMU of its own in this run; otherwise one FMU holds the
        whole system.
        """
        self._files: ExitStack | None = None
        self._folder: Path | None = None
        changed = apply(system, **changes)
        if changed.without and executor == FUSED:
            names = ", ".join(changed.without)
            raise UsageError(f"--open {names}: needs --executor c or python, not {executor}")
        self._lay_out(changed, checked(changed))

    def _lay_out(
        self, system: System, found: Checked, every: int | None = None, recorded: Slots = None
    ) -> None:
        """Allocate the memory of a run. every: macro steps per row (None: the value given to the
        constructor, or else the number in the system); recorded: indices of recorded slots, in
        order (None: all).
        """
        chosen = next(n for n in (every, self.every, system.experiment.every) if n is not None)
        width = len(found.graph.slots if recorded is None else recorded)
        self.recorder = Recorder(found.steps, width, chosen, getattr(self, "recorder", None))
        self.system, (self.graph, self.steps), self.recorded = system, found, recorded
        self.clock = Clock(system.experiment.start, system.experiment.step or 0.0)
        # a bus of the same width is reused, so that arrays returned by port() remain valid
        if len(getattr(self, "bus", ())) != width:
            self.bus: NDArray[np.float64] = np.zeros(width)
        self.bus[:] = 0.0
        self.pace = math.inf
        """Mean wall-clock time of a macro step [s] in the fastest block of steps so far."""
        self._initialised = False

    # ---- life

    def __enter__(self) -> Self:
        """Load and instantiate all FMUs; raise FmuError or ArchiveError if one cannot be loaded."""
        self._files = ExitStack()
        try:
            self._assemble()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Terminate and free all FMUs and remove the folders of unpacked FMUs."""
        while self.instances:
            self.instances.pop().close()
        if self._files is not None:
            self._files.close()
            self._files = self._folder = None

    # ---- a further run

    def run(
        self, *, every: int | None = None, progress: Show | None = None, **changes: Unpack[Changes]
    ) -> Result:
        """Run the system of this simulation with these changes. The result is bit-identical to
        `harness.run`.

        every: record every N-th macro step (default: as for the simulation); progress: called
        repeatedly with the number of complete steps. Raises the exceptions of harness.run(); a
        failed run does not affect the next one.
        """
        return self.run_system(apply(self.base, **changes), every=every, progress=progress)

    def run_system(
        self,
        system: System,
        *,
        every: int | None = None,
        progress: Show | None = None,
        recorded: Collection[str] | None = None,
    ) -> Result:
        """Run a system to which all changes have been applied.

        recorded: variables to record, by their names without indices (None: all). Only the executor
        `fused` omits other variables, and only if the run does not fail.
        """
        self.begin(system, every, recorded)
        try:
            self.advance(progress=progress)
            return self.result()
        finally:
            for instance in self.instances:
                messages.report_warnings(instance.name)

    def begin(
        self, system: System, every: int | None = None, recorded: Collection[str] | None = None
    ) -> None:
        """Prepare a run of `system`, which replaces the present system; initialize() must
        follow.

        FMUs of the project that are already loaded are reset; all other FMUs are loaded. Raises the
        errors of the constructor and of the beginning of the `with` block.
        """
        if self._files is None:
            raise UsageError("a Simulation can run inside its `with` block only")
        found = rechecked(system, self.system, self.graph)
        self._apart = self._executor_name != FUSED
        everything = self._apart or recorded is None
        slots = None if everything else slots_of(found.graph.slots, frozenset(recorded or ()))
        self._lay_out(system, found, every, slots)
        self._assemble()

    def _nodes(self) -> tuple[Node, ...]:
        """Return the nodes to load: one per component, or one for the whole system if the executor
        is `fused`. If the system cannot be compiled to one FMU, log the reason and use the executor
        `c`.
        """
        if self._apart:
            return self.graph.nodes
        if self.fused is None or not self.fused.fits(self.system, self.graph):
            self.fused = compiled(self.system, self.graph)
        if self.fused is None:
            self._executor_name = "c"
            self._separate()
            return self.graph.nodes
        return (self.fused.node(self.recorded),)

    def _separate(self) -> None:
        """Prepare to run from the beginning with one FMU per component, recording all variables."""
        self._apart = True
        self._lay_out(self.system, Checked(self.graph, self.steps), self.recorder.every)

    def _assemble(self) -> None:
        """Create or reuse an instance for every node, and make the executor of the run."""
        before = {instance.name: instance for instance in self.instances}
        self.instances = []
        try:
            for node in self._nodes():
                self.instances.append(self._instance(node, before))
        finally:
            for left in before.values():
                left.close()
        without = self.system.without
        plan, pause = steered(self.system.experiment.algorithm, self.instances, without)
        loop = Loop(plan, self.bus, self.recorder, self.clock, pause)
        self._executor = EXECUTORS[self._executor_name](loop)
        self._ports: Ports | None = None

    def _instance(self, node: Node, before: dict[str, Instance]) -> Instance:
        """Return the instance in `before` with the name of this node if it can be reset, else a new
        instance.
        """
        name = node.component.name
        if name in before and before[name].renew(node):
            return before.pop(name)
        if name in before:
            before.pop(name).close()
        if self._apart or self.fused is None:
            return Instance(node, self._own_folder)
        return WholeInstance(node, self._own_folder, self.fused)

    def _own_folder(self) -> Path:
        """Return the folder for unpacked FMUs outside the cache, created at the first use."""
        if self._folder is None:
            assert self._files is not None
            self._folder = self._files.enter_context(PrivateFolder())
        return self._folder

    # ---- initialization

    def initialize(self) -> None:
        """Set parameters, propagate initial values until nothing changes, and record the row at the
        start time.

        Raises RunError: a rejected parameter, a failing FMU, or an output that is not finite.
        """
        for instance in self.instances:
            if isinstance(instance, WholeInstance):
                instance.values = instance.whole.values(self.system, self.graph)
            instance.set_start_values(self.clock.start)
            instance.enter_initialization(self.clock.start, self.clock.time(self.steps))
        undecided = self._settle()
        for instance in self.instances:
            instance.exit_initialization(self.clock.start)
        for instance in self.instances:
            instance.propagate(Verb.GET, self.bus, self.clock.start)
            instance.check_outputs(self.clock.start)
        if names := [self.graph.slots[i].name for i in np.flatnonzero(undecided)]:
            note = "%s: initial values do not settle (an algebraic loop): %s"
            _log.warning(note, self.system.name, some(names))
        self._initialised = True
        self.recorder.record(0, self.bus)
        self._executor.prepare(0)

    def _settle(self) -> NDArray[np.bool_]:
        """Repeat GET and SET of all instances until no slot of the bus changes. Return a mask of
        the slots that still change after MAX_ROUNDS; a slot that stays NaN does not change. A chain
        of n components needs n + 1 rounds.

        Flight software that reads back its own command forms a loop. If the loop does not settle,
        its last values are used.
        """
        changed = np.zeros(len(self.bus), dtype=np.bool_)
        for _ in range(MAX_ROUNDS):
            before = self.bus.copy()
            for verb in (Verb.GET, Verb.SET):
                for instance in self.instances:
                    instance.propagate(verb, self.bus, self.clock.start)
            changed = self.bus.view(np.uint64) != before.view(np.uint64)
            if not changed.any():
                break
        return changed

    # ---- running

    @property
    def step(self) -> int:
        """Return the number of completed macro steps."""
        return self.recorder.done

    @property
    def time(self) -> float:
        """Return the present time [s]."""
        return self.clock.time(self.step)

    def advance(self, to: int | None = None, progress: Show | None = None) -> None:
        """Perform macro steps until `to` are complete (default: all). Initialize first if that was
        not done.

        progress: called repeatedly with the number of complete steps. Raises RunError
        (InterruptionError on Ctrl-C) whose `partial` contains everything recorded, or UsageError if
        an FMU rejects a value of --set.
        """
        try:
            if self._files is None:
                raise UsageError("a Simulation can advance inside its `with` block only")
            if to is not None and not isinstance(to, int | np.integer):
                raise UsageError(
                    f"advance(to={to!r}): expected a whole number of macro steps since the start"
                )
            self._in_words(self.steps if to is None else min(int(to), self.steps), progress)
        except KeyboardInterrupt:
            raise self._partial(InterruptionError(self.system.name, self.time)) from None
        except RejectedValueError as error:
            typed = as_typed(error, self.system.origin.set, f"{error.component}.")
            raise typed from error.__cause__
        except RunError as error:
            raise self._partial(error) from error.__cause__

    def forward(self, to: int) -> None:
        """Perform macro steps until `to` are complete, with less effort than advance(), for callers
        that make single steps: Ctrl-C is not checked, and a RunError contains no recorded rows.
        """
        self._executor.run(self.step, to)

    def stretch(self, to: int) -> Stretch:
        """Return the macro steps from the present one until `to` are complete, not yet performed;
        the class Stretches of harness.master.executors performs them.
        """
        assert isinstance(self._executor, CExecutor)
        return self._executor.stretch(self.step, to)

    def finish(self, stretch: Stretch) -> None:
        """Store the number of macro steps that a performed stretch completed; raise RunError if a
        call failed.
        """
        assert isinstance(self._executor, CExecutor)
        self._executor.finish(stretch.stop)

    def _in_words(self, to: int, progress: Show | None) -> None:
        """Perform macro steps until `to` are complete. If a fused system fails, repeat the run with
        one FMU per component, so that the error names the failed component.
        """
        try:
            self._advance(to, progress)
        except RunError:
            if self._apart:
                raise
            self._separate()
            self._assemble()
            self._advance(to, progress)

    def _advance(self, to: int, progress: Show | None) -> None:
        if not self._initialised:
            self.initialize()
        chunk = 1
        while self.step < to:
            first, began = self.step, perf_counter()
            self._executor.run(first, min(first + chunk, to))
            seconds = perf_counter() - began
            self.pace = min(self.pace, seconds / (self.step - first))
            if progress is not None:
                progress(self.step)
            signals.check()
            chunk = 2 * chunk if seconds < CHUNK_SECONDS / 2 else chunk

    def _partial(self, error: RunError) -> RunError:
        if self._initialised:
            error.partial = self.result(str(error))
        return error

    def calls(self) -> list[tuple[str, str]]:
        """Return the calls of a macro step in order: name of the instance, and FMI function. The
        recorder stores the present call as its index in this list.
        """
        return self._executor.calls

    # ---- steering

    def port(self, name: str) -> NDArray[Any]:
        """Return an output `component.variable` as an array that shows its present value. For an
        open component the array contains the value that the component publishes next, and the
        caller writes to the array. Raises UsageError if there is no such output.

        The array remains valid until the FMUs are closed or exchanged.
        """
        return self._steerable().view(name)

    def get(self, name: str) -> NDArray[np.float64]:
        """Return the present value of an output or of a connected input, in the shape of the
        variable; raise UsageError if there is no such variable.
        """
        return self._steerable().get(name)

    def set(self, name: str, value: Any) -> None:
        """Set an output of an open component, or an unconnected input, from the next macro step on.

        value: a number, or an array in the shape of the variable. Raises UsageError for another
        name or shape, RunError if the FMU rejects the value.
        """
        self._steerable().set(name, value, self.time)

    def _steerable(self) -> Ports:
        if self._files is None:
            raise UsageError("a Simulation can be steered inside its `with` block only")
        if not self._initialised:
            self.advance(to=0)
        if self._ports is None:
            self._ports = Ports(self.graph, self.instances, self.bus, self.system.without)
        return self._ports

    def _held(self) -> list[Any]:
        """Return the buffers of open components, with the outputs that these components publish
        next.
        """
        opened = (i for i in self.instances if i.name in self.system.without)
        return [transfer.values for i in opened for transfer in i.transfers[Verb.GET]]

    # ---- rollback

    def save(self) -> Snapshot:
        """Return the state of the whole system, to be released with free(); raise RunError if an
        FMU cannot save its state.
        """
        states = tuple(instance.save(self.time) for instance in self.instances)
        return Snapshot(self.step, self.bus.copy(), states, tuple(map(bytes, self._held())))

    def restore(self, snapshot: Snapshot) -> None:
        """Return to a saved state; further macro steps overwrite the rows recorded after it."""
        for instance, state in zip(self.instances, snapshot.states, strict=True):
            instance.restore(state, self.time)
        self.bus[:] = snapshot.bus
        for values, saved in zip(self._held(), snapshot.held, strict=True):
            ctypes.memmove(values, saved, len(saved))
        self.recorder.done = snapshot.step

    def free(self, snapshot: Snapshot) -> None:
        """Release the FMU states of a snapshot."""
        for instance, state in zip(self.instances, snapshot.states, strict=True):
            instance.free(state)

    # ---- outcome

    def result(self, message: str = "") -> Result:
        """Return everything recorded so far, complete or not; message: reason of a failure.

        The table is not copied: after restore(), further steps overwrite its later rows.
        """
        slots = self.graph.slots
        recorded = slots if self.recorded is None else tuple(slots[i] for i in self.recorded)
        names, units, texts, modes = columns(recorded)
        time = np.asarray(
            self.clock.start + self.recorder.macro_steps * self.clock.step, dtype=float
        )
        name, rows, complete = self.system.name, self.recorder.rows, self.step == self.steps
        made = run_provenance(self.system, self._executor_name, self.recorder.every)
        about = complete, message, self.parameters(), made
        return Result(name, time, names, units, rows, texts, *about, modes=modes)

    def last(self) -> NDArray[np.float64]:
        """Return the present values of all slots of the system, including those that are not
        recorded.
        """
        if self.recorded is None:
            return self.bus.copy()
        (instance,) = self.instances
        assert isinstance(instance, WholeInstance)
        return instance.everything()

    def parameters(self) -> Result:
        """Return the values of all parameters of the system in this run, as a table of one row."""
        return parameters_of(self.system.name, self.graph, self.clock.start)
