# SPDX-License-Identifier: BSD-2-Clause
"""What a user's earlier runs have unpacked, made and checked, kept under the hash of its content.

What is kept appears whole or not at all, is compared with its hash whenever it is used, and made
anew if it is damaged. Every process that uses the folder holds a lock on it until it ends; what is
too much goes when a process begins that is alone there. HARNESS_CACHE names another folder; empty
or `off`, nothing is kept.

The folder is used only if programs can be run in it, it belongs to the user, nobody else may enter
it, and no folder above it lets others exchange it. One that cannot be used is left out, with one
note.
"""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
import stat
from collections.abc import Callable
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from harness.errors import ArchiveError, ResultsError
from harness.files import sealed
from harness.files.archive import unpack
from harness.files.temporary import PrivateFolder

try:
    import fcntl
except ImportError:  # Windows: nothing is kept there
    fcntl = None  # type: ignore[assignment]

OFF = ("", "off", "0")

_log = logging.getLogger("harness")

_left_out: set[Path] = set()
"""Folders that have failed this process."""


def folder() -> Path | None:
    """The folder; None if nothing is to be kept, or nowhere safe."""
    wanted = os.environ.get("HARNESS_CACHE")
    if fcntl is None or (wanted is not None and wanted.strip().lower() in OFF):
        return None
    found = _usable(wanted, os.environ.get("XDG_CACHE_HOME"))
    return None if found in _left_out else found


def leave_out(path: Path, reason: str) -> None:
    """Keep nothing in this folder from now on, and say so once."""
    if path not in _left_out:
        _left_out.add(path)
        _log.warning("%s: not used as a cache, %s (see HARNESS_CACHE)", path, reason)


@lru_cache
def _usable(wanted: str | None, caches: str | None) -> Path | None:
    """The folder itself, made if it is missing, if it can be used; else a warning."""
    path = Path(wanted or Path(caches or "~/.cache") / "servicing-fmus")
    try:
        path = path.expanduser() if not (wanted or caches) else path
        reason = "the path of XDG_CACHE_HOME is not absolute"
        if wanted or path.is_absolute():
            path = path.absolute()
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
            reason = _unusable(path)
    except (OSError, RuntimeError) as error:  # no home, or one that cannot be written
        reason = getattr(error, "strerror", None) or str(error)
    if reason:
        leave_out(path, reason)
        return None
    return path


def _unusable(path: Path) -> str:
    """Why a folder is no place to keep libraries in: others could read or exchange what is there,
    it cannot be written, or they could not be loaded; "" if it is one.
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
"""Largest sum of all that is kept [bytes]; beyond it the least recently used goes first."""

MAX_ARCHIVE = 128 * 1024**2
"""Larger archives are not kept [bytes]."""

PASSED = "passed"
"""Folder of the marks of checks, which is no entry."""


def unpacked(archive: Path) -> Path | None:
    """Folder with the content of an archive, to be read only, or None if nothing is kept here."""
    root = folder()
    content = None if root is None else _content(archive)
    if root is None or content is None:
        return None
    try:
        return _kept(root / _word(content), lambda into: unpack(archive, into, content=content))
    except (OSError, ArchiveError) as error:  # a damaged archive is for the caller
        if reason := _fault(error):
            leave_out(root, reason)
        return None


def _content(archive: Path) -> bytes | None:
    """All bytes of an archive, once, so that what is unpacked is what was hashed."""
    try:
        return archive.read_bytes() if archive.stat().st_size <= MAX_ARCHIVE else None
    except OSError:
        return None  # unpack() says what is wrong


def passed(kind: str, content: bytes, check: Callable[[], None]) -> None:
    """Run a check on some content, unless the same check has already passed on the same content.

    kind: names the check and its version.
    """
    root = folder()
    if root is None:
        return check()
    mark = root / PASSED / hashlib.sha256(kind.encode() + b"\0" + content).hexdigest()
    if not mark.exists():
        check()
        with suppress(OSError):
            mark.parent.mkdir(exist_ok=True)
            mark.touch()
    return None


def made(name: str, key: bytes, make: Callable[[Path], None]) -> Path:
    """The file `name` that make(path) writes; made once for every key, whatever the run."""
    word = _word(name.encode() + b"\0", key)
    if root := folder():
        try:
            return _kept(root / word, lambda into: make(into / name)) / name
        except (OSError, ResultsError) as error:
            if not (reason := _fault(error)):
                raise
            leave_out(root, reason)
    place = _own_folder().path / word / name
    if not place.is_file():
        place.parent.mkdir(exist_ok=True)
        make(place)
    return place


def _fault(error: Exception) -> str:
    """Of the cache or its disk; "" if it is not theirs."""
    cause = error if isinstance(error, OSError) else error.__cause__
    return str(cause.strerror or cause) if isinstance(cause, OSError) and cause.errno else ""


@lru_cache
def _own_folder() -> PrivateFolder:
    """Where nothing is kept: a folder of this process."""
    return PrivateFolder()


# ---- entries


def _word(*parts: bytes) -> str:
    """Name of an entry: versions of the harness with another layout know nothing of it."""
    total = hashlib.sha256(sealed.LAYOUT)
    for part in parts:
        total.update(part)
    return total.hexdigest()


def _kept(place: Path, make: Callable[[Path], None]) -> Path:
    """The content of an entry, whole; made by make(folder) if it is not there or damaged. The time
    of its folder says when it was used last.
    """
    _hold(place.parent)
    if not sealed.is_whole(place):
        with sealed.beside(place, make) as new, (place.parent / "exchange").open("ab") as file:
            fcntl.flock(file, fcntl.LOCK_EX)
            if not sealed.is_whole(place):  # else somebody was quicker
                sealed.exchange(place, new)
    os.utime(place)
    return place / sealed.CONTENT


@lru_cache
def _hold(root: Path) -> int:
    """Let nobody remove anything until this process ends; whoever is the first tidies up."""
    descriptor = os.open(root / "used", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    with suppress(BlockingIOError):
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        _tidy(root)
    fcntl.flock(descriptor, fcntl.LOCK_SH)
    return descriptor


def _tidy(root: Path) -> None:
    """Remove what is left of interrupted work, and what was used least recently until the rest is
    small enough.
    """
    entries = [path for path in root.iterdir() if path.is_dir() and path.name != PASSED]
    total = 0
    for entry in sorted(entries, key=lambda path: path.stat().st_mtime, reverse=True):
        if not entry.name.startswith(sealed.UNFINISHED):
            total += sum(p.lstat().st_size for p in entry.rglob("*") if p.is_file())
        if total > LIMIT or entry.name.startswith(sealed.UNFINISHED):
            shutil.rmtree(entry, ignore_errors=True)
