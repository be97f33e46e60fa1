# SPDX-License-Identifier: BSD-2-Clause
"""Output files that appear completely or not at all, the command line that is stated in them, and
private temporary folders that are removed even if the process is killed.

Python removes a temporary folder after an error or Ctrl-C, but not if the code of an FMU crashes
the process or the process is killed. Then a guard removes the folder: a shell process that waits
for the end of a pipe, which the system closes with the process. (Windows and machines without a
shell have no guard.)
"""

from __future__ import annotations

import os
import re
import secrets
import shutil
import subprocess
import sys
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
    """Yield the path of a new empty file for writing, which is renamed to `path` at the end of the
    `with` block.

    The new file is in the folder of `path`, which is created if missing. After a failure an earlier
    file at `path` is unchanged. If `path` is a link, the file to which it points is replaced. The
    permissions of an earlier file are preserved. Ctrl-C takes effect when the file is complete.
    Raises ResultsError if the file cannot be written.
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
    """Create an empty file or folder with an unpredictable name in the folder of `target`, and
    return its path; raise OSError if this fails.

    Such files and folders that killed processes have left there for the same target are removed.
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
    for name in os.listdir(target.parent):  # noqa: PTH208 - a Path for each of many files is slow
        if (match := left.fullmatch(name)) and not _is_running(int(match[1])):
            file = target.with_name(name)
            if file.is_dir() and not file.is_symlink():
                shutil.rmtree(file, ignore_errors=True)
            else:
                file.unlink(missing_ok=True)


def _is_running(process: int) -> bool:
    if os.name == "posix":  # on Windows os.kill(process, 0) would end the process
        try:
            os.kill(process, 0)
        except ProcessLookupError:
            return False
        except (OSError, OverflowError):
            return True
    return process_state(process) != "Z"  # zombie: it has ended


def process_state(process: int) -> str:
    """Return the letter by which Linux states the state of a process, such as T (stopped) or Z
    (zombie); "" if it is unknown. process: process id.
    """
    try:
        text = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
    return text.rpartition(") ")[2][:1]


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """Replace an OSError in the `with` block by a ResultsError that names the file `path`."""
    try:
        yield
    except OSError as error:
        raise ResultsError(f"{path}: cannot be written ({error.strerror or error})") from error


# ---- the command line that output files name

_command: str | None = None


def work_for(text: str | None) -> None:
    """Set the command line that all later output files of this process state; None: none."""
    global _command  # noqa: PLW0603 - a process has one
    _command = text


def command_line() -> str | None:
    """Return the command line that output files state; None in a Python program of the user."""
    return _command


@contextmanager
def commanded(text: str) -> Iterator[None]:
    """Set the command line that output files state if they are written in the `with` block."""
    before = _command
    work_for(text)
    try:
        yield
    finally:
        work_for(before)


# ---- private temporary folders


_GUARD = 'IFS= read -r word; [ "$word" = done ] || rm -rf -- "$1"'


class PrivateFolder:
    """New temporary folder that only this user can read; a context manager that yields its path and
    then removes it.

    longest: largest length of its path [bytes]. If its path in TMPDIR were longer, the folder is in
    /tmp.
    """

    def __init__(self, longest: int = sys.maxsize) -> None:
        guard, name = None, f"harness-{secrets.token_hex(8)}"
        place = os.environ.get("TMPDIR", "the temporary folder")
        try:
            self.path = Path(tempfile.gettempdir(), name)
            if len(os.fsencode(self.path)) > longest:
                place, self.path = "/tmp", Path("/tmp", name)
            # the guard starts before mkdir(), so that it also removes the folder if the process is
            # killed directly after mkdir()
            guard = _guard(self.path)
            self.path.mkdir(mode=0o700)
        except OSError as error:
            _dismiss(guard)
            raise ResultsError(
                f"{place}: cannot create temporary files ({error.strerror or error})"
            ) from error
        self._remove = weakref.finalize(self, _remove, self.path, guard)

    def close(self) -> None:
        """Remove the folder with its content. Without this call it is removed once no variable
        refers to this object, or at the end of the process.
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
    """Start and return the shell process that removes the folder if this process crashes; None if
    there is no shell. It has its own session, so that Ctrl-C in the terminal does not end it.
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
