# SPDX-License-Identifier: BSD-2-Clause
"""Number of runs: intervals and tests of a probability, and stopping rules that stay valid however
often they are evaluated.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta, Struct

from harness.system.tables import Count, Flag

LEAST = 1e-6
"""Smallest share in `until`: 1 - p of a smaller one may round to 1, and the test needs log(1 - p).
"""
Share = Annotated[
    float, Meta(ge=LEAST, lt=1, description=f"a number between 0 and 1, at least {LEAST:g}")
]


def clopper_pearson(failures: int, runs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Return the two-sided interval of a probability from the failures in a number of runs that was
    fixed beforehand (Clopper & Pearson 1934). It is too narrow if it is evaluated repeatedly to
    decide when to stop.
    """
    from scipy.special import betaincinv

    if runs == 0:
        return 0.0, 1.0
    tail = (1 - confidence) / 2
    low = betaincinv(failures, runs - failures + 1, tail) if failures else 0.0
    high = betaincinv(failures + 1, runs - failures, 1 - tail) if failures < runs else 1.0
    return float(low), float(high)


def wilks(probability: float, confidence: float, failures: int = 0) -> int:
    """Return the smallest number of runs, of which at most `failures` may fail, that proves a
    failure probability below `probability` (Wilks 1941): P(at most `failures` of n) <= 1 -
    confidence.
    """
    from scipy.special import bdtr

    few, many = 0, failures + 1
    while bdtr(failures, many, probability) > 1 - confidence:
        few, many = many, 2 * many
    while many - few > 1:
        middle = (few + many) // 2
        enough = middle > failures and bdtr(failures, middle, probability) <= 1 - confidence
        few, many = (few, middle) if enough else (middle, many)
    return many


CLAIM = 5.0
"""Ratio of the probability that Wald's test rejects to the one for which it is sharpest."""


def wald(failures: int, runs: int, probability: float, confidence: float) -> bool | None:
    """Return whether runs fail with less than a probability: True, False, or None if it is
    undecided.

    The likelihood ratio of p1 = probability / CLAIM against p0 = probability,

        (p1 / p0)^failures ((1 - p1) / (1 - p0))^(runs - failures),

    exceeds 1 / (1 - confidence) at any time with at most 1 - confidence if p0 is true, and its
    inverse does if p1 is (Wald 1945, Ville 1939), so the test may be evaluated after every run.
    """
    p0, p1 = probability, probability / CLAIM
    ratio = failures * math.log(p1 / p0) + (runs - failures) * math.log((1 - p1) / (1 - p0))
    bound = -math.log(1 - confidence)
    return True if ratio >= bound else False if ratio <= -bound else None


class Until(Struct, frozen=True):
    """Stopping rule of a campaign: `until = {success = 0.99, confidence = 0.95}`.

    success: the share of successes to be exceeded; fixed: stop after the number of runs without a
    failure that Wilks requires, otherwise when Wald's test has decided; most: largest number of
    runs of the test.
    """

    success: Share
    confidence: Share = 0.95
    fixed: Flag = False
    most: Count = 0

    @property
    def runs(self) -> int:
        """Return the largest number of runs."""
        least = wilks(1 - self.success, self.confidence)
        return least if self.fixed else self.most or 20 * least

    def decided(self, failed: Sequence[bool]) -> int | None:
        """Return the number of runs, in order, after which the test is decided; None if
        it is not.
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
        """Return the conclusion from a number of failures in a number of runs, in a line."""
        needed = f"success above {100 * self.success:g} % at {100 * self.confidence:g} %"
        if self.fixed:
            shown = failures == 0 and runs >= self.runs
            rule = f"Wilks: {self.runs} runs without a failure"
        else:
            decision = wald(failures, runs, 1 - self.success, self.confidence)
            shown, rule = bool(decision), "Wald's test"
            if decision is None:
                return f"{needed}: not decided by {runs} runs, {failures} failed ({rule})"
        word = "shown" if shown else "NOT shown" if self.fixed else "disproved"
        return f"{needed}: {word} by {runs} runs, {failures} failed ({rule})"
