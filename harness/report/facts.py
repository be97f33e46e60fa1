# SPDX-License-Identifier: BSD-2-Clause
"""What a page says of a run in words and numbers: state, measures, verdicts, margins, parameters.

Everything is taken from the result and from the tables of the project.
"""

from __future__ import annotations

import math
from typing import Any

from harness.claims.case import listed
from harness.claims.report import OTHER, PaperJudged, judged, rule_findings
from harness.mission import Claim, Judgement, Limits
from harness.mission.exchange import remarks
from harness.mission.library import missing, notes_of, of_result
from harness.report.plots import number
from harness.results.requirements import findings
from harness.results.result import Result
from harness.results.verdict import OPEN, Kind
from harness.system.values import base

Facts = dict[str, Any]


def head(result: Result) -> Facts:
    """Name, span and state of the run."""
    time, known = result.time, result.provenance
    return {
        "system": result.system,
        "flown": known.lines() if known else [],
        "date": known.date if known else "",
        "rows": len(time),
        "begin": f"{time[0]:g}" if len(time) else "",
        "end": f"{time[-1]:g}" if len(time) else "",
        "complete": result.complete,
        "message": result.message or ("" if result.complete else "the run ended early"),
        "notes": [*notes_of(result), *remarks(result), *filter(None, (missing(result),))],
    }


WORST_FIRST = ("bad", "fair", "none", "idle", "good")
"""Looks of verdicts in the order of the head."""


def chips(result: Result) -> list[Facts]:
    """How many rules, requirements and claims have which verdict, the worst first."""
    given = judged(result)
    found = [{"kind": "good", "text": "complete"} if result.complete else BROKEN]
    found += [{"kind": "fair", "text": OTHER} for paper in given if paper.deviations]
    tallies = (
        (Kind.RULE, [each.verdict for each in rule_findings(of_result(result), result)]),
        (Kind.REQUIREMENT, [each.verdict for each in findings(result)]),
        (Kind.CLAIM, [each.verdict for paper in given for _, each in paper.claims]),
    )
    for kind, verdicts in tallies:
        for verdict, word, count in kind.tally(verdicts):
            text = f"{count} {kind.value}{'' if count == 1 else 's'} {word}"
            found.append({"kind": verdict.value, "text": text.replace("rules holds", "rules hold")})
    return sorted(found, key=lambda chip: WORST_FIRST.index(chip["kind"]))


BROKEN = {"kind": "bad", "text": "incomplete"}


def measures(result: Result) -> list[Facts]:
    """The measures of harness compare that this run has."""
    if not len(result.time):
        return []
    offered = of_result(result)
    limits = offered.limits(Limits(), {"": result})
    taken = ((m, m(result, limits)) for m in offered.measures)
    return [
        {"name": m.name, "value": f"{value:.4g}", "unit": m.unit}
        for m, value in taken
        if math.isfinite(value) and not m.beside
    ]


# ---- claims


def papers(result: Result) -> list[Facts]:
    """Every paper that is about such a result, with the verdicts of its claims."""
    return [_paper(each) for each in judged(result)]


def _paper(each: PaperJudged) -> Facts:
    return {
        "title": each.paper.title,
        "differences": listed(each.deviations) if each.deviations else "",
        "other": OTHER if each.deviations else "",
        "count": [
            {"kind": verdict.value, "text": word, "number": count}
            for verdict, word, count in Kind.CLAIM.tally(j.verdict for _, j in each.claims)
        ],
        "claims": [_claim(*pair, bool(each.deviations)) for pair in each.claims],
    }


def _claim(claim: Claim, judgement: Judgement, other: bool) -> Facts:
    return {
        "text": claim.text,
        "where": claim.where,
        "figure": judgement.figure,
        "reproduced": claim.criterion(claim.reproduced),
        "partly": claim.criterion(claim.partly),
        "verdict": Kind.CLAIM.word(judgement.verdict),
        "kind": judgement.verdict.value,
        "other": OTHER if other and judgement.verdict not in OPEN else "",
    }


def demands(result: Result) -> list[Facts]:
    """The requirements of a run, with what was compared where each was closest to failing."""
    return [
        {
            "name": found.name,
            "text": found.text,
            "detail": found.detail,
            "kind": found.verdict.value,
            "verdict": Kind.REQUIREMENT.word(found.verdict),
            "time": found.time,
        }
        for found in findings(result)
    ]


# ---- safety


def margins(result: Result) -> list[Facts]:
    """Least margin of every rule of the safety monitor that was in force, and its violation."""
    return [
        {
            "name": found.name,
            "text": found.text,
            "value": f"{found.margin:.4g}",
            "unit": found.unit,
            "kind": found.verdict.value,
            "since": "" if found.verdict.fulfilled else f"{found.violated:g}",
        }
        for found in rule_findings(of_result(result), result)
    ]


# ---- parameters


def parameters(result: Result) -> list[Facts]:
    """All parameters of all components with value, unit and meaning."""
    table = result.parameters
    if table is None:
        return []
    given = result.provenance.set if result.provenance else ()
    changed = {base(name) for name, _ in given}
    return [
        {
            "name": name,
            "value": number(table[name][0]),
            "unit": table.unit(name),
            "text": table.description(name),
            "changed": name in changed,
        }
        for name in table.names
    ]
