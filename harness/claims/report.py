# SPDX-License-Identifier: BSD-2-Clause
"""What a paper claims, what a result shows, and the verdict as plain text, claim by claim.

The mission of a result lists the papers; which of them belongs to it is decided by the variables
that it holds. Below stands what the safety monitor of the run has found.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import NamedTuple

from harness.claims.case import listed, unlike
from harness.errors import ResultsError
from harness.mission import Claim, Judgement, Mission, Paper, RuleFinding
from harness.mission.library import missing, notes_of, of_result
from harness.results.requirements import findings
from harness.results.result import Result
from harness.results.verdict import OPEN, Judged, Kind, Verdict, missed
from harness.spelling import columns

WIDTH = 120
OTHER = "not the case of the paper"
CELL = "    {:12}"
"""Begin of a line about a claim: what it says."""
CELLS = len(CELL.format(""))


class Line(NamedTuple):
    """A line or a paragraph of a report, which begins below `start`; verdict: on the paper, if it
    is one.
    """

    text: str
    verdict: Verdict | None = None
    start: str = ""


def report(result: Result, width: int = WIDTH) -> tuple[str, bool]:
    """What was flown, notes, requirements and the claims behind a result; whether the run is
    complete and every claim could be judged.

    width: of the text. An honest "not reproduced" is no failure. Raises ResultsError if no paper
    belongs to a result without requirements.
    """
    text = "\n".join(line.text for line in lines(result, width))
    return text, result.complete and not missed(outcomes(result))


def lines(result: Result, width: int = WIDTH) -> Iterator[Line]:
    """The report line by line, no line wider than asked for."""
    for text, verdict, start in _paragraphs(result):
        wrapped = textwrap.wrap(
            text, width, initial_indent=start, subsequent_indent=" " * len(start)
        )
        yield from (Line(line, verdict) for line in wrapped or [""])


def _paragraphs(result: Result) -> Iterator[Line]:
    found, wanted = judged(result), findings(result)
    offered, known = of_result(result), result.provenance
    if not found and not wanted:
        raise ResultsError(_without_claims(result))
    flown = known.lines() if known else ["the file does not say"]
    yield from (Line(text, start="       " if k else "Flown: ") for k, text in enumerate(flown))
    if gone := missing(result):
        yield from (Line(""), Line(gone))
    for head, texts in (("Notes:", notes_of(result)), ("Requirements:", map(str, wanted))):
        if below := [Line(text, start="  ") for text in texts]:
            yield from (Line(""), Line(head), *below)
    for each in found:
        yield from _section(result, each)
    if not found and offered.claims:
        yield from (Line(""), Line(_without_claims(result)))
    if safe := safety(offered, result):
        yield from (Line(""), *map(Line, safe.splitlines()))


def _without_claims(result: Result) -> str:
    """That no paper belongs to a result, and why perhaps."""
    text = f"{result.system}: there are no claims of a paper about such a result"
    hint = " (the file does not hold the parameters by which some are known)"
    return text if result.parameters else text + hint


def outcomes(result: Result) -> list[Judged]:
    """All claims behind a result; "not reproduced" only where it is the case of the paper."""
    return [
        Judged(Kind.CLAIM, claim.name, found.verdict, f"{claim.name}: {_said(found)}")
        for each in judged(result)
        for claim, found in each.claims
        if not (each.deviations and found.verdict is Verdict.NOT_REPRODUCED)
    ]


def _said(found: Judgement) -> str:
    return f"{Kind.CLAIM.word(found.verdict)}; {found.figure}"


class PaperJudged(NamedTuple):
    """The claims of a paper with their judgements, and how the run differs from its cases."""

    paper: Paper
    claims: list[tuple[Claim, Judgement]]
    deviations: list[str]


def judged(result: Result) -> list[PaperJudged]:
    """All papers that a result belongs to."""
    return [
        PaperJudged(
            paper,
            [(claim, claim.evaluate(result)) for claim in paper.claims],
            unlike(paper, result),
        )
        for paper in of_result(result).claims
        if paper.belongs_to(result)
    ]


def _section(result: Result, paper: PaperJudged) -> Iterator[Line]:
    """The claims of a paper."""
    yield from (Line(""), Line(paper.paper.title), Line(""), Line(f"Run {result.summary}"))
    if paper.deviations:
        yield Line(f"Not the case of the paper: {listed(paper.deviations)}")
    for claim, judgement in paper.claims:
        yield from (Line(""), Line(f"{claim.text} [{claim.where}]"))
        yield from _judgement(claim, judgement, bool(paper.deviations))
    found = Kind.CLAIM.tally(judgement.verdict for _, judgement in paper.claims)
    parts = ", ".join(f"{count} {word}" for _, word, count in found)
    other = f"; {OTHER}" if paper.deviations else ""
    yield from (Line(""), Line(f"{len(paper.claims)} claims: {parts}{other}"))


def _judgement(claim: Claim, found: Judgement, other: bool) -> Iterator[Line]:
    """What became of a claim; of another case a verdict is none on the paper."""
    cells = {
        "our figure": found.figure,
        "reproduced": claim.criterion(claim.reproduced),
        "partly": claim.criterion(claim.partly),
    }
    yield from (Line(cell, start=CELL.format(name)) for name, cell in cells.items() if cell)
    mark = f", {OTHER}" if other and found.verdict not in OPEN else ""
    verdict = None if other else found.verdict
    yield Line(Kind.CLAIM.word(found.verdict) + mark, verdict, CELL.format("verdict"))


HEADING = "Safety: least margin of every rule in force, between samples too"


def rule_findings(mission: Mission, result: Result) -> list[RuleFinding]:
    """What the monitors of a run have found, rule by rule."""
    return [found for rules in mission.rules for found in rules(result)]


def safety(mission: Mission, result: Result) -> str:
    """One line per rule in force; "" if no monitor has watched the run, or no rule was in force."""
    rows = [
        (each.name, f"{each.margin:.4g} {each.unit}", each.state, each.limit)
        for each in rule_findings(mission, result)
    ]
    head = ("rule", "least margin", "verdict", "limit")
    return "\n".join([HEADING, "", *columns([head, *rows])]) if rows else ""
