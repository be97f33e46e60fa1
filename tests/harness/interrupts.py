# SPDX-License-Identifier: BSD-2-Clause
"""Processes that a test starts: Ctrl-C and hang-up handled also where the tests themselves ignore
them (`make test &`, nohup), since a process inherits that a signal is ignored; and patience with a
machine that has much else to do.
"""

import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

ANSWERS: dict[int, Any] = {signal.SIGINT: signal.default_int_handler}
if hasattr(signal, "SIGHUP"):
    ANSWERS[signal.SIGHUP] = signal.SIG_DFL
LONGEST = 600.0
"""Patience with a process, for any result or for its end [s]: for a test that would fail anyway."""


def until(found: Callable[[], Any], what: str) -> Any:
    """Return the result of a function as soon as it is not empty."""
    end = time.monotonic() + LONGEST
    while not (result := found()):
        assert time.monotonic() < end, f"no {what} after {LONGEST} s"
        time.sleep(0.02)
    return result


def start(command: list[str], **options: Any) -> "subprocess.Popen[Any]":
    """As subprocess.Popen, with the default answers to signals in the child."""
    with heard():
        return subprocess.Popen(command, **options)


@contextmanager
def heard() -> Iterator[None]:
    """The default answers to the signals that a shell or nohup may have switched off."""
    inherited = {number: signal.signal(number, answer) for number, answer in ANSWERS.items()}
    try:
        yield
    finally:
        for number, answer in inherited.items():
            signal.signal(number, answer)
