# SPDX-License-Identifier: BSD-2-Clause
"""What a user's earlier runs have unpacked and checked, kept under the hash of its content.

The folder is private: it is used only if it belongs to the user, nobody else may enter it, and no
folder above it lets others exchange it. What is kept appears whole or not at all, and nothing is
removed while somebody uses it. HARNESS_CACHE names another folder; empty or `off`, nothing is kept.
"""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
import stat
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from tempfile import mkdtemp

from harness.errors import ArchiveError
from harness.files.archive import unpack
from harness.files.temporary import PrivateFolder

try:
    import fcntl
except ImportError:  # Windows: nothing is kept there
    fcntl = None  # type: ignore[assignment]

LIMIT = 512 * 1024**2
"""Largest sum of all that is kept [bytes]; beyond it the least recently used goes first."""

MAX_ARCHIVE = 128 * 1024**2
"""Larger archives are not kept [bytes]."""

STALE = 24 * 3600.0
"""Age at which what an interrupted process has left half unpacked is removed [s]."""

OFF = ("", "off", "0")

_log = logging.getLogger("harness")


@contextmanager
def unpacked(archive: Path) -> Iterator[Path | None]:
    """Folder with the content of an archive, to be read only, or None if nothing is kept here.

    Nobody removes it before the end of the `with` block.
    """
    with ExitStack() as use:
        try:
            place = _enter(archive, use)
        except (OSError, ArchiveError):  # no locks, no room; a damaged archive is for the caller
            place = None
        yield place


def _enter(archive: Path, use: ExitStack) -> Path | None:
    root = folder()
    content = None if root is None else _content(archive)
    if root is None or content is None:
        return None
    place = root / hashlib.sha256(content).hexdigest()
    use.enter_context(_locked(place.with_suffix(".lock")))
    if not place.is_dir():
        _add(archive, content, place)
    return place


def passed(kind: str, content: bytes, check: Callable[[], None]) -> None:
    """Run a check on some content, unless the same check has already passed on the same content.

    kind: names the check and its version.
    """
    root = folder()
    if root is None:
        return check()
    mark = root / "passed" / hashlib.sha256(kind.encode() + b"\0" + content).hexdigest()
    if not mark.exists():
        check()
        with suppress(OSError):
            mark.parent.mkdir(exist_ok=True)
            mark.touch()
    return None


_used_here = ExitStack()
"""What made() has given out, until this process ends."""


def made(name: str, key: bytes, make: Callable[[Path], None]) -> Path:
    """The file `name` that make(path) writes; made once for every key, whatever the run.

    Nobody removes it before this process ends.
    """
    root = folder()
    if root is None:
        root = _own_folder()
    place = root / hashlib.sha256(name.encode() + b"\0" + key).hexdigest()
    if fcntl is not None:
        _used_here.enter_context(_locked(place.with_suffix(".lock")))
    if not (place / name).is_file():
        beside = Path(mkdtemp(prefix="new-", dir=root))
        try:
            make(beside / name)
            with suppress(OSError):  # somebody was quicker
                beside.rename(place)
        finally:
            shutil.rmtree(beside, ignore_errors=True)
        _tidy(root)
    return place / name


@lru_cache
def _own_folder() -> Path:
    """Where nothing is kept: a folder of this process."""
    return _used_here.enter_context(PrivateFolder())


# ---- the folder


def folder() -> Path | None:
    """The private folder; None if nothing is to be kept, or nowhere safe."""
    wanted = os.environ.get("HARNESS_CACHE")
    if fcntl is None or (wanted is not None and wanted.strip().lower() in OFF):
        return None
    return _private(wanted, os.environ.get("XDG_CACHE_HOME"))


@lru_cache
def _private(wanted: str | None, caches: str | None) -> Path | None:
    """The folder itself, made if it is missing, if it is safe; else a warning."""
    try:
        path = Path(wanted or Path(caches or Path.home() / ".cache") / "servicing-fmus").absolute()
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        reason = _unsafe(path)
    except (OSError, RuntimeError) as error:  # no home, or one that cannot be written
        if wanted is None:
            return None
        path, reason = Path(wanted), getattr(error, "strerror", None) or str(error)
    if reason:
        _log.warning("%s: nothing is kept there, %s (see HARNESS_CACHE)", path, reason)
        return None
    return path


def _unsafe(path: Path) -> str | None:
    """Why others could read or exchange what is in a folder, or None."""
    about = path.lstat()
    if not stat.S_ISDIR(about.st_mode):
        return "it is not a folder"
    if about.st_uid != os.geteuid():
        return "it belongs to somebody else"
    if about.st_mode & 0o077:
        return "others may enter it"
    for above in path.resolve().parents:
        about = above.stat()
        if about.st_uid not in (0, os.geteuid()):
            return f"{above} belongs to somebody else"
        if about.st_mode & 0o022 and not about.st_mode & stat.S_ISVTX:
            return f"others may write to {above}"
    return None if os.access(path, os.W_OK) else "it cannot be written"


# ---- entries


def _content(archive: Path) -> bytes | None:
    """All bytes of an archive, once, so that what is unpacked is what was hashed."""
    try:
        return archive.read_bytes() if archive.stat().st_size <= MAX_ARCHIVE else None
    except OSError:
        return None  # unpack() says what is wrong


def _add(archive: Path, content: bytes, place: Path) -> None:
    """Unpack beside the place, then rename: a folder that is there is whole."""
    beside = Path(mkdtemp(prefix="new-", dir=place.parent))
    try:
        unpack(archive, beside, content=content)
        with suppress(OSError):  # somebody was quicker
            beside.rename(place)
    finally:
        shutil.rmtree(beside, ignore_errors=True)
    _tidy(place.parent)


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Hold a lock that others may hold too; its time says when the entry was used last."""
    if (descriptor := _lock(path, fcntl.LOCK_SH)) is None:
        raise BlockingIOError(path)
    try:
        os.utime(descriptor)
        yield
    finally:
        os.close(descriptor)


def _lock(path: Path, how: int) -> int | None:
    """Descriptor of a locked file; None if it is taken. A lock on a file that was removed meanwhile
    counts for nothing.
    """
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(descriptor, how)
        except BlockingIOError:
            os.close(descriptor)
            return None
        with suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(descriptor), path.stat()):
                return descriptor
        os.close(descriptor)


def _tidy(root: Path) -> None:
    """Remove what was used least recently until the rest is small enough, and what is left of
    interrupted work.
    """
    now = time.time()
    for left in root.glob("new-*"):
        with suppress(OSError):
            if now - left.stat().st_mtime > STALE:
                shutil.rmtree(left, ignore_errors=True)
    entries = sorted(root.glob("*.lock"), key=_used)
    sizes = {lock: _size(lock.with_suffix("")) for lock in entries}
    total = sum(sizes.values())
    for lock in entries:
        if total <= LIMIT:
            return
        total -= sizes[lock] if _remove(lock) else 0


def _remove(lock: Path) -> bool:
    """Remove an entry that nobody uses."""
    descriptor = _lock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    if descriptor is None:
        return False
    try:
        shutil.rmtree(lock.with_suffix(""), ignore_errors=True)
        lock.unlink(missing_ok=True)
    finally:
        os.close(descriptor)
    return True


def _used(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


def _size(path: Path) -> int:
    return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
