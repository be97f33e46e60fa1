# SPDX-License-Identifier: BSD-2-Clause
"""Two executors of the same schedule: one to read and to debug, one in C. They agree bit for
bit.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.files.paths import loop_library
from harness.master.fmu import Instance
from harness.master.recorder import Recorder
from harness.master.transfer import TYPES_3, CFunction, Transfer
from harness.system.schedule import NOT_FINITE, TOO_WIDE, Action, Verb


class Clock(NamedTuple):
    """Time of macro step k is start + k * step [s]: a product, never a sum."""

    start: float
    step: float

    def time(self, k: int) -> float:
        """Communication point of macro step k [s]."""
        return self.start + k * self.step


class Loop(NamedTuple):
    """What an executor runs: the plan of a macro step, over one bus, into one table."""

    plan: Sequence[Action[Instance]]
    bus: NDArray[np.float64]
    recorder: Recorder
    clock: Clock


class Executor(Protocol):
    """Something that performs macro steps; RunError names the instance that failed.

    calls: instance and verb of every call of a macro step, in the order that the recorder marks.
    """

    calls: list[tuple[str, str]]

    def run(self, first: int, last: int) -> None:
        """Macro steps first .. last - 1, recording each."""


class PythonExecutor:
    """The loop as it is meant."""

    def __init__(self, loop: Loop) -> None:
        self.loop = loop
        self.calls = [_marked(action) for action in loop.plan]

    def run(self, first: int, last: int) -> None:
        """Macro steps first .. last - 1, recording each; RunError names the instance that
        failed.
        """
        plan, bus, recorder, clock = self.loop
        for k in range(first, last):
            for i, action in enumerate(plan):
                if action.due(k):
                    recorder.marks[1] = i
                    action.instance.act(action.verb, bus, clock.time(k), clock.step)
            recorder.record(k + 1, bus)


_SET_AFFINE, _SET_FLOAT64, _GET_FLOAT64 = 5, 6, 7
_SET_OTHER, _GET_OTHER, _STEP_3, _SET_AFFINE_3 = 8, 9, 10, 11
_KINDS = {
    (2, Verb.SET, True): 0,
    (2, Verb.SET, False): 1,
    (2, Verb.STEP, True): 2,
    (2, Verb.GET, True): 3,
    (2, Verb.GET, False): 4,
    (3, Verb.SET, True): _SET_FLOAT64,
    (3, Verb.SET, False): _SET_OTHER,
    (3, Verb.STEP, True): _STEP_3,
    (3, Verb.GET, True): _GET_FLOAT64,
    (3, Verb.GET, False): _GET_OTHER,
}
"""Call.kind in loop.c by version of FMI, verb, and whether the values are doubles."""


def _marked(action: Action[Instance]) -> tuple[str, str]:
    """Instance and call, as the recorder marks them."""
    return action.instance.name, action.verb.call(action.instance.node.interface.fmi)


class _Call(ctypes.Structure):
    """Struct Call of loop.c."""

    _fields_ = [
        ("kind", ctypes.c_int),
        ("every", ctypes.c_int),
        ("phase", ctypes.c_int),
        ("no_rollback", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("component", ctypes.c_void_p),
        ("count", ctypes.c_size_t),
        ("reference", ctypes.c_void_p),
        ("slot", ctypes.c_void_p),
        ("piece", ctypes.c_void_p),
        ("pieces", ctypes.c_size_t),
        ("value", ctypes.c_void_p),
        ("factor", ctypes.c_void_p),
        ("offset", ctypes.c_void_p),
        ("wires", ctypes.c_size_t),
        ("values", ctypes.c_size_t),
        ("at", ctypes.c_void_p),
        ("type", ctypes.c_int),
        ("finite", ctypes.c_int),
    ]


class _Run(ctypes.Structure):
    """Struct Run of loop.c."""

    _fields_ = [
        ("start", ctypes.c_double),
        ("step", ctypes.c_double),
        ("bus", ctypes.c_void_p),
        ("slots", ctypes.c_size_t),
        ("table", ctypes.c_void_p),
        ("every", ctypes.c_long),
        ("steps", ctypes.c_long),
        ("marks", ctypes.c_void_p),
    ]


class _Stop(ctypes.Structure):
    """Struct Stop of loop.c."""

    _fields_ = [("done", ctypes.c_long), ("call", ctypes.c_size_t), ("status", ctypes.c_int)]


class CExecutor:
    """The same loop in C, over the function pointers of the libraries that FMPy has loaded."""

    def __init__(self, loop: Loop) -> None:
        self.loop = loop  # what C points into
        self._execute = _library()
        self._origin = list(_origins(loop.plan))
        self.calls = [_marked(action) for action, _ in self._origin]
        self._calls = (_Call * len(self._origin))(*(_call(*origin) for origin in self._origin))
        recorder, clock = loop.recorder, loop.clock
        self._run = _Run(
            clock.start,
            clock.step,
            loop.bus.ctypes.data,
            len(loop.bus),
            recorder.table.ctypes.data,
            recorder.every,
            recorder.steps,
            recorder.marks.ctypes.data,
        )

    def run(self, first: int, last: int) -> None:
        """Macro steps first .. last - 1, recording each; RunError names the instance that
        failed.
        """
        stop = self._execute(self._calls, len(self._calls), ctypes.byref(self._run), first, last)
        self.loop.recorder.done = stop.done
        if stop.done < last:
            action, transfer = self._origin[stop.call]
            self._fail(action, transfer, stop.status, self.loop.clock.time(stop.done))

    def _fail(
        self, action: Action[Instance], transfer: Transfer | None, status: int, time: float
    ) -> None:
        if status in (NOT_FINITE, TOO_WIDE) and transfer is not None:
            action.instance.raise_if_no_number(transfer, time)
        action.instance.raise_if_failed(action.verb, status, time)


def _origins(
    plan: Sequence[Action[Instance]],
) -> Iterator[tuple[Action[Instance], Transfer | None]]:
    """One entry per FMI call: an action is one step, or one transfer per type of variable."""
    for action in plan:
        if action.verb is Verb.STEP:
            yield action, None
        for transfer in action.instance.transfers[action.verb]:
            yield action, transfer


def _call(action: Action[Instance], transfer: Transfer | None) -> _Call:
    instance, period = action.instance, (action.every, action.phase, action.instance.no_rollback)
    fmi = instance.node.interface.fmi
    if transfer is None:
        kind = _KINDS[fmi, Verb.STEP, True]
        return _Call(kind, *period, _address(instance.do_step), instance.handle)
    kind = _KINDS[fmi, action.verb, transfer.real]
    if not transfer.plain and transfer.real:
        kind = _SET_AFFINE if fmi == 2 else _SET_AFFINE_3
    return _Call(
        kind,
        *period,
        _address(transfer.function),
        instance.handle,
        len(transfer.references),
        ctypes.addressof(transfer.references),
        transfer.slots.ctypes.data,
        ctypes.addressof(transfer.pieces),
        len(transfer.pieces),
        ctypes.addressof(transfer.values),
        transfer.factors.ctypes.data,
        transfer.offsets.ctypes.data,
        len(transfer.names),
        len(transfer.values),
        transfer.at.ctypes.data,
        TYPES_3.index(transfer.access) if transfer.access else 0,
        instance.ours,
    )


def _address(function: CFunction) -> int | None:
    return ctypes.cast(function, ctypes.c_void_p).value


def _library() -> CFunction:
    path = loop_library()
    if path is None:
        raise UsageError(
            "the C executor has not been built: build the project, or choose --executor python"
        )
    execute = ctypes.CDLL(str(path)).execute
    execute.restype = _Stop
    execute.argtypes = [
        ctypes.c_void_p,
        ctypes.c_size_t,
        ctypes.c_void_p,
        ctypes.c_long,
        ctypes.c_long,
    ]
    return execute


Factory = Callable[[Loop], Executor]

FUSED = "fused"
"""The loop in C over one FMU of the whole system (harness.master.fused)."""

EXECUTORS: dict[str, Factory] = {"c": CExecutor, "python": PythonExecutor, FUSED: CExecutor}


def known_executor(name: str) -> str:
    """The name; UsageError if there is no such executor."""
    if name not in EXECUTORS:
        *names, last = EXECUTORS
        raise UsageError(f"there is no executor {name}, only {', '.join(names)} and {last}")
    return name
