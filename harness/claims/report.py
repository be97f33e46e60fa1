# SPDX-License-Identifier: BSD-2-Clause
"""What a paper claims, what a result shows, and the verdict as plain text: a table of 120 columns,
or claim by claim where there is less room.

The mission of a result lists the papers; which of them belongs to it is decided by the variables
that it holds. Below stands what the safety monitor of the run has found.
"""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, repeat, zip_longest
from typing import NamedTuple

from harness.claims.case import listed, unlike
from harness.errors import ResultsError
from harness.mission import Claim, Judgement, Mission, Paper, RuleFinding
from harness.mission.library import missing, notes_of, of_result
from harness.results.requirements import Finding, findings
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
    found, wanted = judged(result), findings(result)
    if not found and not wanted:
        raise ResultsError(_without_claims(result))
    sections = [_section(result, each, width) for each in found]
    if not found and of_result(result).claims:
        sections = [_wrapped(_without_claims(result), width)]
    note = missing(result)
    parts = (_wrapped(note, width), _notes(result, width), _requirements(wanted, width), *sections,
             _safety(result, width))  # fmt: skip
    text = _flown(result, width)
    for part in filter(None, parts):
        text += [Line(""), *part]
    return text


def _without_claims(result: Result) -> str:
    """That no paper belongs to a result, and why perhaps."""
    hint = (
        ""
        if result.parameters
        else " (the file does not hold the parameters by which some are known)"
    )
    return f"{result.system}: there are no claims of a paper about such a result{hint}"


def _notes(result: Result, width: int) -> list[Line]:
    """One paragraph, if there are any."""
    each = [line for note in notes_of(result) for line in _wrapped(note, width, "  ")]
    return [Line("Notes:"), *each] if each else []


def _requirements(wanted: Sequence[Finding], width: int) -> list[Line]:
    """One paragraph, if there are any."""
    each = [line for found in wanted for line in _wrapped(str(found), width, "  ")]
    return [Line("Requirements:"), *each] if each else []


def _safety(result: Result, width: int) -> list[Line]:
    """What the safety monitor has found, if there was one."""
    text = safety(of_result(result), result).splitlines()
    return [line for row in text for line in (_wrapped(row, width) or [Line("")])]


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
    texts = ["the file does not say"] if known is None else known.lines()
    starts = chain([FLOWN], repeat(" " * len(FLOWN)))
    return [
        line
        for start, text in zip(starts, texts, strict=False)
        for line in _wrapped(text, width, start)
    ]


def _section(result: Result, judged: PaperJudged, width: int) -> list[Line]:
    other = bool(judged.deviations)
    differences = f"Not the case of the paper: {listed(judged.deviations)}"
    return [
        *_wrapped(judged.paper.title, width),
        Line(""),
        *_wrapped(_about(result), width),
        *(_wrapped(differences, width) if other else ()),
        Line(""),
        *(_table(judged.claims, other) if width >= WIDTH else _blocks(judged.claims, other, width)),
        Line(""),
        *_wrapped(_summary([judgement for _, judgement in judged.claims], other), width),
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


def _table(claims: Sequence[tuple[Claim, Judgement]], other: bool) -> Iterator[Line]:
    """A row for each claim, an empty line after it."""
    for text in _row(title for title, _ in COLUMNS):
        yield Line(text)
    yield Line(GAP.join("-" * width for _, width in COLUMNS))
    for claim, judgement in claims:
        for text in _row(_cells(claim, judgement, other)):
            yield Line(text, None if other else judgement.verdict, WIDTH - COLUMNS[-1][1])
        yield Line("")


def _blocks(claims: Sequence[tuple[Claim, Judgement]], other: bool, width: int) -> Iterator[Line]:
    """Some lines for each claim, an empty line after them."""
    for claim, judgement in claims:
        text, *cells = _cells(claim, judgement, other)
        yield from _wrapped(text, width)
        for (name, _), cell in zip(COLUMNS[1:-1], cells[:-1], strict=True):
            yield from _wrapped(cell, width, f"{INDENT}{name:{NAMED}}") if cell else ()
        for line in _wrapped(cells[-1], width, f"{INDENT}{'verdict':{NAMED}}"):
            yield line._replace(
                verdict=None if other else judgement.verdict, begin=len(INDENT) + NAMED
            )
        yield Line("")


def _cells(claim: Claim, judgement: Judgement, other: bool) -> list[str]:
    bands = [claim.criterion(band) for band in (claim.reproduced, claim.partly)]
    return [f"{claim.text} [{claim.where}]", judgement.figure, *bands, _verdict(judgement, other)]


def _verdict(judgement: Judgement, other: bool) -> str:
    """Of another case a verdict is none on the paper."""
    mark = f", {OTHER}" if other and judgement.verdict not in OPEN else ""
    return Kind.CLAIM.word(judgement.verdict) + mark


def _row(cells: Iterable[str]) -> list[str]:
    """Lines of one row of the table, wrapped within their columns."""
    wrapped = [textwrap.wrap(cell, width) for cell, (_, width) in zip(cells, COLUMNS, strict=True)]
    return [
        GAP.join(
            part.ljust(width) for part, (_, width) in zip(parts, COLUMNS, strict=True)
        ).rstrip()
        for parts in zip_longest(*wrapped, fillvalue="")
    ]


def _summary(judgements: Sequence[Judgement], other: bool) -> str:
    count = Counter(judgement.verdict for judgement in judgements)
    parts = [
        f"{count[verdict]} {Kind.CLAIM.word(verdict)}" for verdict in Verdict if count[verdict]
    ]
    return f"{len(judgements)} claims: {', '.join(parts)}{f'; {OTHER}' if other else ''}"


HEADING = "Safety: least margin of every rule in force, between samples too"


def rule_findings(mission: Mission, result: Result) -> list[RuleFinding]:
    """What the monitors of a run have found, rule by rule."""
    return [found for rules in mission.rules for found in rules(result)]


def safety(mission: Mission, result: Result) -> str:
    """One line per rule in force; "" if no monitor has watched the run, or no rule was in force."""
    rows = list(_safety_rows(rule_findings(mission, result)))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
    return "\n".join([HEADING, "", *lines]) if len(rows) > 1 else ""


def _safety_rows(found: list[RuleFinding]) -> Iterator[tuple[str, ...]]:
    yield "rule", "least margin", "verdict", "limit"
    for each in found:
        yield each.name, f"{each.margin:.4g} {each.unit}", each.state, each.limit
