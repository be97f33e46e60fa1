# SPDX-License-Identifier: BSD-2-Clause
"""A safety rule that was in force during a run, as a mission reports it."""

from __future__ import annotations

import math
from typing import NamedTuple

from harness.results.verdict import Judged, Kind, Verdict


class RuleFinding(NamedTuple):
    """A rule: its name, the least margin since the start and its unit, the time of the first
    violation [s] (NaN: none), what the margin is, and the limit in words.
    """

    name: str
    margin: float
    unit: str
    violated: float
    text: str = ""
    limit: str = ""

    @property
    def verdict(self) -> Verdict:
        """Whether the rule was never violated."""
        return Verdict.HOLDS if math.isnan(self.violated) else Verdict.VIOLATED

    @property
    def state(self) -> str:
        """The verdict in words, with the first violation."""
        since = "" if math.isnan(self.violated) else f", first at {self.violated:.2f} s"
        return Kind.RULE.word(self.verdict) + since

    @property
    def judged(self) -> Judged:
        """What decides on the exit status."""
        return Judged(Kind.RULE, self.name, self.verdict, f"{self.name}: {self.state}")
