# SPDX-License-Identifier: BSD-2-Clause
"""A system brought to life: load, initialise, step, roll back, and hand out what was recorded."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Collection
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
from harness.master.initialization import initialize
from harness.master.pacer import Pacer
from harness.master.progress import Watch, shown
from harness.master.recorder import Recorder
from harness.master.refusals import as_typed
from harness.results.provenance import flown, now
from harness.results.result import Result
from harness.system.graph import Checked, Node, checked, columns, constants, rechecked
from harness.system.model import System
from harness.system.schedule import schedule

CHUNK_SECONDS = 0.1
"""Wall-clock time between two looks at the keyboard and two updates of the progress bar."""

REHEARSED = 100
"""Rows of a run that are repeated to see whether an FMU from elsewhere can be reset."""

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
        found = checked(changed)
        self._lay_out(changed, found, self._recorder(found, changed))

    def _recorder(
        self,
        found: Checked,
        system: System,
        every: int | None = None,
        kept: Kept = None,
        earlier: Recorder | None = None,
    ) -> Recorder:
        """Every: the first that is said, of this run, of the simulation, of the system."""
        told = next(n for n in (every, self.every, system.experiment.every) if n is not None)
        width = len(found.graph.slots if kept is None else kept)
        return Recorder(found.steps, width, told, earlier)

    def _lay_out(
        self, system: System, found: Checked, recorder: Recorder, kept: Kept = None
    ) -> None:
        self.system = system
        self.graph, self.steps = found
        self.kept = kept
        """Slots that are recorded, in order; None: all."""
        self.clock = Clock(system.experiment.start, system.experiment.step or 0.0)
        width = len(self.graph.slots if kept is None else kept)
        self.bus: NDArray[np.float64] = np.zeros(width)
        self.settled: NDArray[np.intp] = np.zeros(width, dtype=np.intp)
        """Per slot the round of initial propagation in which it changed last."""
        self.recorder = recorder
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
        self,
        *,
        every: int | None = None,
        progress: Callable[[int], None] | None = None,
        **changes: Unpack[Changes],
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
        progress: Callable[[int], None] | None = None,
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
        self,
        system: System,
        every: int | None = None,
        wanted: Collection[str] | None = None,
    ) -> None:
        """Go back to before the initialization, with this system in the place of the present one.

        FMUs are reset; only those that were not there before, or cannot be reset to the bit, are
        loaded. Raises what the constructor and `with` raise.
        """
        if self._files is None:
            raise UsageError("a Simulation can run inside its `with` block only")
        found = rechecked(system, self.system, self.graph)
        self._apart = self._executor_name != FUSED
        everything = self._apart or wanted is None
        kept = None if everything else slots_of(found.graph.slots, frozenset(wanted or ()))
        recorder = self._recorder(found, system, every, kept, self.recorder)
        if self._initialised and self.step >= self.recorder.every and self._unproved():
            self._rehearse()
        self._lay_out(system, found, recorder, kept)
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
        return (self._whole.node(self.graph, self.kept),)

    def _separate(self) -> None:
        """The same run with the FMUs one by one, from its beginning, and all of it recorded."""
        self._apart = True
        every, found = self.recorder.every, Checked(self.graph, self.steps)
        recorder = self.recorder if self.kept is None else self._recorder(found, self.system, every)
        recorder.done = 0
        self._lay_out(self.system, found, recorder)

    def _assemble(self, *, trial: bool = False) -> None:
        """An instance for every node: the one of that name if it can go back, else a new one."""
        before = {instance.name: instance for instance in self.instances}
        self.instances = []
        try:
            for node in self._nodes():
                earlier = before.get(node.component.name)
                if earlier is not None and earlier.renew(node, trial=trial):
                    self.instances.append(before.pop(node.component.name))
                else:
                    self.instances.append(self._loaded(node, before.pop(node.component.name, None)))
        finally:
            for left in before.values():
                left.close()
        plan = schedule(self.system.experiment.algorithm, self.instances)
        loop = Loop(plan, self.bus, self.recorder, self.clock)
        self._executor = EXECUTORS[self._executor_name](loop)

    def _loaded(self, node: Node, earlier: Instance | None) -> Instance:
        """A new instance; of the earlier one only what is known of its reset is kept."""
        if earlier is not None:
            earlier.close()
        if self._apart or self._whole is None:
            instance = Instance(node, self._own_folder)
        else:
            instance = WholeInstance(node, self._own_folder, self._whole)
        if earlier is not None and earlier.node.interface is node.interface:
            instance.resettable = earlier.resettable
        return instance

    def _own_folder(self) -> Path:
        """Where FMUs are unpacked that no cache keeps, made when the first one is."""
        if self._folder is None:
            assert self._files is not None
            self._folder = self._files.enter_context(PrivateFolder())
        return self._folder

    # ---- whether a reset leaves nothing behind

    def _unproved(self) -> list[Instance]:
        return [i for i in self.instances if i.resettable is None]

    def _rehearse(self) -> None:
        """Repeat the beginning of the run that is over: an FMU from elsewhere may reset itself
        badly, then the same run has other bits.

        If it has, every FMU whose reset was not proved is loaded anew for every run from now on.
        """
        every = self.recorder.every
        regular = min(max(REHEARSED // every, 1), self.step // every) + 1
        wanted = self.recorder.rows[:regular].copy()
        again = Recorder((len(wanted) - 1) * every, len(self.bus), every)
        self._lay_out(self.system, Checked(self.graph, self.steps), again, self.kept)
        self._assemble(trial=True)
        same = self._repeats(wanted)
        unproved = self._unproved()
        for instance in unproved:
            instance.resettable = same
        if unproved and not same:
            messages.note_irreversible([instance.name for instance in unproved])

    def _repeats(self, wanted: NDArray[np.float64]) -> bool:
        last = (len(wanted) - 1) * self.recorder.every
        try:
            self._advance(last, None)
        except RunError:
            return False
        finally:
            for instance in self.instances:
                messages.forget(instance.name)
        return self.recorder.rows.tobytes() == wanted.tobytes()

    # ---- initialization

    def initialize(self) -> None:
        """Set parameters, propagate initial values until nothing changes, record the row at the
        start time.

        Raises RunError: a refused parameter, a failing FMU, or an output that is not finite.
        """
        for instance in self.instances:
            if isinstance(instance, WholeInstance):
                instance.values = instance.whole.values(self.system, self.graph)
        self.settled, undecided = initialize(
            self.instances, self.bus, self.clock.start, self.clock.time(self.steps)
        )
        if names := [self.graph.slots[i].name for i in np.flatnonzero(undecided)]:
            more = f" and {len(names) - 5} more" if len(names) > 5 else ""
            loop = f"{', '.join(names[:5])}{more}"
            _log.warning(
                "%s: initial values do not settle (an algebraic loop): %s", self.system.name, loop
            )
        self._initialised = True
        self.recorder.record(0, self.bus)

    # ---- running

    @property
    def step(self) -> int:
        """Macro steps completed."""
        return self.recorder.done

    @property
    def time(self) -> float:
        """Present time [s]."""
        return self.clock.time(self.step)

    def advance(self, to: int | None = None, progress: Callable[[int], None] | None = None) -> None:
        """Perform macro steps until `to` are complete (default: all), initialising first if that
        was not done.

        progress: called repeatedly with the number of complete steps. Raises RunError
        (InterruptionError on Ctrl-C) whose `partial` holds everything recorded; values of --set
        that an FMU refuses are a UsageError.
        """
        try:
            if self._files is None:
                raise UsageError("a Simulation can advance inside its `with` block only")
            last = self.steps if to is None else min(to, self.steps)
            try:
                self._advance(last, progress)
            except RunError:
                if self._apart:
                    raise
                self._separate()  # the same run, and its end in the words of the FMU that fails
                self._assemble()
                self._advance(last, progress)
        except KeyboardInterrupt:
            raise self._partial(InterruptionError(self.system.name, self.time)) from None
        except RefusalError as error:
            typed = as_typed(error, self.system.origin.set, f"{error.component}.")
            raise typed from error.__cause__
        except RunError as error:
            raise self._partial(error) from error.__cause__

    def _advance(self, to: int, progress: Callable[[int], None] | None) -> None:
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

    def _look(self, progress: Callable[[int], None] | None) -> None:
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
        names, units, descriptions = columns(recorded)
        time = np.asarray(
            self.clock.start + self.recorder.macro_steps * self.clock.step, dtype=np.float64
        )
        return Result(
            self.system.name,
            time,
            names,
            units,
            self.recorder.rows,
            descriptions,
            complete=self.step == self.steps,
            message=message,
            parameters=self.parameters(),
            provenance=flown(self.system, self._executor_name, self.recorder.every, self.timing),
        )

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
        names, units, descriptions = columns(slots)
        return Result(
            self.system.name,
            np.array([self.clock.start]),
            names,
            units,
            np.array([values]),
            descriptions,
        )


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
