# SPDX-License-Identifier: BSD-2-Clause
"""Printing of the report of a run, with coloured verdicts on a terminal (unless NO_COLOR is set),
and the exit status that follows from requirements, safety rules and claims.
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
from harness.results.verdict import Outcome, Verdict, missed
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
    """Print the report of a result, as wide as the terminal."""
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
    """Raise RequirementError with a line for every requirement, safety rule or claim that makes the
    exit status 1.

    results: results by label of the run; required: requirements that must be met (--require);
    strict: all requirements must be met and all safety rules must hold; claims: claims of papers
    must be exercised and must not have the verdict "not judged"; with `strict` they must also be
    reproduced, at least partly.
    """
    lines = [
        f"{label}: {line}" if label else line
        for label, result in results.items()
        for line in missed(_outcomes(result, claims), required, strict)
    ]
    if lines:
        raise RequirementError("\n".join(map(printable, lines)))


def _outcomes(result: Result, claims: bool) -> Iterator[Outcome]:
    yield from (found.outcome for found in findings(result))
    yield from (found.outcome for found in rule_findings(of_result(result), result))
    if claims:
        yield from outcomes(result)
