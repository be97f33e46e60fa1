# SPDX-License-Identifier: BSD-2-Clause
"""Run FMUs on all flight processors and write their costs into a page; rows of the page for other
FMUs remain. The exit status is 1 if the bits of a run differ from the same run on this machine.

python .ci/processor_figures.py docs/processor_figures.md FMU...   # make processors
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from harness.remote.firmware import PROCESSORS
from harness.studies.processor import HEAD, Row, compute_costs

TOP = Path(__file__).with_suffix(".md")
"""File with the text above the table."""


def markdown(rows: Iterable[Row], page: str = "") -> str:
    """Return the page with a line per row. Of the earlier text `page`, the lines for other FMUs or
    processors remain.
    """
    lines = [line.strip("| ").split(" | ") for line in page.splitlines() if line[:2] == "| "]
    known = {(cells[0], cells[1]): cells for cells in lines if cells[1] in PROCESSORS}
    known |= {(row.fmu, row.processor): [*row.cells()] for row in rows}
    named = list(PROCESSORS)
    order = sorted(known, key=lambda key: (key[0], named.index(key[1])))
    body = [HEAD, ("---",) * len(HEAD), *(known[key] for key in order)]
    top = TOP.read_text(encoding="utf-8")
    return top + "".join(f"| {' | '.join(cells)} |\n" for cells in body)


def main(page: Path, fmus: Sequence[str]) -> int:
    """Write the page and return the exit status."""
    rows = compute_costs(
        fmus, list(PROCESSORS), notify=lambda row: print(row.fmu, "on", row.processor, flush=True)
    )
    earlier = page.read_text(encoding="utf-8") if page.exists() else ""
    page.write_text(markdown(rows, earlier), encoding="utf-8")
    return int(any(row.difference for row in rows))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2:]))
