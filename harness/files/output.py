# SPDX-License-Identifier: BSD-2-Clause
"""Files that appear whole or not at all, whatever ends the program meanwhile, and the command line
that they come of.
"""

from __future__ import annotations

import os
import re
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from harness.errors import ResultsError
from harness.files.signals import held


@contextmanager
def written(path: Path) -> Iterator[Path]:
    """A new empty file to write to, which becomes `path` at the end of the `with` block.

    It stands beside `path`, in a folder that is made if it is missing. If anything fails, an
    earlier file stays as it was. A link is followed, and the permissions of an earlier file are
    kept. Ctrl-C waits until the file is complete. Raises ResultsError if the file cannot be
    written.
    """
    with held(), naming(path):
        target = path.resolve()
        if target.exists() and not target.is_file():  # a device or pipe is written as it is
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
    """A new empty file, or folder, beside `target` under a name that nobody can foresee; OSError.

    What a killed process has left of an earlier one is removed.
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
    for file in target.parent.iterdir():
        if (match := left.fullmatch(file.name)) and not _is_running(int(match[1])):
            if file.is_dir() and not file.is_symlink():
                shutil.rmtree(file, ignore_errors=True)
            else:
                file.unlink(missing_ok=True)


def _is_running(process: int) -> bool:
    if os.name != "posix":  # asking would end it there
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
    """An OSError as a ResultsError that names the file."""
    try:
        yield
    except OSError as error:
        raise ResultsError(f"{path}: cannot be written ({error.strerror or error})") from error


# ---- the command line that is at work

_command: str | None = None


def work_for(text: str | None) -> None:
    """From now on, what this process writes comes of this command line."""
    global _command  # noqa: PLW0603 - a process has one
    _command = text


def command_line() -> str | None:
    """The command line; None in a Python program of the user."""
    return _command


@contextmanager
def commanded(text: str) -> Iterator[None]:
    """What is written in the `with` block comes of this command line."""
    before = _command
    work_for(text)
    try:
        yield
    finally:
        work_for(before)
