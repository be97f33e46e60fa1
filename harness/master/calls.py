# SPDX-License-Identifier: BSD-2-Clause
"""The calls of one instance of an FMU, by its version of FMI: the only place, with transfer.py and
loop.c, that knows what they are called.

Every call returns the status of FMI (OK, WARNING, ...), but for those that load and free, and for
what a link is asked.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, ClassVar, NamedTuple, Protocol

import fmpy
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave

from harness.errors import FmuError
from harness.master import messages
from harness.system.interface import Interface
from harness.system.schedule import EARLY_RETURN, TERMINATION
from harness.system.values import Scalar, Variable

OK, WARNING, FATAL = 0, 1, 4
NAMES = {2: "Discard", 3: "Error", 4: "Fatal", 5: "Pending"}

CTYPES: dict[str, Any] = {
    "Real": ctypes.c_double,
    "Integer": ctypes.c_int,
    "Boolean": ctypes.c_int,
    "String": ctypes.c_char_p,
}
"""Types in C of FMI 2.0."""

CTYPES_3: dict[str, Any] = {
    "Float64": ctypes.c_double,
    "Float32": ctypes.c_float,
    **{f"Int{n}": getattr(ctypes, f"c_int{n}") for n in (8, 16, 32, 64)},
    **{f"UInt{n}": getattr(ctypes, f"c_uint{n}") for n in (8, 16, 32, 64)},
    "Boolean": ctypes.c_bool,
    "String": ctypes.c_char_p,
}
"""Types in C of FMI 3.0."""


class Calls(ABC):
    """What both versions have in common; a subclass spells the functions."""

    prefix: ClassVar[str]
    in_c: ClassVar[dict[str, Any]]
    state: ClassVar[str]

    name: str
    library: Any
    handle: ctypes.c_void_p
    do_step: Any

    def call(self, function: str, *arguments: object) -> int:
        """Status of one function, which is named without its prefix."""
        messages.note_call(self.name, self.prefix + function)
        return int(getattr(self.library, self.prefix + function)(self.handle, *arguments))

    def function(self, verb: str, access: str) -> Any:
        """FmiXGetY or fmiXSetY."""
        return getattr(self.library, f"{self.prefix}{verb}{access}")

    def put(self, variables: Sequence[Variable], values: Sequence[Scalar]) -> int:
        """Set variables of one type, in FMI 3.0 all elements of one array."""
        access = variables[0].access
        messages.note_call(self.name, f"{self.prefix}Set{access}")
        buffer = (self.in_c[access] * len(values))(*map(_in_c, values))
        return self._transfer("Set", variables, buffer)

    def get(self, variables: Sequence[Variable]) -> tuple[int, list[float]]:
        """Status and values of variables of one type, in FMI 3.0 all elements of one array."""
        access = variables[0].access
        messages.note_call(self.name, f"{self.prefix}Get{access}")
        buffer = (self.in_c[access] * len(variables))()
        return self._transfer("Get", variables, buffer), [float(value) for value in buffer]

    @abstractmethod
    def _transfer(self, verb: str, variables: Sequence[Variable], buffer: Any) -> int:
        """Status of the transfer of a buffer of these values."""

    @abstractmethod
    def listen(self, categories: Sequence[str]) -> None:
        """Let messages of these categories through, and no others, if the FMU can do that."""

    @abstractmethod
    def initialization(
        self, start: float, stop: float | None
    ) -> Iterator[tuple[str, tuple[Any, ...]]]:
        """The functions, without their prefix, that lead to initialization mode."""

    @abstractmethod
    def step(self, time: float, size: float, no_rollback: int) -> int:
        """One step; a status of loop.c if it is complete and more is to be said."""

    @abstractmethod
    def free(self) -> None:
        """Free the instance and unload the library."""


class FMU2Library(FMU2Slave):  # type: ignore[misc]
    """FMPy's, which looks up the types of its functions for every instance anew: here the first one
    hands them on. From the beginning of the name FMPy knows which version of FMI it is.
    """

    _types: ClassVar[dict[str, tuple[Any, ...]]] = {}

    def _loadFunctions(self) -> None:
        if not self._types:
            super()._loadFunctions()
            self._types.update(
                {n: (f.argnames, f.argtypes, f.restype) for n, f in self._functions.items()}
            )
        for name, types in self._types.items():
            self._functions[name] = function = getattr(self.dll, name)
            function.argnames, function.argtypes, function.restype = types


class Fmi2(Calls):
    """FMI 2.0, over what FMPy has loaded."""

    prefix, in_c, state = "fmi2", CTYPES, "FMUstate"

    def __init__(
        self, name: str, interface: Interface, folder: Path, library: Path, logging: bool
    ) -> None:
        self.name = name
        with contextlib.chdir(Path.cwd()):  # FMPy does not return from a library that fails
            self.slave = FMU2Library(
                guid=interface.model.guid,
                modelIdentifier=interface.model.coSimulation.modelIdentifier,
                unzipDirectory=str(folder),
                instanceName=name,
                libraryPath=str(library),
            )
        self.slave.instantiate(callbacks=messages.callbacks(), loggingOn=logging)
        self.library = self.slave.dll
        self.handle = ctypes.c_void_p(self.slave.component)
        self.do_step = self.library.fmi2DoStep

    def _transfer(self, verb: str, variables: Sequence[Variable], buffer: Any) -> int:
        references = (ctypes.c_uint * len(variables))(*(v.reference for v in variables))
        function = self.function(verb, variables[0].access)
        return int(function(self.handle, references, len(variables), buffer))

    def listen(self, categories: Sequence[str]) -> None:
        """Let messages of these categories through, and no others, if the FMU can do that."""
        messages.note_call(self.name, "fmi2SetDebugLogging")
        with contextlib.suppress(FMICallException):
            self.slave.setDebugLogging(True, categories)

    def initialization(
        self, start: float, stop: float | None
    ) -> Iterator[tuple[str, tuple[Any, ...]]]:
        """The functions, without their prefix, that lead to initialization mode."""
        yield "SetupExperiment", (0, 0.0, start, int(stop is not None), stop or 0.0)
        yield "EnterInitializationMode", ()

    def step(self, time: float, size: float, no_rollback: int) -> int:
        """One step."""
        return int(self.do_step(self.handle, time, size, no_rollback))

    def free(self) -> None:
        """Free the instance and unload the library."""
        messages.note_call(self.name, "fmi2FreeInstance")
        self.slave.freeInstance()


ARGUMENTS_3: dict[str, tuple[Any, ...]] = {
    "SetDebugLogging": (ctypes.c_bool, ctypes.c_size_t, ctypes.c_void_p),
    "EnterInitializationMode": (
        ctypes.c_bool, ctypes.c_double, ctypes.c_double, ctypes.c_bool, ctypes.c_double,
    ),
    "ExitInitializationMode": (),
    "Terminate": (),
    "Reset": (),
    "DoStep": (ctypes.c_double, ctypes.c_double, ctypes.c_bool, *(ctypes.c_void_p,) * 4),
    "GetFMUState": (ctypes.c_void_p,),
    "SetFMUState": (ctypes.c_void_p,),
    "FreeFMUState": (ctypes.c_void_p,),
    **{
        f"{verb}{kind}": (ctypes.c_void_p, ctypes.c_size_t) * 2
        for verb in ("Get", "Set") for kind in CTYPES_3
    },
}  # fmt: skip
"""Arguments of the functions of FMI 3.0 after the instance."""

LOGGER_3 = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_char_p)


class Fmi3(Calls):
    """FMI 3.0: without event mode, early return and intermediate update, so that an FMU handles its
    events by itself.
    """

    prefix, in_c, state = "fmi3", CTYPES_3, "FMUState"

    def __init__(
        self, name: str, interface: Interface, folder: Path, library: Path, logging: bool
    ) -> None:
        self.name = name
        with contextlib.chdir(library.parent):  # where libraries that it needs may lie
            self.library = ctypes.CDLL(str(library))
        for function, arguments in ARGUMENTS_3.items():
            if (found := getattr(self.library, f"fmi3{function}", None)) is not None:
                found.argtypes = (ctypes.c_void_p, *arguments)
        self._logger = LOGGER_3(self._receive)  # the FMU calls it as long as it lives
        self.handle = self._instantiated(interface, folder, logging)
        self.do_step = self.library.fmi3DoStep
        self._flags, self._last = (ctypes.c_bool * 3)(), ctypes.c_double()
        first = ctypes.addressof(self._flags)
        self._said = (first, first + 1, first + 2, ctypes.addressof(self._last))

    def _instantiated(self, interface: Interface, folder: Path, logging: bool) -> ctypes.c_void_p:
        new = self.library.fmi3InstantiateCoSimulation
        new.restype = ctypes.c_void_p
        new.argtypes = (
            *(ctypes.c_char_p,) * 3, *(ctypes.c_bool,) * 4, ctypes.c_void_p, ctypes.c_size_t,
            ctypes.c_void_p, LOGGER_3, ctypes.c_void_p,
        )  # fmt: skip
        resources = folder / "resources"
        where = f"{resources}{os.sep}".encode() if resources.is_dir() else None
        token = interface.model.guid.encode()
        handle = new(
            self.name.encode(), token, where, False, logging, False, False, None, 0, None,
            self._logger, None,
        )  # fmt: skip
        if not handle:
            self._unload()
            raise FmuError("fmi3InstantiateCoSimulation gives no instance")
        return ctypes.c_void_p(handle)

    def _receive(self, _: object, status: int, category: bytes | None, text: bytes | None) -> None:
        messages.receive(self.name.encode(), status, category, text)

    def _transfer(self, verb: str, variables: Sequence[Variable], buffer: Any) -> int:
        references = (ctypes.c_uint * 1)(variables[0].reference)
        function = self.function(verb, variables[0].access)
        return int(function(self.handle, references, 1, buffer, len(buffer)))

    def listen(self, categories: Sequence[str]) -> None:
        """Let messages of these categories through, and no others, if the FMU can do that."""
        names = (ctypes.c_char_p * len(categories))(*(c.encode() for c in categories))
        self.call("SetDebugLogging", True, len(categories), names)

    def initialization(
        self, start: float, stop: float | None
    ) -> Iterator[tuple[str, tuple[Any, ...]]]:
        """The functions, without their prefix, that lead to initialization mode."""
        yield "EnterInitializationMode", (False, 0.0, start, stop is not None, stop or 0.0)

    def step(self, time: float, size: float, no_rollback: int) -> int:
        """One step; TERMINATION, EARLY_RETURN if the FMU says so."""
        status = int(self.do_step(self.handle, time, size, bool(no_rollback), *self._said))
        _, terminate, early = self._flags
        if status not in (OK, WARNING):
            return status
        return TERMINATION if terminate else EARLY_RETURN if early else status

    def free(self) -> None:
        """Free the instance and unload the library."""
        messages.note_call(self.name, "fmi3FreeInstance")
        self.library.fmi3FreeInstance.restype = None
        self.library.fmi3FreeInstance(self.handle)
        self._unload()

    def _unload(self) -> None:
        fmpy.freeLibrary(self.library._handle)


def _in_c(value: Scalar) -> Any:
    return value.encode("utf-8") if isinstance(value, str) else value


def load(
    name: str, interface: Interface, folder: Path, library: Path, *, logging: bool = False
) -> Calls:
    """Load the library of an unpacked FMU and instantiate it; FmuError, or what FMPy and ctypes
    raise.
    """
    kind = Fmi3 if interface.fmi == 3 else Fmi2
    messages.note_call(
        name, "fmi3InstantiateCoSimulation" if interface.fmi == 3 else "fmi2Instantiate"
    )
    return kind(name, interface, folder, library, logging)


# ---- what a component on another processor has cost there, asked of the link that stands for it


class Linked(Protocol):
    """An instance of an FMU."""

    name: str
    library: Any
    handle: Any


class Cost(NamedTuple):
    """Steps of a component on its processor.

    steps: number; total, largest: instructions of all steps, and of the dearest (0: not counted);
    when: communication point of the dearest [s]; stack: used by the steps [bytes]; memory:
    allocated by the instance [bytes]; late: answers after their deadline.
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
        """Instructions of a step."""
        return self.total / self.steps if self.steps else 0.0


class _Statistics(ctypes.Structure):
    """Struct LinkStatistics of link_statistics.h."""

    _fields_ = [
        ("steps", ctypes.c_uint64),
        ("total", ctypes.c_uint64),
        ("largest", ctypes.c_uint64),
        ("when", ctypes.c_double),
        ("stack", ctypes.c_uint32),
        ("memory", ctypes.c_uint32),
        ("late", ctypes.c_uint64),
    ]


def cost(instance: Linked) -> Cost:
    """Cost of the steps so far; FmuError if the instance is no link, or its board is silent."""
    ask = getattr(instance.library, "slnk_statistics", None)
    if ask is None:
        raise FmuError(f"{instance.name}: runs in the simulation, not on a processor of its own")
    ask.restype = ctypes.c_bool
    found = _Statistics()
    if not ask(instance.handle, ctypes.byref(found)):
        raise FmuError(f"{instance.name}: its board does not say what its steps have cost")
    return Cost(*(getattr(found, name) for name in Cost._fields))
