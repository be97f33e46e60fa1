# SPDX-License-Identifier: BSD-2-Clause
"""Cache of files that earlier runs have unpacked or built, and of values computed from such files.
The name of an entry is a hash of everything on which its content depends.

An entry appears completely or not at all. It is compared with its checksum at every use and made
again if it is damaged. Every process that uses the folder holds a lock on it until the process
ends. A process that starts while no other process uses the folder removes the least recently used
entries above the size limit, at most once an hour. HARNESS_CACHE names another folder; if it is
empty, `off` or `0`, nothing is stored.

The folder is used only if libraries can be loaded from it, it belongs to the user, no other user
may enter it, and no folder above it lets others replace it. Otherwise a note states the reason and
this process runs without a cache.
"""

from __future__ import annotations

import hashlib
import logging
import os
import pickle
import shutil
import stat
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

from harness.errors import ArchiveError, FmuError, ResultsError, StructureError
from harness.files import checksums
from harness.files.archive import unpack
from harness.files.output import PrivateFolder

try:
    import fcntl
except ImportError:  # Windows has no cache
    fcntl = None  # type: ignore[assignment]

OFF = ("", "off", "0")

_log = logging.getLogger("harness")

T = TypeVar("T")

_BEGAN = time.time()

_left_out: set[Path] = set()
"""Cache folders that this process does not use, because they are unsafe or have failed."""

_used: dict[Path, int] = {}
"""Time at which each entry that this process has used was made [ns since the epoch]."""


def folder() -> Path | None:
    """Return the cache folder; None if the cache is off or the folder cannot be used safely."""
    configured = os.environ.get("HARNESS_CACHE")
    if fcntl is None or (configured is not None and configured.strip().lower() in OFF):
        return None
    found = _usable(configured, os.environ.get("XDG_CACHE_HOME"))
    return None if found in _left_out else found


def leave_out(path: Path, reason: str) -> None:
    """Stop using this folder as a cache for the rest of the process, and log the reason once."""
    if path not in _left_out:
        _left_out.add(path)
        _log.warning(
            "%s: not used as a cache, %s (set HARNESS_CACHE to another folder)", path, reason
        )


@lru_cache
def _usable(configured: str | None, caches: str | None) -> Path | None:
    """Return the cache folder, created if missing; log a warning and return None if it is unsafe.

    configured: value of HARNESS_CACHE; caches: value of XDG_CACHE_HOME, used if
    HARNESS_CACHE has no value.
    """
    path = Path(configured or Path(caches or "~/.cache") / "servicing-fmus")
    try:
        path = path.expanduser() if not (configured or caches) else path
        reason = "the path of XDG_CACHE_HOME is not absolute"
        if configured or path.is_absolute():
            path = path.absolute()
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
            reason = _unusable(path)
    except (OSError, RuntimeError) as error:  # no home folder, or a folder without write access
        reason = getattr(error, "strerror", None) or str(error)
    if reason:
        leave_out(path, reason)
        return None
    return path


def _unusable(path: Path) -> str:
    """Return the reason why a folder must not be the cache: others could read or replace its
    content, it cannot be written, or no library can be loaded from it; "" if it may
    be the cache.
    """
    about = path.lstat()
    reasons = {
        "it is not a folder": not stat.S_ISDIR(about.st_mode),
        "it belongs to somebody else": about.st_uid != os.geteuid(),
        "others may enter it": about.st_mode & 0o077,
    }
    for above in path.resolve().parents:
        about = above.stat()
        open_to_all = about.st_mode & 0o022 and not about.st_mode & stat.S_ISVTX
        reasons[f"{above} belongs to somebody else"] = about.st_uid not in (0, os.geteuid())
        reasons[f"others may write to {above}"] = open_to_all
    noexec = os.statvfs(path).f_flag & getattr(os, "ST_NOEXEC", 0)
    reasons["it cannot be written"] = not os.access(path, os.W_OK)
    reasons["no library can be loaded from it (it is mounted with noexec)"] = noexec
    return next((reason for reason, holds in reasons.items() if holds), "")


LIMIT = 512 * 1024**2
"""Size limit of the cache [bytes]; the least recently used entries are removed first."""

TIDY_SECONDS = 3600.0
"""Least time between two clean-ups [s]: summing the sizes of thousands of files takes a second."""

MAX_ARCHIVE = 128 * 1024**2
"""Size of the largest archive whose content is stored [bytes]."""


def unpacked(archive: Path) -> Path | None:
    """Return a folder of the cache with the unpacked content of an archive, which the caller must
    not change; None if there is no cache, or if the archive is damaged or larger than MAX_ARCHIVE.
    """
    root = folder()
    content = None if root is None else _content(archive)
    if root is None or content is None:
        return None
    try:
        return _entry(root / _word(content), lambda into: unpack(archive, into, content=content))
    # after None, the caller unpacks the archive itself and so reports if it is damaged
    except (OSError, ArchiveError) as error:
        if reason := _fault(error):
            leave_out(root, reason)
        return None


def _content(archive: Path) -> bytes | None:
    """Return all bytes of an archive, None if it is unreadable or too large. The archive is read
    only once, so that the unpacked bytes are the hashed bytes.
    """
    try:
        return archive.read_bytes() if archive.stat().st_size <= MAX_ARCHIVE else None
    except OSError:
        return None  # the caller of unpacked() then calls unpack(), which reports the fault


def made(name: str, key: bytes, make: Callable[[Path], None]) -> Path:
    """Return the file `name` that make(path) writes. It is made once for every key and then taken
    from the cache, or without a cache from a temporary folder of this process.
    """
    word = _word(name.encode() + b"\0", key)
    if root := folder():
        try:
            return _entry(root / word, lambda into: make(into / name)) / name
        except (OSError, ResultsError) as error:
            if not (reason := _fault(error)):
                raise
            leave_out(root, reason)
    place = _own_folder().path / word / name
    if not place.is_file():
        place.parent.mkdir(exist_ok=True)
        make(place)
    return place


def has(name: str, key: bytes) -> bool:
    """Return whether the cache has the file `name` that made() would return for a key."""
    root = folder()
    return root is not None and (root / _word(name.encode() + b"\0", key)).is_dir()


def computed(kind: str, key: bytes, compute: Callable[[], T]) -> T:
    """Return compute(), or its value from an earlier call with the same kind and key; compute()
    must depend on nothing else. The cache stores the value as a pickle, which is used until the
    Python version or the code of the harness changes.
    """

    def write(file: Path) -> None:
        file.write_bytes(pickle.dumps(compute()))

    if folder() is None:
        return compute()
    file = made(kind, key + _code(), write)
    try:
        value: T = pickle.loads(file.read_bytes())
    except Exception:
        return compute()
    return value


@lru_cache
def _code() -> bytes:
    """Return a hash of the Python version and of all source files of the harness, on which computed
    values in the cache depend.
    """
    total = hashlib.sha256(sys.version.encode())
    for path in sorted(Path(__file__).parents[1].rglob("*.py")):
        total.update(path.read_bytes())
    return total.digest()


def with_second_try(work: Callable[[], T], before: Callable[[], object] = bool) -> T:
    """Return work(). If it fails because a file of the cache was damaged during the process, stop
    using the cache, call before(), and return work() once more.
    """
    try:
        return work()
    except (ArchiveError, StructureError, FmuError):
        root = folder()
        if root is None or not _is_damaged(root):
            raise
        leave_out(root, "a file in it was damaged while it was read")
    before()
    return work()


def _is_damaged(root: Path) -> bool:
    """Return whether an entry that this process or a child process has used is damaged, or was
    damaged and has been made again by another process in the meantime.
    """
    used = (place for place in _used if place.parent == root)
    if any(_time_made(place) != _used[place] for place in used):
        return True
    return any(p.stat().st_mtime >= _BEGAN and not checksums.is_whole(p) for p in _entries(root))


def _time_made(place: Path) -> int:
    """Return the time at which an entry was made [ns since the epoch], 0 if it does not exist."""
    try:
        return (place / checksums.DIGEST).stat().st_mtime_ns
    except FileNotFoundError:
        return 0


def _fault(error: Exception) -> str:
    """Return the reason if an error comes from the operating system, such as a full disk under the
    cache; "" for other errors.
    """
    cause = error if isinstance(error, OSError) else error.__cause__
    return str(cause.strerror or cause) if isinstance(cause, OSError) and cause.errno else ""


@lru_cache
def _own_folder() -> PrivateFolder:
    """Return the temporary folder of this process, which replaces a missing cache."""
    return PrivateFolder()


# ---- entries


def _word(*parts: bytes) -> str:
    """Return the name of an entry: a hash of the given parts and of the layout of entries, so that
    versions of the harness with another layout use other names.
    """
    return hashlib.sha256(b"".join((checksums.LAYOUT, *parts))).hexdigest()


def _entry(place: Path, make: Callable[[Path], None]) -> Path:
    """Return the content folder of the entry at `place`; make(folder) writes its content if the
    entry is missing or damaged. The modification time of `place` becomes the time of this use.
    """
    _hold(place.parent)
    if not checksums.is_whole(place):
        with checksums.beside(place, make) as new, (place.parent / "exchange").open("ab") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            if not checksums.is_whole(place):  # else another process has just made this entry
                checksums.exchange(place, new)
    os.utime(place)
    _used[place] = _time_made(place)
    return place / checksums.CONTENT


@lru_cache
def _hold(root: Path) -> int:
    """Lock the cache until this process ends, so that no other process removes entries, and return
    the descriptor of the lock file. If no other process uses the cache, remove old entries first.
    """
    descriptor = os.open(root / "used", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    with suppress(BlockingIOError):
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if time.time() - os.fstat(descriptor).st_mtime >= TIDY_SECONDS:
            _tidy(root)
            os.utime(descriptor)
    fcntl.flock(descriptor, fcntl.LOCK_SH)
    return descriptor


def _tidy(root: Path) -> None:
    """Remove the unfinished entries of interrupted processes, and then the least recently used
    entries until the remaining entries together are within LIMIT.
    """
    for unfinished in root.glob(f"{checksums.UNFINISHED}*"):
        shutil.rmtree(unfinished, ignore_errors=True)
    total = 0
    for entry in sorted(_entries(root), key=lambda path: path.stat().st_mtime, reverse=True):
        total += sum(p.lstat().st_size for p in entry.rglob("*") if p.is_file())
        if total > LIMIT:
            shutil.rmtree(entry, ignore_errors=True)


def _entries(root: Path) -> list[Path]:
    """Return the folders of all finished entries."""
    folders = (path for path in root.iterdir() if path.is_dir())
    return [path for path in folders if not path.name.startswith(checksums.UNFINISHED)]
