# SPDX-License-Identifier: BSD-2-Clause
"""Folders whose damage shows: the content of an entry, and beside it the hash of all its files.

    entry/content/...   what is kept
    entry/sha256        over the names and bytes of all files of it

An entry gets its name when it is on the disk, so a power failure leaves it whole or not at all.
"""

from __future__ import annotations

import hashlib
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import mkdtemp

LAYOUT = b"content, sha256"
CONTENT, SEAL = "content", "sha256"

UNFINISHED = "new-"
"""Beginning of the names of folders that are no entries yet, or no longer."""


def is_whole(place: Path) -> bool:
    """Whether an entry is there, with the very bytes that were put there."""
    try:
        return (place / SEAL).read_text(encoding="ascii") == _digest(place / CONTENT)
    except (OSError, UnicodeDecodeError):
        return False


@contextmanager
def beside(place: Path, make: Callable[[Path], None]) -> Iterator[Path]:
    """A new entry beside the one at `place`, with what make(folder) writes; it is on the disk.
    Removed at the end of the `with` block, unless it was moved.
    """
    new = Path(mkdtemp(prefix=UNFINISHED, dir=place.parent))
    try:
        (new / CONTENT).mkdir()
        make(new / CONTENT)
        (new / SEAL).write_text(_digest(new / CONTENT), encoding="ascii")
        on_the_disk(new)
        yield new
    finally:
        shutil.rmtree(new, ignore_errors=True)


def on_the_disk(root: Path) -> None:
    """Wait until a folder with all that is in it would survive a loss of power; OSError."""
    for folder, _, files in os.walk(root):
        for path in (*(f"{folder}/{name}" for name in files), folder):
            _sync(path)


def exchange(place: Path, new: Path) -> None:
    """Put a new entry in the place of what is there, if anything is."""
    old = new.with_name(f"{new.name}-old")
    with suppress(FileNotFoundError):
        place.rename(old)
    new.rename(place)
    _sync(place.parent)
    if old.is_dir():
        shutil.rmtree(old, ignore_errors=True)
    else:
        old.unlink(missing_ok=True)


def _digest(content: Path) -> str:
    """SHA-256 over the names, sizes and bytes of all files of a folder."""
    if not content.is_dir():
        raise NotADirectoryError(content)
    total = hashlib.sha256()
    for path in sorted(f"{folder}/{n}" for folder, _, names in os.walk(content) for n in names):
        data = _read(path)
        total.update(f"{path[len(str(content)) :]}\0{len(data)}\0".encode())
        total.update(data)
    return total.hexdigest()


def _read(path: str) -> bytes:
    """All bytes of a file; half as long as Path.read_bytes() for small ones."""
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)
    try:
        data, parts = os.read(descriptor, 1 << 20), []
        while data:
            parts.append(data)
            data = os.read(descriptor, 1 << 20)
        return b"".join(parts)
    finally:
        os.close(descriptor)


def _sync(path: str | Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
