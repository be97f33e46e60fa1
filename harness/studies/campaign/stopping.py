# SPDX-License-Identifier: BSD-2-Clause
"""How many runs: intervals and tests of a probability, and stopping rules that stay honest however
often one looks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

from msgspec import Meta, Struct

from harness.system.schema import Count, Flag

Share = Annotated[float, Meta(gt=0, lt=1, description="a number between 0 and 1")]


def clopper_pearson(failures: int, runs: int, confidence: float = 0.95) -> tuple[float, float]:
    """Two-sided interval of a probability from so many failures of a number of runs that was fixed
    beforehand (Clopper & Pearson 1934); looked at again and again it claims too much.
    """
    from scipy.special import betaincinv

    if runs == 0:
        return 0.0, 1.0
    tail = (1 - confidence) / 2
    low = betaincinv(failures, runs - failures + 1, tail) if failures else 0.0
    high = betaincinv(failures + 1, runs - failures, 1 - tail) if failures < runs else 1.0
    return float(low), float(high)


def wilks(probability: float, confidence: float, failures: int = 0) -> int:
    """Least number of runs whose at most so many failures prove that one fails with less than this
    probability (Wilks 1941): P(at most `failures` of n) <= 1 - confidence.
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
"""Wald's test is sharpest for a probability so many times smaller than the one it disproves."""


def wald(failures: int, runs: int, probability: float, confidence: float) -> bool | None:
    """Whether runs fail with less than a probability: True, False, or None: not decided yet.

    The likelihood ratio of p1 = probability / CLAIM against p0 = probability,

        (p1 / p0)^failures ((1 - p1) / (1 - p0))^(runs - failures),

    exceeds 1 / (1 - confidence) at any time with at most 1 - confidence if p0 is true, and its
    inverse does if p1 is (Wald 1945, Ville 1939): one may look after every run.
    """
    p0, p1 = probability, probability / CLAIM
    ratio = failures * math.log(p1 / p0) + (runs - failures) * math.log((1 - p1) / (1 - p0))
    bound = -math.log(1 - confidence)
    return True if ratio >= bound else False if ratio <= -bound else None


class Until(Struct, frozen=True):
    """When a campaign has flown enough: `until = {success = 0.99, confidence = 0.95}`.

    success: what the share of successes shall exceed; fixed: by so many runs without a failure as
    Wilks demands, else as soon as Wald's test has decided; most: runs of a test without an end.
    """

    success: Share
    confidence: Share = 0.95
    fixed: Flag = False
    most: Count = 0

    @property
    def runs(self) -> int:
        """Largest number of runs."""
        least = wilks(1 - self.success, self.confidence)
        return least if self.fixed else self.most or 20 * least

    def decided(self, failed: Sequence[bool]) -> int | None:
        """Number of runs, in their order, after which it is decided; None: not yet."""
        if self.fixed:
            return None
        failures = 0
        for n, each in enumerate(failed, 1):
            failures += each
            if wald(failures, n, 1 - self.success, self.confidence) is not None:
                return n
        return None

    def verdict(self, failures: int, runs: int) -> str:
        """What so many failures of so many runs say, in a line."""
        wanted = f"success above {100 * self.success:g} % at {100 * self.confidence:g} %"
        if self.fixed:
            shown = failures == 0 and runs >= self.runs
            rule = f"Wilks: {self.runs} runs without a failure"
        else:
            decision = wald(failures, runs, 1 - self.success, self.confidence)
            shown, rule = bool(decision), "Wald's test"
            if decision is None:
                return f"{wanted}: not decided by {runs} runs, {failures} failed ({rule})"
        word = "shown" if shown else "NOT shown" if self.fixed else "not so"
        return f"{wanted}: {word} by {runs} runs, {failures} failed ({rule})"
