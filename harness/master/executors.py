# SPDX-License-Identifier: BSD-2-Clause
"""Two executors of the same schedule: one in Python, to read and to debug, and one in C. Their
results are bit-identical.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.files.paths import built
from harness.master.calls import OK, WARNING, address, layout
from harness.master.fmu import Instance
from harness.master.recorder import Recorder
from harness.master.transfer import Transfer
from harness.system.schedule import Action, Verb


class Clock(NamedTuple):
    """Times of the macro steps [s]: macro step k begins at start + k * step. The product prevents
    the rounding errors of a sum from accumulating.
    """

    start: float
    step: float

    def time(self, k: int) -> float:
        """Return the time [s] at which macro step k begins."""
        return self.start + k * self.step


class Loop(NamedTuple):
    """Input of an executor.

    plan: actions of a macro step, in order; bus: values of all signals; recorder: table of recorded
    rows; clock: times of the macro steps; pause: index in the plan before which the run pauses, so
    that the user can set the outputs of an open component (a component that is not stepped); the
    actions before this index are performed at the end of the previous macro step (0: there are no
    such actions).
    """

    plan: Sequence[Action[Instance]]
    bus: NDArray[np.float64]
    recorder: Recorder
    clock: Clock
    pause: int = 0


class PythonExecutor:
    """Reference implementation of the loop over macro steps.

    calls: name of the instance and FMI function of every action of a macro step; the recorder
    stores the index of the present action in this list, which identifies the FMI call if a process
    crashes.
    """

    def __init__(self, loop: Loop) -> None:
        self.loop = loop
        self.calls = _marked(loop.plan)

    def run(self, first: int, last: int) -> None:
        """Perform the macro steps first .. last - 1 and record the results; raise RunError, which
        names the failed instance.
        """
        for k in range(first, last):
            self._act(k, self.loop.pause, None)
            self.loop.recorder.record(k + 1, self.loop.bus)
            if k + 1 < self.loop.recorder.steps:
                self.prepare(k + 1)

    def prepare(self, k: int) -> None:
        """Perform the actions of macro step k that precede the pause; raise RunError if an FMU
        fails.
        """
        self._act(k, 0, self.loop.pause)

    def _act(self, k: int, begin: int, end: int | None) -> None:
        plan, bus, recorder, clock, _ = self.loop
        for i, action in list(enumerate(plan))[begin:end]:
            if action.due(k):
                recorder.progress[1] = i
                action.instance.act(action.verb, bus, clock.time(k), clock.step)


_KINDS = {
    2: {Verb.SET: (0, 1, 5), Verb.STEP: (2,), Verb.GET: (3, 4)},
    3: {Verb.SET: (6, 8, 11), Verb.STEP: (10,), Verb.GET: (7, 9)},
}
"""Values of Call.kind in loop.c by FMI version and action (SET, STEP, GET). SET and GET have one
kind for doubles and one for other types. SET has a third kind for doubles whose unit is converted.
"""


def _marked(actions: Iterable[Action[Instance]]) -> list[tuple[str, str]]:
    """Return name of the instance and FMI function of every action, in the given order."""
    return [(a.instance.name, a.verb.call(a.instance.node.interface.fmi)) for a in actions]


class _Call(ctypes.Structure):
    """C struct Call of loop.c: one FMI call of a macro step."""

    _fields_ = layout(
        (ctypes.c_int, "kind every phase no_rollback type finite"),
        (ctypes.c_size_t, "count pieces wires values"),
        (ctypes.c_void_p, "function component reference slot at piece value factor offset"),
    )


class _Run(ctypes.Structure):
    """C struct Run of loop.c: times, bus and recorded rows of a run."""

    _fields_ = layout(
        (ctypes.c_double, "start step"),
        (ctypes.c_size_t, "slots"),
        (ctypes.c_long, "every steps"),
        (ctypes.c_void_p, "bus table progress"),
    )


class Stop(ctypes.Structure):
    """C struct Stop of loop.c: number of completed macro steps; index of the call that failed, or,
    if none failed, before which the execution stopped; status of this call (OK if none failed).
    """

    _fields_ = layout((ctypes.c_long, "done"), (ctypes.c_size_t, "call"), (ctypes.c_int, "status"))


class Stretch(ctypes.Structure):
    """C struct Stretch of loop.c: consecutive macro steps of one simulation, to be performed."""

    _fields_ = layout(
        (ctypes.c_void_p, "calls"),
        (ctypes.c_size_t, "count"),
        (ctypes.c_void_p, "run"),
        (ctypes.c_long, "first last"),
        (ctypes.c_size_t, "pause"),
        (Stop, "stop"),
    )


class CExecutor:
    """Executor in C, which calls the FMI functions of the loaded FMUs by their addresses."""

    def __init__(self, loop: Loop) -> None:
        self.loop = loop  # retained, since the C structs point to its arrays
        self._execute = library().execute
        self._origin = list(_origins(loop.plan))
        self.calls = _marked(action for action, _ in self._origin)
        self._calls = (_Call * len(self._origin))(*(_call(*origin) for origin in self._origin))
        bus, recorder, clock = loop.bus, loop.recorder, loop.clock
        numbers = (*clock, len(bus), recorder.every, recorder.steps)
        arrays = bus, recorder.table, recorder.progress
        self._run = _Run(*numbers, *(array.ctypes.data for array in arrays))
        self._pause = len(list(_origins(loop.plan[: loop.pause])))

    def run(self, first: int, last: int) -> None:
        """Perform the macro steps first .. last - 1 and record the results; raise RunError, which
        names the failed instance.
        """
        self._execute_until(first, last, 1)

    def prepare(self, k: int) -> None:
        """Perform the calls of macro step k that precede the pause; raise RunError if an FMU
        fails.
        """
        self._execute_until(k, k, 0)

    def stretch(self, first: int, last: int) -> Stretch:
        """Return the macro steps first .. last - 1 in the form in which execute_all() of loop.c
        performs them.
        """
        calls, run = ctypes.addressof(self._calls), ctypes.addressof(self._run)
        return Stretch(calls, len(self._calls), run, first, last, self._pause)

    def _execute_until(self, first: int, last: int, ready: int) -> None:
        count, run = len(self._calls), ctypes.byref(self._run)
        self.finish(self._execute(self._calls, count, run, first, last, self._pause, ready))

    def finish(self, stop: Stop) -> None:
        """Store the number of completed macro steps in the recorder. If a call failed, raise
        RunError, which names the failed instance.
        """
        self.loop.recorder.done = stop.done
        if stop.status not in (OK, WARNING):
            action, transfer = self._origin[stop.call]
            time = self.loop.clock.time(stop.done)
            action.instance.raise_if_failed(action.verb, stop.status, time, transfer)


def _origins(
    plan: Sequence[Action[Instance]],
) -> Iterator[tuple[Action[Instance], Transfer | None]]:
    """Yield action and transfer of every FMI call of a macro step. STEP is one call, without a
    transfer (None). SET and GET are one call per transfer, which has variables of one type.
    """
    for action in plan:
        if action.verb is Verb.STEP:
            yield action, None
        for transfer in action.instance.transfers[action.verb]:
            yield action, transfer


def _call(action: Action[Instance], transfer: Transfer | None) -> _Call:
    instance = action.instance
    kinds = _KINDS[instance.node.interface.fmi][action.verb]
    period = action.every, action.phase, instance.no_rollback
    if transfer is None:
        step = {"function": address(instance.calls.do_step), "component": instance.calls.handle}
        return _Call(kinds[0], *period, **step)
    t = transfer
    kind = kinds[(0 if t.plain else 2) if t.real else 1]
    sizes = len(t.references), len(t.pieces), len(t.names), len(t.values)
    places = (t.slots.ctypes.data, t.at.ctypes.data, ctypes.addressof(t.pieces))
    values = ctypes.addressof(t.values), t.factors.ctypes.data, t.offsets.ctypes.data
    called = address(t.function), t.handle, ctypes.addressof(t.references)
    return _Call(kind, *period, t.type, instance.ours, *sizes, *called, *places, *values)


def library() -> Any:
    """Return loop.c as a loaded library; raise UsageError if it has not been built."""
    path = built("loop")
    if path is None:
        raise UsageError(
            "the C executor has not been built: build the project, or choose --executor python"
        )
    return _loaded(path)


@cache
def _loaded(path: Path) -> Any:
    found = ctypes.CDLL(str(path))
    found.execute.restype = Stop
    calls, run = (ctypes.c_void_p, ctypes.c_size_t), ctypes.c_void_p
    steps = ctypes.c_long, ctypes.c_long
    found.execute.argtypes = [*calls, run, *steps, ctypes.c_size_t, ctypes.c_int]
    found.execute_all.restype = None
    return found


class Stretches:
    """Stretches (consecutive macro steps) of several simulations, which C performs one after the
    other without Python in between. each: the stretches; the field `stop` of each is its outcome.
    """

    def __init__(self, given: Sequence[Stretch]) -> None:
        self.all = (Stretch * len(given))(*given)
        self.each = list(self.all)
        self._execute, self._count = library().execute_all, ctypes.c_size_t(len(given))

    def execute(self) -> None:
        """Perform the macro steps of all stretches."""
        self._execute(self.all, self._count)


Executor = PythonExecutor | CExecutor

FUSED = "fused"
"""Name of the executor in C that runs the whole system as one FMU (harness.master.fused)."""

EXECUTORS: dict[str, type[Executor]] = {"c": CExecutor, "python": PythonExecutor, FUSED: CExecutor}


def known_executor(name: str) -> str:
    """Return the name of an executor unchanged; raise UsageError if there is no such executor."""
    if name not in EXECUTORS:
        *names, last = EXECUTORS
        raise UsageError(f"there is no executor {name}, only {', '.join(names)} and {last}")
    return name
