# SPDX-License-Identifier: BSD-2-Clause
"""The table of a comparison: one line per run, one column per measure; for reading and as .csv."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from harness.errors import ResultsError
from harness.files.output import written
from harness.spelling import one_line

Measures = Mapping[tuple[str, str], Mapping[str, float]]
"""Values by (name, unit) of a measure, then by the label of a run."""


def text(measures: Measures, labels: Sequence[str]) -> str:
    """The table for reading; measures that no run has are left out, single gaps are `-`."""
    shown = {
        key: column for key, column in measures.items() if any(map(math.isfinite, column.values()))
    }
    columns = [
        [*(*one_line(name).split(" ", 1), "")[:2], f"[{one_line(unit)}]", *_numbers(column, labels)]
        for (name, unit), column in shown.items()
    ]
    rows = list(zip(["", "", "", *map(one_line, labels)], *columns, strict=True))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return "\n".join(_line(row, widths) for row in rows)


def _line(row: Sequence[str], widths: Sequence[int]) -> str:
    cells = [cell.rjust(width) for cell, width in zip(row[1:], widths[1:], strict=True)]
    return "  ".join([row[0].ljust(widths[0]), *cells]).rstrip()


def _numbers(column: Mapping[str, float], labels: Sequence[str]) -> list[str]:
    """A column with the same decimals everywhere: four digits of its largest value, or powers of
    ten where the smallest would vanish.
    """
    values = [column.get(label, math.nan) for label in labels]
    sizes = [abs(v) for v in values if math.isfinite(v) and v]
    decimals = max(0, 3 - math.floor(math.log10(max(sizes, default=1.0))))
    small = bool(sizes) and min(sizes) < 0.5 * 10.0 ** -min(decimals, 4)
    form = "z.2e" if small else f"z.{min(decimals, 4)}f"  # z: no zero has a sign
    return [format(v, form) if math.isfinite(v) else "-" for v in values]


def _rows(measures: Measures, labels: Sequence[str]) -> Iterator[tuple[str, list[float]]]:
    for label in labels:
        yield label, [column.get(label, math.nan) for column in measures.values()]


def read_csv(path: Path) -> tuple[dict[str, dict[str, float]], list[str]]:
    """Columns of a table of write_csv() by their heading `name [unit]`, then by the label of the
    run, and the labels; ResultsError if it cannot be read.
    """
    try:
        with path.open(encoding="utf-8", newline="") as file:
            (_, *heads), *rows = csv.reader(file)
        labels = [label for label, *_ in rows]
        cells = [[float(cell or "nan") for cell in row] for _, *row in rows]
        columns = zip(*cells, strict=True) if cells else ([] for _ in heads)
        found = zip(heads, columns, strict=True)
        return {head: dict(zip(labels, c, strict=True)) for head, c in found}, labels
    except (OSError, ValueError) as error:
        raise ResultsError(f"{path}: cannot be read ({error})") from error


def write_csv(measures: Measures, labels: Sequence[str], path: Path) -> None:
    """All measures with all digits, one line per run; what does not exist is empty. ResultsError if
    the file cannot be written.
    """
    with written(path) as target, target.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["run", *(one_line(f"{name} [{unit}]") for name, unit in measures)])
        for label, values in _rows(measures, labels):
            writer.writerow([one_line(label), *("" if math.isnan(v) else repr(v) for v in values)])
