# SPDX-License-Identifier: BSD-2-Clause
"""The call into an FMU that is being made, kept where others can read it if the process ends in it.

The calls of the macro step are marked by the executors instead (Recorder.mark), which costs less.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

SIZE = 400
"""Bytes of the note: name of the instance, a zero byte, name of the call."""

Note = NDArray[np.uint8]

_note: Note = np.zeros(SIZE, dtype=np.uint8)


def keep_in(note: Note) -> None:
    """From now on keep the note there: memory that is shared with another process."""
    global _note  # noqa: PLW0603 - one process makes one call at a time
    _note = note


def enter(instance: str, call: str) -> None:
    """Note that an instance is about to be called."""
    _note[:] = _written(instance, call)


@lru_cache(maxsize=1024)
def _written(instance: str, call: str) -> Note:
    text = f"{instance[:200]}\0{call}".encode()[:SIZE].ljust(SIZE, b"\0")
    return np.frombuffer(text, dtype=np.uint8)


def read(note: Note) -> tuple[str, str]:
    """Instance and call that were noted last; ("", "") if none was."""
    instance, _, call = note.tobytes().decode(errors="replace").partition("\0")
    return instance, call.rstrip("\0")
