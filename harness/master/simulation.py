# SPDX-License-Identifier: BSD-2-Clause
"""A system brought to life: load, initialise, step, roll back, and hand out what was recorded."""

from __future__ import annotations

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

from harness.errors import InterruptionError, RefusalError, RunError, UsageError
from harness.files import signals
from harness.files.temporary import PrivateFolder
from harness.master import messages
from harness.master.changes import Changes, apply
from harness.master.executors import EXECUTORS, FUSED, Clock, Loop, known_executor
from harness.master.fmu import Instance
from harness.master.fused import Whole, WholeInstance, compiled, slots_of
from harness.master.pacer import Pacer
from harness.master.progress import Show, Watch, shown
from harness.master.recorder import Recorder
from harness.master.refusals import as_typed
from harness.results.provenance import flown, now
from harness.results.result import Result
from harness.spelling import some
from harness.system.graph import Checked, Node, checked, columns, constants, rechecked
from harness.system.model import System
from harness.system.schedule import Verb, schedule

CHUNK_SECONDS = 0.1
"""Wall-clock time between two looks at the keyboard and two updates of the progress bar."""

MAX_ROUNDS = 200
"""Rounds of initial propagation; a loop of two units and gain 1/2 has settled to the last bit after
half of them.
"""

_log = logging.getLogger("harness")

Kept = tuple[int, ...] | None
"""Slots that are recorded, in order; None: all."""


@dataclass(frozen=True)
class Snapshot:
    """State of the whole system after `step` macro steps: the bus and one FMU state per
    instance.
    """

    step: int
    bus: NDArray[np.float64]
    states: tuple[Any, ...]


class Simulation:
    """The units of a system, the bus between them and the recorded rows; a context manager.

    with Simulation(system) as simulation:
        simulation.advance()
        result = simulation.result()
        other = simulation.fly(set={"servicer.mass_0": 120})

    A further run resets the loaded FMUs instead of loading them again and gives the same bits.
    """

    def __init__(
        self,
        system: System,
        *,
        executor: str = "c",
        every: int | None = None,
        pacer: Pacer | None = None,
        **changes: Unpack[Changes],
    ) -> None:
        """Check the system with these changes; nothing is loaded before `with`.

        every: record every N-th macro step, None: as the system says. pacer: lets macro steps begin
        when they are due; None: as soon as they can. Raises StructureError, FmuError or UsageError.
        """
        now()  # a SOURCE_DATE_EPOCH that is none is refused before the run, not after it
        self.base = system
        self.every = every
        self.pacer = pacer
        self.timing = ""
        """How well the pacer was followed, in a line."""
        self.instances: list[Instance] = []
        self._executor_name = known_executor(executor)
        self._whole: Whole | None = None
        self._apart = executor != FUSED
        """Whether the FMUs are loaded one by one; else there is one for the whole system."""
        self._files: ExitStack | None = None
        self._folder: Path | None = None
        changed = apply(system, **changes)
        self._lay_out(changed, checked(changed))

    def _lay_out(
        self, system: System, found: Checked, every: int | None = None, kept: Kept = None
    ) -> None:
        """Room for a run; every: the first that is said, of this run, of the simulation, of the
        system; kept: slots that are recorded, in order (None: all).
        """
        told = next(n for n in (every, self.every, system.experiment.every) if n is not None)
        width = len(found.graph.slots if kept is None else kept)
        self.recorder = Recorder(found.steps, width, told, getattr(self, "recorder", None))
        self.system, (self.graph, self.steps), self.kept = system, found, kept
        self.clock = Clock(system.experiment.start, system.experiment.step or 0.0)
        self.bus: NDArray[np.float64] = np.zeros(width)
        self.settled: NDArray[np.intp] = np.zeros(width, dtype=np.intp)
        """Per slot the round of initial propagation in which it changed last."""
        self.pace = math.inf
        """Time of a macro step so far, of the quickest stretch between two looks [s]."""
        self._initialised = False

    # ---- life

    def __enter__(self) -> Self:
        """Load and instantiate all FMUs; FmuError or ArchiveError if one cannot be."""
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
        """Terminate and free all FMUs and remove what was unpacked."""
        while self.instances:
            self.instances.pop().close()
        if self._files is not None:
            self._files.close()
            self._files = self._folder = None

    # ---- a further run

    def fly(
        self, *, every: int | None = None, progress: Show | None = None, **changes: Unpack[Changes]
    ) -> Result:
        """Run the system that the simulation was made with, with these changes: the same bits as
        run().

        every: record every N-th macro step (default: as for the simulation). Raises the exceptions
        of run(); a failed run does not affect the next one.
        """
        return self.fly_system(apply(self.base, **changes), every=every, progress=progress)

    def fly_system(
        self,
        system: System,
        *,
        every: int | None = None,
        progress: Show | None = None,
        wanted: Collection[str] | None = None,
    ) -> Result:
        """The same for a system that was changed already.

        wanted: variables that are to be recorded, by their names without indices (None: all); only
        the executor `fused` leaves out the others, and only where a run does not fail.
        """
        self.begin(system, every, wanted)
        try:
            self.advance(progress=progress)
            return self.result()
        finally:
            for instance in self.instances:
                messages.report_warnings(instance.name)

    def begin(
        self, system: System, every: int | None = None, wanted: Collection[str] | None = None
    ) -> None:
        """Go back to before the initialization, with this system in the place of the present one.

        FMUs of the project are reset; others, and those that were not there before, are loaded.
        Raises what the constructor and `with` raise.
        """
        if self._files is None:
            raise UsageError("a Simulation can run inside its `with` block only")
        found = rechecked(system, self.system, self.graph)
        self._apart = self._executor_name != FUSED
        everything = self._apart or wanted is None
        kept = None if everything else slots_of(found.graph.slots, frozenset(wanted or ()))
        self._lay_out(system, found, every, kept)
        self._assemble()

    def _nodes(self) -> tuple[Node, ...]:
        """What is loaded: a node per component, or one for the whole system; where that cannot be
        made, a line says so and the usual executor runs.
        """
        if self._apart:
            return self.graph.nodes
        if self._whole is None or not self._whole.fits(self.system, self.graph):
            self._whole = compiled(self.system, self.graph)
        if self._whole is None:
            self._executor_name = "c"
            self._separate()
            return self.graph.nodes
        return (self._whole.node(self.kept),)

    def _separate(self) -> None:
        """The same run with the FMUs one by one, from its beginning, and all of it recorded."""
        self._apart = True
        self._lay_out(self.system, Checked(self.graph, self.steps), self.recorder.every)

    def _assemble(self) -> None:
        """An instance for every node: the one of that name if it can go back, else a new one."""
        before = {instance.name: instance for instance in self.instances}
        self.instances = []
        try:
            for node in self._nodes():
                self.instances.append(self._instance(node, before))
        finally:
            for left in before.values():
                left.close()
        plan = schedule(self.system.experiment.algorithm, self.instances)
        loop = Loop(plan, self.bus, self.recorder, self.clock)
        self._executor = EXECUTORS[self._executor_name](loop)

    def _instance(self, node: Node, before: dict[str, Instance]) -> Instance:
        """The one of that name from before if it can go back, else a new one."""
        name = node.component.name
        if name in before and before[name].renew(node):
            return before.pop(name)
        if name in before:
            before.pop(name).close()
        if self._apart or self._whole is None:
            return Instance(node, self._own_folder)
        return WholeInstance(node, self._own_folder, self._whole)

    def _own_folder(self) -> Path:
        """Where FMUs are unpacked that no cache keeps, made when the first one is."""
        if self._folder is None:
            assert self._files is not None
            self._folder = self._files.enter_context(PrivateFolder())
        return self._folder

    # ---- initialization

    def initialize(self) -> None:
        """Set parameters, propagate initial values until nothing changes, record the row at the
        start time.

        Raises RunError: a refused parameter, a failing FMU, or an output that is not finite.
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

    def _settle(self) -> NDArray[np.bool_]:
        """Rounds of GET and SET until nothing changes; a chain of n units needs n + 1.

        Where flight software reads back its own command there is a loop. If it does not settle, its
        last values are taken: returns which slots (NaN counts as a value).
        """
        changed = np.zeros(len(self.bus), dtype=np.bool_)
        for count in range(1, MAX_ROUNDS + 1):
            before = self.bus.copy()
            for verb in (Verb.GET, Verb.SET):
                for instance in self.instances:
                    instance.propagate(verb, self.bus, self.clock.start)
            changed = self.bus.view(np.uint64) != before.view(np.uint64)
            self.settled[changed] = count
            if not changed.any():
                break
        return changed

    # ---- running

    @property
    def step(self) -> int:
        """Macro steps completed."""
        return self.recorder.done

    @property
    def time(self) -> float:
        """Present time [s]."""
        return self.clock.time(self.step)

    def advance(self, to: int | None = None, progress: Show | None = None) -> None:
        """Perform macro steps until `to` are complete (default: all), initialising first if that
        was not done.

        progress: called repeatedly with the number of complete steps. Raises RunError
        (InterruptionError on Ctrl-C) whose `partial` holds everything recorded; values of --set
        that an FMU refuses are a UsageError.
        """
        try:
            if self._files is None:
                raise UsageError("a Simulation can advance inside its `with` block only")
            self._in_words(self.steps if to is None else min(to, self.steps), progress)
        except KeyboardInterrupt:
            raise self._partial(InterruptionError(self.system.name, self.time)) from None
        except RefusalError as error:
            typed = as_typed(error, self.system.origin.set, f"{error.component}.")
            raise typed from error.__cause__
        except RunError as error:
            raise self._partial(error) from error.__cause__

    def _in_words(self, to: int, progress: Show | None) -> None:
        """_advance(); where a whole fails the same run again, and its end in the words of the FMU
        that fails.
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
            if self.pacer is not None:
                self.pacer.wait(self.step * self.clock.step, lambda: self._look(progress))
                chunk = 1
            first, began = self.step, perf_counter()
            self._executor.run(first, min(first + chunk, to))
            seconds = perf_counter() - began
            self.pace = min(self.pace, seconds / (self.step - first))
            self._look(progress)
            chunk = 2 * chunk if seconds < CHUNK_SECONDS / 2 else chunk
        if self.pacer is not None:
            self.timing = str(self.pacer.timing())

    def _look(self, progress: Show | None) -> None:
        if progress is not None:
            progress(self.step)
        signals.check()

    def _partial(self, error: RunError) -> RunError:
        if self._initialised:
            error.partial = self.result(str(error))
        return error

    def calls(self) -> list[tuple[str, str]]:
        """Instance and FMI function of every call of a macro step, as the recorder counts them."""
        return self._executor.calls

    # ---- rollback

    def save(self) -> Snapshot:
        """State of the whole system; RunError if an FMU cannot save its own. Release it with
        free().
        """
        states = tuple(instance.save(self.time) for instance in self.instances)
        return Snapshot(self.step, self.bus.copy(), states)

    def restore(self, snapshot: Snapshot) -> None:
        """Return to a saved state; later rows are recorded anew."""
        for instance, state in zip(self.instances, snapshot.states, strict=True):
            instance.restore(state, self.time)
        self.bus[:] = snapshot.bus
        self.recorder.done = snapshot.step

    def free(self, snapshot: Snapshot) -> None:
        """Release the FMU states of a snapshot."""
        for instance, state in zip(self.instances, snapshot.states, strict=True):
            instance.free(state)

    # ---- outcome

    def result(self, message: str = "") -> Result:
        """Everything recorded so far (complete or not), with the reason if the run has failed.

        The table is not copied: stepping on after restore() overwrites its later rows.
        """
        slots = self.graph.slots
        recorded = slots if self.kept is None else tuple(slots[i] for i in self.kept)
        names, units, texts = columns(recorded)
        time = np.asarray(
            self.clock.start + self.recorder.macro_steps * self.clock.step, dtype=float
        )
        name, rows, complete = self.system.name, self.recorder.rows, self.step == self.steps
        made = flown(self.system, self._executor_name, self.recorder.every, self.timing)
        about = complete, message, self.parameters(), made
        return Result(name, time, names, units, rows, texts, *about)

    def last(self) -> NDArray[np.float64]:
        """Present values of all slots of the system, recorded or not."""
        if self.kept is None:
            return self.bus.copy()
        (instance,) = self.instances
        assert isinstance(instance, WholeInstance)
        return instance.everything()

    def parameters(self) -> Result:
        """All parameters as a table of one row."""
        found = list(constants(self.graph))
        slots, values = zip(*found, strict=True) if found else ((), ())
        names, units, texts = columns(slots)
        start = np.array([self.clock.start])
        return Result(self.system.name, start, names, units, np.array([values]), texts)


def simulate(
    system: System,
    *,
    executor: str = "c",
    every: int | None = None,
    progress: bool | Watch = False,
    pacer: Pacer | None = None,
) -> Result:
    """Run a system as it is; executor, every, progress: as for run()."""
    with Simulation(system, executor=executor, every=every, pacer=pacer) as simulation:
        with shown(simulation, progress) as show:
            simulation.advance(progress=show)
        return simulation.result()
