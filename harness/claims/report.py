# SPDX-License-Identifier: BSD-2-Clause
"""What a paper claims, what a result shows, and the verdict: a table of plain text, 120 columns
wide at most.

Which paper belongs to a result is decided by the variables that the result holds, see
harness/claims.
"""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import zip_longest

from harness.claims import PAPERS, Claim, Judgement, Paper, Verdict
from harness.errors import ResultsError
from harness.results.result import Result

COLUMNS = (
    ("claim of the paper", 38),
    ("our figure", 38),
    ("reproduced", 11),
    ("partly", 11),
    ("verdict", 14),
)
GAP = "  "
WIDTH = sum(width for _, width in COLUMNS) + len(GAP) * (len(COLUMNS) - 1)


def report(result: Result) -> tuple[str, bool]:
    """Table of the claims behind a result, and whether the run is complete and every claim could be
    judged.

    An honest "not reproduced" is no failure. Raises ResultsError if no paper belongs to the result.
    """
    papers = [paper for paper in PAPERS if paper.belongs_to(result)]
    if not papers:
        hint = (
            ""
            if result.parameters
            else " (a .csv does not keep the parameters by which some are known: use .nc)"
        )
        raise ResultsError(
            f"{result.system}: there are no claims of a paper about such a result{hint}"
        )
    judged = [
        (paper, [(claim, claim.evaluate(result)) for claim in paper.claims]) for paper in papers
    ]
    text = "\n\n".join(_section(result, paper, table) for paper, table in judged)
    verdicts = {judgement.verdict for _, table in judged for _, judgement in table}
    return text, result.complete and Verdict.NOT_JUDGED not in verdicts


def _section(result: Result, paper: Paper, table: Sequence[tuple[Claim, Judgement]]) -> str:
    head = [
        *textwrap.wrap(paper.title, WIDTH),
        "",
        *_about(result),
        *_differences(result, paper),
        "",
    ]
    body = [line for claim, judgement in table for line in _row(_cells(claim, judgement))]
    return "\n".join(
        [*head, *_heading(), *body, "", _summary([judgement for _, judgement in table])]
    )


def _about(result: Result) -> list[str]:
    span = (
        f"{result.time[0]:g} to {result.time[-1]:g} s" if len(result.time) else "nothing recorded"
    )
    state = (
        "complete" if result.complete else f"incomplete: {result.message or 'the run ended early'}"
    )
    return textwrap.wrap(f"Run {result.system}: {span}, {len(result.time)} rows, {state}", WIDTH)


def _differences(result: Result, paper: Paper) -> list[str]:
    if not len(result.time):
        return []
    found = [text for condition in paper.conditions if (text := condition.difference(result))]
    return textwrap.wrap(f"Not the case of the paper: {'; '.join(found)}", WIDTH) if found else []


def _heading() -> list[str]:
    return [
        *_row([title for title, _ in COLUMNS], end=False),
        GAP.join("-" * width for _, width in COLUMNS),
    ]


def _cells(claim: Claim, judgement: Judgement) -> list[str]:
    bands = [claim.criterion(band) for band in (claim.reproduced, claim.partly)]
    return [f"{claim.text} [{claim.where}]", judgement.figure, *bands, judgement.verdict.value]


def _row(cells: Iterable[str], end: bool = True) -> list[str]:
    """Lines of one row of the table, wrapped within their columns; an empty line follows."""
    wrapped = [textwrap.wrap(cell, width) for cell, (_, width) in zip(cells, COLUMNS, strict=True)]
    lines = [
        GAP.join(
            part.ljust(width) for part, (_, width) in zip(parts, COLUMNS, strict=True)
        ).rstrip()
        for parts in zip_longest(*wrapped, fillvalue="")
    ]
    return [*lines, ""] if end else lines


def _summary(judgements: Sequence[Judgement]) -> str:
    count = Counter(judgement.verdict for judgement in judgements)
    parts = [f"{count[verdict]} {verdict.value}" for verdict in Verdict if count[verdict]]
    return f"{len(judgements)} claims: {', '.join(parts)}"
