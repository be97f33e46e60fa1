# SPDX-License-Identifier: BSD-2-Clause
"""Locations of the built FMUs, systems and the C executor: inside the installed package, or else in
build/ beside it.

The environment variable SERVICING_FMUS_BUILD names another build folder, which has precedence over
both.
"""

from __future__ import annotations

import errno
import filecmp
import os
from functools import lru_cache
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent
BUILD = PACKAGE.parent / "build"


def fmus() -> dict[str, Path]:
    """Return all FMUs of the project by name."""
    return _files("fmus", "fmu")


def is_file(path: str | Path) -> bool:
    """Return whether a file with this name exists; False for a name that is too long or invalid."""
    return os.path.isfile(path)  # noqa: PTH113 - a Path raises an error for such names


def contents(path: Path, most: int) -> bytes:
    """Return the bytes of a file; raise OSError if there are more than `most`, as from a device
    that never ends, such as /dev/zero.
    """
    with path.open("rb") as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise OSError(errno.EFBIG, f"longer than the limit of {most} bytes")
    return data


def is_folder(path: str | Path) -> bool:
    """Return whether a folder with this name exists; False for a too long or invalid name."""
    return os.path.isdir(path)  # noqa: PTH112


Stamp = tuple[int, int, int, int]
"""Device, inode, time of modification [ns] and size [bytes] of a file, which identify its present
content: another file, or the same file after a change, has another stamp.
"""


def stamp(path: Path) -> Stamp:
    """Return the stamp of a file; raise OSError if the file does not exist."""
    found = path.stat()
    return found.st_dev, found.st_ino, found.st_mtime_ns, found.st_size


def is_ours(fmu: Path) -> bool:
    """Return whether a file has the same bytes as an FMU of the project, in any folder.

    Such an FMU may run inside this process: it cannot crash, has no global variables, and tests
    show that its reset works. The bytes are compared because the name of the generation tool, which
    any FMU can state, would not prove this.
    """
    return is_file(fmu) and _is_ours(fmu, stamp(fmu), tuple(_chosen()))


@lru_cache(maxsize=256)
def _is_ours(fmu: Path, _: Stamp, _chosen: tuple[Path, ...]) -> bool:
    packed = (*fmus().values(), *_files("fmus3", "fmu").values())
    return any(_are_same(path, fmu) for path in packed)


def _are_same(ours: Path, fmu: Path) -> bool:
    try:
        return filecmp.cmp(ours, fmu, shallow=False)
    except FileNotFoundError:  # a file was removed after the folder was listed
        return False


def systems() -> dict[str, Path]:
    """Return all systems of the project by name."""
    return _files("ssp", "ssp")


def core() -> Path | None:
    """Return the folder of the C code that FMUs share, or None if it is not installed."""
    return _first(PACKAGE / "data" / "source" / "core", PACKAGE.parent / "fmus" / "core")


def examples() -> Path | None:
    """Return the folder of the examples (sources of components), or None if it is not installed."""
    return _first(PACKAGE / "data" / "examples", PACKAGE.parent / "examples")


def site() -> Path | None:
    """Return the first page of the documentation site, or None if this installation has none."""
    pages = (PACKAGE / "data" / "site" / "index.html", BUILD / "site" / "index.html")
    return next((page for page in pages if page.is_file()), None)


def _first(*folders: Path) -> Path | None:
    return next((folder for folder in folders if folder.is_dir()), None)


def link_sources() -> Path:
    """Return the folder of the C files from which the firmware of flight processors is built."""
    installed = PACKAGE / "data" / "link"
    return installed if installed.is_dir() else PACKAGE.parent / "fmus" / "core" / "link"


def built(name: str) -> Path | None:
    """Return the path of a compiled library of the project, or None if it is missing.

    name: "loop" (the C executor), "link" (library of an FMU that represents a remote component),
    "board" (the remote end of this link) or "monolith" (all models in one library, without FMI).
    """
    candidates = (folder / f"{name}.so" for folder in (*_chosen(), PACKAGE / "data", BUILD))
    return next((path for path in candidates if path.is_file()), None)


def _chosen() -> list[Path]:
    """Return a list of the build folder that SERVICING_FMUS_BUILD names, or an empty list."""
    return [Path(folder).resolve()] if (folder := os.environ.get("SERVICING_FMUS_BUILD")) else []


def _files(kind: str, ending: str) -> dict[str, Path]:
    """Return the files with an ending in the subfolder `kind` of the build folders, by stem.

    The build folder that SERVICING_FMUS_BUILD names has precedence over the package, and the
    package over the default build folder.
    """
    folders = (BUILD / kind, PACKAGE / "data" / kind, *(folder / kind for folder in _chosen()))
    return {path.stem: path for folder in folders for path in sorted(folder.glob(f"*.{ending}"))}
