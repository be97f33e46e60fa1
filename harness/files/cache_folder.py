# SPDX-License-Identifier: BSD-2-Clause
"""Where the cache is, if it can be used: a private folder in which programs can be run.

It is used only if it belongs to the user, nobody else may enter it, and no folder above it lets
others exchange it.
"""

from __future__ import annotations

import logging
import os
import stat
from functools import lru_cache
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows: nothing is kept there
    fcntl = None  # type: ignore[assignment]

OFF = ("", "off", "0")

_log = logging.getLogger("harness")

_left_out: set[Path] = set()
"""Folders that have failed this process."""


def folder() -> Path | None:
    """The folder; None if nothing is to be kept, or nowhere safe."""
    wanted = os.environ.get("HARNESS_CACHE")
    if fcntl is None or (wanted is not None and wanted.strip().lower() in OFF):
        return None
    found = _usable(wanted, os.environ.get("XDG_CACHE_HOME"))
    return None if found in _left_out else found


def leave_out(path: Path, reason: str) -> None:
    """Keep nothing in this folder from now on, and say so once."""
    if path not in _left_out:
        _left_out.add(path)
        _log.warning("%s: not used as a cache, %s (see HARNESS_CACHE)", path, reason)


@lru_cache
def _usable(wanted: str | None, caches: str | None) -> Path | None:
    """The folder itself, made if it is missing, if it can be used; else a warning."""
    path = Path(wanted or Path(caches or "~/.cache") / "servicing-fmus")
    try:
        path = path.expanduser() if not (wanted or caches) else path
        reason = "the path of XDG_CACHE_HOME is not absolute"
        if wanted or path.is_absolute():
            path = path.absolute()
            path.mkdir(mode=0o700, parents=True, exist_ok=True)
            reason = _unusable(path)
    except (OSError, RuntimeError) as error:  # no home, or one that cannot be written
        reason = getattr(error, "strerror", None) or str(error)
    if reason:
        leave_out(path, reason)
        return None
    return path


def _unusable(path: Path) -> str:
    """Why a folder is no place to keep libraries in: others could read or exchange what is there,
    it cannot be written, or they could not be loaded; "" if it is one.
    """
    about = path.lstat()
    reasons = {
        "it is not a folder": not stat.S_ISDIR(about.st_mode),
        "it belongs to somebody else": about.st_uid != os.geteuid(),
        "others may enter it": about.st_mode & 0o077,
    }
    for above in path.resolve().parents:
        about = above.stat()
        open_to_all = about.st_mode & 0o022 and not about.st_mode & stat.S_ISVTX
        reasons[f"{above} belongs to somebody else"] = about.st_uid not in (0, os.geteuid())
        reasons[f"others may write to {above}"] = open_to_all
    noexec = getattr(os, "ST_NOEXEC", 0)
    reasons["it cannot be written"] = not os.access(path, os.W_OK)
    reasons["no library can be loaded from it (it is mounted with noexec)"] = (
        os.statvfs(path).f_flag & noexec
    )
    return next((reason for reason, holds in reasons.items() if holds), "")
