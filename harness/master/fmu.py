# SPDX-License-Identifier: BSD-2-Clause
"""One loaded FMU: prepared buffers, the verbs of the schedule, save and restore.

calls.py loads the library and knows what the functions of its version of FMI are called; here is
the order of a life, and the macro step with arguments that are built once. The C executor makes the
same calls with the same buffers.
"""

from __future__ import annotations

import ctypes
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.errors import FmuError, RefusalError, RunError
from harness.files import cache, machine
from harness.files.archive import unpack
from harness.files.paths import is_ours
from harness.master import calls, messages
from harness.master.calls import FATAL, NAMES, OK, WARNING, Calls
from harness.master.refusals import refusals
from harness.master.transfer import Transfer, transfers
from harness.system.graph import Node
from harness.system.interface import Interface, binaries
from harness.system.schedule import EARLY_RETURN, TERMINATION, Verb
from harness.system.values import Scalar, Variable, base, resting

ERROR_CATEGORIES = ("logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal")
"""Log categories of FMI 2.0 that are listened to; everything else stays off."""

SAID = {
    TERMINATION: "asks to end the simulation",
    EARLY_RETURN: "returned early although that was not allowed",
}
"""What a step of FMI 3.0 may say although it has not failed."""

HEARD = (*ERROR_CATEGORIES, messages.STATISTICS)


def _is_python(interface: Interface) -> bool:
    """Whether an FMU was built by PythonFMU, which names its exceptions only with logging on."""
    return "PythonFMU" in str(interface.model.generationTool or "")


def loaded(  # noqa: PLR0913, PLR0917 - of an instance
    name: str,
    interface: Interface,
    folder: Callable[[], Path],
    files: ExitStack,
    label: str = "",
    ours: bool | None = None,
) -> Calls:
    """An instance of an FMU, unpacked below folder() until `files` are closed; FmuError, which
    begins with the label. ours: whether it keeps no globals (None: as its place says).
    """
    label += interface.path.name
    ours = is_ours(interface.path) if ours is None else ours
    unpacked = _unpacked(interface.path, folder, files, ours)
    library = _library(interface, unpacked, label)
    messages.forget(name)
    try:
        return calls.load(name, interface, unpacked, library, logging=_is_python(interface))
    except Exception as error:  # FMPy raises bare Exceptions, ctypes its own
        reason = messages.take_error(name) or " ".join(str(error).split())
        raise FmuError(f"{label} cannot be loaded: {reason}") from error


def _unpacked(path: Path, folder: Callable[[], Path], files: ExitStack, ours: bool) -> Path:
    """The unpacked FMU: in the cache, or as a copy of its own below folder().

    An FMU from elsewhere may keep globals, and a library that is loaded twice from one file has
    them once: each of its instances needs files of its own.
    """
    kept = files.enter_context(cache.unpacked(path)) if ours else None
    if kept is not None:
        return kept
    own = folder() / f"fmu-{secrets.token_hex(4)}"
    files.callback(shutil.rmtree, own, ignore_errors=True)
    unpack(path, own)
    return own


def _library(interface: Interface, folder: Path, label: str) -> Path:
    """Path of its library in the unpacked FMU."""
    places = (folder / name for name in binaries(interface))
    if (library := next((file for file in places if file.is_file()), None)) is None:
        raise FmuError(f"{label} holds no binary for this platform")
    with library.open("rb") as file:
        reason = machine.foreign(file.read(machine.HEAD))
    if reason:
        raise FmuError(f"{label}: {library.relative_to(folder)} {reason}")
    return library


class Instance:
    """An instance of an FMU in its place in the system."""

    def __init__(self, node: Node, folder: Callable[[], Path], ours: bool | None = None) -> None:
        """Unpack below folder(), load and instantiate; FmuError if that fails. ours: whether it is
        an FMU of the project (None: as its place says): it keeps no globals, and gives no output
        that is not finite.
        """
        self.name = node.component.name
        self._states: list[ctypes.c_void_p] = []
        self._status = OK
        self._stepping = False
        self._used = False
        self.node = node
        self.ours = is_ours(node.interface.path) if ours is None else ours
        self._files = ExitStack()
        try:
            label = f"{self.name}: "
            self.calls = loaded(self.name, node.interface, folder, self._files, label, self.ours)
            self._listen()
        except BaseException:
            self._files.close()
            raise
        self.library, self.handle, self.do_step = (
            self.calls.library,
            self.calls.handle,
            self.calls.do_step,
        )
        self.slave = getattr(self.calls, "slave", None)
        """What FMPy has loaded, of FMI 2.0."""
        self.no_rollback = 0 if node.interface.model.coSimulation.canGetAndSetFMUstate else 1
        self.transfers = self._transfers()
        self.resettable = True if self.ours else None
        """Whether a reset leaves nothing of a run behind; None: not known yet."""

    @property
    def every(self) -> int:
        """Macro steps per step of the instance."""
        return self.node.component.every

    @property
    def latency(self) -> int:
        """Macro steps by which it publishes later."""
        return self.node.component.latency

    def _transfers(self) -> dict[Verb, list[Transfer]]:
        held = {variable.name: value for variable, value in self.node.settings}
        return {
            Verb.SET: list(
                transfers("Set", self.calls, self.node.inputs, self.node.interface, held)
            ),
            Verb.STEP: [],
            Verb.GET: list(transfers("Get", self.calls, self.node.outputs, self.node.interface)),
        }

    # ---- life

    def _listen(self) -> None:
        """Let errors and warnings through, and nothing else; an FMU that cannot do that is left
        silent.
        """
        interface = self.node.interface
        categories = [c.name for c in interface.model.logCategories if c.name in HEARD]
        if categories and not _is_python(interface):
            self.calls.listen(categories)

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
        same = node.inputs == old.inputs and node.outputs == old.outputs
        if not same or (node.interface.fmi == 3 and node.settings != old.settings):
            self.transfers = self._transfers()
        messages.forget(self.name)
        self._listen()
        return True

    def _reset(self, trial: bool) -> bool:
        unable = self.resettable is False or (self.resettable is None and not trial)
        if unable or self._status not in (OK, WARNING):
            return False
        self._terminate()
        if self.calls.call("Reset") not in (OK, WARNING):
            self.resettable = False
            messages.note_irreversible([self.name])
        return self.resettable is not False

    def set_start_values(self, time: float) -> None:
        """Set parameters and start values one by one, so that a refused one is named; in FMI 3.0 an
        array at once.
        """
        self._used = True
        for variables, values, name in self._settings():
            if (status := self.calls.put(variables, values)) not in (OK, WARNING):
                access = variables[0].access
                value = values[0] if len(values) == 1 else list(values)
                raise self._failure(status, f"set{access} refused {value}", time, name)

    def _settings(self) -> Iterator[tuple[tuple[Variable, ...], list[Scalar], str]]:
        """What is set at once, with the name for an error: one value, or all elements of an array
        of which one is set.
        """
        interface = self.node.interface
        if interface.fmi == 2:
            yield from (
                ((variable,), [value], variable.name) for variable, value in self.node.settings
            )
            return
        rows: dict[tuple[int, str], dict[int, Scalar]] = {}
        first: dict[tuple[int, str], Variable] = {}
        for variable, value in self.node.settings:
            key = variable.reference, variable.access
            rows.setdefault(key, {})[variable.element] = value
            first.setdefault(key, variable)
        for key, given in rows.items():
            row = interface.row(first[key])
            values = [given.get(v.element, resting(v)) for v in row]
            name = first[key].name if len(given) == 1 else base(first[key].name)
            yield row, values, name

    def enter_initialization(self, start: float, stop: float) -> None:
        """The calls that lead to initialization mode."""
        for function, arguments in self.calls.initialization(start, stop):
            self._call(function, start, *arguments)

    def exit_initialization(self, time: float) -> None:
        """The FMU judges its parameters."""
        self._call("ExitInitializationMode", time)
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
            self.calls.free()
        self._files.close()

    def _terminate(self) -> None:
        """End a run; an FMU that does not want to is not asked twice."""
        if self._stepping and self._status in (OK, WARNING):
            self.calls.call("Terminate")
        self._stepping = False

    # ---- the macro step

    def act(self, verb: Verb, bus: NDArray[np.float64], time: float, step: float) -> None:
        """Do one verb; time: communication point [s]; step: macro step [s]; RunError if the FMU
        fails.
        """
        if verb is Verb.STEP:
            self.raise_if_failed(
                verb, self.calls.step(time, self.every * step, self.no_rollback), time
            )
        for transfer in self.transfers[verb]:
            self.raise_if_failed(
                verb, transfer.write(bus) if verb is Verb.SET else transfer.read(bus), time
            )
            if verb is Verb.GET:
                self.raise_if_no_number(transfer, time)

    def propagate_inputs(self, bus: NDArray[np.float64], time: float) -> None:
        """Set the inputs in initialization mode, as far as what drives them has been computed
        yet.
        """
        messages.note_call(self.name, Verb.SET.call(self.node.interface.fmi))
        for transfer in self.transfers[Verb.SET]:
            if np.isfinite(bus[transfer.slots]).all():
                self.raise_if_failed(Verb.SET, transfer.write(bus), time)

    def propagate_outputs(self, bus: NDArray[np.float64], time: float) -> None:
        """Read the outputs in initialization mode, where they may not be finite yet."""
        messages.note_call(self.name, Verb.GET.call(self.node.interface.fmi))
        for transfer in self.transfers[Verb.GET]:
            self.raise_if_failed(Verb.GET, transfer.read(bus), time)

    def raise_if_failed(self, verb: Verb, status: int, time: float) -> None:
        """RunError if an FMI call has failed, or a step has said that there is no next one."""
        if status in SAID:
            raise RunError(self.name, time, SAID[status])
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
            self.raise_if_no_number(transfer, time)

    def raise_if_no_number(self, transfer: Transfer, time: float) -> None:
        """RunError if an output is infinite, not a number, or a whole number that is none of the
        bus.
        """
        if transfer.real and not np.isfinite(transfer.view).all():
            name = transfer.not_finite()
            raise RunError(self.name, time, "output is not a finite number", name)
        if transfer.wide and (found := transfer.too_wide()) is not None:
            name, value = found
            line = f"{name} = {value}: is beyond 2^53, which the bus cannot carry"
            raise RunError(self.name, time, line)

    # ---- rollback

    def save(self, time: float) -> ctypes.c_void_p:
        """The state of the FMU now; RunError if it has none to give. Release it with free()."""
        if self.no_rollback:
            raise RunError(self.name, time, "this FMU cannot save and restore its state")
        state = ctypes.c_void_p()
        self._call(f"Get{self.calls.state}", time, ctypes.byref(state))
        self._states.append(state)
        return state

    def restore(self, state: ctypes.c_void_p, time: float) -> None:
        """Return to a saved state."""
        self._call(f"Set{self.calls.state}", time, state)

    def free(self, state: ctypes.c_void_p) -> None:
        """Release a saved state."""
        self._states.remove(state)
        self.calls.call(f"Free{self.calls.state}", ctypes.byref(state))

    # ---- calls

    def _call(self, function: str, time: float, *arguments: object) -> None:
        status = self.calls.call(function, *arguments)
        if status not in (OK, WARNING):
            raise self._failure(status, f"{self.calls.prefix}{function} failed", time)

    def _failure(
        self, status: int, doing: str, time: float, variable: str | None = None
    ) -> RunError:
        self._status = status
        reason = messages.take_error(self.name) or f"{self._word(status)}, without a message"
        if not self._stepping and (found := refusals(reason, self.node.interface.settable())):
            return RefusalError(self.name, time, found)
        return RunError(self.name, time, f"{doing}: {reason}", variable)

    def _word(self, status: int) -> str:
        return f"{self.calls.prefix}{NAMES[status]}" if status in NAMES else f"status {status}"
