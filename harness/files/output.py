# SPDX-License-Identifier: BSD-2-Clause
"""Output files that appear completely or not at all, even if the program is terminated, the
command line that wrote them, and private temporary folders that do not outlive the process, even if
it is killed.

Python removes a temporary folder after an error or Ctrl-C. If the code of an FMU crashes or the
process is killed, Python cannot do this. Then a guard removes the folder: a shell that waits at a
pipe which closes with the process. (Windows and machines without a shell have no guard.)
"""

from __future__ import annotations

import os
import re
import secrets
import shutil
import subprocess
import tempfile
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from harness.errors import ResultsError
from harness.files.signals import held


@contextmanager
def written(path: Path) -> Iterator[Path]:
    """Yield a new empty file for writing, which becomes `path` at the end of the `with` block.

    It lies beside `path`, in a folder that is created if missing. After a failure an earlier file
    stays unchanged. A link is followed, and the permissions of an earlier file are preserved.
    Ctrl-C waits until the file is complete. Raises ResultsError if the file cannot be written.
    """
    with held(), naming(path):
        target = path.resolve()
        if target.exists() and not target.is_file():  # a device or pipe is written directly
            yield target
            return
        beside = new_beside(target)
        try:
            yield beside
            if target.exists():
                shutil.copymode(target, beside)
            beside.replace(target)
        finally:
            beside.unlink(missing_ok=True)


def new_beside(target: Path, folder: bool = False) -> Path:
    """Return a new empty file, or folder, beside `target` under an unpredictable name; raise
    OSError.

    Remains of an earlier one from a killed process are removed.
    """
    target.parent.mkdir(parents=True, exist_ok=True)
    _sweep(target)
    word = f"{os.getpid()}-{secrets.token_hex(6)}"
    beside = target.with_name(f".{target.stem[:100]}-{word}{target.suffix}")
    if folder:
        beside.mkdir()
    else:
        os.close(os.open(beside, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    return beside


def _sweep(target: Path) -> None:
    left = re.compile(
        rf"\.{re.escape(target.stem[:100])}-(\d+)-[0-9a-f]{{12}}{re.escape(target.suffix)}"
    )
    for name in os.listdir(target.parent):  # noqa: PTH208 - without a Path for each of many files
        if (match := left.fullmatch(name)) and not _is_running(int(match[1])):
            file = target.with_name(name)
            if file.is_dir() and not file.is_symlink():
                shutil.rmtree(file, ignore_errors=True)
            else:
                file.unlink(missing_ok=True)


def _is_running(process: int) -> bool:
    if os.name != "posix":  # the query would kill the process there
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Raise an OSError inside the block as a ResultsError that names the file."""
    try:
        yield
    except OSError as error:
        raise ResultsError(f"{path}: cannot be written ({error.strerror or error})") from error


# ---- the command line that is at work

_command: str | None = None


def work_for(text: str | None) -> None:
    """Set the command line that later output files of this process name."""
    global _command  # noqa: PLW0603 - a process has one
    _command = text


def command_line() -> str | None:
    """Return the command line; None in a Python program of the user."""
    return _command


@contextmanager
def commanded(text: str) -> Iterator[None]:
    """Set the command line that output files written in the `with` block name."""
    before = _command
    work_for(text)
    try:
        yield
    finally:
        work_for(before)


# ---- private temporary folders


_GUARD = 'IFS= read -r word; [ "$word" = done ] || rm -rf -- "$1"'


class PrivateFolder:
    """New folder that only this user can read; a context manager that gives its path.

    where: an existing folder (None: the folder of temporary files).
    """

    def __init__(self, where: Path | None = None) -> None:
        guard = None
        try:
            self.path = (where or Path(tempfile.gettempdir())) / f"harness-{secrets.token_hex(8)}"
            guard = _guard(self.path)  # before mkdir(): removed even if killed in between
            self.path.mkdir(mode=0o700)
        except OSError as error:
            _dismiss(guard)
            place = where or os.environ.get("TMPDIR", "the temporary folder")
            raise ResultsError(
                f"{place}: cannot create temporary files ({error.strerror or error})"
            ) from error
        self._remove = weakref.finalize(self, _remove, self.path, guard)

    def close(self) -> None:
        """Remove the folder with all that is in it. A folder that is not closed is removed once
        nothing refers to it, or at the end of the process.
        """
        self._remove()

    def __enter__(self) -> Path:
        return self.path

    def __exit__(self, *_: object) -> None:
        self.close()


def _remove(folder: Path, guard: subprocess.Popen[bytes] | None) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    _dismiss(guard)


def _dismiss(guard: subprocess.Popen[bytes] | None) -> None:
    if guard is not None:
        guard.communicate(b"done\n")


def _guard(folder: Path) -> subprocess.Popen[bytes] | None:
    """Return the process that removes the folder after a crash. It has a session of its own, so
    that Ctrl-C does not reach it.
    """
    if os.name != "posix":
        return None
    command = ["/bin/sh", "-c", _GUARD, "harness-guard", str(folder)]
    quiet = subprocess.DEVNULL
    streams: Any = {"stdin": subprocess.PIPE, "stdout": quiet, "stderr": quiet}
    try:
        return subprocess.Popen(command, start_new_session=True, cwd="/", **streams)
    except OSError:  # a machine without a shell
        return None
