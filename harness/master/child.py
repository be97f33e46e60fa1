# SPDX-License-Identifier: BSD-2-Clause
"""A call in a process of its own, so that foreign code can neither end nor disturb ours.

What enters: a function and its arguments. What leaves: the messages that it sends, notes for the
user, what was written to its terminal, and in what way it ended. The child stands in a session of
its own, hears no Ctrl-C, and ends with us, whatever ends us.
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
from collections.abc import Callable, Iterator
from contextlib import suppress
from multiprocessing.connection import Connection, wait
from multiprocessing.sharedctypes import RawArray
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import DTypeLike, NDArray

from harness.errors import HarnessError, UsageError
from harness.files.signals import held
from harness.master.messages import NOTE_SIZE, Notes, keep_note_in, noted_call

_log = logging.getLogger("harness")

FORK = sys.platform == "linux"
"""Whether children are forks, which begin at once; elsewhere they are fresh interpreters."""

Block = Any
"""Shared bytes that can be handed to a child."""


def block(size: int) -> Block:
    """So many zero bytes; UsageError if there is no room."""
    try:
        return mmap.mmap(-1, max(size, 1)) if FORK else RawArray("b", size)
    except (OSError, ValueError, OverflowError, MemoryError) as error:
        raise UsageError(
            f"{size} bytes of results do not fit into memory: record fewer with --every"
        ) from error


def array(shared: Block, shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """The bytes as an array."""
    return np.frombuffer(shared, dtype=dtype, count=math.prod(shape)).reshape(shape)


LOOK_SECONDS = 0.2
"""Time between two looks at the child."""

GRACE_SECONDS = 0.5
"""Time that a child has to end by itself when it is asked to."""

LAST_WORDS = 200
"""Characters kept of what was written last to the terminal of the child."""

PIPE = 1 << 16
"""Bytes that a pipe holds."""

NOTE, OUTCOME = "note", "outcome"
"""Kinds of messages: a note for the user; the last one, None or the error that the function has
raised, beside its value.
"""

Send = Callable[[str, Any], None]


class Child:
    """A process that calls function(send, *arguments); a context manager that ends it."""

    def __init__(self, function: Callable[..., Any], *arguments: Any) -> None:
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
            args=((theirs, terminal), _open_files(), note, function, arguments),
            daemon=True,
        )
        # a daemonic process, as a worker of dask is, may have this child: it ends with its parent
        multiprocessing.current_process().daemon = False
        # an interrupt between the locks of a fork would leave them closed for ever
        with held(), warnings.catch_warnings():  # newer Pythons warn of forks beside other threads
            warnings.simplefilter("ignore", DeprecationWarning)
            self.process.start()
        theirs.close()
        terminal.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()
        self._code = self.process.exitcode
        self.process.close()  # at once, not when an error that knows of it is forgotten
        self._messages.close()
        self._terminal.close()

    def messages(self, seconds: float = math.inf) -> Iterator[tuple[str, Any]]:
        """What the function sends until it has ended, with ("", None) now and then; at most for
        so many seconds.
        """
        until, over = time.monotonic() + seconds, False
        while time.monotonic() < until and not over:
            ended = not self.process.is_alive()  # then all that will ever come is in the pipes
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
        except Exception:  # the end of the pipe, or what foreign code has written into it
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
        """End the process now."""
        if self.process.is_alive():
            self.process.kill()
        self.process.join()

    @property
    def place(self) -> tuple[str, str]:
        """Instance and call of an FMU that was noted last."""
        return noted_call(self._note)

    def last_words(self) -> str:
        """The last line that was written to its terminal; "" if there is none."""
        lines = [line for line in "".join(self._words).splitlines() if line.strip()]
        return "".join(c if c.isprintable() else " " for c in lines[-1]).strip() if lines else ""

    def end(self) -> str:
        """In what way the process has ended."""
        code = self.process.exitcode if self._code is None else self._code
        if code is None:
            text = "lost contact"
        elif code >= 0:
            text = f"ended the process by exit({code})"
        else:
            known = -code in set(signal.Signals)
            name = signal.Signals(-code).name if known else f"signal {-code}"
            text = f"crashed ({name}, {(signal.strsignal(-code) or 'unknown').lower()})"
        words = self.last_words()
        return text + (f", its last output: {words}" if words else "")

    def report_output(self) -> None:
        """Say in one note what was written to the terminal, if anything was."""
        if words := self.last_words():
            count = max(self._lines, 1)
            _log.warning("the FMUs wrote %d line%s, the last: %s", count, "s" * (count > 1), words)


def _open_files() -> set[int]:
    """Numbers of the files that a fork would inherit now."""
    folder = Path("/proc/self/fd")
    if not FORK or not folder.is_dir():
        return set()
    listed = list(folder.iterdir())  # with the number of this list itself, which is closed now
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
    # foreign code must not write into files of ours, nor keep pipes open that others wait for
    for number in inherited - {0, 1, 2, messages.fileno(), terminal.fileno()}:
        with suppress(OSError):
            os.close(number)
    keep_note_in(array(note, (NOTE_SIZE,), "uint8"))

    def send(kind: str, content: Any) -> None:
        messages.send((kind, content))

    _log.handlers, _log.propagate = [Notes(lambda text: send(NOTE, text))], False
    try:
        value = function(send, *arguments)
    except HarnessError as error:
        send(OUTCOME, (error, None))
    except Exception as error:  # others may not go through a pipe
        send(OUTCOME, (RuntimeError(f"{type(error).__name__}: {error}"), None))
    else:
        send(OUTCOME, (None, value))


def _stand_alone() -> None:
    """Hear none of the signals of a terminal, and end with the parent."""
    for name in ("SIGINT", "SIGHUP", "SIGTERM"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    if hasattr(os, "setsid"):
        os.setsid()
    end_with_parent()


def end_with_parent() -> None:
    """Let this process end when the one that has made it ends, whatever it is doing then."""

    def wait_for_parent() -> None:
        if parent := multiprocessing.parent_process():
            parent.join()
            os._exit(1)

    threading.Thread(target=wait_for_parent, daemon=True).start()


def _redirect(terminal: Connection) -> None:
    """Standard output and standard error of everything in this process go to the parent."""
    if os.name != "posix":
        return
    for stream in (sys.stdout, sys.stderr):
        if stream is not None:
            stream.flush()
    for number in (1, 2):
        os.dup2(terminal.fileno(), number)
    sys.stdout = sys.stderr = open(2, "w", closefd=False, errors="replace")  # noqa: SIM115
