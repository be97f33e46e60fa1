# SPDX-License-Identifier: BSD-2-Clause
"""The report of a result as one text."""

from __future__ import annotations

from harness.claims.report import WIDTH, lines, outcomes
from harness.results.verdict import missed


def report(result, width=WIDTH):
    """The text, and whether the run is complete and every claim could be evaluated."""
    text = "\n".join(line.text for line in lines(result, width))
    return text, result.complete and not missed(outcomes(result))
