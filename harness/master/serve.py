# SPDX-License-Identifier: BSD-2-Clause
"""A stand-in for a board on this machine: an FMU behind the board's end of the protocol.

The code that answers is that of the firmware (fmus/core/link/board.c) as a library; the FMU is the
binary for this machine. One link at a time; the next one waits until the present one has gone.
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
from harness.files.paths import built
from harness.files.temporary import PrivateFolder
from harness.master.calls import layout
from harness.remote.firmware import functions, software
from harness.system.interface import binaries, binary_problem, read_interface

TARGET = b"this machine"

Receive = Callable[[int], bytes]
"""At most so many bytes; b"" when there will be no more."""

Send = Callable[[bytes], object]


class _Software(ctypes.Structure):
    """Struct Software of board.h."""

    _fields_ = layout(
        (ctypes.c_char_p, "name guid"),
        (ctypes.c_uint32, "variables"),
        (ctypes.c_void_p, " ".join(software())),
    )


class _Slot(ctypes.Structure):
    """Struct Slot of board.h."""

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
    """Struct Board of board.h."""

    _fields_ = layout(
        (ctypes.c_char_p, "target"),
        (ctypes.POINTER(_Software), "software"),
        (ctypes.POINTER(_Slot), "slot"),
        (ctypes.c_size_t, "count"),
        (_READ, "read"),
        (_WRITE, "write"),
        (ctypes.c_void_p, "port counter paint_stack measure_stack"),
    )


class StandIn:
    """An FMU on a board that is this machine; a context manager."""

    def __init__(self, fmu: Path) -> None:
        """FmuError if the FMU cannot be loaded here."""
        interface = read_interface(fmu)
        if interface.fmi != 2:
            raise FmuError(f"{fmu.name}: is of FMI 3.0, a board speaks FMI 2.0")
        if problem := binary_problem(interface):
            raise FmuError(f"{fmu.name}: {problem}")
        place = built("board")
        if place is None:
            raise UsageError("a stand-in board is for Linux and macOS only")
        self._files = ExitStack()
        folder = Path(self._files.enter_context(PrivateFolder()))
        unpack(fmu, folder)
        path = next(file for name in binaries(interface) if (file := folder / name).is_file())
        self._fmu = ctypes.CDLL(str(path))
        self._serve = ctypes.CDLL(str(place)).serve
        about = fmu.stem.encode(), interface.model.guid.encode(), len(interface.variables)
        members = {member: _address(self._fmu, f) for member, f in functions(interface).items()}
        self._software = _Software(*about, **members)
        self._slot = _Slot()

    def __enter__(self) -> StandIn:
        return self

    def __exit__(self, *_: object) -> None:
        if self._slot.instance:
            self._fmu.fmi2FreeInstance(ctypes.c_void_p(self._slot.instance))
            self._slot.instance = None
        self._files.close()

    def answer(self, receive: Receive, send: Send) -> None:
        """Answer requests until the stream ends; raises what receive() and send() raise."""
        failures: list[BaseException] = []

        def read(_port: Any, to: int, most: int) -> int:
            try:
                data = b"" if failures else receive(most)
            except BaseException as error:  # through C code it would be lost
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


def _address(library: ctypes.CDLL, function: str) -> int | None:
    return ctypes.cast(getattr(library, function), ctypes.c_void_p).value


@contextmanager
def listening(port: int, host: str = "127.0.0.1") -> Iterator[socket.socket]:
    """A socket that listens; port 0: any that is free. UsageError if it cannot."""
    try:
        listener = socket.create_server((host, port))
    except (OSError, OverflowError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UsageError(f"port {port}: cannot be listened on ({reason})") from error
    with closing(listener):
        yield listener


def serve(board: StandIn, listener: socket.socket) -> None:
    """Answer the next link that connects, until it goes."""
    connection, _ = listener.accept()
    with closing(connection):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            board.answer(connection.recv, connection.sendall)
        except OSError:
            return  # the link has gone without a word
