# SPDX-License-Identifier: BSD-2-Clause
"""What a paper claims, what a result shows, and the verdict as plain text: a table of 120 columns,
or claim by claim where there is less room.

The mission of a result lists the papers; which of them belongs to it is decided by the variables
that it holds. Below stands what the safety monitor of the run has found.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Iterator
from itertools import zip_longest
from typing import NamedTuple

from harness.claims.case import listed, unlike
from harness.errors import ResultsError
from harness.mission import Claim, Judgement, Mission, Paper, RuleFinding
from harness.mission.library import missing, notes_of, of_result
from harness.results.requirements import findings
from harness.results.result import Result
from harness.results.verdict import OPEN, Judged, Kind, Verdict, missed

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


INDENT = "    "
NAMED = 12
"""Width of the names before the cells of a claim, where it has lines of its own."""


class Line(NamedTuple):
    """A line of a report; from column `begin` on it says this verdict on the paper, if any."""

    text: str
    verdict: Verdict | None = None
    begin: int = 0


def report(result: Result, width: int = WIDTH) -> tuple[str, bool]:
    """What was flown, notes, requirements and the table of the claims behind a result; whether the
    run is complete and every claim could be judged.

    width: of the text. An honest "not reproduced" is no failure. Raises ResultsError if no paper
    belongs to a result without requirements.
    """
    text = "\n".join(line.text for line in lines(result, width))
    return text, result.complete and not missed(outcomes(result))


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


def lines(result: Result, width: int = WIDTH) -> list[Line]:
    """The report line by line."""
    text = _flown(result, width)
    for part in filter(None, _parts(result, width)):
        text += [Line(""), *part]
    return text


def _parts(result: Result, width: int) -> Iterator[list[Line]]:
    """Paragraphs below what was flown, some of them empty."""
    found, wanted = judged(result), findings(result)
    if not found and not wanted:
        raise ResultsError(_without_claims(result))
    yield _wrapped(missing(result), width)
    yield _paragraph("Notes:", notes_of(result), width)
    yield _paragraph("Requirements:", map(str, wanted), width)
    for each in found:
        yield _section(result, each, width)
    if not found and of_result(result).claims:
        yield _wrapped(_without_claims(result), width)
    safe = safety(of_result(result), result).splitlines()
    yield [line for text in safe for line in (_wrapped(text, width) or [Line("")])]


def _without_claims(result: Result) -> str:
    """That no paper belongs to a result, and why perhaps."""
    text = f"{result.system}: there are no claims of a paper about such a result"
    hint = " (the file does not hold the parameters by which some are known)"
    return text if result.parameters else text + hint


def _paragraph(head: str, texts: Iterable[str], width: int) -> list[Line]:
    """Texts below a heading, if there are any."""
    each = [line for text in texts for line in _wrapped(text, width, "  ")]
    return [Line(head), *each] if each else []


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


def _flown(result: Result, width: int) -> list[Line]:
    """What was flown, at the head of everything."""
    known = result.provenance
    first, *further = ["the file does not say"] if known is None else known.lines()
    below = [line for text in further for line in _wrapped(text, width, " " * len(FLOWN))]
    return [*_wrapped(first, width, FLOWN), *below]


def _section(result: Result, paper: PaperJudged, width: int) -> list[Line]:
    differences = f"Not the case of the paper: {listed(paper.deviations)}"
    return [
        *_wrapped(paper.paper.title, width),
        Line(""),
        *_wrapped(_about(result), width),
        *(_wrapped(differences, width) if paper.deviations else ()),
        Line(""),
        *(_table(paper) if width >= WIDTH else _blocks(paper, width)),
        Line(""),
        *_wrapped(_summary(paper), width),
    ]


def _wrapped(text: str, width: int, start: str = "") -> list[Line]:
    """Lines of that width; those after the first begin below the text of the first."""
    below = " " * len(start)
    wrapped = textwrap.wrap(text, width, initial_indent=start, subsequent_indent=below)
    return [Line(line) for line in wrapped]


def _about(result: Result) -> str:
    span = (
        f"{result.time[0]:g} to {result.time[-1]:g} s" if len(result.time) else "nothing recorded"
    )
    state = (
        "complete" if result.complete else f"incomplete: {result.message or 'the run ended early'}"
    )
    return f"Run {result.system}: {span}, {len(result.time)} rows, {state}"


def _table(paper: PaperJudged) -> Iterator[Line]:
    """A row for each claim, an empty line after it."""
    for text in _row(title for title, _ in COLUMNS):
        yield Line(text)
    yield Line(GAP.join("-" * width for _, width in COLUMNS))
    for claim, judgement in paper.claims:
        for text in _row(_cells(claim, judgement, paper)):
            yield Line(text, _shown(judgement, paper), WIDTH - COLUMNS[-1][1])
        yield Line("")


def _blocks(paper: PaperJudged, width: int) -> Iterator[Line]:
    """Some lines for each claim, an empty line after them."""
    for claim, judgement in paper.claims:
        text, *cells, verdict = _cells(claim, judgement, paper)
        yield from _wrapped(text, width)
        for (name, _), cell in zip(COLUMNS[1:-1], cells, strict=True):
            yield from _wrapped(cell, width, f"{INDENT}{name:{NAMED}}") if cell else ()
        for line in _wrapped(verdict, width, f"{INDENT}{'verdict':{NAMED}}"):
            yield Line(line.text, _shown(judgement, paper), len(INDENT) + NAMED)
        yield Line("")


def _shown(judgement: Judgement, paper: PaperJudged) -> Verdict | None:
    """Of another case a verdict is none on the paper."""
    return None if paper.deviations else judgement.verdict


def _cells(claim: Claim, judgement: Judgement, paper: PaperJudged) -> list[str]:
    bands = [claim.criterion(band) for band in (claim.reproduced, claim.partly)]
    mark = f", {OTHER}" if paper.deviations and judgement.verdict not in OPEN else ""
    verdict = Kind.CLAIM.word(judgement.verdict) + mark
    return [f"{claim.text} [{claim.where}]", judgement.figure, *bands, verdict]


def _row(cells: Iterable[str]) -> list[str]:
    """Lines of one row of the table, wrapped within their columns."""
    wrapped = [textwrap.wrap(cell, width) for cell, (_, width) in zip(cells, COLUMNS, strict=True)]
    return [
        GAP.join(
            part.ljust(width) for part, (_, width) in zip(parts, COLUMNS, strict=True)
        ).rstrip()
        for parts in zip_longest(*wrapped, fillvalue="")
    ]


def _summary(paper: PaperJudged) -> str:
    found = Kind.CLAIM.tally(judgement.verdict for _, judgement in paper.claims)
    parts = ", ".join(f"{count} {word}" for _, word, count in found)
    return f"{len(paper.claims)} claims: {parts}{f'; {OTHER}' if paper.deviations else ''}"


HEADING = "Safety: least margin of every rule in force, between samples too"


def rule_findings(mission: Mission, result: Result) -> list[RuleFinding]:
    """What the monitors of a run have found, rule by rule."""
    return [found for rules in mission.rules for found in rules(result)]


def safety(mission: Mission, result: Result) -> str:
    """One line per rule in force; "" if no monitor has watched the run, or no rule was in force."""
    rows = [
        ("rule", "least margin", "verdict", "limit"),
        *(
            (each.name, f"{each.margin:.4g} {each.unit}", each.state, each.limit)
            for each in rule_findings(mission, result)
        ),
    ]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
    return "\n".join([HEADING, "", *lines]) if len(rows) > 1 else ""
