# SPDX-License-Identifier: BSD-2-Clause
"""Probability of a failure by random runs or by subset simulation (Au & Beck 2001) with the chains
of Papaioannou et al. 2015. A run fails where its margin is negative.

Subset simulation follows decreasing margins. A failure towards which the margin does not decrease
can be found only by the random runs at the beginning. Importance sampling gives no evidence of
a region without a centre. With a share of random runs as a remedy (a defensive mixture), its bound
is no lower than the bound by these runs alone. Therefore it is not offered.
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
"""Share of the runs of a level that is below the limit of the next one."""
ACCEPTED, WIDTH = 0.44, 0.6
"""Target acceptance rate of the chains; their first step in standard deviations."""
REPEATS, LEAST = 5, 50
"""Number of independent simulations; smallest number of runs per level of each."""
T95 = 2.7764451051977987
"""Quantile of Student's distribution for 95 %, two-sided, of four degrees of freedom."""


class Level(NamedTuple):
    """Level of a subset simulation: its limit of the margin, the probability of a smaller margin,
    and the share of accepted proposals.
    """

    limit: float
    p: float
    accepted: float


class Estimate(NamedTuple):
    """Probability of a failure with its 95 % interval and coefficient of variation; runs: number
    of runs; levels: of all repetitions; parts: probability of each repetition; warning: reason
    not to trust it.
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
    """Return the estimate of random runs with the interval of Clopper and Pearson for a fixed
    number of runs.
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
    """Result of one subset simulation: probability and coefficient of variation, levels, runs, and
    whether it reached a failure.
    """

    p: float
    cov: float
    levels: tuple[Level, ...]
    runs: int
    reached: bool


def one_subset(
    d: int, seed: Sequence[int], n: int, most: int = 20
) -> Generator[Array, Array, Sampled]:
    """Return the result of one subset simulation with n runs per level and at most
    `most` levels.
    """
    rng = np.random.default_rng(list(seed))
    count = int(n * P0)
    z = rng.standard_normal((n, d))
    y = exercised((yield z))
    levels, variance, accepted = list[Level](), 0.0, 1.0
    chains = np.arange(n)[:, None]  # rows of each chain: n chains of one run
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
    """Return n rows below a limit: parallel chains from the seeds z, whose width adapts to the
    acceptance rate.

    v = sqrt(1 - s^2) z + s w, with w normal, preserves the normal distribution; v is accepted where
    y(v) <= limit.
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
    """Return the squared coefficient of variation of the share p of rows (chains, length) below a
    limit.
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
    """Return the runs per level, a multiple of ten, with which repetitions down to about 1e-6 meet
    a budget.
    """
    return 10 * int(runs / REPEATS / (1 + 5 * (1 - P0)) / 10)


def _most(runs: float, n: int) -> int:
    """Return the number of levels of n runs that a budget of runs allows."""
    return 1 + int((runs - n) / (n * (1 - P0)) + 1e-9)


def subset(d: int, seed: int, runs: int) -> Method:
    """Return the estimate of independent repetitions of subset simulation, with the interval of
    their scatter. The interval of a single one is too short if its levels lead elsewhere.
    """
    n, found = per_level(runs), list[Sampled]()
    for k in range(REPEATS):  # unused runs go to the next repeats
        left = runs - sum(each.runs for each in found)
        found.append((yield from one_subset(d, [seed, k], n, _most(left / (REPEATS - k), n))))
    return pooled(found)


def pooled(found: Sequence[Sampled]) -> Estimate:
    """Return the estimate of independent repetitions."""
    parts = tuple(each.p for each in found)
    runs, levels = sum(e.runs for e in found), tuple(e.levels for e in found)
    if not all(each.reached for each in found):
        limits = [each.levels[-1].limit for each in found]
        warning = (
            f"{sum(e.reached for e in found)} of {len(found)} repeats reached a failure, the "
            "others "
            f"ended at a margin of {max(limits):.4g} with a probability of {max(parts):.2g}: "
            f"p is an upper bound"
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
    """Estimate how probable it is that a requirement fails.

    definition: path of a campaign TOML with a table [probability], or the table itself; output:
    OUT.zarr; how: as for sensitivity(). Raises UsageError, StructureError.
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
    """Return whether a probability is below the required one; complete: all runs have a
    margin.
    """
    if estimate.low > below:
        return "NOT MET"
    trusted = complete and not estimate.warning
    return "met" if estimate.high < below and trusted else "undecided"
