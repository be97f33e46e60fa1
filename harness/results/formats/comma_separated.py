# SPDX-License-Identifier: BSD-2-Clause
"""A .csv: a bare table for whatever reads tables; units and parameters stand in NAME.csv.toml."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

import numpy as np

from harness.results import sidecar
from harness.results.result import Result

INCOMPLETE = "# incomplete: "
"""Begin of the last line of a run that ended early; its reason follows."""

LONGEST_LINE = 64 * 1024**2
"""Characters."""


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
    """A name in the header; csv.writer leaves a carriage return, which ends a line, without
    quotes.
    """
    marks = any(mark in name for mark in ',"\r\n') or name != name.strip() or not name
    return '"{}"'.format(name.replace('"', '""')) if marks else name


def _lines(file: TextIO) -> Iterator[str]:
    """Lines of a file; ValueError if one does not end, as those of a device."""
    while line := file.readline(LONGEST_LINE):
        if len(line) == LONGEST_LINE:
            raise ValueError(f"a line is longer than {LONGEST_LINE} characters")
        yield line


def read(path: Path) -> Result:
    """Read the table and what is beside it; ValueError if it is none."""
    with path.open(encoding="utf-8", newline="") as file:
        names = next(csv.reader(_lines(file)), [])
        if not names or names[0] != "time":
            raise ValueError("it does not begin with a column named time")
        table = np.loadtxt(file, delimiter=",", ndmin=2)
    reason = _last_line(path).partition(INCOMPLETE)
    if table.shape[1] != len(names):
        raise ValueError(f"{len(names)} names for {table.shape[1]} columns")
    units = ("",) * (len(names) - 1)
    result = Result(
        path.stem,
        table[:, 0],
        tuple(names[1:]),
        units,
        table[:, 1:],
        (),
        not reason[1],
        reason[2].strip(),
    )
    return sidecar.completed(result, path)


def _last_line(path: Path) -> str:
    with path.open("rb") as file:
        file.seek(0, os.SEEK_END)
        file.seek(max(0, file.tell() - 10_000))
        lines = file.read().decode(errors="replace").splitlines()
    return lines[-1] if lines else ""
