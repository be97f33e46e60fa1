# SPDX-License-Identifier: BSD-2-Clause
"""Software board: an FMU on this machine that answers a link FMU by the protocol of boards.

The code with which firmware answers requests (fmus/core/link/board.c) is compiled to a library for
this machine, and calls the FMU's binary for this machine. One link FMU is served at a time; the
next one waits.
"""

from __future__ import annotations

import ctypes
import socket
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from pathlib import Path
from typing import Any

from harness.errors import FmuError, UsageError
from harness.files.archive import unpack
from harness.files.output import PrivateFolder
from harness.files.paths import built
from harness.master.calls import address, layout
from harness.remote.firmware import functions, software
from harness.system.interface import binaries, binary_problem, read_interface

TARGET = b"this machine"

Receive = Callable[[int], bytes]
"""Function that returns at most the given number of bytes, b"" at the end of the stream."""

Send = Callable[[bytes], object]


class _Software(ctypes.Structure):
    """C struct Software of board.h."""

    _fields_ = layout(
        (ctypes.c_char_p, "name guid"),
        (ctypes.c_uint32, "variables"),
        (ctypes.c_void_p, " ".join(software())),
    )


class _Slot(ctypes.Structure):
    """C struct Slot of board.h."""

    _fields_ = layout(
        (ctypes.c_void_p, "instance"),
        (ctypes.c_uint32, "first last"),
        (ctypes.c_bool, "described"),
        (ctypes.c_uint32, "memory"),
        (ctypes.c_uint64, "steps total largest"),
        (ctypes.c_double, "when"),
    )


_READ = ctypes.CFUNCTYPE(ctypes.c_size_t, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t)
_WRITE = ctypes.CFUNCTYPE(ctypes.c_bool, ctypes.c_void_p, ctypes.c_void_p, ctypes.c_size_t)


class _Board(ctypes.Structure):
    """C struct Board of board.h."""

    _fields_ = layout(
        (ctypes.c_char_p, "target"),
        (ctypes.POINTER(_Software), "software"),
        (ctypes.POINTER(_Slot), "slot"),
        (ctypes.c_size_t, "count"),
        (_READ, "read"),
        (_WRITE, "write"),
        (ctypes.c_void_p, "port counter paint_stack measure_stack"),
    )


class Board:
    """FMU that this machine serves as a board would; a context manager that frees the FMU."""

    def __init__(self, fmu: Path) -> None:
        """Load the FMU; raise FmuError if it is no FMU of FMI 2.0 with a binary for this machine,
        UsageError if board.so has not been built.
        """
        interface = read_interface(fmu)
        if interface.fmi != 2:
            raise FmuError(f"{fmu.name}: expected an FMU of FMI 2.0, got FMI {interface.fmi}.0")
        if problem := binary_problem(interface):
            raise FmuError(f"{fmu.name}: {problem}")
        place = built("board")
        if place is None:
            raise UsageError("harness serve needs board.so, which `make` builds on Linux and macOS")
        self._files = ExitStack()
        folder = Path(self._files.enter_context(PrivateFolder()))
        unpack(fmu, folder)
        path = next(file for name in binaries(interface) if (file := folder / name).is_file())
        self._fmu = ctypes.CDLL(str(path))
        self._serve = ctypes.CDLL(str(place)).serve
        about = fmu.stem.encode(), interface.model.guid.encode(), len(interface.variables)
        members = {m: address(getattr(self._fmu, f)) for m, f in functions(interface).items()}
        self._software = _Software(*about, **members)
        self._slot = _Slot()

    def __enter__(self) -> Board:
        return self

    def __exit__(self, *_: object) -> None:
        if self._slot.instance:
            self._fmu.fmi2FreeInstance(ctypes.c_void_p(self._slot.instance))
            self._slot.instance = None
        self._files.close()

    def answer(self, receive: Receive, send: Send) -> None:
        """Answer the requests of a link FMU until its stream ends; raise the errors of receive()
        and send().
        """
        failures: list[BaseException] = []

        def read(_port: Any, to: int, most: int) -> int:
            try:
                data = b"" if failures else receive(most)
            except BaseException as error:  # raised below: it cannot pass through C
                failures.append(error)
                return 0
            ctypes.memmove(to, data, len(data))
            return len(data)

        def write(_port: Any, data: int, count: int) -> bool:
            try:
                send(ctypes.string_at(data, count))
            except BaseException as error:
                failures.append(error)
            return not failures

        software, slot = ctypes.pointer(self._software), ctypes.pointer(self._slot)
        board = _Board(TARGET, software, slot, 1, _READ(read), _WRITE(write))
        self._serve(ctypes.byref(board))
        if failures:
            raise failures[0]


@contextmanager
def listening(path: Path | None = None) -> Iterator[socket.socket]:
    """Yield a listening Unix socket that only this user can open (mode 600), at `path` or in a
    private folder; raise UsageError if the socket cannot be made.
    """
    with ExitStack() as life:
        place = path or Path(life.enter_context(PrivateFolder())) / "board"
        listener = life.enter_context(closing(socket.socket(socket.AF_UNIX)))
        try:
            listener.bind(str(place.absolute()))
            life.callback(place.unlink, missing_ok=True)
            place.chmod(0o600)  # before listen(), so that no other user can connect
            listener.listen()
        except OSError as error:
            reason = error.strerror or error
            raise UsageError(f"{place}: cannot listen on this socket ({reason})") from error
        yield listener


def serve(board: Board, listener: socket.socket) -> None:
    """Accept the next link FMU that connects, and answer its requests until it disconnects."""
    connection, _ = listener.accept()
    with closing(connection):
        try:
            board.answer(connection.recv, connection.sendall)
        except OSError:
            return  # the link disconnected without a request to end
