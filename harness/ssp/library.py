# SPDX-License-Identifier: BSD-2-Clause
"""Systems by name or path: systems of the project and of installed missions, any .ssp, any TOML,
and the folder of a mission.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from harness.errors import UsageError
from harness.files import paths
from harness.files.checksums import sha256
from harness.mission.library import FILE, SYSTEM, systems, use
from harness.spelling import did_you_mean
from harness.ssp import reader
from harness.system.model import Origin, System


@contextmanager
def load(system: str | Path | System) -> Iterator[System]:
    """Yield the system with that name or path. Its FMUs stay unpacked until the end of the `with`
    block.

    A System is yielded unchanged. For a TOML file and for the folder of a mission, the system is
    built first, and take_mission() is called. Raises UsageError, ArchiveError, StructureError or
    FmuError.
    """
    if isinstance(system, System):
        yield system
        return
    path = find_system(system)
    origin = Origin(str(system), sha256(path))
    if path.suffix == ".toml":
        yield replace(_built(path), origin=origin)
        return
    with reader.opened(path) as found:
        yield replace(found, origin=origin)


@contextmanager
def examined(path: Path) -> Iterator[tuple[System, tuple[str, ...]]]:
    """Yield the system of a file as far as it can be read, and a line per problem of its
    description; raise ArchiveError or StructureError if nothing can be read, and StructureError for
    any problem of a TOML file.
    """
    if path.suffix == ".toml":
        yield _built(path), ()
        return
    with reader.examined(path) as found:
        yield found


def name_of(path: Path) -> str:
    """Return the name of a system from its path: the folder's name for the main TOML file of a
    mission, else the file name without its ending.
    """
    return path.resolve().parent.name if path.name == SYSTEM else path.stem


def _built(path: Path) -> System:
    """Return the system of a TOML file, after take_mission()."""
    # imported only here, because build imports msgspec, which reading an .ssp does not need
    from harness.ssp import build

    take_mission(path)
    return build.read(path, paths.fmus())


_without_python: set[Path] = set()
"""Folders whose Python files are not executed, because a results file and not the user named these
folders.
"""


def leave_python(system: str | Path) -> None:
    """Prevent take_mission() from executing Python files in the folder of a system that only a
    results file names; raise UsageError if the system does not exist.
    """
    _without_python.add(find_system(system).resolve().parent)


def take_mission(system: Path) -> None:
    """Add the mission in the folder of a system's TOML file to the library of missions, unless
    leave_python() has disabled the Python of this folder.
    """
    if system.resolve().parent in _without_python:
        return
    if system.suffix == ".toml" and any((system.parent / n).is_file() for n in (FILE, SYSTEM)):
        use(system.parent)


def find_system(name: str | Path) -> Path:
    """Return the path of an .ssp or TOML by name or path; raise UsageError with close matches if
    there is none.
    """
    known = paths.systems()
    if str(name) in known:
        return known[str(name)]
    if paths.is_folder(name) and paths.is_file(Path(name) / SYSTEM):
        return Path(name) / SYSTEM
    if paths.is_file(name):
        return Path(name)
    offered = systems()
    if str(name) in offered:
        return offered[str(name)]
    close = did_you_mean(str(name), {**offered, **known})
    raise UsageError(f"{name or '(nothing)'}: there is no such system{close}")


def of_component(name: str | Path) -> tuple[Path, str] | None:
    """Split `SYSTEM.component` into the path of the system and the name of the component, which is
    "" for `SYSTEM` alone; return None if the text does not begin with the name or path of a system.
    """
    text, known = str(name), paths.systems()
    ends = [i for i, character in enumerate(text) if character == "."]
    for end in (len(text), *reversed(ends)):
        path = known.get(text[:end]) or Path(text[:end])
        if paths.is_folder(path) and paths.is_file(path / SYSTEM):
            path = path / SYSTEM
        if path.suffix in (".ssp", ".toml") and paths.is_file(path):
            return path, text[end + 1 :]
    return None
