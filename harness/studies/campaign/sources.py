# SPDX-License-Identifier: BSD-2-Clause
"""Files and packages that decide the runs of a campaign beside its table: the system with all that
it extends, FMUs, parameter files, start files, the Python of metrics and missions. A dataset
records the hash or version of each, and only a campaign with equal ones can resume it.
"""

from __future__ import annotations

import ast
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from harness.files.checksums import sha256
from harness.files.paths import is_file, is_folder
from harness.mission.library import places
from harness.ssp.extends import chain
from harness.studies.campaign.metrics import file_of, offering
from harness.studies.campaign.plan import Plan, Source
from harness.system.model import System
from harness.system.swap import find_fmu

PACKAGES = ("servicing-fmus", "numpy", "scipy")
SUFFIXES = (".py", *EXTENSION_SUFFIXES)
INSTALLED = tuple(
    sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")
)
"""Folders of Python and of installed packages."""


def sources(plan: Plan, loaded: System, changed: Iterable[System]) -> dict[str, Source]:
    """Return all sources by name; loaded: the system of the plan; changed: the system with the
    changes of every structure of the campaign.
    """
    files = [plan.system, *(Path(start) for start in loaded.starts.values() if is_file(start))]
    if plan.system.suffix == ".toml":  # an .ssp holds its FMUs
        files += [*chain(plan.system), *(component.fmu for component in loaded.components)]
    for origin in (system.origin for system in changed):
        files += [find_fmu(swap.fmu) for swap in origin.swaps.values()]
        files += [Path(str(origin.params))] if origin.params_sha256 else []
    texts, python = set(plan.table.texts.values()), set[Path]()
    for file in filter(None, map(file_of, texts)):
        python.update(_imported(plan.folder / file))
    offered = {each[0] for each in map(offering, texts) if each}
    for name, place in places().items():
        if name in {loaded.mission, *offered}:
            own = _package(place.folder)
            python.update(own if place.package else (f for each in own for f in _imported(each)))
    packages = {f"version of {name}": Source(name, _state(name)) for name in PACKAGES}
    return named([*files, *sorted(python)]) | packages


def named(files: Iterable[Path]) -> dict[str, Source]:
    """Return files by their names, with as many of their folders as make them unique. A campaign
    that was moved as a whole has the same sources.
    """
    found: dict[str, Source] = {}
    for path in (file.resolve() for file in files):
        place, count = str(path), 1
        while (name := "/".join(path.parts[-count:])) in found and found[name].place != place:
            count += 1
        found[name] = Source(place, _state(place))
    return found


def differing(then: Mapping[str, Source]) -> list[str]:
    """Return the names of the files and packages that are no longer as they were."""
    known = {n: source for n, source in then.items() if not is_folder(source.place)}
    return [name for name, source in known.items() if _state(source.place) != source.state]


def _state(place: str) -> str:
    """Return the hash of a file or folder, or the version of a package, "" if it is not there."""
    try:
        if place in PACKAGES:
            return version(place)
        return sha256(place) if is_file(place) or is_folder(place) else ""
    except (OSError, PackageNotFoundError):
        return ""


def _imported(file: Path) -> Iterator[Path]:
    """Yield a file of Python and all that it imports, also in functions, from its folder, the
    working directory and the folders of sys.path that hold neither Python nor installed packages.
    """
    found, waiting = set[Path](), [file]
    folders = [file.parent, Path.cwd(), *(Path(p) for p in sys.path if not p.startswith(INSTALLED))]
    while waiting:
        if (file := waiting.pop()) not in found:
            found.add(file)
            yield file
            for name, places in _names(file, folders):
                waiting += _modules(name, places)


def _names(file: Path, folders: Sequence[Path]) -> Iterator[tuple[str, Sequence[Path]]]:
    """Yield the modules that a file imports, and attributes that may be modules, with the folders
    in which they are searched.
    """
    try:
        tree = ast.parse(file.read_bytes() if file.suffix == ".py" else b"")
    except (SyntaxError, ValueError):
        return
    for node in ast.walk(tree):
        match node:
            case ast.Import(names=names):
                yield from ((each.name, folders) for each in names)
            case ast.ImportFrom(module=module, names=names, level=level):
                start = [*file.parents][level - 1 : level] if level else folders
                yield from ((f"{module or ''}.{each.name}".strip("."), start) for each in names)


def _modules(name: str, folders: Sequence[Path]) -> Iterator[Path]:
    """Yield the files of a module and of the packages above it, without the harness."""
    for part in name.split(".") if name.partition(".")[0] != "harness" else ():
        stems = [folder / stem for folder in folders for stem in (part, f"{part}/__init__")]
        yield from filter(Path.is_file, (Path(f"{s}{end}") for s in stems for end in SUFFIXES))
        folders = [folder / part for folder in folders if (folder / part).is_dir()]


def _package(folder: Path) -> Iterator[Path]:
    """Yield the Python of the outermost package that a folder belongs to, or of the folder."""
    while all((each / "__init__.py").is_file() for each in (folder, folder.parent)):
        folder = folder.parent
    for file in folder.rglob("*.py"):
        if not any(part.startswith(".") for part in file.relative_to(folder).parts):
            yield file
