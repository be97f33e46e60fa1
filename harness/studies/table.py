"""The table of a comparison: one line per run, one column per measure; for reading and as .csv."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from harness.output import written

Measures = Mapping[tuple[str, str], Mapping[str, float]]
"""Values by (name, unit) of a measure, then by the label of a run."""


def text(measures: Measures, labels: Sequence[str]) -> str:
    """The table for reading; measures that no run has are left out, single gaps are `-`."""
    shown = {
        key: column for key, column in measures.items() if any(map(math.isfinite, column.values()))
    }
    heading = [(*name.split(" ", 1), "")[:2] for name, _ in shown]
    rows = [["", *words] for words in zip(*heading, strict=True)]
    rows += [["", *(f"[{unit}]" for _, unit in shown)]]
    rows += [[label, *map(_rounded, values)] for label, values in _rows(shown, labels)]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(_line(row, widths) for row in rows)


def _rows(measures: Measures, labels: Sequence[str]) -> Iterator[tuple[str, list[float]]]:
    for label in labels:
        yield label, [column.get(label, math.nan) for column in measures.values()]


def _line(row: Sequence[str], widths: Sequence[int]) -> str:
    cells = [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
    return "  ".join([row[0].ljust(widths[0]), *cells]).rstrip()


def _rounded(value: float) -> str:
    """Four digits, but whole numbers and three decimals; very small numbers as a power of ten."""
    if not math.isfinite(value):
        return "-"
    if abs(value) >= 1:
        return f"{value:.0f}" if abs(value) >= 1000 else f"{value:.4g}"
    return f"{value:.1e}" if 0 < abs(value) < 5e-4 else f"{value:.3f}"


def write_csv(measures: Measures, labels: Sequence[str], path: Path) -> None:
    """All measures with all digits, one line per run; what does not exist is empty. ResultsError if
    the file cannot be written.
    """
    with written(path) as target, target.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["run", *(f"{name} [{unit}]" for name, unit in measures)])
        for label, values in _rows(measures, labels):
            writer.writerow([label, *("" if math.isnan(v) else repr(v) for v in values)])
