# SPDX-License-Identifier: BSD-2-Clause
"""What a paper claims, what a result shows, and the verdict: a table of plain text, 120 columns
wide at most.

Which paper belongs to a result is decided by the variables that the result holds, see
harness/claims. Below stands what the safety monitor of the run has found.
"""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import chain, repeat, zip_longest
from typing import NamedTuple

from harness.claims import PAPERS, Claim, Judgement, Paper, Verdict, safety
from harness.claims.case import listed
from harness.errors import ResultsError
from harness.results.requirements import Finding, findings
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


OTHER = "not the case of the paper"
FLOWN = "Flown: "


def report(result: Result) -> tuple[str, bool]:
    """What was flown, requirements, and the table of the claims behind a result; and whether the
    run is complete and every claim could be judged.

    An honest "not reproduced" is no failure. Raises ResultsError if no paper belongs to the result.
    """
    found, wanted = judged(result), findings(result)
    if not found and not wanted:
        hint = (
            ""
            if result.parameters
            else " (the file does not hold the parameters by which some are known)"
        )
        raise ResultsError(
            f"{result.system}: there are no claims of a paper about such a result{hint}"
        )
    sections = (_section(result, each) for each in found)
    parts = (_flown(result), _requirements(wanted), *sections, safety.section(result))
    text = "\n\n".join(filter(None, parts))
    verdicts = {judgement.verdict for each in found for _, judgement in each.claims}
    return text, result.complete and Verdict.NOT_JUDGED not in verdicts


def _requirements(wanted: Sequence[Finding]) -> str:
    """One paragraph, if there are any."""
    lines = [
        line
        for each in wanted
        for line in textwrap.wrap(str(each), WIDTH, initial_indent="  ", subsequent_indent="    ")
    ]
    return "\n".join(["Requirements:", *lines]) if lines else ""


class Judged(NamedTuple):
    """The claims of a paper with their judgements, and how the run differs from its cases."""

    paper: Paper
    claims: list[tuple[Claim, Judgement]]
    deviations: list[str]


def judged(result: Result) -> list[Judged]:
    """All papers that a result belongs to."""
    return [
        Judged(
            paper,
            [(claim, claim.evaluate(result)) for claim in paper.claims],
            paper.deviations(result),
        )
        for paper in PAPERS
        if paper.belongs_to(result)
    ]


def _flown(result: Result) -> str:
    """What was flown, at the head of everything."""
    known = result.provenance
    lines = ["the file does not say"] if known is None else known.lines()
    return "\n".join(
        textwrap.fill(line, WIDTH, initial_indent=start, subsequent_indent=" " * len(FLOWN))
        for start, line in zip(chain([FLOWN], repeat(" " * len(FLOWN))), lines, strict=False)
    )


def _section(result: Result, judged: Judged) -> str:
    head = [
        *textwrap.wrap(judged.paper.title, WIDTH),
        "",
        *_about(result),
        *_differences(judged),
        "",
    ]
    other = bool(judged.deviations)
    body = [
        line for claim, judgement in judged.claims for line in _row(_cells(claim, judgement, other))
    ]
    return "\n".join(
        [
            *head,
            *_heading(),
            *body,
            "",
            _summary([judgement for _, judgement in judged.claims], other),
        ]
    )


def _about(result: Result) -> list[str]:
    span = (
        f"{result.time[0]:g} to {result.time[-1]:g} s" if len(result.time) else "nothing recorded"
    )
    state = (
        "complete" if result.complete else f"incomplete: {result.message or 'the run ended early'}"
    )
    return textwrap.wrap(f"Run {result.system}: {span}, {len(result.time)} rows, {state}", WIDTH)


def _differences(judged: Judged) -> list[str]:
    if not judged.deviations:
        return []
    return textwrap.wrap(f"Not the case of the paper: {listed(judged.deviations)}", WIDTH)


def _heading() -> list[str]:
    return [
        *_row([title for title, _ in COLUMNS], end=False),
        GAP.join("-" * width for _, width in COLUMNS),
    ]


def _cells(claim: Claim, judgement: Judgement, other: bool) -> list[str]:
    bands = [claim.criterion(band) for band in (claim.reproduced, claim.partly)]
    return [f"{claim.text} [{claim.where}]", judgement.figure, *bands, _verdict(judgement, other)]


def _verdict(judgement: Judgement, other: bool) -> str:
    """Of another case a verdict is none on the paper."""
    mark = f", {OTHER}" if other and judgement.verdict is not Verdict.NOT_JUDGED else ""
    return judgement.verdict.value + mark


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


def _summary(judgements: Sequence[Judgement], other: bool) -> str:
    count = Counter(judgement.verdict for judgement in judgements)
    parts = [f"{count[verdict]} {verdict.value}" for verdict in Verdict if count[verdict]]
    return f"{len(judgements)} claims: {', '.join(parts)}{f'; {OTHER}' if other else ''}"
