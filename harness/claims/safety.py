# SPDX-License-Identifier: BSD-2-Clause
"""The section on safety of a report: what each rule of the monitor asks for, the least margin, and
the first violation.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from harness.results.result import Result
from harness.results.safety import Finding, findings, limit

HEADING = "Safety (docs/models.md G): least margin of every rule in force, between samples too"


def section(result: Result) -> str:
    """One line per rule in force; "" if no monitor has watched the run, or no rule was in force."""
    rows = list(_rows(result))
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = (
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )
    return "\n".join([HEADING, "", *lines]) if len(rows) > 1 else ""


def _rows(result: Result) -> Iterator[tuple[str, ...]]:
    yield "rule", "least margin", "verdict", "limit"
    for found in findings(result):
        unit = found.rule.unit
        yield (
            found.rule.name,
            f"{found.margin:.4g} {unit}",
            _verdict(found),
            limit(result, found.rule),
        )


def _verdict(found: Finding) -> str:
    if math.isnan(found.violated):
        return "holds"
    return f"violated, first at {found.violated:.2f} s"
