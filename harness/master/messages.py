# SPDX-License-Identifier: BSD-2-Clause
"""What the FMUs say through the logger callback of FMI, and the call that is being made.

FMPy formats the variadic messages in a small C library that knows one Python function per process,
so there is one log for all instances. An FMU's message is fetched right after its call has failed.
"""

from __future__ import annotations

import ctypes
import logging
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

import numpy as np
from fmpy import calloc, free
from fmpy.fmi2 import (
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.fmi3 import fmi3LogMessageCallback
from fmpy.logging import addLoggerProxy
from numpy.typing import NDArray

WARNING, DISCARD = 1, 2
"""fmi2Status values: messages of status DISCARD and above explain a failed call."""

STATISTICS = "logStatistics"
"""Log category of links: what the steps of a component have cost on its processor."""

_log = logging.getLogger("harness")
_errors: deque[tuple[str, str]] = deque(maxlen=20)
_warnings: dict[str, tuple[int, str]] = {}


def _receive(instance: bytes | None, status: int, category: bytes | None, said: Any) -> None:
    """Note what an instance says."""
    name, text = _text(instance), " ".join(_text(said).split())
    if status >= DISCARD:
        _errors.append((name, text))
    elif status == WARNING:
        count, _ = _warnings.get(name, (0, ""))
        _warnings[name] = count + 1, text
    elif category == STATISTICS.encode():
        _log.warning("%s: %s", name, text)


def _text(raw: bytes | None) -> str:
    return (raw or b"").decode("utf-8", errors="replace")


_logger = fmi2CallbackLoggerTYPE(lambda _environment, *said: _receive(*said))
_allocate = fmi2CallbackAllocateMemoryTYPE(calloc)
_free = fmi2CallbackFreeMemoryTYPE(free)


def callbacks() -> ctypes.Structure:
    """Callback functions of FMI 2.0 for one instance; they log to this module."""
    functions: ctypes.Structure = fmi2CallbackFunctions()
    functions.logger, functions.allocateMemory, functions.freeMemory = _logger, _allocate, _free
    addLoggerProxy(ctypes.byref(functions))
    return functions


def logger(instance: str) -> Any:
    """The callback of FMI 3.0 for the messages of one instance."""
    name = instance.encode()
    return fmi3LogMessageCallback(lambda _environment, *said: _receive(name, *said))


def take_error(instance: str) -> str | None:
    """The newest error message of an instance (or of an FMU that does not give its name), which is
    then forgotten.
    """
    candidates = [text for name, text in _errors if name in (instance, "")]
    _errors.clear()
    return candidates[-1] if candidates else None


def report_warnings(instance: str) -> None:
    """Pass on how often an instance has warned, and its last warning, as one line of Python's
    logging.
    """
    count, last = _warnings.pop(instance, (0, ""))
    if count:
        several = "s" * (count > 1)
        _log.warning("%s: %d warning%s, the last: %s", instance, count, several, last)


def forget(instance: str) -> None:
    """Drop what an earlier instance of the same name has said."""
    _warnings.pop(instance, None)
    take_error(instance)


# ---- the call that is being made, kept where others can read it if the process ends in it
# (those of the macro step are marked by the executors instead, which costs less)

NOTE_SIZE = 400
"""Bytes of a note: name of the instance, a zero byte, name of the call."""

Note = NDArray[np.uint8]

_note: Note = np.zeros(NOTE_SIZE, dtype=np.uint8)


def keep_note_in(note: Note) -> None:
    """From now on keep the note there: memory that is shared with another process."""
    global _note  # noqa: PLW0603 - one process makes one call at a time
    _note = note


def note_call(instance: str, call: str) -> None:
    """Note that an instance is about to be called."""
    _note[:] = _written(instance, call)


@lru_cache(maxsize=1024)
def _written(instance: str, call: str) -> Note:
    text = f"{instance[:200]}\0{call}".encode()[:NOTE_SIZE].ljust(NOTE_SIZE, b"\0")
    return np.frombuffer(text, dtype=np.uint8)


def noted_call(note: Note) -> tuple[str, str]:
    """Instance and call that were noted last; ("", "") if none was."""
    instance, _, call = note.tobytes().decode(errors="replace").partition("\0")
    return instance, call.rstrip("\0")


# ---- notes of the harness on several runs of one system: what holds for all is said once


class Notes(logging.Handler):
    """Hands every note to a function."""

    def __init__(self, hear: Callable[[str], object]) -> None:
        super().__init__(logging.WARNING)
        self._hear = hear

    def emit(self, record: logging.LogRecord) -> None:
        """Hand on the line."""
        self._hear(record.getMessage())


@contextmanager
def noted() -> Iterator[dict[str, None]]:
    """What the harness notes in the `with` block, each line once, in place of its log."""
    lines: dict[str, None] = {}
    before = _log.handlers, _log.propagate
    _log.handlers, _log.propagate = [Notes(lines.setdefault)], False
    try:
        yield lines
    finally:
        _log.handlers, _log.propagate = before


@contextmanager
def said_once() -> Iterator[None]:
    """Let the notes of the `with` block through when it is over, each line once."""
    lines: dict[str, None] = {}
    try:
        with noted() as lines:
            yield
    finally:
        for line in lines:
            _log.warning("%s", line)
