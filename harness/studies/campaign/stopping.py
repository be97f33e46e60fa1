# SPDX-License-Identifier: BSD-2-Clause
"""Number of runs that a campaign needs: the number of runs without a failure that proves a
probability of success, and a stopping rule that may be evaluated after every run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta, Struct

from harness.system.tables import Count, Flag

LEAST = 1e-6
"""Smallest `success` and `confidence` that `until` accepts. Wilks and Wald compute with 1 - p,
where p is one of the two; for a much smaller p, 1 - p would be rounded to 1, as for p = 0.
"""
Share = Annotated[
    float, Meta(ge=LEAST, lt=1, description=f"a number between 0 and 1, at least {LEAST:g}")
]


def wilks(probability: float, confidence: float) -> int:
    """Return the smallest number of runs n that proves a failure probability below `probability` if
    none of the runs fails (Wilks 1941): (1 - probability)^n <= 1 - confidence.
    """
    return math.ceil(math.log(1 - confidence) / math.log1p(-probability))


CLAIM = 5.0
"""Ratio p0 / p1 of the two failure probabilities that Wald's test distinguishes. p0 is the required
limit. If the true probability is p1, no test of equal error rates needs fewer runs on average.
"""


def wald(failures: int, runs: int, probability: float, confidence: float) -> bool | None:
    """Return True if the runs show that the failure probability is below `probability`, False if
    they show that it is above probability / CLAIM, None if they show neither.

    The test compares p1 = probability / CLAIM with p0 = probability by the likelihood ratio

        (p1 / p0)^failures ((1 - p1) / (1 - p0))^(runs - failures).

    If p0 is true, the probability that the ratio ever exceeds 1 / (1 - confidence) is at most
    1 - confidence. If p1 is true, the same holds for the inverse of the ratio (Wald 1945, Ville
    1939). Therefore the test may be evaluated after every run.
    """
    p0, p1 = probability, probability / CLAIM
    ratio = failures * math.log(p1 / p0) + (runs - failures) * math.log((1 - p1) / (1 - p0))
    bound = -math.log(1 - confidence)
    return True if ratio >= bound else False if ratio <= -bound else None


class Until(Struct, frozen=True):
    """Stopping rule of a campaign: `until = {success = 0.99, confidence = 0.95}`.

    success: share of successful runs to prove; confidence: confidence of the proof; fixed: whether
    to perform as many runs as Wilks requires if none fails, instead of stopping when Wald's test is
    decided; most: largest number of runs for Wald's test (0: twenty times the number that Wilks
    requires).
    """

    success: Share
    confidence: Share = 0.95
    fixed: Flag = False
    most: Count = 0

    @property
    def runs(self) -> int:
        """Return the number of runs to plan. The campaign can need fewer runs, but not more."""
        least = wilks(1 - self.success, self.confidence)
        return least if self.fixed else self.most or 20 * least

    def decided(self, failed: Sequence[bool]) -> int | None:
        """Return the number of runs, from the first on, after which Wald's test is decided; None if
        it is not decided after all runs, or if `fixed` is set. failed: whether each run failed or
        has no verdict, in the order of the runs.
        """
        if self.fixed:
            return None
        failures = 0
        for n, each in enumerate(failed, 1):
            failures += each
            if wald(failures, n, 1 - self.success, self.confidence) is not None:
                return n
        return None

    def verdict(self, failures: int, runs: int) -> str:
        """Return one line that states the required success, whether the runs prove it, and the
        test. failures: number of runs that failed or have no verdict; runs: number of all runs.
        """
        needed = f"success above {100 * self.success:g} % at {100 * self.confidence:g} % confidence"
        if self.fixed:
            word = "shown" if failures == 0 and runs >= self.runs else "NOT shown"
            rule = f"Wilks: {self.runs} runs without a failure"
        else:
            words = {True: "shown", False: "NOT shown", None: "not decided"}
            word = words[wald(failures, runs, 1 - self.success, self.confidence)]
            rule = "Wald's test"
        return f"{needed}: {word} by {runs} runs, {failures} failed ({rule})"
