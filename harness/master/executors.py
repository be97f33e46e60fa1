# SPDX-License-Identifier: BSD-2-Clause
"""Two executors of the same schedule: one to read and to debug, one in C. They agree bit for
bit.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.files.paths import built
from harness.master.calls import layout
from harness.master.fmu import Instance
from harness.master.recorder import Recorder
from harness.master.transfer import Transfer
from harness.system.schedule import Action, Verb


class Clock(NamedTuple):
    """Time of macro step k is start + k * step [s]: a product, never a sum."""

    start: float
    step: float

    def time(self, k: int) -> float:
        """Return the communication point of macro step k [s]."""
        return self.start + k * self.step


class Loop(NamedTuple):
    """Input of an executor: the plan of a macro step, one bus, and one table."""

    plan: Sequence[Action[Instance]]
    bus: NDArray[np.float64]
    recorder: Recorder
    clock: Clock


class PythonExecutor:
    """Reference implementation of the loop.

    calls: instance and function of every call of a macro step, in the order of the index that
    the recorder stores as progress.
    """

    def __init__(self, loop: Loop) -> None:
        self.loop = loop
        self.calls = _marked(loop.plan)

    def run(self, first: int, last: int) -> None:
        """Run the macro steps first .. last - 1 and record each; raise RunError naming the instance
        that failed.
        """
        plan, bus, recorder, clock = self.loop
        for k in range(first, last):
            for i, action in enumerate(plan):
                if action.due(k):
                    recorder.progress[1] = i
                    action.instance.act(action.verb, bus, clock.time(k), clock.step)
            recorder.record(k + 1, bus)


_KINDS = {
    2: {Verb.SET: (0, 1, 5), Verb.STEP: (2,), Verb.GET: (3, 4)},
    3: {Verb.SET: (6, 8, 11), Verb.STEP: (10,), Verb.GET: (7, 9)},
}
"""Call.kind in loop.c by version of FMI and verb: of doubles, of other types, of doubles that are
changed on the way.
"""


def _marked(actions: Iterable[Action[Instance]]) -> list[tuple[str, str]]:
    """Return instances and functions in the order of the recorder's counter."""
    return [(a.instance.name, a.verb.call(a.instance.node.interface.fmi)) for a in actions]


class _Call(ctypes.Structure):
    """Struct Call of loop.c."""

    _fields_ = layout(
        (ctypes.c_int, "kind every phase no_rollback type finite"),
        (ctypes.c_size_t, "count pieces wires values"),
        (ctypes.c_void_p, "function component reference slot at piece value factor offset"),
    )


class _Run(ctypes.Structure):
    """Struct Run of loop.c."""

    _fields_ = layout(
        (ctypes.c_double, "start step"),
        (ctypes.c_size_t, "slots"),
        (ctypes.c_long, "every steps"),
        (ctypes.c_void_p, "bus table progress"),
    )


class _Stop(ctypes.Structure):
    """Struct Stop of loop.c."""

    _fields_ = layout((ctypes.c_long, "done"), (ctypes.c_size_t, "call"), (ctypes.c_int, "status"))


class CExecutor:
    """The same loop in C, over the function pointers of the libraries that FMPy has loaded."""

    def __init__(self, loop: Loop) -> None:
        self.loop = loop  # holds the arrays to which the C structs point
        self._execute = _library()
        self._origin = list(_origins(loop.plan))
        self.calls = _marked(action for action, _ in self._origin)
        self._calls = (_Call * len(self._origin))(*(_call(*origin) for origin in self._origin))
        bus, recorder, clock = loop.bus, loop.recorder, loop.clock
        numbers = (*clock, len(bus), recorder.every, recorder.steps)
        arrays = bus, recorder.table, recorder.progress
        self._run = _Run(*numbers, *(array.ctypes.data for array in arrays))

    def run(self, first: int, last: int) -> None:
        """Run the macro steps first .. last - 1 and record each; raise RunError naming the instance
        that failed.
        """
        stop = self._execute(self._calls, len(self._calls), ctypes.byref(self._run), first, last)
        self.loop.recorder.done = stop.done
        if stop.done < last:
            action, transfer = self._origin[stop.call]
            time = self.loop.clock.time(stop.done)
            action.instance.raise_if_failed(action.verb, stop.status, time, transfer)


def _origins(
    plan: Sequence[Action[Instance]],
) -> Iterator[tuple[Action[Instance], Transfer | None]]:
    """Yield one entry per FMI call: an action is one step, or one transfer per type of variable."""
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
        step = {"function": _address(instance.calls.do_step), "component": instance.calls.handle}
        return _Call(kinds[0], *period, **step)
    t = transfer
    kind = kinds[(0 if t.plain else 2) if t.real else 1]
    sizes = len(t.references), len(t.pieces), len(t.names), len(t.values)
    places = (t.slots.ctypes.data, t.at.ctypes.data, ctypes.addressof(t.pieces))
    values = ctypes.addressof(t.values), t.factors.ctypes.data, t.offsets.ctypes.data
    called = _address(t.function), t.handle, ctypes.addressof(t.references)
    return _Call(kind, *period, t.type, instance.ours, *sizes, *called, *places, *values)


def _address(function: Any) -> int | None:
    return ctypes.cast(function, ctypes.c_void_p).value


def _library() -> Any:
    path = built("loop")
    if path is None:
        raise UsageError(
            "the C executor has not been built: build the project, or choose --executor python"
        )
    execute = ctypes.CDLL(str(path)).execute
    execute.restype = _Stop
    calls, run = (ctypes.c_void_p, ctypes.c_size_t), ctypes.c_void_p
    execute.argtypes = [*calls, run, ctypes.c_long, ctypes.c_long]
    return execute


Executor = PythonExecutor | CExecutor

FUSED = "fused"
"""The loop in C over one FMU of the whole system (harness.master.fused)."""

EXECUTORS: dict[str, type[Executor]] = {"c": CExecutor, "python": PythonExecutor, FUSED: CExecutor}


def known_executor(name: str) -> str:
    """Return the name of an existing executor; raise UsageError."""
    if name not in EXECUTORS:
        *names, last = EXECUTORS
        raise UsageError(f"there is no executor {name}, only {', '.join(names)} and {last}")
    return name
