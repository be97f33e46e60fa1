# SPDX-License-Identifier: BSD-2-Clause
"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from harness.errors import ResultsError


@contextmanager
def written(path: Path) -> Iterator[Path]:
    """A new empty file to write to, which becomes `path` at the end of the `with` block.

    It stands beside `path`, in a folder that is made if it is missing. If anything fails, an
    earlier file stays as it was. A link is followed, and the permissions of an earlier file are
    kept. Raises ResultsError if the file cannot be written.
    """
    target = path.resolve()
    with _naming(path):
        beside = new_beside(target)
    try:
        with _naming(path):
            yield beside
            if target.exists():
                shutil.copymode(target, beside)
            beside.replace(target)
    finally:
        beside.unlink(missing_ok=True)


def new_beside(target: Path) -> Path:
    """A new empty file in the folder of `target` under a name that nobody can foresee; OSError."""
    beside = target.with_name(f".{target.stem[:100]}-{secrets.token_hex(6)}{target.suffix}")
    target.parent.mkdir(parents=True, exist_ok=True)
    os.close(os.open(beside, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    return beside


@contextmanager
def _naming(path: Path) -> Iterator[None]:
    """An OSError as a ResultsError that names the file."""
    try:
        yield
    except OSError as error:
        raise ResultsError(f"{path}: cannot be written ({error.strerror or error})") from error
