# SPDX-License-Identifier: BSD-2-Clause
"""A file that one process at a time may hold; the lock ends with the process, whatever ends it."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows: nobody is kept out there
    fcntl = None  # type: ignore[assignment]


class Taken(Exception):  # noqa: N818 - what has happened, not a mistake
    """Somebody else holds the file."""


@contextmanager
def locked(file: Path) -> Iterator[None]:
    """Hold a file that is there; Taken if somebody else does. OSError.

    It is opened for writing, without which network file systems lock nothing.
    """
    with file.open("r+b") as held:
        if fcntl is not None:
            try:
                fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                if error.errno in (errno.EWOULDBLOCK, errno.EACCES):
                    raise Taken from error
                if error.errno not in (errno.ENOLCK, errno.EOPNOTSUPP):  # a disk without locks
                    raise
        yield
