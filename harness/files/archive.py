# SPDX-License-Identifier: BSD-2-Clause
"""Reading of untrusted archives and XML, and writing of archives.

Every name in an .ssp or .fmu is checked before a file is unpacked: no absolute path, no `..`, no
link, no name twice, at most MAX_UNPACKED bytes. XML with a document type is rejected, so no entity
is expanded and no network is used. An encoding in which a document type could not be recognised is
rejected too.
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
from lzma import LZMAError
from pathlib import Path, PurePosixPath
from typing import Any

from lxml import etree

from harness.errors import ArchiveError
from harness.files.output import written
from harness.files.paths import is_file

XmlElement = Any
"""Element of lxml, which provides no types."""

MAX_UNPACKED = 2 * 1024**3
"""Largest sum of unpacked sizes of one archive, and of the FMUs of one run [bytes]."""

MAX_FILES = 100_000
"""Largest number of files in one archive."""

DATE = (1980, 1, 1, 0, 0, 0)
"""Date of every file in a written archive, constant so that equal contents give equal bytes."""

MAX_ENTRY = 64 * 1024**2
"""Largest file that is read by itself, as by read_entry() [bytes]; read_all() has no such limit."""

_DAMAGE = (zipfile.BadZipFile, zlib.error, LZMAError, EOFError, RuntimeError, ValueError, OSError)
"""Exceptions of zipfile for archives that are damaged, encrypted or compressed by a method that
Python does not support.
"""


_DISK_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EMFILE, errno.EFBIG)
"""Error numbers that show that files cannot be written here (disk full, read-only or without
permission, too many open files), not that the archive is damaged.
"""


def unpack(path: Path, folder: Path, content: bytes | None = None) -> None:
    """Unpack a zip archive into a folder, which is created if missing; raise ArchiveError if the
    archive is missing, damaged or unsafe, or if the disk is full.

    content: the bytes of the archive, if they have been read already.
    """
    with _opened(path, "unpacked", content) as archive:
        _reject_unsafe(path, archive.infolist())
        try:
            folder.mkdir(exist_ok=True)
            archive.extractall(folder)
        except OSError as error:
            if error.errno not in _DISK_FULL:
                raise
            reason = f"cannot be unpacked into {folder.parent} ({error.strerror})"
            raise ArchiveError(f"{path}: {reason}") from error


def inspect(path: Path) -> tuple[str, ...]:
    """Return the names of all files of an archive; raise ArchiveError if unpack() would reject the
    archive.
    """
    with _opened(path, "unpacked") as archive:
        _reject_unsafe(path, archive.infolist())
        return tuple(entry.filename for entry in archive.infolist() if not entry.is_dir())


def read_all(path: Path) -> dict[str, bytes]:
    """Return the bytes of all files of an archive by name; raise ArchiveError if unpack() would
    reject the archive.
    """
    with _opened(path, "read") as archive:
        _reject_unsafe(path, archive.infolist())
        return {e.filename: archive.read(e) for e in archive.infolist() if not e.is_dir()}


def unpacked_size(path: Path) -> int:
    """Return the size of all unpacked files of an archive [bytes]; raise ArchiveError if it cannot
    be read.
    """
    with _opened(path, "read") as archive:
        return sum(entry.file_size for entry in archive.infolist())


def read_entry(path: Path, name: str) -> bytes:
    """Return the bytes of one file of an archive; raise ArchiveError if the file is missing,
    damaged or longer than MAX_ENTRY.
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
    """Return the first `count` bytes of one file of an archive, or all of a shorter file; raise
    ArchiveError if the archive is damaged.
    """
    with _opened(path, "read") as archive, archive.open(name) as file:
        return file.read(count)


@contextmanager
def _opened(path: Path, done: str, content: bytes | None = None) -> Iterator[zipfile.ZipFile]:
    """Yield an archive opened for reading, and raise the exceptions _DAMAGE in the `with` block as
    an ArchiveError. done: word for the error message, "read" or "unpacked".
    """
    if not is_file(path):
        raise ArchiveError(f"{path}: no such file")
    try:
        with zipfile.ZipFile(path if content is None else io.BytesIO(content)) as archive:
            yield archive
    except _DAMAGE as error:
        # an error of the system such as ENOSPC (disk full): the archive itself is not damaged
        if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL):
            raise ArchiveError(f"{path}: cannot be {done} ({error.strerror})") from None
        raise ArchiveError(
            f"{path}: cannot be {done}, the file is damaged or not a zip archive ({error})"
        ) from error


def pack(path: Path, content: Mapping[str, bytes], compression: int = zipfile.ZIP_STORED) -> None:
    """Write files, given as bytes by name, into a zip archive. Equal contents give equal archives.

    Raises ArchiveError for an unsafe name, ResultsError if the archive cannot be written.
    """
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", compression) as archive:
        for name, file in sorted(content.items()):
            entry = _entry(name)
            if reason := _unsafe(entry):
                raise ArchiveError(f"{path}: cannot be written with {reason}: {name!r}")
            archive.writestr(entry, file, compression)
    with written(path) as target:
        target.write_bytes(data.getvalue())


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name, DATE)
    entry.create_system = 3  # Unix, so that the bytes do not depend on the platform
    entry.external_attr = 0o100644 << 16
    return entry


def _reject_unsafe(path: Path, entries: list[zipfile.ZipInfo]) -> None:
    """Raise ArchiveError for an archive that must not be unpacked, and BadZipFile if the first
    entry is not at offset 0: for a truncated archive, zipfile may list the entries of an archive
    nested in it.
    """
    if min((entry.header_offset for entry in entries), default=1) != 0:
        raise zipfile.BadZipFile("File is truncated")
    for fault in _faults(entries):
        raise ArchiveError(f"{path}: rejected, it {fault}")


def _faults(entries: list[zipfile.ZipInfo]) -> Iterator[str]:
    """Yield the reasons why an archive must not be unpacked."""
    for entry in entries:
        if reason := _unsafe(entry):
            yield f"holds {reason}: {entry.orig_filename!r}"
    if double := _double(entries):
        yield f"holds two files of one name: {double!r}"
    if len(entries) > MAX_FILES:
        yield f"holds {len(entries)} files, more than the limit of {MAX_FILES}"
    size = sum(entry.file_size for entry in entries)
    if size > MAX_UNPACKED:
        yield f"would unpack to {size} bytes, more than the limit of {MAX_UNPACKED}"


def _double(entries: list[zipfile.ZipInfo]) -> str | None:
    """Return a name that would occur twice after unpacking, where `a//b` counts as `a/b`; None if
    there is none.
    """
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
"""Encodings in which ASCII characters have their ASCII bytes, apart from zero bytes (UTF-16), so
that a document type can be recognised.
"""


_SAFELY = {
    "resolve_entities": False,
    "no_network": True,
    "load_dtd": False,
    "remove_comments": True,
    "remove_pis": True,
}


class UnsafeXmlError(ValueError):
    """Error: an XML text is unreadable or could be unsafe. str() gives the reason."""


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
    """Return an element as the bytes of an XML file in UTF-8; pretty: with indentation."""
    return bytes(etree.tostring(root, xml_declaration=True, encoding="UTF-8", pretty_print=pretty))


def _reject_hidden(data: bytes) -> None:
    """Raise UnsafeXmlError for bytes that must not reach the parser: text that is not XML, a
    document type, or an encoding that could hide a document type.
    """
    text = data.replace(b"\0", b"")
    for mark in _BOMS:
        text = text.removeprefix(mark)
    if not text.lstrip().startswith(b"<"):
        raise UnsafeXmlError("not a readable XML file (it does not begin with <)")
    declared = _DECLARED.match(text.lstrip())
    if declared and not _PLAIN.fullmatch(declared[1].lower()):
        encoding = declared[1].decode("ascii", "replace")
        raise UnsafeXmlError(f"its encoding {encoding} is not supported; save it as UTF-8")
    if b"<!DOCTYPE" in text:
        raise UnsafeXmlError("a document type declaration is not allowed")
