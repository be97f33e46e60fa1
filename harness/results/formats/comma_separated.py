# SPDX-License-Identifier: BSD-2-Clause
"""Comma-separated format: a plain .csv table for any reader of tables, and beside it NAME.csv.toml
with units, descriptions, parameters and provenance.

The .csv contains numbers and names only, so that a spreadsheet or pandas reads it without settings.
NAME.csv.toml contains the hash of its .csv and is ignored if the .csv has another hash.
"""

from __future__ import annotations

import csv
import logging
import os
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from harness.files.checksums import sha256
from harness.files.output import written
from harness.results import provenance
from harness.results.result import Result

INCOMPLETE = "# incomplete: "
"""Beginning of the last line in the file of a run that ended early; the reason follows on this
line.
"""
LONGEST_LINE = 64 * 1024**2
"""A line of the header with this number of characters or more is rejected."""

_log = logging.getLogger("harness")


def write(result: Result, path: Path) -> None:
    """Write the table, every number with all its digits. If the run ended early, add a last line
    that states the reason.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        file.write(",".join(map(_quoted, ("time", *result.columns))) + "\n")
        table = np.column_stack((result.time, result.values))
        for row in table:  # repr: the shortest text that is read as the same number
            file.write(",".join(map(repr, row.tolist())) + "\n")
        if not result.complete:
            file.write(f"{INCOMPLETE}{' '.join(result.message.split())}\n")


def _quoted(name: str) -> str:
    """Return a name for the header, in quotes if necessary. csv.writer writes a carriage return
    without quotes, which a reader takes as the end of the line.
    """
    needed = any(character in name for character in ',"\r\n') or name != name.strip() or not name
    return '"{}"'.format(name.replace('"', '""')) if needed else name


def read(path: Path) -> Result:
    """Read a .csv and the NAME.csv.toml beside it; raise ValueError if the .csv is not a table."""
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
    """Yield the lines of a file; raise ValueError for a line longer than LONGEST_LINE, as when
    reading a device without line breaks.
    """
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


# ---- NAME.csv.toml


def beside(path: Path) -> Path:
    """Return the path of the NAME.csv.toml beside a NAME.csv."""
    return path.with_name(f"{path.name}.toml")


def write_beside(result: Result, path: Path) -> None:
    """Write the NAME.csv.toml of a .csv that is already written; raise OSError or ResultsError."""
    import tomli_w

    about = {"sha256": sha256(path), **_content(result)}
    with written(beside(path)) as target:
        target.write_text(tomli_w.dumps(about), encoding="utf-8")


def _completed(result: Result, path: Path) -> Result:
    """Return the result of a .csv completed by its NAME.csv.toml, unchanged if that file is
    missing, unreadable or of another table.
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
    return _with(result, about)


def _content(result: Result) -> dict[str, Any]:
    """Return everything in a result except the values of its table, for TOML."""
    about: dict[str, Any] = {
        "system": result.system,
        "complete": result.complete,
        "message": result.message,
    }
    if result.provenance is not None:
        about["provenance"] = provenance.table(result.provenance)
    if (fixed := result.parameters) is not None:
        values = dict(zip(fixed.columns, fixed.values[0].tolist(), strict=True))
        about["parameters"] = {"values": values, **_texts(fixed)}
    return {**about, "columns": _texts(result)}


def _texts(result: Result) -> dict[str, Any]:
    """Return units, descriptions and modes, each by column, without empty texts."""
    given = {"units": result.units, "descriptions": result.descriptions, "modes": result.modes}
    return {
        kind: {name: text for name, text in zip(result.columns, texts, strict=False) if text}
        for kind, texts in given.items()
    }


def _with(result: Result, about: Mapping[str, Any]) -> Result:
    """Return `result`, which has only columns and values, completed by the texts, parameters and
    provenance in `about`, a table that _content() made; raise ValueError if the table is invalid.
    """
    origin, parameters = _table(about, "provenance"), _table(about, "parameters")
    return replace(
        _named(result, _table(about, "columns")),
        system=about.get("system", result.system),
        parameters=_parameters(result, parameters) if parameters else None,
        provenance=provenance.from_table(origin) if origin else None,
    )


def _table(about: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Return the table with this name inside a table, {} if it is missing; raise ValueError if the
    entry is not a table.
    """
    if not isinstance(found := about.get(name, {}), dict):
        raise ValueError(f"{name}: expected a TOML table, got {found!r:.40}")
    return found


def _named(result: Result, texts: Mapping[str, Any]) -> Result:
    found: dict[str, Any] = {
        kind: tuple(_table(texts, kind).get(name, "") for name in result.columns)
        for kind in ("units", "descriptions", "modes")
    }
    return replace(result, **found)


def _parameters(result: Result, table: Mapping[str, Any]) -> Result:
    given = _table(table, "values")
    for name, value in given.items():
        if not isinstance(value, int | float):
            raise ValueError(f"parameter {name}: expected a number, got {value!r:.40}")
    values = np.array([list(given.values())], dtype=np.float64)
    return _named(Result(result.system, result.time[:1], tuple(given), (), values), table)
