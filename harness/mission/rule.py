# SPDX-License-Identifier: BSD-2-Clause
"""A safety rule that was in force during a run, as a mission reports it."""

from __future__ import annotations

import math
from typing import NamedTuple


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
    def holds(self) -> bool:
        """Whether the rule was never violated."""
        return math.isnan(self.violated)
