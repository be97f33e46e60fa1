# SPDX-License-Identifier: BSD-2-Clause
"""Comma-separated format: a plain .csv table for any reader of tables, and beside it NAME.csv.toml
with units, descriptions, parameters and provenance.

Everything that a plain table cannot express is beside the .csv and not inside, so that a
spreadsheet or pandas reads the table without settings. NAME.csv.toml contains the hash of its table
and is ignored beside any other table.
"""

from __future__ import annotations

import csv
import logging
import os
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TextIO

import numpy as np

from harness.files.checksums import sha256
from harness.files.output import written
from harness.results.formats import completed, content
from harness.results.result import Result

INCOMPLETE = "# incomplete: "
"""Begin of the last line of a run that ended early; its reason follows."""
LONGEST_LINE = 64 * 1024**2
"""Largest number of characters of a line."""

_log = logging.getLogger("harness")


def write(result: Result, path: Path) -> None:
    """Write the table; numbers in full, and a last line if the run ended early."""
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(map(_quoted, ("time", *result.columns))) + "\n")
        table = np.column_stack((result.time, result.values))
        for row in table:  # repr is the shortest text that reads back as the same number
            file.write(",".join(map(repr, row.tolist())) + "\n")
        if not result.complete:
            file.write(f"{INCOMPLETE}{' '.join(result.message.split())}\n")


def _quoted(name: str) -> str:
    """Return a name for the header. csv.writer leaves a carriage return, which ends a line, without
    quotes.
    """
    needed = any(character in name for character in ',"\r\n') or name != name.strip() or not name
    return '"{}"'.format(name.replace('"', '""')) if needed else name


def read(path: Path) -> Result:
    """Read the table and the file beside it; raise ValueError if it is not a table."""
    with path.open(encoding="utf-8", newline="") as file:
        names = next(csv.reader(_lines(file)), [])
        if names[:1] != ["time"]:
            raise ValueError("the first column must be named time")
        table = np.loadtxt(file, delimiter=",", ndmin=2)
    if table.shape[1] != len(names):
        raise ValueError(f"the header has {len(names)} names for {table.shape[1]} columns")
    _, mark, reason = _last_line(path).partition(INCOMPLETE)
    units = ("",) * (len(names) - 1)
    result = Result(path.stem, table[:, 0], tuple(names[1:]), units, table[:, 1:])
    return _completed(replace(result, complete=not mark, message=reason.strip()), path)


def _lines(file: TextIO) -> Iterator[str]:
    """Yield the lines of a file; raise ValueError for an endless line, as from a device."""
    while line := file.readline(LONGEST_LINE):
        if len(line) == LONGEST_LINE:
            raise ValueError(f"a line is longer than {LONGEST_LINE} characters")
        yield line


def _last_line(path: Path) -> str:
    with path.open("rb") as file:
        file.seek(0, os.SEEK_END)
        file.seek(max(0, file.tell() - 10_000))
        lines = file.read().decode(errors="replace").splitlines()
    return lines[-1] if lines else ""


# ---- the file beside


def beside(path: Path) -> Path:
    """Return the path of the file beside a .csv."""
    return path.with_name(f"{path.name}.toml")


def write_beside(result: Result, path: Path) -> None:
    """Write the file beside a .csv that is complete; OSError or ResultsError."""
    import tomli_w

    about = {"sha256": sha256(path), **content(result)}
    with written(beside(path)) as target:
        target.write_text(tomli_w.dumps(about), encoding="utf-8")


def _completed(result: Result, path: Path) -> Result:
    """Return the result of a .csv with the file beside it, unchanged if that file is missing or
    belongs to another table.
    """
    try:
        about = tomllib.loads(beside(path).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return result
    except (OSError, ValueError, RecursionError) as error:
        _log.warning("%s: cannot be read (%s)", beside(path).name, error)
        return result
    if about.get("sha256") != sha256(path):
        _log.warning(
            "%s: ignored, because it belongs to another version of %s", beside(path).name, path.name
        )
        return result
    return completed(result, about)
