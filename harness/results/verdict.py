# SPDX-License-Identifier: BSD-2-Clause
"""One scale of verdicts for requirements, claims of papers, safety rules and what a campaign
expects, and the one rule by which they decide on the exit status.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable
from enum import Enum
from typing import NamedTuple


class Verdict(Enum):
    """Outcome of a requirement, a claim or a safety rule; the value is how it looks on a page.

    NOT_EXERCISED: the run ended before the time from which it counts.
    """

    MET = REPRODUCED = HOLDS = "good"
    PARTLY = "fair"
    NOT_MET = NOT_REPRODUCED = VIOLATED = "bad"
    NOT_EXERCISED = "idle"
    NOT_JUDGED = "none"

    @property
    def fulfilled(self) -> bool:
        """Whether one may rely on it."""
        return self in {Verdict.MET, Verdict.PARTLY}


class Kind(Enum):
    """What is judged, as it is called."""

    REQUIREMENT = "requirement"
    EXPECTATION = "expectation"
    CLAIM = "claim"
    RULE = "safety rule"

    def word(self, verdict: Verdict) -> str:
        """A verdict in the words of its kind."""
        return WORDS[self].get(verdict) or OPEN[verdict]

    def tally(self, verdicts: Iterable[Verdict]) -> list[tuple[Verdict, str, int]]:
        """Verdicts that were given, in the words of their kind, and how often."""
        count = Counter(verdicts)
        return [(each, self.word(each), count[each]) for each in Verdict if count[each]]


WORDS = {
    Kind.REQUIREMENT: {Verdict.MET: "met", Verdict.NOT_MET: "not met"},
    Kind.EXPECTATION: {Verdict.MET: "as expected", Verdict.NOT_MET: "NOT as expected"},
    Kind.CLAIM: {
        Verdict.REPRODUCED: "reproduced",
        Verdict.PARTLY: "partly",
        Verdict.NOT_REPRODUCED: "not reproduced",
    },
    Kind.RULE: {Verdict.HOLDS: "holds", Verdict.VIOLATED: "violated"},
}
OPEN = {Verdict.NOT_EXERCISED: "not exercised", Verdict.NOT_JUDGED: "not judged"}
"""Words of all kinds."""


class Judged(NamedTuple):
    """Something that was judged: its kind, name and verdict, and the line that says so."""

    kind: Kind
    name: str
    verdict: Verdict
    text: str


def missed(
    judged: Iterable[Judged], required: Collection[str] = (), strict: bool = False
) -> list[str]:
    """Lines of what gives the exit status 1: requirements of the names `required` and, if strict,
    everything that is not fulfilled; claims that are not exercised or cannot be judged always.
    """
    return [
        f"{each.kind.value} {each.text}"
        for each in judged
        if not each.verdict.fulfilled
        and (
            strict
            or (each.kind is Kind.REQUIREMENT and each.name in required)
            or (each.kind is Kind.CLAIM and each.verdict in OPEN)
        )
    ]
