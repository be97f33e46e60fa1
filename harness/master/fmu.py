# SPDX-License-Identifier: BSD-2-Clause
"""Loaded FMU: its buffers, the actions of the schedule (set inputs, step, get outputs), and how its
state is saved and restored.

calls.py loads the library and hides most differences between FMI 2.0 and 3.0. This module defines
the order of calls. The arguments of the calls in a macro step are built once, and the C executor
makes the same calls with the same buffers.
"""

from __future__ import annotations

import ctypes
import secrets
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from harness.errors import FmuError, RejectedValueError, RunError
from harness.files import cache
from harness.files.archive import unpack
from harness.files.paths import is_ours
from harness.master import messages
from harness.master.calls import FATAL, NAMES, OK, WARNING, Calls
from harness.master.messages import rejections
from harness.master.transfer import Transfer, transfers
from harness.system.graph import Node
from harness.system.interface import Interface, binaries, binary_problem
from harness.system.schedule import EARLY_RETURN, TERMINATION, Verb
from harness.system.values import Scalar, Variable, base, coerce, resting

HEARD = (
    *("logStatusWarning", "logStatusDiscard", "logStatusError", "logStatusFatal"),
    messages.STATISTICS,
)
"""Log categories whose messages are requested from an FMU: four categories of FMI 2.0, and one of
the FMUs of the project. All other categories stay off.
"""

REASONS = {
    TERMINATION: "requested termination",
    EARLY_RETURN: "returned early although that was not allowed",
}
"""Reasons why a step ends the run although the FMI status of the step is OK or a warning."""

DOING = {
    Verb.SET: "setting inputs failed",
    Verb.STEP: "step failed",
    Verb.GET: "reading outputs failed",
}


def _is_python(interface: Interface) -> bool:
    """Return whether the tool PythonFMU built an FMU. The logging of such an FMU must be on from
    its instantiation, because otherwise it does not report its exceptions.
    """
    return "PythonFMU" in str(interface.model.generationTool or "")


def _unpacked(path: Path, folder: Callable[[], Path], files: ExitStack, ours: bool) -> Path:
    """Return the folder of the unpacked FMU: in the cache for an FMU of the project, else a
    separate copy in a new folder inside folder(). Closing `files` removes the copy.

    A third-party FMU may have global variables. Instances that load the library from one file would
    share these variables, so each instance gets a copy of the files.
    """
    cached = cache.unpacked(path) if ours else None
    if cached is not None:
        return cached
    own = folder() / f"fmu-{secrets.token_hex(4)}"
    files.callback(shutil.rmtree, own, ignore_errors=True)
    unpack(path, own)
    return own


class Instance:
    """Loaded instance of the FMU of one component."""

    def __init__(self, node: Node, folder: Callable[[], Path], ours: bool | None = None) -> None:
        """Unpack, load and instantiate the FMU of a node; raise ArchiveError or FmuError if that
        fails.

        folder: function that returns the folder for unpacked third-party FMUs; ours: whether the
        FMU belongs to the project (None: decided by its bytes). Such an FMU has no global
        variables, resets completely, and has finite outputs only, so instances share its unpacked
        files, the next run may reuse the instance, and loop.c does not check its outputs.
        """
        self.name = node.component.name
        self._states: list[ctypes.c_void_p] = []
        self._status = OK
        self._stepping = False
        self._used = False
        self.node = node
        self.ours = is_ours(node.interface.path) if ours is None else ours
        with ExitStack() as files:
            self.calls = self._loaded(_unpacked(node.interface.path, folder, files, self.ours))
            self._listen()
            self.transfers = self._transfers()
            self._files = files.pop_all()
        self.no_rollback = 0 if node.interface.model.coSimulation.canGetAndSetFMUstate else 1

    def _loaded(self, folder: Path) -> Calls:
        """Load the library of an unpacked FMU, instantiate the FMU and return its calls; raise
        FmuError if this fails.
        """
        interface = self.node.interface
        places = [folder / name for name in binaries(interface)]
        library = next((file for file in places if file.is_file()), places[0])
        messages.forget(self.name)
        try:
            return Calls(self.name, interface, folder, library, logging=_is_python(interface))
        except Exception as error:  # loading a library can raise any error
            message = messages.take_error(self.name) or " ".join(str(error).split())
            reason = binary_problem(interface) or message
            file = interface.path.name
            raise FmuError(f"{self.name}: {file} cannot be loaded: {reason}") from error

    @property
    def every(self) -> int:
        """Return the number of macro steps per step of the instance."""
        return self.node.component.every

    @property
    def latency(self) -> int:
        """Return the number of macro steps by which the outputs are published late."""
        return self.node.component.latency

    def _transfers(self) -> dict[Verb, list[Transfer]]:
        calls, node = self.calls, self.node
        held = {variable.name: value for variable, value in node.settings}
        return {
            Verb.SET: list(transfers("Set", calls, node.inputs, node.interface, held)),
            Verb.STEP: [],
            Verb.GET: list(transfers("Get", calls, node.outputs, node.interface, {})),
        }

    # ---- life

    def _listen(self) -> None:
        """Enable only the log categories in HEARD. Leave the logging unchanged in an FMU of
        PythonFMU or without these categories.
        """
        interface = self.node.interface
        categories = [c.name for c in interface.model.logCategories if c.name in HEARD]
        if categories and not _is_python(interface):
            self.calls.listen(categories)

    def renew(self, node: Node) -> bool:
        """Reset the instance to the state after instantiation, for the next run with `node`. Return
        False if the node has another FMU, or if the FMU cannot be reset or may retain values of the
        last run.
        """
        if node.interface is not self.node.interface or (self._used and not self._reset()):
            return False
        self._used = False
        old, self.node = self.node, node
        same = node.inputs == old.inputs and node.outputs == old.outputs
        if not same or (node.interface.fmi == 3 and node.settings != old.settings):
            self.transfers = self._transfers()
        messages.forget(self.name)
        self._listen()
        return True

    def _reset(self) -> bool:
        if not self.ours or self._status not in (OK, WARNING):
            return False
        self._terminate()
        return self.calls.call("Reset") in (OK, WARNING)

    def set_start_values(self, time: float) -> None:
        """Set parameters and start values. Every scalar in FMI 2.0, and every array in FMI 3.0, is
        set by its own call, so that an error names the rejected variable.
        """
        self._used = True
        for variables, values, name in self._settings():
            if (status := self.calls.put(variables, values)) not in (OK, WARNING):
                access = variables[0].access
                value = values[0] if len(values) == 1 else list(values)
                raise self._failure(status, f"set{access} rejected {value}", time, name)

    def _settings(self) -> Iterator[tuple[tuple[Variable, ...], list[Scalar], str]]:
        """Yield for each call that sets values: its variables, their values, and the name for an
        error message. In FMI 2.0 a call sets one variable, in FMI 3.0 all elements of an array of
        which at least one has a new value.
        """
        interface = self.node.interface
        if interface.fmi == 2:
            yield from (((v,), [value], v.name) for v, value in self.node.settings)
            return
        given = {variable.name: value for variable, value in self.node.settings}
        rows = {(v.reference, v.access): interface.row(v) for v, _ in self.node.settings}
        for row in rows.values():
            names = [v.name for v in row if v.name in given]
            name = names[0] if len(names) == 1 else base(row[0].name)
            yield row, [given.get(v.name, resting(v)) for v in row], name

    def put(self, variables: Sequence[Variable], values: NDArray[np.float64], time: float) -> None:
        """Set all elements of one input between steps, at `time` [s]; raise RunError if the FMU
        rejects the values.
        """
        given = [coerce(float(x), v.type, v.access) for v, x in zip(variables, values, strict=True)]
        if (status := self.calls.put(variables, given)) not in (OK, WARNING):
            raise self._failure(status, f"set{variables[0].access} rejected {given}", time)

    def enter_initialization(self, start: float, stop: float) -> None:
        """Bring the FMU into initialization mode; start, stop: time span of the run [s]."""
        for function, arguments in self.calls.initialization(start, stop):
            self._call(function, start, *arguments)

    def exit_initialization(self, time: float) -> None:
        """Leave initialization mode; the FMU then checks its parameters. Raise RunError if it
        fails.
        """
        self._call("ExitInitializationMode", time)
        self._stepping = True

    def close(self) -> None:
        """Terminate the instance if its last call succeeded, free it and unload the library; after
        a fatal error skip all three. Remove the unpacked files.
        """
        messages.report_warnings(self.name)
        if self._status != FATAL:
            for state in list(self._states):
                self.free(state)
            self._terminate()
            self.calls.free()
        self._files.close()

    def _terminate(self) -> None:
        """Call Terminate if the FMU is initialised and its last call succeeded; ignore the returned
        status.
        """
        if self._stepping and self._status in (OK, WARNING):
            self.calls.call("Terminate")
        self._stepping = False

    # ---- the macro step

    def act(self, verb: Verb, bus: NDArray[np.float64], time: float, step: float) -> None:
        """Perform one action of the schedule: SET inputs, STEP, or GET outputs; raise RunError if
        the FMU fails. time: communication point [s]; step: length of a macro step [s].
        """
        if verb is Verb.STEP:
            status = self.calls.step(time, self.every * step, self.no_rollback)
            self.raise_if_failed(verb, status, time)
        for transfer in self.transfers[verb]:
            status = transfer.write(bus) if verb is Verb.SET else transfer.read(bus)
            self.raise_if_failed(verb, status, time, transfer)

    def propagate(self, verb: Verb, bus: NDArray[np.float64], time: float) -> None:
        """Perform SET or GET outside the schedule, as in initialization mode. GET accepts outputs
        that are not finite yet. SET skips a transfer while one of its values is not finite.
        """
        messages.note_call(self.name, verb.call(self.node.interface.fmi))
        for transfer in self.transfers[verb]:
            if verb is Verb.GET:
                self.raise_if_failed(verb, transfer.read(bus), time)
            elif np.isfinite(bus[transfer.slots]).all():
                self.raise_if_failed(verb, transfer.write(bus), time)

    def check_outputs(self, time: float) -> None:
        """Raise RunError if an output that was read last is not a finite number, or is a whole
        number that a double on the bus cannot represent.
        """
        for transfer in self.transfers[Verb.GET]:
            self.raise_if_failed(Verb.GET, OK, time, transfer)

    def raise_if_failed(
        self, verb: Verb, status: int, time: float, transfer: Transfer | None = None
    ) -> None:
        """Raise RunError if an FMI call has failed, if a step has requested termination or returned
        early, or if an output is not a finite number or is a whole number that a double on the bus
        cannot represent. transfer: values to be checked after GET (None: no check of outputs).
        """
        if status in REASONS:
            raise RunError(self.name, time, REASONS[status])
        read = transfer if verb is Verb.GET and status <= WARNING else None
        if read is not None and (problem := read.problem()):
            raise RunError(self.name, time, *problem)
        if status not in (OK, WARNING):
            raise self._failure(status, DOING[verb], time)

    # ---- rollback

    def save(self, time: float) -> ctypes.c_void_p:
        """Save the present state of the FMU and return a pointer to it, to be released with free();
        raise RunError if the FMU cannot save its state.
        """
        if self.no_rollback:
            raise RunError(self.name, time, "this FMU cannot save and restore its state")
        state = ctypes.c_void_p()
        self._call(f"Get{self.calls.state}", time, ctypes.byref(state))
        self._states.append(state)
        return state

    def restore(self, state: ctypes.c_void_p, time: float) -> None:
        """Return the FMU to a state that save() returned; raise RunError if the FMU fails."""
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
        word = f"{self.calls.prefix}{NAMES[status]}" if status in NAMES else f"status {status}"
        reason = messages.take_error(self.name) or f"{word}, without a message"
        if not self._stepping and (found := rejections(reason, self.node.interface.settable())):
            return RejectedValueError(self.name, time, found)
        return RunError(self.name, time, f"{doing}: {reason}", variable)
