# SPDX-License-Identifier: BSD-2-Clause
"""The report of `harness report` on standard output: as wide as a terminal is, verdicts in
colour there (not if NO_COLOR is set).
"""

from __future__ import annotations

import os
import sys

import typer

from harness.claims.report import WIDTH, lines
from harness.results.result import Result
from harness.spelling import printable

NARROWEST = 40
COLOURS = {"good": "green", "fair": "yellow", "bad": "red", "none": "magenta"}


def show(result: Result) -> bool:
    """Print the report; returns whether the run is complete and every claim could be judged."""
    from rich.console import Console
    from rich.text import Text

    console = Console(file=sys.stdout, highlight=False, soft_wrap=True)
    known = console.is_terminal or "COLUMNS" in os.environ
    found, passed = lines(result, max(console.width, NARROWEST) if known else WIDTH)
    if not console.is_terminal:
        typer.echo("\n".join(printable(line.text) for line in found))
        return passed
    for line in found:
        text = Text(printable(line.text))
        if line.verdict:
            text.stylize(COLOURS[line.verdict.kind], line.begin)
        console.print(text)
    return passed
