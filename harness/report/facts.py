# SPDX-License-Identifier: BSD-2-Clause
"""What a page says of a run in words and numbers: state, measures, verdicts, margins, parameters.

Everything is taken from the result and from the tables of the project.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator
from typing import Any

from harness.claims import Verdict
from harness.claims.case import listed
from harness.claims.report import OTHER, Judged, judged
from harness.report.plots import number
from harness.results.notes import notes
from harness.results.result import Result
from harness.studies.measures import MEASURES, Limits
from harness.system.names import base

Facts = dict[str, Any]

MONITOR = "monitor"
RULES = ("keep_out", "corridor", "speed", "passive", "plume", "navigation")
"""Rules of the safety monitor in the order of its outputs."""
KINDS = {
    Verdict.REPRODUCED: "good",
    Verdict.PARTLY: "fair",
    Verdict.NOT_REPRODUCED: "bad",
    Verdict.NOT_JUDGED: "none",
}
"""How a verdict looks."""


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
        "notes": list(notes(result)) if len(time) else [],
    }


def measures(result: Result) -> list[Facts]:
    """The measures of harness compare that this run has."""
    if not len(result.time):
        return []
    limits = Limits().common({"": result})
    taken = ((m, m(result, limits)) for m in MEASURES)
    return [
        {"name": m.name, "value": f"{value:.4g}", "unit": m.unit}
        for m, value in taken
        if math.isfinite(value)
    ]


# ---- claims


def papers(result: Result) -> list[Facts]:
    """Every paper that is about such a result, with the verdicts of its claims."""
    return [_paper(each) for each in judged(result)]


def _paper(each: Judged) -> Facts:
    count = Counter(judgement.verdict for _, judgement in each.claims)
    return {
        "title": each.paper.title,
        "differences": listed(each.deviations) if each.deviations else "",
        "other": OTHER if each.deviations else "",
        "count": [
            {"kind": KINDS[v], "text": v.value, "number": count[v]} for v in Verdict if count[v]
        ],
        "claims": [
            {
                "text": claim.text,
                "where": claim.where,
                "figure": judgement.figure,
                "reproduced": claim.criterion(claim.reproduced),
                "partly": claim.criterion(claim.partly),
                "verdict": judgement.verdict.value,
                "kind": KINDS[judgement.verdict],
            }
            for claim, judgement in each.claims
        ],
    }


# ---- safety


def margins(result: Result) -> list[Facts]:
    """Least margin of every rule of a safety monitor, and when it was first violated."""
    needs = [f"{MONITOR}.{name}" for name in ("least_margin", "violated", "t_first")]
    if not (result.holds(*needs) and len(result.time)):
        return []
    least, violated, first = (result[name][-1] for name in needs)
    return [
        {
            "rule": result.description(f"{MONITOR}.{rule}_margin"),
            "name": f"{rule}_margin",
            "value": f"{least[k]:.4g}",
            "unit": result.unit(f"{MONITOR}.{rule}_margin"),
            "kind": "bad" if violated[k] else "good",
            "since": f"{first[k]:g}" if violated[k] else "",
        }
        for k, rule in enumerate(RULES)
        if abs(least[k]) < RESTING
    ]


RESTING = 1e9
"""Margin of a rule that is not in force, and above."""


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
        for name in _names(table)
    ]


def _names(table: Result) -> Iterator[str]:
    whole = {column for columns in table.vectors.values() for column in columns.flat}
    yield from table.vectors
    yield from (name for i, name in enumerate(table.columns) if i not in whole)
