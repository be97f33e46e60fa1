# SPDX-License-Identifier: BSD-2-Clause
"""The command line that is at work, for what is written while it is."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

_command: str | None = None


def work_for(text: str | None) -> None:
    """From now on, what this process writes comes of this command line."""
    global _command  # noqa: PLW0603 - a process has one
    _command = text


def command_line() -> str | None:
    """The command line; None in a Python program of the user."""
    return _command


@contextmanager
def commanded(text: str) -> Iterator[None]:
    """What is written in the `with` block comes of this command line."""
    before = _command
    work_for(text)
    try:
        yield
    finally:
        work_for(before)
