# SPDX-License-Identifier: BSD-2-Clause
"""Systems by name or path: those of the project, and any .ssp."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from harness.errors import UsageError
from harness.files import paths
from harness.files.digest import sha256
from harness.spelling import did_you_mean
from harness.ssp import reader
from harness.system.model import Origin, System


@contextmanager
def load(system: str | Path | System) -> Iterator[System]:
    """The system of that name or path; its FMUs are unpacked until the end of the `with` block.

    A System is handed through. Raises UsageError, ArchiveError or StructureError.
    """
    if isinstance(system, System):
        yield system
        return
    path = find_system(system)
    origin = Origin(str(system), sha256(path))
    with reader.opened(path) as found:
        yield replace(found, origin=origin)


def find_system(name: str | Path) -> Path:
    """Path of an .ssp by name or path; UsageError with close matches if there is none."""
    known = paths.systems()
    if str(name) in known:
        return known[str(name)]
    if paths.is_file(name):
        return Path(name)
    raise UsageError(
        f"{name or '(nothing)'}: there is no such system{did_you_mean(str(name), known)}"
    )


def of_component(name: str | Path) -> tuple[Path, str] | None:
    """System and component that `SYSTEM` (component "") or `SYSTEM.component` names; None if it
    begins with no system, by name or path of an .ssp.
    """
    text, known = str(name), paths.systems()
    ends = [i for i, character in enumerate(text) if character == "."]
    for end in (len(text), *reversed(ends)):
        path = known.get(text[:end]) or Path(text[:end])
        if path.suffix == ".ssp" and paths.is_file(path):
            return path, text[end + 1 :]
    return None
