# SPDX-License-Identifier: BSD-2-Clause
"""Notes of several runs of one system: what holds for all of them is said once."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

_log = logging.getLogger("harness")


class _Keeper(logging.Handler):
    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: dict[str, None] = {}

    def emit(self, record: logging.LogRecord) -> None:
        self.lines[record.getMessage()] = None


@contextmanager
def noted() -> Iterator[list[str]]:
    """What the harness notes in the `with` block, each line once, in place of its log; filled when
    the block is over.
    """
    keeper, kept = _Keeper(), list[str]()
    spread, _log.propagate = _log.propagate, False
    _log.addHandler(keeper)
    try:
        yield kept
    finally:
        _log.removeHandler(keeper)
        _log.propagate = spread
        kept += keeper.lines


@contextmanager
def said_once() -> Iterator[None]:
    """Let the notes of the `with` block through when it is over, each line once."""
    notes: list[str] = []
    try:
        with noted() as notes:
            yield
    finally:
        for note in notes:
            _log.warning("%s", note)
