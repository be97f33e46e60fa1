# SPDX-License-Identifier: BSD-2-Clause
"""Missions by name: folders that the user has named, and those of installed packages.

Python is taken from nowhere else: what a .ssp, a results file or an FMU says is the name of a
mission, never a place. A package offers its missions by an entry point of the group
`harness.missions` that names a package: a mission, or a package of missions.
"""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Iterator
from functools import lru_cache
from importlib.machinery import ModuleSpec
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import NamedTuple

from harness.errors import UsageError
from harness.mission.mission import Mission, together
from harness.results.result import Result
from harness.spelling import did_you_mean

GROUP = "harness.missions"
FILE = "mission.py"
SYSTEM = "system.toml"


class Place(NamedTuple):
    """The folder of a mission, and the package that it is ("": none that is installed)."""

    folder: Path
    package: str = ""


_named: dict[str, Place] = {}
"""Missions whose folder the user of this process has named."""
_chosen: list[str] = []
"""The one that is taken whatever a result remembers."""


def use(folder: Path, always: bool = False) -> str:
    """Take the mission of a folder that the user has named into the library; returns its name.

    always: for every result, whatever mission it remembers. UsageError if there is no such folder.
    """
    place = folder.resolve()
    if not place.is_dir():
        raise UsageError(f"{folder}: there is no such folder of a mission")
    if not any((place / name).is_file() for name in (FILE, SYSTEM)):
        raise UsageError(f"{folder}: is not a mission: it holds neither {FILE} nor {SYSTEM}")
    packages = {p.folder: p.package for p in installed().values()}
    _named[place.name] = Place(place, packages.get(place, ""))
    if always:
        _chosen[:] = [place.name]
    return place.name


@lru_cache(maxsize=1)
def installed() -> dict[str, Place]:
    """Missions of installed packages by name."""
    found: dict[str, Place] = {}
    for point in entry_points(group=GROUP):
        for place in _offered(point):
            found.setdefault(place.folder.name, place)
    return found


def _offered(point: EntryPoint) -> Iterator[Place]:
    """The missions of an entry point; none if its package is not there."""
    try:
        spec = importlib.util.find_spec(point.value)
    except (ImportError, ValueError):
        return
    for top in map(Path, (spec.submodule_search_locations or ()) if spec else ()):
        if (top / FILE).is_file() or (top / SYSTEM).is_file():
            yield Place(top, point.value)
        elif top.is_dir():
            inside = sorted(p for p in top.iterdir() if (p / FILE).is_file())
            yield from (Place(each, f"{point.value}.{each.name}") for each in inside)


def places() -> dict[str, Place]:
    """All missions at hand by name; a folder that the user has named wins."""
    return {**_named, **{n: p for n, p in installed().items() if n not in _named}}


def systems_in(folder: Path) -> dict[str, Path]:
    """The TOML of every system of a mission by name: that of the folder, with that of the file
    unless it is system.toml.
    """
    found = sorted(folder.glob("*.toml"))
    return {folder.name if p.name == SYSTEM else f"{folder.name}_{p.stem}": p for p in found}


def systems() -> dict[str, Path]:
    """The TOML of every system of the missions at hand."""
    return {n: p for place in places().values() for n, p in systems_in(place.folder).items()}


def campaigns() -> dict[str, Path]:
    """All campaigns of the missions at hand by name."""
    folders = (place.folder / "campaigns" for place in places().values())
    return {path.stem: path for folder in folders for path in sorted(folder.glob("*.toml"))}


def mission(name: str) -> Mission | None:
    """The mission of that name, None if it is not at hand; UsageError if its Python fails."""
    place = places().get(name)
    return None if place is None else _loaded(place)


@lru_cache(maxsize=64)
def _loaded(place: Place) -> Mission:
    if not (place.folder / FILE).is_file():
        return Mission()
    try:
        module = importlib.import_module(f"{place.package or _package(place.folder)}.mission")
    except Exception as error:
        raise UsageError(_failure(place.folder, error)) from error
    found = getattr(module, "MISSION", None)
    if not isinstance(found, Mission):
        raise UsageError(f"{place.folder / FILE}: MISSION must be a harness.mission.Mission")
    return found


def _package(folder: Path) -> str:
    """Make a folder a package, so that its files import each other; returns its name."""
    name = f"mission_{folder.name}_{abs(hash(folder)):x}"
    if name not in sys.modules:
        spec = ModuleSpec(name, None, is_package=True)
        spec.submodule_search_locations = [str(folder)]
        sys.modules[name] = importlib.util.module_from_spec(spec)
    return name


def _failure(folder: Path, error: Exception) -> str:
    """What is wrong with the Python of a mission: the line of its own that failed."""
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
    """A mission's own figures, measures and so on before those of another one; UsageError if that
    is not at hand.
    """
    if (other := mission(name)) is None:
        raise UsageError(f"the mission {name} is not available{did_you_mean(name, places())}")
    return together((own, other))


def of_result(result: Result) -> Mission:
    """What the mission of a result offers; all that is at hand if it remembers none, nothing if its
    mission is not at hand (missing() says so).
    """
    name = remembered(result)
    return (mission(name) or Mission()) if name else everything()


def remembered(result: Result) -> str:
    """Name of the mission of a result, "" if it does not say."""
    if _chosen:
        return _chosen[0]
    return result.provenance.mission if result.provenance else ""


def missing(result: Result) -> str:
    """One line if the mission of a result is not at hand, else ""."""
    name = remembered(result)
    if not name or name in places():
        return ""
    return (
        f"the mission {name} is not available: general figures only; name its folder with --mission"
    )


def notes_of(result: Result) -> list[str]:
    """What a reader must know of a result and no number in it says, by its mission."""
    if not len(result.time):
        return []
    return [line for notes in of_result(result).notes for line in notes(result)]


def everything() -> Mission:
    """All that the missions at hand offer."""
    return _together(tuple(places().values()))


@lru_cache(maxsize=4)
def _together(all_: tuple[Place, ...]) -> Mission:
    return together(map(_loaded, all_))
