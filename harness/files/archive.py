# SPDX-License-Identifier: BSD-2-Clause
"""Archives and XML that may come from anywhere, and packing of our own.

Of an .ssp or .fmu every name is checked before anything is written: no absolute path, no `..`, no
link, no name twice, no more than MAX_UNPACKED bytes. XML has no document type, hence no entity, no
network, and no encoding in which a document type could hide.
"""

from __future__ import annotations

import errno
import io
import re
import stat
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any

from lxml import etree

from harness.errors import ArchiveError
from harness.files.output import written
from harness.files.paths import is_file

XmlElement = Any
"""lxml has no types."""

MAX_UNPACKED = 2 * 1024**3
"""Largest sum of unpacked sizes of one archive, and of the FMUs of one run [bytes]."""

MAX_FILES = 100_000
"""Largest number of files in one archive."""

DATE = (1980, 1, 1, 0, 0, 0)
"""Date of every file in an archive that is written."""

MAX_ENTRY = 64 * 1024**2
"""Largest single file that is read into memory [bytes]."""

_DAMAGE = (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, ValueError, OSError)
"""Exceptions of zipfile for damaged, encrypted or exotically compressed archives."""


_DISK_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EMFILE, errno.EFBIG)
"""Faults of the temporary folder, not of the archive."""


def unpack(
    path: Path, folder: Path, limit: int = MAX_UNPACKED, content: bytes | None = None
) -> None:
    """Unpack a zip archive into a folder, which is created if missing; raise ArchiveError if the
    archive is missing, damaged or unsafe, or if the disk is full.

    content: the bytes of the archive, if they have been read already.
    """
    with _opened(path, "unpacked", content) as archive:
        _reject_unsafe(path, archive.infolist(), limit)
        try:
            folder.mkdir(exist_ok=True)
            archive.extractall(folder)
        except OSError as error:
            if error.errno not in _DISK_FULL:
                raise
            reason = f"cannot be unpacked into {folder.parent} ({error.strerror})"
            raise ArchiveError(f"{path}: {reason}") from error


def inspect(path: Path) -> tuple[str, ...]:
    """Return the names of all files of an archive that unpack() accepts; raise ArchiveError if it
    does not.
    """
    with _opened(path, "unpacked") as archive:
        _reject_unsafe(path, archive.infolist(), MAX_UNPACKED)
        return tuple(entry.filename for entry in archive.infolist() if not entry.is_dir())


def read_all(path: Path) -> dict[str, bytes]:
    """Return all files of an archive by name; ArchiveError where unpack() raises it."""
    with _opened(path, "read") as archive:
        _reject_unsafe(path, archive.infolist(), MAX_UNPACKED)
        return {e.filename: archive.read(e) for e in archive.infolist() if not e.is_dir()}


def unpacked_size(path: Path) -> int:
    """Return the bytes that an unpacked archive takes; raise ArchiveError if it cannot be read."""
    with _opened(path, "read") as archive:
        return sum(entry.file_size for entry in archive.infolist())


def read_entry(path: Path, name: str) -> bytes:
    """Return one file of an archive; raise ArchiveError if it is missing, damaged or longer than
    the limit.
    """
    with _opened(path, "read") as archive:
        found = [entry for entry in archive.infolist() if entry.filename == name]
        if len(found) != 1:
            number = f"{len(found)} files" if found else "no file"
            raise ArchiveError(f"{path}: contains {number} {name}, expected one")
        if found[0].file_size > MAX_ENTRY:
            raise ArchiveError(f"{path}: {name} is longer than the limit of {MAX_ENTRY} bytes")
        return archive.read(found[0])


def head(path: Path, name: str, count: int) -> bytes:
    """Return the first bytes of one file of an archive, at most `count`; raise ArchiveError like
    read_entry().
    """
    with _opened(path, "read") as archive, archive.open(name) as file:
        return file.read(count)


@contextmanager
def _opened(path: Path, done: str, content: bytes | None = None) -> Iterator[zipfile.ZipFile]:
    """Yield an archive opened for reading, with every failure as an ArchiveError."""
    if not is_file(path):
        raise ArchiveError(f"{path}: no such file")
    try:
        with zipfile.ZipFile(path if content is None else io.BytesIO(content)) as archive:
            yield archive
    except _DAMAGE as error:
        if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL):  # a full disk
            raise ArchiveError(f"{path}: cannot be {done} ({error.strerror})") from None
        raise ArchiveError(
            f"{path}: cannot be {done}, the file is damaged or not a zip archive ({error})"
        ) from error


def pack(path: Path, content: Mapping[str, bytes], compression: int = zipfile.ZIP_STORED) -> None:
    """Write files by name as a zip archive, always with the same bytes; raise ResultsError if it
    cannot be written.
    """
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", compression) as archive:
        for name, file in sorted(content.items()):
            entry = _entry(name)
            if reason := _unsafe(entry):
                raise ArchiveError(f"{path}: cannot be written, it would hold {reason}: {name!r}")
            archive.writestr(entry, file, compression)
    with written(path) as target:
        target.write_bytes(data.getvalue())


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name, DATE)
    entry.create_system = 3  # Unix, so that the bytes do not depend on the platform
    entry.external_attr = 0o100644 << 16
    return entry


def _reject_unsafe(path: Path, entries: list[zipfile.ZipInfo], limit: int) -> None:
    """Reject unsafe entries. An archive whose first entry is not at the start of the file is the
    inner archive of a truncated one.
    """
    if min((entry.header_offset for entry in entries), default=1) != 0:
        raise zipfile.BadZipFile("File is truncated")
    for fault in _faults(entries, limit):
        raise ArchiveError(f"{path}: rejected, it {fault}")


def _faults(entries: list[zipfile.ZipInfo], limit: int) -> Iterator[str]:
    """Yield the reasons why an archive must not be unpacked."""
    for entry in entries:
        if reason := _unsafe(entry):
            yield f"holds {reason}: {entry.orig_filename!r}"
    if double := _double(entries):
        yield f"holds two files of one name: {double!r}"
    if len(entries) > MAX_FILES:
        yield f"holds {len(entries)} files, more than the limit of {MAX_FILES}"
    size = sum(entry.file_size for entry in entries)
    if size > limit:
        yield f"would unpack to {size} bytes, more than the limit of {limit}"


def _double(entries: list[zipfile.ZipInfo]) -> str | None:
    """Return a name that occurs twice after unpacking (`a//b` is `a/b`), or None."""
    seen: set[PurePosixPath] = set()
    for entry in entries:
        place = PurePosixPath(entry.filename)
        if place in seen:
            return entry.orig_filename
        seen.add(place)
    return None


def _unsafe(entry: zipfile.ZipInfo) -> str | None:
    """Return why an entry must not be unpacked, or None."""
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


# ---- XML

_BOMS = (b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff")
_DECLARED = re.compile(rb"""<\?xml[^>]*?\sencoding\s*=\s*["']([^"'>]*)["']""")
_PLAIN = re.compile(rb"(utf-?8|utf-?16([bl]e)?|us-ascii|ascii|iso-?8859-?\d+|(windows|cp)-?125\d)")
"""Encodings that write ASCII as itself, but for zeros."""


_SAFELY = {
    "resolve_entities": False,
    "no_network": True,
    "load_dtd": False,
    "remove_comments": True,
    "remove_pis": True,
}


class UnsafeXmlError(ValueError):
    """Text that is not parsed because it could be unsafe. str() gives the reason."""


def parsed(data: bytes) -> XmlElement:
    """Return the root element of an XML text without comments and processing instructions.

    Raises UnsafeXmlError for a document type, an encoding that could hide one, or text that is not
    XML.
    """
    _reject_hidden(data)
    try:
        tree = etree.ElementTree(etree.fromstring(data, etree.XMLParser(**_SAFELY)))
    except etree.XMLSyntaxError as error:
        raise UnsafeXmlError(f"not a readable XML file ({error})") from error
    if tree.docinfo.doctype:
        raise UnsafeXmlError("a document type declaration is not allowed")
    return tree.getroot()


def serialized(root: XmlElement, pretty: bool = False) -> bytes:
    """Return an element as a file in UTF-8; pretty: with indentation."""
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=pretty))


def _reject_hidden(data: bytes) -> None:
    """Raise UnsafeXmlError for bytes that must not reach the parser."""
    text = data.replace(b"\0", b"")
    for mark in _BOMS:
        text = text.removeprefix(mark)
    if not text.lstrip().startswith(b"<"):
        raise UnsafeXmlError("not a readable XML file (it does not begin with <)")
    declared = _DECLARED.match(text.lstrip())
    if declared and not _PLAIN.fullmatch(declared[1].lower()):
        encoding = declared[1].decode("ascii", "replace")
        raise UnsafeXmlError(f"its encoding {encoding} is not read, only UTF-8 and its like")
    if b"<!DOCTYPE" in text:
        raise UnsafeXmlError("a document type declaration is not allowed")
