# SPDX-License-Identifier: BSD-2-Clause
"""Scale of verdicts for requirements, claims of papers, safety rules and expected values of a
campaign, and the rule by which verdicts determine the exit status.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterable
from enum import Enum
from typing import NamedTuple


class Verdict(Enum):
    """Verdict on a statement of any Kind. The enum value is its style on a page.

    NOT_EXERCISED: the condition did not apply in the run, which may have ended too early.
    NOT_JUDGED: the condition could not be evaluated.
    """

    MET = REPRODUCED = HOLDS = "good"
    PARTLY = "fair"
    NOT_MET = NOT_REPRODUCED = VIOLATED = "bad"
    NOT_EXERCISED = "idle"
    NOT_JUDGED = "none"

    @property
    def fulfilled(self) -> bool:
        """Return whether the verdict is MET (which equals REPRODUCED and HOLDS) or PARTLY."""
        return self in {Verdict.MET, Verdict.PARTLY}


class Kind(Enum):
    """Kind of a statement with a verdict; the enum value is the name of the kind."""

    REQUIREMENT = "requirement"
    EXPECTATION = "expectation"
    CLAIM = "claim"
    RULE = "safety rule"

    def word(self, verdict: Verdict) -> str:
        """Return the name of a verdict on a statement of this kind: Verdict.MET, which equals
        REPRODUCED, is "met" for a requirement and "reproduced" for a claim.
        """
        return WORDS[self].get(verdict) or OPEN[verdict]

    def tally(self, verdicts: Iterable[Verdict]) -> list[tuple[Verdict, str, int]]:
        """Return the verdicts that occur, each with its name for this kind and its count."""
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
"""Names of the verdicts that leave a statement undecided; all kinds of statement share them."""


class Outcome(NamedTuple):
    """Statement with its verdict: kind, name, verdict, and a line of text."""

    kind: Kind
    name: str
    verdict: Verdict
    text: str


def missed(
    outcomes: Iterable[Outcome], required: Collection[str] = (), strict: bool = False
) -> list[str]:
    """Return a line for every outcome that causes exit status 1.

    These are each requirement named in `required` whose verdict is not fulfilled, each claim with
    the verdict NOT_EXERCISED or NOT_JUDGED, and, if `strict`, every outcome whose verdict is not
    fulfilled (see Verdict.fulfilled).
    """
    return [
        f"{each.kind.value} {each.text}"
        for each in outcomes
        if not each.verdict.fulfilled
        and (
            strict
            or (each.kind is Kind.REQUIREMENT and each.name in required)
            or (each.kind is Kind.CLAIM and each.verdict in OPEN)
        )
    ]
