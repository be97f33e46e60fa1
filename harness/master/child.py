# SPDX-License-Identifier: BSD-2-Clause
"""Function calls in a child process, so that third-party code can neither terminate nor disturb
this process.

The child calls a function with arguments. It returns the messages that the function sends, notes
for the user, terminal output, and how the function ended. The child has a session of its own,
receives no Ctrl-C, and always ends with this process.
"""

from __future__ import annotations

import logging
import math
import mmap
import multiprocessing
import os
import signal
import sys
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Collection, Iterator
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.sharedctypes import RawArray
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import DTypeLike, NDArray

from harness.errors import HarnessError, UsageError
from harness.files.signals import NUMBERS, held
from harness.master.messages import NOTE_SIZE, Notes, noted_call, share_note

_log = logging.getLogger("harness")

FORK = sys.platform == "linux"
"""True where children are forked from this process, which takes no time; elsewhere a child is a new
interpreter.
"""

Block = Any
"""Block of memory that this process shares with a child."""


def block(size: int) -> Block:
    """Return `size` zero bytes of shared memory; raise UsageError if there is not enough memory."""
    try:
        return mmap.mmap(-1, max(size, 1)) if FORK else RawArray("b", size)
    except (OSError, ValueError, OverflowError, MemoryError) as error:
        raise UsageError(
            f"{size} bytes of results do not fit into memory: record fewer rows with --every"
        ) from error


def array(shared: Block, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Return shared memory as an array of this shape and type, without a copy."""
    return np.frombuffer(shared, dtype=dtype, count=math.prod(shape)).reshape(shape)


LOOK_SECONDS = 0.2
"""Longest wait for a message before the state of the child is checked again [s]."""

GRACE_SECONDS = 0.5
"""Time in which a child that was requested to stop may end by itself [s]."""

LAST_WORDS = 200
"""Number of characters of the newest terminal output of the child that are stored."""

PIPE = 1 << 16
"""Number of bytes that a pipe can hold."""

NOTE, OUTCOME = "note", "outcome"
"""Kinds of messages from the child. NOTE: a note for the user. OUTCOME: the last message, a pair of
the error that the function raised (None: none) and the value that the function returned.
"""

Send = Callable[[str, Any], None]


class Child:
    """Child process that calls function(send, *arguments); a context manager that ends the process.

    send(kind, content): function that sends a message to the parent, which messages() yields;
    open_files: descriptors of files that stay open in the child, because `arguments` need them.
    """

    def __init__(
        self, function: Callable[..., Any], *arguments: Any, open_files: Collection[int] = ()
    ) -> None:
        note = block(NOTE_SIZE)
        self._note = array(note, (NOTE_SIZE,), "uint8")
        self._code: int | None = None
        self._messages, theirs = multiprocessing.Pipe(duplex=False)
        self._terminal, terminal = multiprocessing.Pipe(duplex=False)
        self._open: list[Any] = [self._messages, self._terminal]
        self._lines, self._words = 0, deque[str](maxlen=LAST_WORDS)
        how: Any = multiprocessing.get_context("fork" if FORK else "spawn")
        self.process = how.Process(
            target=_work,
            args=((theirs, terminal), _open_files() - {*open_files}, note, function, arguments),
            daemon=True,
        )
        # Python forbids children of a daemonic process, such as a worker of
        # multiprocessing.Pool; this child is safe, because it ends with its parent
        multiprocessing.current_process().daemon = False
        # held() delays Ctrl-C: an exception during the fork would leave locks of Python locked
        with held(), warnings.catch_warnings():  # newer Pythons warn of a fork with threads
            warnings.simplefilter("ignore", DeprecationWarning)
            self.process.start()
        theirs.close()
        terminal.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
        self._code = self.process.exitcode
        # not left to the garbage collector: an error that refers to this Child would delay it
        self.process.close()
        self._messages.close()
        self._terminal.close()

    def messages(self, seconds: float = math.inf) -> Iterator[tuple[str, Any]]:
        """Yield the messages of the function until it ends, for at most `seconds`. Between
        messages, yield ("", None) about every LOOK_SECONDS, so that the caller can act.
        """
        until, over = time.monotonic() + seconds, False
        while time.monotonic() < until and not over:
            ended = not self.process.is_alive()  # if so, all its output is in the pipes by now
            sources = self._open if ended else [*self._open, self.process.sentinel]
            ready = wait(sources, 0 if ended else LOOK_SECONDS)
            if self._terminal in ready:
                self._read_terminal()
            if self._messages in ready:
                yield from self._received()
            yield "", None
            over = ended and self._messages not in ready

    def _received(self) -> Iterator[tuple[str, Any]]:
        try:
            kind, content = self._messages.recv()
        except Exception:  # at the end of the pipe, or if third-party code wrote into it
            self._open.remove(self._messages)
            return
        if kind == NOTE:
            _log.warning("%s", content)
        else:
            yield kind, content

    def _read_terminal(self) -> None:
        data = b""
        with suppress(OSError):
            data = os.read(self._terminal.fileno(), PIPE)
        if not data:
            self._open.remove(self._terminal)
        self._lines += data.count(b"\n")
        self._words.extend(data[-4 * LAST_WORDS :].decode(errors="replace"))

    def kill(self) -> None:
        """End the child, and the processes that it has started in its session, at once."""
        pid = self.process.pid
        if pid is not None and self.process.is_alive():
            # AttributeError: on Windows; OSError: the child has just begun and has no session yet
            with suppress(AttributeError, OSError):
                os.killpg(pid, signal.SIGKILL)
            self.process.kill()
        self.process.join()

    @property
    def place(self) -> tuple[str, str]:
        """Return the names of the instance and the FMI function of the last call that the child
        noted by note_call(), ("", "") if none.
        """
        return noted_call(self._note)

    def last_words(self) -> str:
        """Return the last line of terminal output; "" if there is none."""
        lines = [line for line in "".join(self._words).splitlines() if line.strip()]
        return "".join(c if c.isprintable() else " " for c in lines[-1]).strip() if lines else ""

    def end(self) -> str:
        """Return in words how the process ended, with the last line of its terminal output."""
        code = self.process.exitcode if self._code is None else self._code
        if code is None:
            text = "lost the connection to its process"
        elif code >= 0:
            text = f"ended the process by exit({code})"
        else:
            known = -code in set(signal.Signals)
            name = signal.Signals(-code).name if known else f"signal {-code}"
            text = f"crashed ({name}, {(signal.strsignal(-code) or 'unknown').lower()})"
        words = self.last_words()
        return text + (f", its last output: {words}" if words else "")

    def report_output(self) -> None:
        """Log the number of lines of the terminal output and the last line, if there was any
        output.
        """
        if words := self.last_words():
            count = max(self._lines, 1)
            _log.warning("the FMUs wrote %d line%s, the last: %s", count, "s" * (count > 1), words)


def _open_files() -> set[int]:
    """Return the descriptors of the open files that a forked child would inherit."""
    folder = Path("/proc/self/fd")
    if not FORK or not folder.is_dir():
        return set()
    listed = list(folder.iterdir())  # one is of the folder itself: now closed, so no link
    return {int(file.name) for file in listed if file.is_symlink()}


# ---- in the child


def _work(
    pipes: tuple[Connection, Connection],
    inherited: set[int],
    note: Block,
    function: Callable[..., Any],
    arguments: tuple[Any, ...],
) -> None:
    messages, terminal = pipes
    _stand_alone()
    _redirect(terminal)
    # close inherited files: third-party code must not write into files of the parent, and other
    # processes may wait until a pipe is closed
    for number in inherited - {0, 1, 2, messages.fileno(), terminal.fileno()}:
        with suppress(OSError):
            os.close(number)
    share_note(array(note, (NOTE_SIZE,), "uint8"))

    def send(kind: str, content: Any) -> None:
        messages.send((kind, content))

    _log.handlers, _log.propagate = [Notes(lambda text: send(NOTE, text))], False
    try:
        value = function(send, *arguments)
    except HarnessError as error:
        send(OUTCOME, (error, None))
    except Exception as error:  # other exceptions may not be picklable
        send(OUTCOME, (RuntimeError(f"{type(error).__name__}: {error}"), None))
    else:
        send(OUTCOME, (None, value))


def _stand_alone() -> None:
    """Ignore Ctrl-C, SIGTERM and SIGHUP, and end together with the parent."""
    for number in NUMBERS:
        signal.signal(number, signal.SIG_IGN)
    if hasattr(os, "setsid"):
        os.setsid()
    end_with_parent()


def end_with_parent() -> None:
    """Start a thread that ends this process as soon as its parent has ended."""

    def wait_for_parent() -> None:
        if parent := multiprocessing.parent_process():
            parent.join()
            os._exit(1)

    threading.Thread(target=wait_for_parent, daemon=True).start()


def _redirect(terminal: Connection) -> None:
    """Redirect standard output and standard error of the whole process to the parent."""
    if os.name != "posix":
        return
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    for number in (1, 2):
        os.dup2(terminal.fileno(), number)
    sys.stdout = sys.stderr = open(2, "w", closefd=False, errors="replace")  # noqa: SIM115
