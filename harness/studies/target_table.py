# SPDX-License-Identifier: BSD-2-Clause
"""The table of what FMUs take of flight processors: for reading, and as a page."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from harness.files.output import written
from harness.master.links import Cost
from harness.remote.firmware import Sizes
from harness.remote.targets import TARGETS


class Row(NamedTuple):
    """One FMU on one processor.

    place: system.component that it flew as; period: of its steps [s]; clock: of the processor
    [Hz]; rows: that were compared; until: end of the flight [s] (None: of the default run);
    difference: where the bits first differ from those of this machine ("": nowhere).
    """

    fmu: str
    target: str
    place: str
    sizes: Sizes
    cost: Cost
    period: float
    clock: float
    rows: int
    until: float | None
    difference: str

    @property
    def share(self) -> float:
        """Part of a period that the dearest step takes, at one instruction per cycle."""
        return self.cost.largest / self.clock / self.period

    def cells(self) -> Iterator[str]:
        """What the table says of it."""
        s, c = self.sizes, self.cost
        yield from (self.fmu, self.target, self.place)
        yield from map(_grouped, (s.code, s.constants, s.data + c.memory, c.stack))
        yield from map(_grouped, (round(c.mean), c.largest))
        yield f"{c.when:g}"
        yield f"{self.clock / 1e6:g}"
        yield f"{float(f'{100 * self.share:.2g}'):g}"
        yield self.verdict()

    def verdict(self) -> str:
        """Whether the bits are equal, and of how much of the run that is said."""
        if self.difference:
            return f"no: {self.difference}"
        span = "" if self.until is None else f" (to {self.until:g} s)"
        return f"yes, {_grouped(self.rows)} rows{span}"


HEAD = (
    *("FMU", "processor", "runs as", "code", "constants", "data", "stack"),
    *("instructions", "at most", "at t [s]", "clock [MHz]", "share [%]", "equal bits"),
)

PAGE = """# Flight software on flight processors

`harness target` writes this page from its runs (`make targets`: all processors). Each FMU executes
the default run of the system named, on the emulated processor and in the simulation on this
machine, up to the end unless the row names a time. FMUs of one system run together, each on its own
processor.

* Code and constants [bytes]: with the FMI adapter, without the C library.
* Data [bytes]: variables and the instance. Stack [bytes]: of the steps.
* Instructions of a step: on average, at most, and at what time.
* Share: part of the sample period, at one instruction per cycle of the clock.
* Equal bits: every value of every row of the whole system.

How to repeat it: [processors.md](processors.md).

"""


def _grouped(number: int) -> str:
    return f"{number:,}".replace(",", " ")


def table(rows: Sequence[Row]) -> str:
    """The rows for reading."""
    lines = [HEAD, *(tuple(row.cells()) for row in rows)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip()
        for line in lines
    )


def markdown(rows: Iterable[Row], earlier: str = "") -> str:
    """The page of the rows, and of those of an earlier page that were not flown anew."""
    lines = {tuple(cells[:2]): cells for cells in _cells(earlier)}
    lines |= {(row.fmu, row.target): list(row.cells()) for row in rows}
    named = list(TARGETS)
    order = sorted(lines, key=lambda key: (key[0], named.index(key[1])))
    body = [HEAD, ("---",) * len(HEAD), *(lines[key] for key in order)]
    return PAGE + "".join(f"| {' | '.join(cells)} |\n" for cells in body)


def _cells(page: str) -> Iterator[list[str]]:
    """Of the rows of a page, if its columns are those of now."""
    table = [line.strip("| \n").split(" | ") for line in page.splitlines() if line[:1] == "|"]
    if table and tuple(table[0]) == HEAD:
        yield from table[2:]


def write(path: Path, rows: Iterable[Row]) -> None:
    """Write the page; what stands in it of other FMUs and processors stays. ResultsError."""
    earlier = path.read_text(encoding="utf-8") if path.is_file() else ""
    with written(path) as page:
        page.write_text(markdown(rows, earlier), encoding="utf-8")
