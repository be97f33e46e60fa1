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

WIDTH = 120
Measures = Mapping[tuple[str, str], Mapping[str, float]]
"""Values by (name, unit) of a measure, then by the label of a run."""


def text(
    measures: Measures,
    labels: Sequence[str],
    about: Mapping[tuple[str, str], str] = {},
    words: Mapping[tuple[str, str], Sequence[str]] = {},
) -> str:
    """The table for reading, in blocks of at most WIDTH columns; measures that no run has are left
    out, single gaps are `-`; about: last line of a heading, words: what values 0, 1, .. stand for.
    """
    shown = {
        key: column for key, column in measures.items() if any(map(math.isfinite, column.values()))
    }
    columns = []
    for key, column in shown.items():
        cells = _words(column, labels, words[key]) if words.get(key) else _numbers(column, labels)
        name, unit = (one_line(part) for part in key)
        bracket = "" if words.get(key) else f"[{unit}]"
        columns.append([*(*name.split(" ", 1), "")[:2], bracket, about.get(key, ""), *cells])
    heads = 4 if any(about.get(key) for key in shown) else 3
    columns = [[*column[:heads], *column[4:]] for column in columns]
    first = ["" for _ in range(heads)] + list(map(one_line, labels))
    return "\n\n".join(_block([first, *block]) for block in _blocks(first, columns))


def _blocks(
    first: Sequence[str], columns: Sequence[Sequence[str]]
) -> Iterator[list[Sequence[str]]]:
    """Columns that fit beside the labels."""
    block: list[Sequence[str]] = []
    width = begin = max(map(len, first))
    for column in columns:
        size = 2 + max(map(len, column))
        if block and width + size > WIDTH:
            yield block
            block, width = [], begin
        block.append(column)
        width += size
    yield block


def _block(columns: Sequence[Sequence[str]]) -> str:
    widths = [max(map(len, column)) for column in columns]
    return "\n".join(_line(row, widths) for row in zip(*columns, strict=True))


def _words(column: Mapping[str, float], labels: Sequence[str], words: Sequence[str]) -> list[str]:
    values = [column.get(label, math.nan) for label in labels]
    return [words[int(v)] if 0 <= v < len(words) else "-" for v in values]


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
