# SPDX-License-Identifier: BSD-2-Clause
"""Calls of one instance of an FMU, in FMI 2.0 or FMI 3.0. Callers name most functions without the
prefix fmi2 or fmi3, such as DoStep.

Argument types are the types that FMPy declares. Every call returns a status of FMI (OK, WARNING,
...), except for loading, freeing, and requests to a link FMU.
"""

from __future__ import annotations

import contextlib
import ctypes
import inspect
import os
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, get_args

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmpy.fmi3 import FMU3Slave, fmi3IntermediateUpdateCallback

from harness.errors import FmuError
from harness.master import messages
from harness.system.interface import Interface
from harness.system.schedule import EARLY_RETURN, TERMINATION
from harness.system.values import Scalar, Variable

OK, WARNING, FATAL = 0, 1, 4
NAMES = {2: "Discard", 3: "Error", 4: "Fatal", 5: "Pending"}

CTYPES: Mapping[int, Mapping[str, Any]] = {
    2: {
        "Real": ctypes.c_double,
        "Integer": ctypes.c_int,
        "Boolean": ctypes.c_int,
        "String": ctypes.c_char_p,
    },
    3: {
        "Float64": ctypes.c_double,
        "Float32": ctypes.c_float,
        **{f"Int{n}": getattr(ctypes, f"c_int{n}") for n in (8, 16, 32, 64)},
        **{f"UInt{n}": getattr(ctypes, f"c_uint{n}") for n in (8, 16, 32, 64)},
        "Boolean": ctypes.c_bool,
        "String": ctypes.c_char_p,
    },
}
"""C types by FMI version (2 or 3) and name of the FMI type. Values are transferred type by type in
this order, and loop.c numbers the types of FMI 3.0 in this order.
"""

NEEDED = ("DoStep", "Terminate", "FreeInstance")
"""Functions that must exist when an FMU is loaded. A missing function would otherwise be noticed
only during or after a run, and the rows of the run would be lost.
"""


def layout(*types: tuple[Any, str]) -> list[tuple[str, Any]]:
    """Return the `_fields_` of a ctypes.Structure. types: pairs of a C type and the names,
    separated by blanks, of consecutive fields of this type.
    """
    return [(name, kind) for kind, names in types for name in names.split()]


def address(function: Any) -> int | None:
    """Return the address of a function of a ctypes library, None for a null pointer."""
    return ctypes.cast(function, ctypes.c_void_p).value


class Library(ctypes.CDLL):
    """Shared library of an FMU, whose FMI functions have the argument and return types of FMPy."""

    def __getattr__(self, name: str) -> Any:
        found = super().__getattr__(name)
        if name.startswith("fmi"):
            found.argtypes, found.restype = _types(name)
        return found


@cache
def _types(function: str) -> tuple[list[Any], Any]:
    """Return the C types of the arguments of an FMI function, such as `fmi2DoStep`, and the C type
    of its return value.
    """
    slave = FMU2Slave if function.startswith("fmi2") else FMU3Slave
    signature = inspect.signature(getattr(slave, function))
    _, *arguments = (
        get_args(p.annotation) or [p.annotation] for p in signature.parameters.values()
    )
    returned = signature.return_annotation
    known = {int: ctypes.c_int, inspect.Signature.empty: None}
    return [types[0] for types in arguments], known.get(returned, returned)


class Calls:
    """Instance of an FMU, with the FMI calls as methods. An instance of FMI 3.0 is created without
    event mode, early return and intermediate update, so that the FMU handles its events by itself.
    """

    def __init__(
        self, name: str, interface: Interface, folder: Path, library: Path, *, logging: bool = False
    ) -> None:
        """Load `library` of the FMU that is unpacked in `folder`, and instantiate the FMU; raise
        FmuError, or the errors of ctypes.
        """
        self.name, self.fmi = name, interface.fmi
        self.prefix, self.in_c = f"fmi{self.fmi}", CTYPES[self.fmi]
        self.state = "FMUstate" if self.fmi == 2 else "FMUState"
        new = f"{self.prefix}Instantiate{'' if self.fmi == 2 else 'CoSimulation'}"
        messages.note_call(name, new)
        with contextlib.chdir(library.parent):  # the library may load others from its own folder
            self.library = Library(str(library))
        for function in NEEDED:
            self.function(function)
        arguments = self._new(interface.model.guid.encode(), folder / "resources", logging)
        self.handle = ctypes.c_void_p(getattr(self.library, new)(name.encode(), *arguments))
        if not self.handle:
            fmpy.freeLibrary(self.library._handle)
            raise FmuError(f"{new} returned no instance")
        self.do_step = self.function("DoStep")
        self._flags, self._last = [ctypes.c_bool() for _ in range(3)], ctypes.c_double()
        self._results = [*map(ctypes.byref, self._flags), ctypes.byref(self._last)]

    def _new(self, token: bytes, resources: Path, logging: bool) -> tuple[Any, ...]:
        """Return the arguments of fmi2Instantiate or fmi3InstantiateCoSimulation after the name of
        the instance. The callback functions among them are stored in `self`, because the FMU calls
        them as long as the instance exists.
        """
        if self.fmi == 2:
            self._heard = messages.callbacks()
            place = resources.as_uri().encode()
            return 1, token, place, ctypes.byref(self._heard), 0, logging
        self._heard = messages.logger(self.name)
        where = f"{resources}{os.sep}".encode() if resources.is_dir() else None
        nothing = fmi3IntermediateUpdateCallback()
        modes = False, logging, False, False
        return token, where, *modes, None, 0, None, self._heard, nothing

    def function(self, name: str) -> Any:
        """Return a function of the library by its name without prefix, such as DoStep; raise
        FmuError if it is missing.
        """
        try:
            return getattr(self.library, self.prefix + name)
        except AttributeError as error:
            raise FmuError(f"{self.name}: its FMU has no function {self.prefix}{name}") from error

    def call(self, function: str, *arguments: object) -> int:
        """Call a function by its name without prefix and return its status."""
        messages.note_call(self.name, self.prefix + function)
        return int(self.function(function)(self.handle, *arguments))

    def put(self, variables: Sequence[Variable], values: Sequence[Scalar]) -> int:
        """Set variables of one FMI type to `values` and return the FMI status. In FMI 3.0 the
        variables must be all elements of one array.
        """
        given = (v.encode("utf-8") if isinstance(v, str) else v for v in values)
        buffer = (self.in_c[variables[0].access] * len(values))(*given)
        count = len(variables) if self.fmi == 2 else 1
        references = (ctypes.c_uint * count)(*(v.reference for v in variables[:count]))
        sizes = () if self.fmi == 2 else (len(buffer),)
        return self.call(f"Set{variables[0].access}", references, count, buffer, *sizes)

    def listen(self, categories: Sequence[str]) -> None:
        """Request the log messages of these categories, and of no others, from the FMU."""
        names = (ctypes.c_char_p * len(categories))(*(c.encode() for c in categories))
        self.call("SetDebugLogging", True, len(categories), names)

    def initialization(
        self, start: float, stop: float | None
    ) -> Iterator[tuple[str, tuple[Any, ...]]]:
        """Yield name (without prefix) and arguments of each function that must be called until the
        FMU is in initialization mode. start, stop: time span of the run [s].
        """
        span = False, 0.0, start, stop is not None, stop or 0.0
        if self.fmi == 2:
            yield "SetupExperiment", span
        yield "EnterInitializationMode", () if self.fmi == 2 else span

    def step(self, time: float, size: float, no_rollback: int) -> int:
        """Perform one step and return the status of FMI; instead of OK or WARNING, return
        TERMINATION or EARLY_RETURN if an FMU of FMI 3.0 reports one of these. time, size: start and
        length of the step [s]; no_rollback: 1 if no earlier state will be restored, else 0.
        """
        results = () if self.fmi == 2 else self._results
        status = int(self.do_step(self.handle, time, size, no_rollback, *results))
        _, terminate, early = self._flags
        if status not in (OK, WARNING):
            return status
        return TERMINATION if terminate else EARLY_RETURN if early else status

    def free(self) -> None:
        """Free the instance and unload the library."""
        messages.note_call(self.name, f"{self.prefix}FreeInstance")
        self.function("FreeInstance")(self.handle)
        fmpy.freeLibrary(self.library._handle)


# ---- cost of a component on another processor, from the link FMU that represents it


class Cost(NamedTuple):
    """Cost of the steps of a component on its processor.

    steps: number of steps; total, largest: instructions of all steps and of the most expensive step
    (0: not counted); when: communication point of the most expensive step [s]; stack: used by the
    steps [bytes]; memory: allocated by the instance [bytes]; late: number of answers after their
    deadline.
    """

    steps: int
    total: int
    largest: int
    when: float
    stack: int
    memory: int
    late: int

    @property
    def mean(self) -> float:
        """Return the mean number of instructions per step."""
        return self.total / self.steps if self.steps else 0.0


class _Statistics(ctypes.Structure):
    """C struct LinkStatistics of link_statistics.h, with the fields of Cost."""

    _fields_ = layout(
        (ctypes.c_uint64, "steps total largest"),
        (ctypes.c_double, "when"),
        (ctypes.c_uint32, "stack memory"),
        (ctypes.c_uint64, "late"),
    )


def cost(calls: Calls) -> Cost:
    """Return the cost of all steps so far of the component that a link FMU represents; raise
    FmuError if the instance is not a link FMU or its board does not answer.
    """
    statistics = getattr(calls.library, "slnk_statistics", None)
    if statistics is None:
        raise FmuError(f"{calls.name}: its cost is counted only on a processor; choose one by --on")
    statistics.restype = ctypes.c_bool
    found = _Statistics()
    if not statistics(calls.handle, ctypes.byref(found)):
        raise FmuError(f"{calls.name}: its board does not report the cost of its steps")
    return Cost(*(getattr(found, name) for name in Cost._fields))
