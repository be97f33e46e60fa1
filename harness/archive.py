"""Unpacking of .ssp and .fmu archives that may come from anywhere.

Every name is judged before anything is written: no absolute path, no `..`, no link, no more than MAX_UNPACKED bytes.
"""

from __future__ import annotations

import stat
import zipfile
import zlib
from pathlib import Path, PurePosixPath

from harness.errors import ArchiveError

MAX_UNPACKED = 2 * 1024**3
"""Largest sum of unpacked sizes of one archive [bytes]."""

_DAMAGE = (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, NotImplementedError, ValueError, OSError)
"""What zipfile raises for damaged, encrypted or exotically compressed archives."""


def unpack(path: Path, folder: Path, limit: int = MAX_UNPACKED) -> None:
    """Unpack a zip archive into an existing folder; ArchiveError if it is missing, damaged or unsafe."""
    if not path.is_file():
        raise ArchiveError(f"{path}: no such file")
    try:
        with zipfile.ZipFile(path) as archive:
            _refuse_unsafe(path, archive.infolist(), limit)
            archive.extractall(folder)
    except _DAMAGE as error:
        raise ArchiveError(f"{path}: cannot be unpacked, the file is damaged or not a zip archive ({error})") from error


def _refuse_unsafe(path: Path, entries: list[zipfile.ZipInfo], limit: int) -> None:
    """Judge all entries; one that does not begin the file belongs to an archive inside a truncated one."""
    if min((entry.header_offset for entry in entries), default=1) != 0:
        raise zipfile.BadZipFile("File is truncated")
    for entry in entries:
        if reason := _unsafe(entry):
            raise ArchiveError(f"{path}: refused, it holds {reason}: {entry.orig_filename!r}")
    size = sum(entry.file_size for entry in entries)
    if size > limit:
        raise ArchiveError(f"{path}: refused, it would unpack to {size} bytes, more than the limit of {limit}")


def _unsafe(entry: zipfile.ZipInfo) -> str | None:
    """Why an entry must not be unpacked, or None."""
    name = entry.orig_filename
    mode = stat.S_IFMT(entry.external_attr >> 16)
    if "\\" in name or ":" in name or "\0" in name:
        return "a name with an illegal character"
    if name.startswith("/"):
        return "an absolute path"
    if ".." in PurePosixPath(name).parts:
        return "a path that leaves the archive"
    if mode not in (0, stat.S_IFREG, stat.S_IFDIR):
        return "a link or special file"
    return None
