# SPDX-License-Identifier: BSD-2-Clause
"""The report of `harness report` on standard output: as wide as a terminal is, verdicts in
colour there (not if NO_COLOR is set). What decides on the exit status.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Collection, Iterator, Mapping

import typer

from harness.claims.report import CELLS, WIDTH, outcomes, rule_findings
from harness.claims.report import lines as report_lines
from harness.errors import RequirementError
from harness.mission.library import of_result
from harness.results.requirements import findings
from harness.results.result import Result
from harness.results.verdict import Judged, Verdict, missed
from harness.spelling import printable

NARROWEST = 40
COLOURS = {
    Verdict.MET: "green",
    Verdict.PARTLY: "yellow",
    Verdict.NOT_MET: "red",
    Verdict.NOT_EXERCISED: "blue",
    Verdict.NOT_JUDGED: "magenta",
}


def show(result: Result) -> None:
    """Print the report."""
    from rich.console import Console
    from rich.text import Text

    console = Console(file=sys.stdout, highlight=False, soft_wrap=True)
    known = console.is_terminal or "COLUMNS" in os.environ
    found = report_lines(result, max(console.width, NARROWEST) if known else WIDTH)
    if not console.is_terminal:
        typer.echo("\n".join(printable(line.text) for line in found))
        return
    for line in found:
        text = Text(printable(line.text))
        if line.verdict:
            text.stylize(COLOURS[line.verdict], CELLS)
        console.print(text)


def insist(
    results: Mapping[str, Result],
    required: Collection[str] = (),
    strict: bool = False,
    claims: bool = False,
) -> None:
    """RequirementError with a line for all that gives the exit status 1, see missed(); results: by
    the label of the run; claims: those of papers too.
    """
    lines = [
        f"{label}: {line}" if label else line
        for label, result in results.items()
        for line in missed(_judged(result, claims), required, strict)
    ]
    if lines:
        raise RequirementError("\n".join(map(printable, lines)))


def _judged(result: Result, claims: bool) -> Iterator[Judged]:
    yield from (found.judged for found in findings(result))
    yield from (found.judged for found in rule_findings(of_result(result), result))
    if claims:
        yield from outcomes(result)
