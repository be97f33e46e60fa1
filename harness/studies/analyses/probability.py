# SPDX-License-Identifier: BSD-2-Clause
"""Probability that a requirement fails (negative margin), by random runs or by subset simulation
(Au & Beck 2001) with the Markov chains of Papaioannou et al. 2015.

Subset simulation moves from level to level towards smaller margins. It can miss failures towards
which the margin does not decrease; only the random runs of its first level can find these.
Importance sampling is not offered: it shows nothing about a failure region in which none of its
sampling distributions is centred. If a share of its runs is random as a remedy (a defensive
mixture), its upper bound is no lower than the bound by these random runs alone.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.results.result import Array
from harness.studies.analyses.evaluator import exercised
from harness.studies.analyses.study import Probability, Study, begun, prepared, report_nominal
from harness.studies.campaign.stopping import clopper_pearson

P0 = 0.1
"""Share of the runs of a level with the smallest margins, from which the next level starts."""
ACCEPTED, WIDTH = 0.44, 0.6
"""Target acceptance rate of the Markov chains; width of their first step in standard deviations."""
REPEATS, LEAST = 5, 50
"""Number of independent subset simulations; smallest number of runs per level of each."""
T95 = 2.7764451051977987
"""Quantile of Student's t distribution with four degrees of freedom, two-sided 95 %."""


class Level(NamedTuple):
    """Level of a subset simulation: limit of the margin, probability p of a margin below this
    limit, and share of accepted proposals of the chains that led to this level.
    """

    limit: float
    p: float
    accepted: float


class Estimate(NamedTuple):
    """Estimated probability p of a failure with its 95 % interval (low, high) and coefficient of
    variation (cov). runs: number of runs; levels, parts: levels and probability of each repeated
    subset simulation; warning: reason not to trust the estimate, "" if there is none.
    """

    p: float
    low: float
    high: float
    cov: float
    runs: int
    levels: tuple[tuple[Level, ...], ...] = ()
    parts: tuple[float, ...] = ()
    warning: str = ""


Method = Generator[Array, Array, Estimate]
Chains = Generator[Array, Array, tuple[Array, Array, float]]


def random(d: int, seed: int, runs: int, abreast: int = 200) -> Method:
    """Return the estimate by independent random runs, with the interval of Clopper and Pearson.

    d: number of coordinates; runs: their fixed number; abreast: runs that are requested together.
    """
    failures = 0
    for first in range(0, runs, abreast):
        rows = range(first, min(first + abreast, runs))
        z = np.array([np.random.default_rng([seed, k]).standard_normal(d) for k in rows])
        failures += int(((yield z) < 0).sum())
    low, high = clopper_pearson(failures, runs)
    p = failures / runs
    cov = math.sqrt((1 - p) / (p * runs)) if failures else math.inf
    return Estimate(p, low, high, cov, runs)


# ---- subset simulation


class Sampled(NamedTuple):
    """Result of one subset simulation: probability p, its coefficient of variation (cov), levels,
    number of runs, and whether its levels reached a failure (a negative margin).
    """

    p: float
    cov: float
    levels: tuple[Level, ...]
    runs: int
    reached: bool


def one_subset(
    d: int, seed: Sequence[int], n: int, most: int = 20
) -> Generator[Array, Array, Sampled]:
    """Return the result of one subset simulation in d coordinates, with n runs per level and at
    most `most` levels. It ends at a level that reaches failures, or does not reach smaller margins.
    """
    rng = np.random.default_rng(list(seed))
    count = int(n * P0)
    z = rng.standard_normal((n, d))
    y = exercised((yield z))
    levels, variance, accepted = list[Level](), 0.0, 1.0
    chains = np.arange(n)[:, None]  # indices of the runs of each chain: n chains of one run
    p = 1.0
    while True:
        order = np.argsort(y, kind="stable")
        pair = y[order[count - 1 : count + 1]]
        limit = float(pair.mean() if np.isfinite(pair).all() else pair[0])
        reached = limit < 0
        below = y < 0 if reached else y <= limit
        part = float(below.mean())
        variance += _variance(below[chains], part)
        p *= part
        stuck = bool(levels) and levels[-1].limit <= limit
        levels.append(Level(max(limit, 0.0), p, accepted))
        if reached or stuck or len(levels) == most:
            runs = n + (len(levels) - 1) * (n - count)
            return Sampled(p, math.sqrt(variance), tuple(levels), runs, reached)
        z, y, accepted = yield from _level(rng, z[order[:count]], y[order[:count]], limit, n)
        chains = np.arange(n).reshape(-1, count).T


def _level(rng: np.random.Generator, z: Array, y: Array, limit: float, n: int) -> Chains:
    """Return coordinates (n, d) and margins (n,) of runs with margins up to a limit, and the share
    of accepted proposals. Markov chains start in parallel from the runs z with margins y.

    A proposal v = sqrt(1 - s^2) z + s w, with w standard normal, preserves the normal distribution.
    It is accepted if its margin is at most `limit`. The width s adapts to the acceptance rate.
    """
    rows, values, width, taken = [z], [y], WIDTH, []
    for k in range(1, n // len(z)):
        s = min(1.0, width)
        tried = math.sqrt(1 - s * s) * z + s * rng.standard_normal(z.shape)
        found = exercised((yield tried))
        better = found <= limit
        z, y = np.where(better[:, None], tried, z), np.where(better, found, y)
        rows.append(z)
        values.append(y)
        taken.append(float(better.mean()))
        width = math.exp(math.log(s) + (taken[-1] - ACCEPTED) / math.sqrt(k))
    return np.concatenate(rows), np.concatenate(values), float(np.mean(taken))


def _variance(below: NDArray[np.bool_], p: float) -> float:
    """Return the squared coefficient of variation of the share p of runs below a limit, with the
    correlation of the runs within each chain; below: by chain and position in it.
    """
    chains, length = below.shape
    n = chains * length
    if p in (0.0, 1.0):
        return (1 - p) / n if p else math.inf
    x = below - p
    gamma = sum(
        2 * (1 - k / length) * float((x[:, :-k] * x[:, k:]).mean()) / (p * (1 - p))
        for k in range(1, length)
    )
    return float((1 - p) / (p * n) * (1 + max(gamma, 0.0)))


def per_level(runs: int) -> int:
    """Return the number of runs per level, a multiple of ten, with which REPEATS subset simulations
    of six levels, which reach probabilities of about 1e-6, need at most `runs` runs.
    """
    return 10 * int(runs / REPEATS / (1 + 5 * (1 - P0)) / 10)


def _most(runs: float, n: int) -> int:
    """Return the largest number of levels, with n runs each, that need at most `runs` runs."""
    return 1 + int((runs - n) / (n * (1 - P0)) + 1e-9)


def subset(d: int, seed: int, runs: int) -> Method:
    """Return the estimate by REPEATS independent subset simulations in d coordinates, with an
    interval from their scatter. The interval of a single simulation would be too short if its
    levels led away from some failures.
    """
    n, found = per_level(runs), list[Sampled]()
    for k in range(REPEATS):  # runs that a repeat has not used are available to the next ones
        left = runs - sum(each.runs for each in found)
        found.append((yield from one_subset(d, [seed, k], n, _most(left / (REPEATS - k), n))))
    return pooled(found)


def pooled(found: Sequence[Sampled]) -> Estimate:
    """Return the common estimate of independent subset simulations. If one did not reach a failure,
    it is an upper bound with a warning.
    """
    parts = tuple(each.p for each in found)
    runs, levels = sum(e.runs for e in found), tuple(e.levels for e in found)
    if not all(each.reached for each in found):
        limits = [each.levels[-1].limit for each in found]
        warning = (
            f"only {sum(e.reached for e in found)} of {len(found)} repeats reached a failure; the "
            "others "
            f"ended at margins up to {max(limits):.4g} with probabilities up to {max(parts):.2g}, "
            f"so p is an upper bound"
        )
        return Estimate(max(parts), 0.0, max(parts), math.inf, runs, levels, parts, warning)
    scatter = float(np.log(parts).std(ddof=1))
    own = math.sqrt(float(np.mean([each.cov**2 for each in found])))
    warning = "the repeats ended in different regions: do not trust this estimate"
    p, cov = float(np.mean(parts)), max(scatter, own) / math.sqrt(len(parts))
    half = math.exp(T95 * cov)
    bounds = p / half, min(p * half, 1.0)
    return Estimate(p, *bounds, cov, runs, levels, parts, warning if scatter > 2 * own else "")


# ---- analysis


def probability(definition: Any, output: str | Path, **how: Any) -> Study:
    """Estimate the probability that a requirement fails, and store the runs in a dataset.

    definition: path of a campaign TOML with a table [probability], or the table itself; output:
    OUT.zarr; how: options as for sensitivity(). Raises UsageError, StructureError.
    """
    entry, evaluator = prepared(Probability, definition, how)
    slope = entry.method == "subset"
    ((name, k),) = evaluator.columns(entry.of, slope, most=1).items()
    if slope and per_level(entry.runs) < LEAST:
        raise UsageError(
            f"probability.runs: expected at least 1400 ({REPEATS} repeats with {LEAST} runs "
            "per level), "
            f"got {entry.runs}"
        )
    method = (subset if slope else random)(evaluator.d, evaluator.plan.table.seed, entry.runs)
    with begun("probability", evaluator, entry.runs, output, how) as driver:
        report_nominal(driver, {name: k})
        if driver.nominal[k] < 0 and slope:
            raise UsageError(f'{name}: the nominal run fails; use method = "random"')
        estimate = driver.answer(method, k)
        found = estimate._asdict() | {"method": entry.method}
        if slope:
            found["random"] = REPEATS * per_level(entry.runs)
        if entry.below:
            complete = not driver.unjudged[k]
            found |= {"below": entry.below, "verdict": _verdict(estimate, entry.below, complete)}
        return Study(driver.path, driver.finish({"of": {name: found}}))


def _verdict(estimate: Estimate, below: float, complete: bool) -> str:
    """Return `met`, `NOT MET` or `undecided` for the condition that the probability is below a
    limit; complete: whether every run has a margin, without which it cannot be met.
    """
    if estimate.low > below:
        return "NOT MET"
    trusted = complete and not estimate.warning
    return "met" if estimate.high < below and trusted else "undecided"
