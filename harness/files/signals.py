# SPDX-License-Identifier: BSD-2-Clause
"""Signals that end the program: when they may, and what they must wait for.

Ctrl-C, SIGTERM and SIGHUP all arrive as KeyboardInterrupt. Inside a `held()` block they are
only recorded. Code that can stop without losing anything calls check() there, which raises
KeyboardInterrupt. Other code in the block is completed first.
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
    """Delay signals until the end of the block; nested blocks are one block. Threads other than the
    main thread receive no signals.
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
        _pending.clear()  # the block has ended early anyway
        raise
    finally:
        _depth = 0
        _restore(list(earlier.items()))
    if _pending:
        number = _pending[0]
        _pending.clear()
        signal.raise_signal(number)


def _exchange_handlers() -> dict[int, signal._HANDLER]:
    """Record arriving signals and return the earlier handlers. Ignored signals stay ignored
    (nohup).
    """
    earlier = {n: signal.getsignal(n) for n in NUMBERS}
    earlier = {n: h for n, h in earlier.items() if h not in (signal.SIG_IGN, None)}
    for number in earlier:
        signal.signal(number, _mark)
    return earlier


def _restore(handlers: list[tuple[int, signal._HANDLER]]) -> None:
    """Restore all handlers, even if a signal arrives as soon as the first one is active again."""
    if handlers:
        try:
            signal.signal(*handlers.pop())
        finally:
            _restore(handlers)


def _mark(number: int, _: FrameType | None) -> None:
    _pending.append(number)


def check() -> None:
    """Raise KeyboardInterrupt if a signal is pending in a held() block, and clear it."""
    if _pending:
        _pending.clear()
        raise KeyboardInterrupt


@contextmanager
def as_interrupts() -> Iterator[None]:
    """Turn SIGTERM and SIGHUP into KeyboardInterrupt inside the block, unless they have
    a handler.
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
