# SPDX-License-Identifier: BSD-2-Clause
"""The section on safety of a report: what each rule of a monitor asks for, the least margin, and
the first violation.
"""

from __future__ import annotations

from collections.abc import Iterator

from harness.mission import Mission, RuleFinding
from harness.results.result import Result

HEADING = "Safety: least margin of every rule in force, between samples too"


def findings(mission: Mission, result: Result) -> list[RuleFinding]:
    """What the monitors of a run have found, rule by rule."""
    return [found for rules in mission.rules for found in rules(result)]


def section(mission: Mission, result: Result) -> str:
    """One line per rule in force; "" if no monitor has watched the run, or no rule was in force."""
    rows = list(_rows(findings(mission, result)))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
    return "\n".join([HEADING, "", *lines]) if len(rows) > 1 else ""


def _rows(found: list[RuleFinding]) -> Iterator[tuple[str, ...]]:
    yield "rule", "least margin", "verdict", "limit"
    for each in found:
        yield each.name, f"{each.margin:.4g} {each.unit}", each.state, each.limit
