"""One loaded FMU: prepared buffers, the verbs of the schedule, save and restore.

FMPy loads the library and instantiates; here are the calls of the macro step with arguments that
are built once. The C executor makes the same calls with the same buffers.
"""

from __future__ import annotations

import contextlib
import ctypes
from pathlib import Path
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from numpy.typing import NDArray

from harness.archive import unpack
from harness.errors import FmuError, RunError
from harness.master import messages, place
from harness.master.transfer import Transfer, transfers
from harness.system.graph import Node, Setting
from harness.system.interface import binaries
from harness.system.schedule import Verb

OK, WARNING, FATAL = 0, 1, 4
STATUS = {2: "fmi2Discard", 3: "fmi2Error", 4: "fmi2Fatal", 5: "fmi2Pending"}

_SETTERS: dict[str, tuple[str, Any]] = {
    "Real": ("Real", ctypes.c_double),
    "Boolean": ("Boolean", ctypes.c_int),
    "String": ("String", ctypes.c_char_p),
}
"""Functions fmi2SetX and the C types of their values; other types go as Integer."""

Slave = Any
"""FMPy's FMU2Slave, which is not typed."""

ERROR_CATEGORIES = ("logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal")
"""Log categories of FMI 2.0 that are listened to; everything else stays off."""


class Instance:
    """An instance of an FMU in its place in the system."""

    def __init__(self, node: Node, folder: Path) -> None:
        """Unpack below `folder`, load and instantiate; FmuError if that fails."""
        self.node = node
        self.name = node.component.name
        self.every = node.component.every
        self.latency = node.component.latency
        self._states: list[ctypes.c_void_p] = []
        self._status = OK
        self._stepping = False
        self.slave = self._load(folder / self.name)
        self.library = self.slave.dll
        self.handle = ctypes.c_void_p(self.slave.component)
        self.do_step = self.library.fmi2DoStep
        self.no_rollback = 0 if node.interface.model.coSimulation.canGetAndSetFMUstate else 1
        self.transfers = {
            Verb.SET: list(transfers("Set", self.library, self.handle, node.inputs)),
            Verb.STEP: [],
            Verb.GET: list(transfers("Get", self.library, self.handle, node.outputs)),
        }

    # ---- life

    def _load(self, folder: Path) -> Slave:
        model = self.node.interface.model
        library = self._unpacked(folder)
        messages.forget(self.name)
        place.enter(self.name, "fmi2Instantiate")
        try:
            with contextlib.chdir(Path.cwd()):  # FMPy does not return from a library that fails
                slave = FMU2Slave(
                    guid=model.guid,
                    modelIdentifier=model.coSimulation.modelIdentifier,
                    unzipDirectory=str(folder),
                    instanceName=self.name,
                    libraryPath=str(library),
                )
            slave.instantiate(callbacks=messages.callbacks(), loggingOn=False)
        except Exception as error:  # FMPy raises bare Exceptions, ctypes its own
            reason = messages.take_error(self.name) or " ".join(str(error).split())
            raise FmuError(
                f"{self.name}: {self.node.interface.path.name} cannot be loaded: {reason}"
            ) from error
        self._listen(slave)
        return slave

    def _unpacked(self, folder: Path) -> Path:
        """Unpack the FMU and return the path of its library."""
        folder.mkdir()
        unpack(self.node.interface.path, folder)
        places = (folder / name for name in binaries(self.node.interface))
        if (library := next((place for place in places if place.is_file()), None)) is None:
            raise FmuError(
                f"{self.name}: {self.node.interface.path.name} holds no binary for this platform"
            )
        return library

    def _listen(self, slave: Slave) -> None:
        """Let errors and warnings through, and nothing else; an FMU that cannot do that is left
        silent.
        """
        categories = [
            c.name for c in self.node.interface.model.logCategories if c.name in ERROR_CATEGORIES
        ]
        if categories:
            place.enter(self.name, "fmi2SetDebugLogging")
            with contextlib.suppress(FMICallException):
                slave.setDebugLogging(True, categories)

    def set_start_values(self, time: float) -> None:
        """Set parameters and start values one by one, so that a refused one is named."""
        for setting in self.node.settings:
            self._set(setting, time)

    def _set(self, setting: Setting, time: float) -> None:
        variable, value = setting
        kind, ctype = _SETTERS.get(variable.type, ("Integer", ctypes.c_int))
        place.enter(self.name, f"fmi2Set{kind}")
        reference = (ctypes.c_uint * 1)(variable.reference)
        plain: Any = value.encode() if isinstance(value, str) else value
        set_value = getattr(self.library, f"fmi2Set{kind}")
        status = set_value(self.handle, reference, ctypes.c_size_t(1), (ctype * 1)(plain))
        if status not in (OK, WARNING):
            raise self._failure(status, f"set{kind} refused {value}", time, variable.name)

    def enter_initialization(self, start: float, stop: float) -> None:
        """fmi2SetupExperiment and fmi2EnterInitializationMode."""
        self._call("fmi2SetupExperiment", start, 0, 0.0, start, 1, stop)
        self._call("fmi2EnterInitializationMode", start)

    def exit_initialization(self, time: float) -> None:
        """fmi2ExitInitializationMode: the FMU judges its parameters."""
        self._call("fmi2ExitInitializationMode", time)
        self._stepping = True

    def close(self) -> None:
        """Terminate and free the instance as far as its last status allows, and unload the
        library.
        """
        messages.report_warnings(self.name)
        if self._status == FATAL:
            return
        for state in list(self._states):
            self.free(state)
        with contextlib.suppress(FMICallException):
            if self._stepping and self._status in (OK, WARNING):
                place.enter(self.name, "fmi2Terminate")
                self.slave.terminate()
        place.enter(self.name, "fmi2FreeInstance")
        self.slave.freeInstance()

    # ---- the macro step

    def act(self, verb: Verb, bus: NDArray[np.float64], time: float, step: float) -> None:
        """Do one verb; time: communication point [s]; step: macro step [s]; RunError if the FMU
        fails.
        """
        if verb is Verb.STEP:
            self.raise_if_failed(
                verb, self.do_step(self.handle, time, self.every * step, self.no_rollback), time
            )
        for transfer in self.transfers[verb]:
            self.raise_if_failed(
                verb, transfer.write(bus) if verb is Verb.SET else transfer.read(bus), time
            )
            if verb is Verb.GET:
                self.raise_if_not_finite(transfer, time)

    def propagate_inputs(self, bus: NDArray[np.float64], time: float) -> None:
        """Set the inputs in initialization mode, as far as what drives them has been computed
        yet.
        """
        place.enter(self.name, Verb.SET.call)
        for transfer in self.transfers[Verb.SET]:
            if np.isfinite(bus[transfer.slots]).all():
                self.raise_if_failed(Verb.SET, transfer.write(bus), time)

    def propagate_outputs(self, bus: NDArray[np.float64], time: float) -> None:
        """Read the outputs in initialization mode, where they may not be finite yet."""
        place.enter(self.name, Verb.GET.call)
        for transfer in self.transfers[Verb.GET]:
            self.raise_if_failed(Verb.GET, transfer.read(bus), time)

    def raise_if_failed(self, verb: Verb, status: int, time: float) -> None:
        """RunError if an FMI call has failed."""
        if status not in (OK, WARNING):
            doing = {
                Verb.SET: "setting inputs failed",
                Verb.STEP: "step failed",
                Verb.GET: "reading outputs failed",
            }
            raise self._failure(status, doing[verb], time)

    def check_outputs(self, time: float) -> None:
        """RunError if an output that was read last is infinite or not a number."""
        for transfer in self.transfers[Verb.GET]:
            self.raise_if_not_finite(transfer, time)

    def raise_if_not_finite(self, transfer: Transfer, time: float) -> None:
        """RunError if an output is infinite or not a number."""
        if transfer.real and not np.isfinite(transfer.view).all():
            name = transfer.not_finite()
            raise RunError(self.name, time, "output is not a finite number", name)

    # ---- rollback

    def save(self, time: float) -> ctypes.c_void_p:
        """The state of the FMU now; RunError if it has none to give. Release it with free()."""
        if self.no_rollback:
            raise RunError(self.name, time, "this FMU cannot save and restore its state")
        state = ctypes.c_void_p()
        self._call("fmi2GetFMUstate", time, ctypes.byref(state))
        self._states.append(state)
        return state

    def restore(self, state: ctypes.c_void_p, time: float) -> None:
        """Return to a saved state."""
        self._call("fmi2SetFMUstate", time, state)

    def free(self, state: ctypes.c_void_p) -> None:
        """Release a saved state."""
        self._states.remove(state)
        with contextlib.suppress(FMICallException):
            self.slave.fmi2FreeFMUstate(self.slave.component, ctypes.byref(state))

    # ---- calls

    def _call(self, function: str, time: float, *arguments: object) -> None:
        place.enter(self.name, function)
        status = getattr(self.library, function)(self.handle, *arguments)
        if status not in (OK, WARNING):
            raise self._failure(status, f"{function} failed", time)

    def _failure(
        self, status: int, doing: str, time: float, variable: str | None = None
    ) -> RunError:
        self._status = status
        reason = (
            messages.take_error(self.name)
            or f"{STATUS.get(status, f'status {status}')}, without a message"
        )
        return RunError(self.name, time, f"{doing}: {reason}", variable)
