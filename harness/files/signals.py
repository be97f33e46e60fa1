# SPDX-License-Identifier: BSD-2-Clause
"""Handling of the signals that end the program (Ctrl-C, SIGTERM, SIGHUP) without loss of results.

In an `as_interrupts()` block all of them raise KeyboardInterrupt. In a `held()` block a signal is
only recorded: code there that can stop without losing results calls check(), which raises
KeyboardInterrupt; all other code runs to the end of the block first.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

NUMBERS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)

_pending: list[int] = []
_depth = 0


@contextmanager
def held() -> Iterator[None]:
    """Delay signals until the end of the `with` block, or of the outermost one if such blocks are
    nested. In a thread other than the main thread this has no effect, since only the main thread
    handles signals.
    """
    global _depth  # noqa: PLW0603 - there is one set of signal handlers
    if _depth or threading.current_thread() is not threading.main_thread():
        yield
        return
    earlier = _exchange_handlers()
    _depth = 1
    try:
        yield
    except BaseException:
        _pending.clear()  # discard the signals: the exception already ends the program
        raise
    finally:
        _depth = 0
        _restore(list(earlier.items()))
    if _pending:
        number = _pending[0]
        _pending.clear()
        signal.raise_signal(number)


def _exchange_handlers() -> dict[int, signal._HANDLER]:
    """Install handlers that only record arriving signals, and return the earlier handlers by signal
    number. A signal that is ignored, as under nohup, stays ignored.
    """
    earlier = {n: signal.getsignal(n) for n in NUMBERS}
    earlier = {n: h for n, h in earlier.items() if h not in (signal.SIG_IGN, None)}
    for number in earlier:
        signal.signal(number, _mark)
    return earlier


def _restore(handlers: list[tuple[int, signal._HANDLER]]) -> None:
    """Restore the handlers of all signals, even if a signal arrives in between and its restored
    handler raises an exception.
    """
    if handlers:
        try:
            signal.signal(*handlers.pop())
        finally:
            _restore(handlers)


def _mark(number: int, _: FrameType | None) -> None:
    _pending.append(number)


def check() -> None:
    """Raise KeyboardInterrupt if a held() block has recorded a signal, and forget this signal."""
    if _pending:
        _pending.clear()
        raise KeyboardInterrupt


@contextmanager
def as_interrupts() -> Iterator[None]:
    """Raise KeyboardInterrupt for SIGTERM and SIGHUP inside the `with` block, unless the program
    has its own handler for them.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    numbers = [n for n in NUMBERS if signal.getsignal(n) is signal.SIG_DFL]
    for number in numbers:
        signal.signal(number, _interrupt)
    try:
        yield
    finally:
        _restore([(number, signal.SIG_DFL) for number in numbers])


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt
