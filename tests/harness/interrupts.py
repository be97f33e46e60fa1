# SPDX-License-Identifier: BSD-2-Clause
"""Ctrl-C and hang-up heard also where the tests themselves are deaf to them (`make test &`, nohup):
a process inherits that a signal is ignored.
"""

import signal
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

ANSWERS: dict[int, Any] = {signal.SIGINT: signal.default_int_handler}
if hasattr(signal, "SIGHUP"):
    ANSWERS[signal.SIGHUP] = signal.SIG_DFL


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
