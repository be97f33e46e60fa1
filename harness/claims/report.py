# SPDX-License-Identifier: BSD-2-Clause
"""Report of a result as plain text: its requirements; for every claim of a paper the text of the
claim, the value in the result and the verdict; then the findings of safety monitor and filter.

The mission of a result lists the papers. The variables and parameters of the result determine which
of these papers have claims that apply to the result.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from typing import NamedTuple

from harness.claims.case import listed, unlike
from harness.errors import ResultsError
from harness.mission import Claim, Judgement, Mission, Paper, RuleFinding
from harness.mission.fields import several
from harness.mission.library import missing, notes_of, of_result
from harness.results.requirements import findings
from harness.results.result import Result
from harness.results.verdict import OPEN, Kind, Outcome, Verdict
from harness.spelling import columns

WIDTH = 120
OTHER = "not the case of the paper"
CELL = "    {:12}"
"""Format of the name at the beginning of a line about a claim: "our value", "reproduced", "partly",
"verdict".
"""
CELLS = len(CELL.format(""))


class Line(NamedTuple):
    """Line or paragraph of a report.

    verdict: verdict that the line states, which determines its colour, or None; start: text in
    front of the first line. Further lines of a paragraph are indented by the width of `start`.
    """

    text: str
    verdict: Verdict | None = None
    start: str = ""


def lines(result: Result, width: int = WIDTH) -> Iterator[Line]:
    """Yield the report, each line at most `width` characters wide: settings of the run, notes,
    requirements, claims, safety rules. Raises ResultsError if the result has no requirements and
    no claims of a paper apply to it.
    """
    for text, verdict, start in _paragraphs(result):
        wrapped = textwrap.wrap(
            text, width, initial_indent=start, subsequent_indent=" " * len(start)
        )
        yield from (Line(line, verdict) for line in wrapped or [""])


def _paragraphs(result: Result) -> Iterator[Line]:
    found, wanted = judgements(result), findings(result)
    offered, known = of_result(result), result.provenance
    if not found and not wanted:
        raise ResultsError(_without_claims(result))
    settings = known.lines() if known else ["the file does not state the settings"]
    yield from (Line(text, start="     " if k else "Run: ") for k, text in enumerate(settings))
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
    """Return a text which states that no claims of a paper apply to a result, and gives a possible
    reason if the result lacks the parameters of the run.
    """
    text = f"{result.system}: no claims of a paper apply to this result"
    hint = " (the file lacks the parameters by which some papers are recognised)"
    return text if result.parameters else text + hint


def outcomes(result: Result) -> list[Outcome]:
    """Return the outcomes of all claims that apply to a result. Claims with the verdict "not
    reproduced" are left out if the result deviates from the cases of the paper, because such a run
    does not contradict the paper.
    """
    return [
        Outcome(Kind.CLAIM, claim.name, found.verdict, f"{claim.name}: {_outcome(found)}")
        for each in judgements(result)
        for claim, found in each.claims
        if not (each.deviations and found.verdict is Verdict.NOT_REPRODUCED)
    ]


def _outcome(found: Judgement) -> str:
    return f"{Kind.CLAIM.word(found.verdict)}; {found.value}"


class PaperJudgements(NamedTuple):
    """Paper with its claims, each with its judgement (measured value and verdict), and the
    deviations of the run from the cases of the paper.
    """

    paper: Paper
    claims: list[tuple[Claim, Judgement]]
    deviations: list[str]


def judgements(result: Result) -> list[PaperJudgements]:
    """Return each paper whose claims apply to a result, with the verdicts on these claims."""
    return [
        PaperJudgements(
            paper,
            [(claim, claim.evaluate(result)) for claim in paper.claims],
            unlike(paper, result),
        )
        for paper in of_result(result).claims
        if paper.belongs_to(result)
    ]


def _section(result: Result, paper: PaperJudgements) -> Iterator[Line]:
    """Yield the lines about a paper: title, deviations of the run, claims, number of claims per
    verdict.
    """
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
    """Yield the lines with value, criteria and verdict of a claim.

    other: whether the run differs from all cases of the paper. Then the verdict has no colour, and
    a note states the difference unless the claim has no verdict.
    """
    cells = {
        "our value": found.value,
        "reproduced": claim.criterion(claim.reproduced),
        "partly": claim.criterion(claim.partly),
    }
    yield from (Line(cell, start=CELL.format(name)) for name, cell in cells.items() if cell)
    mark = f", {OTHER}" if other and found.verdict not in OPEN else ""
    verdict = None if other else found.verdict
    yield Line(Kind.CLAIM.word(found.verdict) + mark, verdict, CELL.format("verdict"))


HEADING = "Safety: smallest margin of every rule in force"


def rule_findings(mission: Mission, result: Result) -> list[RuleFinding]:
    """Return the findings on the rules of safety monitor and filter that were in force in a run."""
    return [found for rules in mission.rules for found in several(RuleFinding, rules, result)]


def safety(mission: Mission, result: Result) -> str:
    """Return a table with one line per safety rule in force during the run; "" if no rule was in
    force, for example because the system has neither safety monitor nor filter.
    """
    rows = [
        (each.name, f"{each.margin:.4g} {each.unit}", each.state, each.limit)
        for each in rule_findings(mission, result)
    ]
    head = ("rule", "smallest margin", "verdict", "limit")
    return "\n".join([HEADING, "", *columns([head, *rows])]) if rows else ""
