# SPDX-License-Identifier: BSD-2-Clause
"""Library of missions by name: folders that the user named, and missions of installed packages.

Python is loaded from no other place: an .ssp, a results file or an FMU contains the name of a
mission, never a path. A package provides missions by an entry point of the group
`harness.missions`. The value of the entry point is the name of a package, which is a mission or
contains missions.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
import traceback
from collections.abc import Iterator
from functools import lru_cache
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import NamedTuple

from harness.errors import HarnessError, UsageError
from harness.files.paths import is_folder
from harness.mission.fields import several
from harness.mission.mission import Mission, together
from harness.results.result import Result
from harness.spelling import did_you_mean

OURS = "ssp"
"""Package that contains the missions of this project."""
GROUP = "harness.missions"
FILE = "mission.py"
SYSTEM = "system.toml"


class Place(NamedTuple):
    """Folder of a mission, and the dotted name by which Python imports this folder as a package
    ("": the folder is in no installed package).
    """

    folder: Path
    package: str = ""


_named: dict[str, Place] = {}
"""Missions whose folder the user of this process has named, by name."""
_chosen: list[str] = []
"""Name of the mission that the user chose for all results, regardless of their provenance; empty if
none.
"""


def use(folder: Path, always: bool = False) -> str:
    """Add the mission in a folder that the user named to the library, and return its name.

    always: whether to use it for every result, regardless of the mission that the result names.
    Raises UsageError if there is no such folder or it contains no mission.
    """
    place = folder.resolve()
    if not is_folder(place):
        raise UsageError(f"{folder}: there is no such folder")
    if not any((place / name).is_file() for name in (FILE, SYSTEM)):
        raise UsageError(f"{folder}: is not a mission: it holds neither {FILE} nor {SYSTEM}")
    packages = {p.folder: p.package for p in installed().values()}
    _named[place.name] = Place(place, packages.get(place, ""))
    if always:
        _chosen[:] = [place.name]
    return place.name


@lru_cache(maxsize=1)
def installed() -> dict[str, Place]:
    """Return the missions of this project and of other installed packages by the name of the
    mission.
    """
    from importlib.metadata import entry_points

    found = dict(_ours())
    for point in entry_points(group=GROUP):
        for place in _offered(point.value):
            found.setdefault(place.folder.name, place)
    return found


@lru_cache(maxsize=1)
def _ours() -> dict[str, Place]:
    """Return the missions of this project by name, without a search in other packages."""
    return {place.folder.name: place for place in _offered(OURS)}


def _offered(package: str) -> Iterator[Place]:
    """Yield the missions of a package: the package itself, or each of its folders that contains
    mission.py; nothing if there is no such package.
    """
    try:
        spec = importlib.util.find_spec(package)
    except (ImportError, ValueError):
        return
    for top in map(Path, (spec.submodule_search_locations or ()) if spec else ()):
        if (top / FILE).is_file() or (top / SYSTEM).is_file():
            yield Place(top, package)
        elif top.is_dir():
            inside = sorted(p for p in top.iterdir() if (p / FILE).is_file())
            yield from (Place(each, f"{package}.{each.name}") for each in inside)


def places() -> dict[str, Place]:
    """Return all available missions by name. A folder that the user named has precedence over an
    installed mission of the same name.
    """
    return {**_named, **{n: p for n, p in installed().items() if n not in _named}}


def systems_in(folder: Path) -> dict[str, Path]:
    """Return the TOML file of every system of a mission by the name of the system. In a folder
    `docking`, this name is `docking` for system.toml, `docking_far` for far.toml.
    """
    found = sorted(folder.glob("*.toml"))
    return {folder.name if p.name == SYSTEM else f"{folder.name}_{p.stem}": p for p in found}


def systems() -> dict[str, Path]:
    """Return the TOML file of every system of all available missions by the name of the system."""
    return {n: p for place in places().values() for n, p in systems_in(place.folder).items()}


def campaigns() -> dict[str, Path]:
    """Return the TOML file of every campaign of all available missions, by name of the campaign."""
    folders = (place.folder / "campaigns" for place in places().values())
    return {path.stem: path for folder in folders for path in sorted(folder.glob("*.toml"))}


def mission(name: str) -> Mission | None:
    """Return the mission with this name, None if it is not available; raise HarnessError if the
    Python code of the mission fails.
    """
    place = _named.get(name) or _ours().get(name) or installed().get(name)
    return None if place is None else _loaded(place)


@lru_cache(maxsize=64)
def _loaded(place: Place) -> Mission:
    if not (place.folder / FILE).is_file():
        return Mission()
    try:
        module = importlib.import_module(f"{place.package or _package(place.folder)}.mission")
    except (Exception, SystemExit) as error:
        raise HarnessError(_failure(place.folder, error)) from error
    found = getattr(module, "MISSION", None)
    if not isinstance(found, Mission):
        raise HarnessError(f"{place.folder / FILE}: MISSION must be a harness.mission.Mission")
    return found


def _package(folder: Path) -> str:
    """Register a folder as a Python package, so that its files can import each other, and return
    the name of the package.
    """
    name = f"mission_{folder.name}_{abs(hash(folder)):x}"
    if name not in sys.modules:
        spec = ModuleSpec(name, None, is_package=True)
        spec.submodule_search_locations = [str(folder)]
        sys.modules[name] = importlib.util.module_from_spec(spec)
    return name


def failure(error: BaseException) -> str:
    """Return a line with the place of an error if the Python code of a user's mission has raised
    it; "" for an error from other code.
    """
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    files = [Path(frame.f_code.co_filename) for frame in frames]
    folders = [place.folder for place in _named.values() if not place.package]
    found = (folder for folder in folders if any(file.is_relative_to(folder) for file in files))
    return next((_failure(folder, error) for folder in found), "")


def _failure(folder: Path, error: BaseException) -> str:
    """Return a text of one line about an error in the Python code of a mission: file and number of
    the last executed line of the mission, and the error.
    """
    line, trace = getattr(error, "lineno", None), error.__traceback__
    file = Path(getattr(error, "filename", None) or folder / FILE)
    while trace is not None:
        code = Path(trace.tb_frame.f_code.co_filename)
        if code.is_relative_to(folder):
            file, line = code, trace.tb_lineno
        trace = trace.tb_next
    where = f"{file}, line {line}" if line else f"{file}"
    return f"{where}: {type(error).__name__}: {' '.join(str(error).split())}"


def inherit(name: str, own: Mission) -> Mission:
    """Return the figures, metrics and other contents of `own`, followed by the contents of the
    mission `name`; raise UsageError if that mission is not available.
    """
    if (other := mission(name)) is None:
        raise UsageError(f"the mission {name} is not available{did_you_mean(name, places())}")
    return together((own, other))


def of_result(result: Result) -> Mission:
    """Return the mission of a result. If the result names none, return all available missions
    together; if its mission is not available, return an empty one (missing() reports this).
    """
    name = remembered(result)
    return (mission(name) or Mission()) if name else everything()


def remembered(result: Result) -> str:
    """Return the name of the mission that the user chose for all results; without such a choice,
    the mission that the result names, "" if it names none.
    """
    if _chosen:
        return _chosen[0]
    return result.provenance.mission if result.provenance else ""


def missing(result: Result) -> str:
    """Return a line that states that the mission of a result is missing; "" if none is missing."""
    name = remembered(result)
    if not name or name in places():
        return ""
    return (
        f"the mission {name} is not available, so there are general figures only; name its folder "
        "with --mission"
    )


def notes_of(result: Result) -> list[str]:
    """Return the notes of the mission about a result, one line each, on facts that its values do
    not show.
    """
    if not len(result.time):
        return []
    return [line for notes in of_result(result).notes for line in several(str, notes, result)]


def everything() -> Mission:
    """Return the contents of all available missions as one mission."""
    return _together(tuple(places().values()))


@lru_cache(maxsize=4)
def _together(all_: tuple[Place, ...]) -> Mission:
    return together(map(_loaded, all_))
