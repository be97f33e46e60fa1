# SPDX-License-Identifier: BSD-2-Clause
"""Where the built FMUs, systems and the C executor are: inside the installed package, else in
build/ beside it.

The environment variable SERVICING_FMUS_BUILD names another build folder, which then wins over both.
"""

from __future__ import annotations

import errno
import filecmp
import os
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

PACKAGE = Path(__file__).resolve().parent.parent
BUILD = PACKAGE.parent / "build"


def fmus() -> dict[str, Path]:
    """All FMUs of the project by name."""
    return _files("fmus", "fmu")


def is_file(path: str | Path) -> bool:
    """Whether there is a file of this name; no name is too long or too odd to ask."""
    try:
        return (path if isinstance(path, Path) else Path(path)).is_file()
    except (OSError, ValueError):
        return False


def contents(path: Path, most: int) -> bytes:
    """The bytes of a file; OSError if there are more than so many, as of a device that never
    ends.
    """
    with path.open("rb") as file:
        data = file.read(most + 1)
    if len(data) > most:
        raise OSError(errno.EFBIG, f"longer than the limit of {most} bytes")
    return data


def is_folder(path: str | Path) -> bool:
    """Whether there is a folder of this name."""
    try:
        return Path(path).is_dir()
    except (OSError, ValueError):
        return False


class Stamp(NamedTuple):
    """What tells a file from every other one, and from itself before it was changed."""

    device: int
    node: int
    modified: int
    size: int


def stamp(path: Path) -> Stamp:
    """Of a file that is there; OSError."""
    found = path.stat()
    return Stamp(found.st_dev, found.st_ino, found.st_mtime_ns, found.st_size)


def is_ours(fmu: Path) -> bool:
    """Whether a file is one of the FMUs of the project, wherever it stands: the same bytes.

    Then it crashes nothing, holds no globals, and its tests prove its reset; what merely names our
    tools as its own may be anybody's.
    """
    return is_file(fmu) and _is_ours(fmu, stamp(fmu), tuple(_chosen()))


@lru_cache(maxsize=256)
def _is_ours(fmu: Path, found: Stamp, _chosen: tuple[Path, ...]) -> bool:
    packed = (*fmus().values(), *_files("fmus3", "fmu").values())
    return any(_are_same(path, fmu, found.size) for path in packed)


def _are_same(ours: Path, fmu: Path, size: int) -> bool:
    try:
        return ours.stat().st_size == size and filecmp.cmp(ours, fmu, shallow=False)
    except FileNotFoundError:  # one of them has been removed since it was listed
        return False


def systems() -> dict[str, Path]:
    """All systems of the project by name."""
    return _files("ssp", "ssp")


def core() -> Path | None:
    """Folder of the C code that FMUs share, or None if it has not been installed."""
    return _first(PACKAGE / "data" / "source" / "core", PACKAGE.parent / "fmus" / "core")


def examples() -> Path | None:
    """Folder of the example controllers, or None if it has not been installed."""
    return _first(PACKAGE / "data" / "examples", PACKAGE.parent / "examples")


def site() -> Path | None:
    """First page of the documentation site, or None if this installation has none."""
    pages = (PACKAGE / "data" / "site" / "index.html", BUILD / "site" / "index.html")
    return next((page for page in pages if page.is_file()), None)


def _first(*folders: Path) -> Path | None:
    return next((folder for folder in folders if folder.is_dir()), None)


def link_sources() -> Path:
    """Folder of the C files of which firmware is built."""
    installed = PACKAGE / "data" / "link"
    return installed if installed.is_dir() else PACKAGE.parent / "fmus" / "core" / "link"


def built(name: str) -> Path | None:
    """A library of ours, or None if there is none: loop (the C executor), link (of an FMU
    that stands for a component elsewhere), board (the other end of it), monolith (the models
    without FMI in one program).
    """
    candidates = (folder / f"{name}.so" for folder in (*_chosen(), PACKAGE / "data", BUILD))
    return next((path for path in candidates if path.is_file()), None)


def _chosen() -> list[Path]:
    """The build folder that the environment names, if any."""
    return [Path(folder).resolve()] if (folder := os.environ.get("SERVICING_FMUS_BUILD")) else []


def _files(kind: str, ending: str) -> dict[str, Path]:
    """Files by stem; the chosen folder wins over the package, the package over the build folder."""
    folders = (BUILD / kind, PACKAGE / "data" / kind, *(folder / kind for folder in _chosen()))
    return {path.stem: path for folder in folders for path in sorted(folder.glob(f"*.{ending}"))}
