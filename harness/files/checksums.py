# SPDX-License-Identifier: BSD-2-Clause
"""Folders with a checksum that reveals damage (entries of the cache), locks on files, and hashes of
files.

    entry/content/...   the content
    entry/sha256        hash over the names and bytes of all files of the content

An entry is renamed to its final name only after all its bytes are on the disk, so after a power
failure it is complete or absent.
"""

from __future__ import annotations

import errno
import hashlib
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp

LAYOUT = b"content, sha256"
CONTENT, DIGEST = "content", "sha256"

UNFINISHED = "new-"
"""Beginning of the names of folders that are not complete entries: being written or removed."""


def is_whole(place: Path) -> bool:
    """Return whether an entry exists and its content still has the checksum stored with it."""
    try:
        return (place / DIGEST).read_text(encoding="ascii") == _digest(place / CONTENT)
    except (OSError, UnicodeDecodeError):
        return False


@contextmanager
def beside(place: Path, make: Callable[[Path], None]) -> Iterator[Path]:
    """Yield the path of a new entry in the folder of `place`, whose content make(folder) has
    written and whose bytes are on the disk. The entry is removed at the end of the `with` block
    unless exchange() has moved it.
    """
    new = Path(mkdtemp(prefix=UNFINISHED, dir=place.parent))
    try:
        (new / CONTENT).mkdir()
        make(new / CONTENT)
        (new / DIGEST).write_text(_digest(new / CONTENT), encoding="ascii")
        on_the_disk(new)
        yield new
    finally:
        shutil.rmtree(new, ignore_errors=True)


def on_the_disk(root: Path) -> None:
    """Write a folder and all its files to the disk (fsync), so that they survive a loss of power;
    raise OSError if this fails.
    """
    for folder, _, files in os.walk(root):
        for path in (*(f"{folder}/{name}" for name in files), folder):
            _sync(path)


def exchange(place: Path, new: Path) -> None:
    """Rename the new entry `new` to `place`, and remove the file or folder that was there
    before.
    """
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
    """Return the SHA-256 over the names, sizes and bytes of all files of a folder."""
    if not content.is_dir():
        raise NotADirectoryError(content)
    total = hashlib.sha256()
    for path in sorted(f"{folder}/{n}" for folder, _, names in os.walk(content) for n in names):
        data = Path(path).read_bytes()
        total.update(f"{path[len(str(content)) :]}\0{len(data)}\0".encode())
        total.update(data)
    return total.hexdigest()


def _sync(path: str | Path) -> None:
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


# ---- one process at a time

try:
    import fcntl
except ImportError:  # Windows has no such lock
    fcntl = None  # type: ignore[assignment]


class Taken(Exception):  # noqa: N818 - an event, not an error
    """Error: another process holds the lock of a file."""


@contextmanager
def locked(file: Path) -> Iterator[None]:
    """Lock an existing file during the `with` block; raise Taken if another process holds the lock,
    OSError if the file cannot be opened. On a disk without locks nothing is locked.

    The file is opened for writing, because network file systems lock nothing otherwise.
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


# ---- one file


def sha256(path: str | Path) -> str:
    """Return the SHA-256 (64 hexadecimal digits) of a file; raise OSError if it cannot be read."""
    stamp = Path(path).stat()
    return _sha256(Path(path).absolute(), stamp.st_mtime_ns, stamp.st_size)


@lru_cache(maxsize=256)
def _sha256(path: Path, _modified: int, _size: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
