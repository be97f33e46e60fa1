# SPDX-License-Identifier: BSD-2-Clause
"""Compare the CSV file of any tool with the expected trace of a reference system. Needs the
standard library and numpy.

    python compare.py traces/sync_approach.csv rows.csv

The first column of both files is the time [s]. The names of other columns may have any separators
and a prefix: `servicer.mass`, `servicer::mass` and `model.root.servicer.mass` name the same
variable. Where a tool writes several rows for an instant, the last one counts. Only instants of the
trace that the CSV file also has are compared; the last one must be among them. tolerances.csv
beside the trace has a tolerance with its reason per variable. Exit status: 0 all variables agree at
these instants, 1 a variable differs or is missing, or the file lacks the last instant of the trace,
2 a file cannot be used.
"""

from __future__ import annotations

import csv
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np

Table = tuple[Any, dict[str, Any]]
"""Pair: times (rows,) [s], and values (rows,) by name of the column."""


def read(path: Path) -> Table:
    """Return times and columns of a CSV file; of several rows for one instant, the last remains."""
    with path.open(encoding="utf-8-sig", newline="") as file:
        head, *rows = (row for row in csv.reader(file, skipinitialspace=True) if row)
    values = np.array([[float(x) for x in row] for row in rows if not row[0].startswith("#")])
    time = values[:, 0]
    last = np.append(np.diff(time) > 0, True)
    return time[last], {name: values[last, k] for k, name in enumerate(head) if k}


def plain(name: str) -> str:
    """Return a name with a dot for each separator: every run of characters other than letters,
    digits, `_`, `,`, `[` and `]`.
    """
    return re.sub(r"[^\w\[\],]+", ".", name.strip()).strip(".")


def column_of(name: str, columns: dict[str, Any]) -> str | None:
    """Return the name of the column for a variable: `name`, or `name` after a prefix; if several
    columns match, the one with the shortest name; None if no column matches.
    """
    found = [c for c in columns if plain(c) == name or plain(c).endswith(f".{name}")]
    return min(found, key=len) if found else None


def verdicts(expected: Path, given: Path) -> dict[str, str]:
    """Return for every variable of the trace "" if it agrees, otherwise what is wrong, and under
    "time" what is wrong if the file lacks the last instant. Raise ValueError if the files have no
    instant in common, or if tolerances.csv lacks a variable.
    """
    times, trace = read(expected)
    instants, columns = read(given)
    near = np.searchsorted(instants, times - 1e-9 * np.maximum(1, np.abs(times)))
    near = np.minimum(near, len(instants) - 1)
    both = np.abs(instants[near] - times) <= 1e-9 * np.maximum(1, np.abs(times))
    if not both.any():
        raise ValueError(f"{given}: has no instant in common with {expected}")
    with expected.with_name("tolerances.csv").open(encoding="utf-8", newline="") as file:
        limits = {
            row["variable"]: float(row["tolerance"])
            for row in csv.DictReader(file)
            if row["trace"] == expected.stem
        }
    if unlimited := sorted(set(trace) - set(limits)):
        raise ValueError(f"tolerances.csv: has no row for {expected.stem}, {unlimited[0]}")
    end, found = times[both][-1], {}
    if end < times[-1]:
        found["time"] = f"compared up to t = {end:g} s, the trace ends at {times[-1]:g} s"
    for name, values in trace.items():
        theirs = column_of(name, columns)
        if theirs is None:
            found[name] = "is missing"
            continue
        differences = np.abs(columns[theirs][near] - values)[both]
        worst = int(np.argmax(differences))
        within = bool((differences <= limits[name]).all())  # False if a difference is NaN
        at = times[both][worst]
        found[name] = "" if within else (
            f"differs by {differences[worst]:.3g} at t = {at:g} s, tolerance {limits[name]:.3g}"
        )  # fmt: skip
    return found


def main(arguments: list[str]) -> int:
    """Print each variable that differs or is missing, and a summary; return the exit status.

    arguments: path of the expected trace, path of the CSV file to compare.
    """
    if len(arguments) != 2:
        print(__doc__)
        return 2
    try:
        found = verdicts(*map(Path, arguments))
    except (OSError, ValueError, IndexError, KeyError) as error:
        print(error, file=sys.stderr)
        return 2
    wrong = {name: text for name, text in found.items() if text}
    for name, text in wrong.items():
        print(f"{name} {text}")
    print(f"{len(found) - len(wrong)} of {len(found)} variables agree")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
