# SPDX-License-Identifier: BSD-2-Clause
"""Sources of a campaign: files and packages that influence the results of its runs, apart from its
table. These are the file of the system and the files that it extends, FMUs, files of parameters
and start values, Python files of metrics and missions, and packages.

A dataset records the hash or version of each source. A campaign can be resumed only if its sources
are unchanged.
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
from harness.files.paths import is_file
from harness.mission.library import places
from harness.ssp.extends import chain
from harness.studies.campaign.metrics import file_of, offering
from harness.studies.campaign.plan import Plan, Source
from harness.system.model import System
from harness.system.swap import find_fmu

PACKAGES = ("servicing-fmus", "numpy", "scipy")
"""Packages whose versions are recorded."""
SUFFIXES = (".py", *EXTENSION_SUFFIXES)
INSTALLED = tuple(
    sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib")
)
"""Folders of Python itself and of installed packages, whose modules are not recorded."""


def sources(plan: Plan, loaded: System, changed: Iterable[System]) -> dict[str, Source]:
    """Return all sources of a campaign by name.

    loaded: system of the plan; changed: the system with the changes of each structure (combination
    of FMUs and options) of the campaign.
    """
    files = [plan.system, *(Path(start) for start in loaded.starts.values() if is_file(start))]
    if plan.system.suffix == ".toml":  # an .ssp contains its FMUs, so its hash covers them
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
    return _named([*files, *sorted(python)]) | packages


def _named(files: Iterable[Path]) -> dict[str, Source]:
    """Return files as sources by a unique name: the file name, with as many parent folders as
    needed. The names lack the full path, so that a campaign that was moved with its files has equal
    sources.
    """
    found: dict[str, Source] = {}
    for path in (file.resolve() for file in files):
        place, count = str(path), 1
        while (name := "/".join(path.parts[-count:])) in found and found[name].place != place:
            count += 1
        found[name] = Source(place, _state(place))
    return found


def differing(then: Mapping[str, Source]) -> list[str]:
    """Return the names of the sources whose hash or version differs from `then`, the recorded
    sources.
    """
    return [name for name, source in then.items() if _state(source.place) != source.state]


def _state(place: str) -> str:
    """Return the version of the package or the hash of the file `place`; "" if there is none."""
    try:
        if place in PACKAGES:
            return version(place)
        return sha256(place) if is_file(place) else ""
    except (OSError, PackageNotFoundError):
        return ""


def _imported(file: Path) -> Iterator[Path]:
    """Yield a Python file and all files that it imports, directly, indirectly, or inside functions.
    Modules of Python, of installed packages and of the harness are not included.
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
    """Yield the dotted names that a Python file imports, each with the folders in which the module
    is to be searched. `from module import name` gives `module.name`, even if this is an attribute
    of a module, not a module.
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
    """Yield the files of a module `a.b.c` and of its packages `a` and `a.b` that exist in the given
    folders; nothing for modules of the harness.
    """
    for part in name.split(".") if name.partition(".")[0] != "harness" else ():
        stems = [folder / stem for folder in folders for stem in (part, f"{part}/__init__")]
        yield from filter(Path.is_file, (Path(f"{s}{end}") for s in stems for end in SUFFIXES))
        folders = [folder / part for folder in folders if (folder / part).is_dir()]


def _package(folder: Path) -> Iterator[Path]:
    """Yield all Python files of the outermost package that contains a folder, or of the folder
    itself if it is no package. Hidden files and folders are left out.
    """
    while all((each / "__init__.py").is_file() for each in (folder, folder.parent)):
        folder = folder.parent
    for file in folder.rglob("*.py"):
        if not any(part.startswith(".") for part in file.relative_to(folder).parts):
            yield file
