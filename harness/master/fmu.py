# SPDX-License-Identifier: BSD-2-Clause
"""One loaded FMU: prepared buffers, the verbs of the schedule, save and restore.

FMPy loads the library and instantiates; here are the calls of the macro step with arguments that
are built once. The C executor makes the same calls with the same buffers.
"""

from __future__ import annotations

import contextlib
import ctypes
import secrets
import shutil
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave
from numpy.typing import NDArray

from harness.errors import FmuError, RefusalError, RunError
from harness.files import cache, machine
from harness.files.archive import unpack
from harness.files.paths import is_ours
from harness.master import messages, place
from harness.master.refusals import refusals
from harness.master.transfer import Transfer, transfers
from harness.system.graph import Node
from harness.system.interface import Interface, binaries
from harness.system.schedule import Verb

OK, WARNING, FATAL = 0, 1, 4
STATUS = {2: "fmi2Discard", 3: "fmi2Error", 4: "fmi2Fatal", 5: "fmi2Pending"}

Slave = Any
"""FMPy's FMU2Slave, which is not typed."""

ERROR_CATEGORIES = ("logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal")
"""Log categories of FMI 2.0 that are listened to; everything else stays off."""

HEARD = (*ERROR_CATEGORIES, messages.STATISTICS)


def _is_python(interface: Interface) -> bool:
    """Whether an FMU was built by PythonFMU, which names its exceptions only with logging on."""
    return "PythonFMU" in str(interface.model.generationTool or "")


def _suffix(kind: str) -> str:
    """X of fmi2SetX by the type of a variable."""
    return "Integer" if kind == "Enumeration" else kind


class Instance:
    """An instance of an FMU in its place in the system."""

    def __init__(self, node: Node, folder: Path) -> None:
        """Unpack below `folder`, load and instantiate; FmuError if that fails."""
        self.name = node.component.name
        self._states: list[ctypes.c_void_p] = []
        self._status = OK
        self._stepping = False
        self._used = False
        self.node = node
        self._place, self._files = folder, ExitStack()
        try:
            self.slave = self._load()
        except BaseException:
            self._files.close()
            raise
        self.library = self.slave.dll
        self.handle = ctypes.c_void_p(self.slave.component)
        self.do_step = self.library.fmi2DoStep
        self.no_rollback = 0 if node.interface.model.coSimulation.canGetAndSetFMUstate else 1
        self.transfers = self._transfers()
        self.resettable = True if is_ours(node.interface.path) else None
        """Whether fmi2Reset leaves nothing of a run behind; None: not known yet."""

    @property
    def every(self) -> int:
        """Macro steps per step of the instance."""
        return self.node.component.every

    @property
    def latency(self) -> int:
        """Macro steps by which it publishes later."""
        return self.node.component.latency

    def _transfers(self) -> dict[Verb, list[Transfer]]:
        return {
            Verb.SET: list(transfers("Set", self.library, self.handle, self.node.inputs)),
            Verb.STEP: [],
            Verb.GET: list(transfers("Get", self.library, self.handle, self.node.outputs)),
        }

    # ---- life

    def _load(self) -> Slave:
        model = self.node.interface.model
        folder = self._unpacked()
        library = self._library(folder)
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
            wordy = _is_python(self.node.interface)
            slave.instantiate(callbacks=messages.callbacks(), loggingOn=wordy)
        except Exception as error:  # FMPy raises bare Exceptions, ctypes its own
            reason = messages.take_error(self.name) or " ".join(str(error).split())
            raise FmuError(
                f"{self.name}: {self.node.interface.path.name} cannot be loaded: {reason}"
            ) from error
        self._listen(slave)
        return slave

    def _unpacked(self) -> Path:
        """The unpacked FMU: in the cache, or as a copy of its own below `place`.

        An FMU from elsewhere may keep globals, and a library that is loaded twice from one file has
        them once: each of its instances needs files of its own.
        """
        path = self.node.interface.path
        kept = self._files.enter_context(cache.unpacked(path)) if is_ours(path) else None
        if kept is not None:
            return kept
        folder = self._place / f"fmu-{secrets.token_hex(4)}"
        self._files.callback(shutil.rmtree, folder, ignore_errors=True)
        unpack(path, folder)
        return folder

    def _library(self, folder: Path) -> Path:
        """Path of its library in the unpacked FMU."""
        files = (folder / name for name in binaries(self.node.interface))
        if (library := next((file for file in files if file.is_file()), None)) is None:
            raise FmuError(
                f"{self.name}: {self.node.interface.path.name} holds no binary for this platform"
            )
        with library.open("rb") as file:
            reason = machine.foreign(file.read(machine.HEAD))
        if reason:
            inside = library.relative_to(folder)
            raise FmuError(f"{self.name}: {self.node.interface.path.name}: {inside} {reason}")
        return library

    def _listen(self, slave: Slave) -> None:
        """Let errors and warnings through, and nothing else; an FMU that cannot do that is left
        silent.
        """
        interface = self.node.interface
        categories = [c.name for c in interface.model.logCategories if c.name in HEARD]
        if categories and not _is_python(interface):
            place.enter(self.name, "fmi2SetDebugLogging")
            with contextlib.suppress(FMICallException):
                slave.setDebugLogging(True, categories)

    def renew(self, node: Node, *, trial: bool = False) -> bool:
        """Go back to what instantiation left, in a place of the same FMU; False if that cannot be
        done.

        trial: also an FMU whose reset is not proved.
        """
        if node.interface is not self.node.interface:
            return False
        if self._used and not self._reset(trial):
            return False
        self._used = False
        old, self.node = self.node, node
        if node.inputs != old.inputs or node.outputs != old.outputs:
            self.transfers = self._transfers()
        messages.forget(self.name)
        self._listen(self.slave)
        return True

    def _reset(self, trial: bool) -> bool:
        unable = self.resettable is False or (self.resettable is None and not trial)
        if unable or self._status not in (OK, WARNING):
            return False
        self._terminate()
        place.enter(self.name, "fmi2Reset")
        if self.library.fmi2Reset(self.handle) not in (OK, WARNING):
            self.resettable = False
            messages.note_irreversible([self.name])
        return self.resettable is not False

    def set_start_values(self, time: float) -> None:
        """Set parameters and start values one by one, so that a refused one is named."""
        self._used = True
        setters = {kind: self._setter(kind) for kind in {v.type for v, _ in self.node.settings}}
        for variable, value in self.node.settings:
            place.enter(self.name, f"fmi2Set{_suffix(variable.type)}")
            if (status := setters[variable.type](variable.reference, value)) not in (OK, WARNING):
                doing = f"set{_suffix(variable.type)} refused {value}"
                raise self._failure(status, doing, time, variable.name)

    def _setter(self, kind: str) -> Callable[[int, Any], int]:
        """fmi2SetX for one value of a type, with buffers of its own; returns the FMI status."""
        function = getattr(self.library, f"fmi2Set{_suffix(kind)}")
        ctype = {"Real": ctypes.c_double, "String": ctypes.c_char_p}.get(kind, ctypes.c_int)
        reference = (ctypes.c_uint * 1)()
        buffer: Any = (ctype * 1)()

        def put(number: int, value: Any) -> int:
            reference[0] = number
            buffer[0] = value.encode("utf-8") if isinstance(value, str) else value
            return int(function(self.handle, reference, 1, buffer))

        return put

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
        if self._status != FATAL:
            for state in list(self._states):
                self.free(state)
            self._terminate()
            place.enter(self.name, "fmi2FreeInstance")
            self.slave.freeInstance()
        self._files.close()

    def _terminate(self) -> None:
        """End a run; an FMU that does not want to is not asked twice."""
        with contextlib.suppress(FMICallException):
            if self._stepping and self._status in (OK, WARNING):
                place.enter(self.name, "fmi2Terminate")
                self.slave.terminate()
        self._stepping = False

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
        if not self._stepping and (found := refusals(reason, self.node.interface.settable())):
            return RefusalError(self.name, time, found)
        return RunError(self.name, time, f"{doing}: {reason}", variable)
