# SPDX-License-Identifier: BSD-2-Clause
"""How probable is a failure: random flights, subset simulation (Au & Beck 2001) with the chains of
Papaioannou et al. 2015, importance sampling. A flight fails where its margin is not positive.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.studies.campaign.stopping import clopper_pearson
from harness.studies.inquiry.flights import exercised
from harness.studies.inquiry.study import Probability, Study, begun, earlier, prepared, say_nominal

Array = NDArray[np.float64]

P0 = 0.1
"""Part of a level that is below the limit of the next one."""
ACCEPTED, WIDTH = 0.44, 0.6
"""Acceptance that chains strive for; part of a standard deviation that they begin with."""
REPEATS = 5
PER_NUMBER = 10
"""Flights per level for every number with which means of failures are centres: chance moves a mean
of m failures in d numbers by sqrt(d / m), most of it in numbers that do not matter.
"""
T95, T99 = 2.7764451051977987, 4.604094871415897
"""Quantiles of Student's distribution for 95 and 99 %, two-sided, of four degrees of freedom."""
Z95 = 1.959963984540054


class Level(NamedTuple):
    """One level of a subset simulation: the margin it ends at, the probability of less, and the
    part of the proposals that were accepted.
    """

    limit: float
    p: float
    accepted: float


class Estimate(NamedTuple):
    """Probability of a failure with its interval of 95 % and coefficient of variation; flights;
    levels: of all repeats; parts: probability of each repeat; warning: why not to trust it.
    """

    p: float
    low: float
    high: float
    cov: float
    flights: int
    levels: tuple[tuple[Level, ...], ...] = ()
    parts: tuple[float, ...] = ()
    warning: str = ""


Ask = Generator[Array, Array, Estimate]
Chains = Generator[Array, Array, tuple[Array, Array, float]]


def fails(y: Array) -> NDArray[np.bool_]:
    """Which flights fail; one without a margin does not."""
    return np.asarray(y <= 0)


def random(d: int, seed: int, flights: int, abreast: int = 200) -> Ask:
    """Random flights with the interval of Clopper and Pearson; their number is fixed beforehand."""
    failures = 0
    for first in range(0, flights, abreast):
        rows = range(first, min(first + abreast, flights))
        z = np.array([np.random.default_rng([seed, k]).standard_normal(d) for k in rows])
        failures += int(fails((yield z)).sum())
    low, high = clopper_pearson(failures, flights)
    p = failures / flights
    cov = math.sqrt((1 - p) / (p * flights)) if failures else math.inf
    return Estimate(p, low, high, cov, flights)


# ---- subset simulation


class Sampled(NamedTuple):
    """What one subset simulation ends with: probability and coefficient of variation, levels,
    flights, the numbers that fail, and whether it has reached any.
    """

    p: float
    cov: float
    levels: tuple[Level, ...]
    flights: int
    failures: Array
    reached: bool


def one_subset(
    d: int, seed: Sequence[int], n: int, most: int = 20
) -> Generator[Array, Array, Sampled]:
    """One subset simulation with n flights per level, of at most so many levels."""
    rng = np.random.default_rng(list(seed))
    count = int(n * P0)
    z = rng.standard_normal((n, d))
    y = exercised((yield z))
    levels, variance, flights, accepted = [], 0.0, n, 1.0
    chains = np.arange(n)[:, None]  # rows of each chain: n of one flight
    p = 1.0
    while True:
        order = np.argsort(y, kind="stable")
        limit = max(float(y[order[count - 1 : count + 1]].mean()), 0.0)
        below = y <= limit if limit == 0 else y <= y[order[count - 1]]
        part = float(below.mean())
        variance += _variance(below[chains], part)
        levels.append(Level(limit, p * part, accepted))
        p *= part
        stuck = len(levels) > 1 and limit >= levels[-2].limit and limit > 0
        if limit == 0 or len(levels) == most or stuck:
            return Sampled(p, math.sqrt(variance), tuple(levels), flights, z[below], limit == 0)
        z, y, accepted = yield from _level(rng, z[order[:count]], y[order[:count]], limit, n)
        chains = np.arange(n).reshape(-1, count).T
        flights += n - count


def _level(rng: np.random.Generator, z: Array, y: Array, limit: float, n: int) -> Chains:
    """Rows below a limit, n of them: chains abreast from the seeds z, whose width adapts to what is
    accepted.

    v = sqrt(1 - s^2) z + s w,  w normal, keeps the normal distribution; v is taken where y(v) <=
    limit.
    """
    rows, values, width, taken = [z], [y], WIDTH, []
    for k in range(1, n // len(z)):
        s = min(1.0, width)
        tried = math.sqrt(1 - s * s) * z + s * rng.standard_normal(z.shape)
        told = exercised((yield tried))
        better = told <= limit
        z, y = np.where(better[:, None], tried, z), np.where(better, told, y)
        rows.append(z)
        values.append(y)
        taken.append(float(better.mean()))
        width = math.exp(math.log(s) + (taken[-1] - ACCEPTED) / math.sqrt(k))
    return np.concatenate(rows), np.concatenate(values), float(np.mean(taken))


def _variance(below: NDArray[np.bool_], p: float) -> float:
    """Squared coefficient of variation of the share p of rows (chains, length) below a limit."""
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


def per_level(flights: int) -> int:
    """Flights per level, a multiple of ten, with which repeats down to some 1e-6 keep a budget."""
    return 10 * int(flights / REPEATS / (1 + 5 * (1 - P0)) / 10)


def _most(flights: float, n: int) -> int:
    """Levels of n flights that a budget allows."""
    return 1 + int((flights - n) / (n * (1 - P0)) + 1e-9)


def subset(d: int, seed: int, flights: int) -> Ask:
    """Independent repeats of subset simulation, with the interval of their scatter: that of a
    single one is too short where its levels lead elsewhere.
    """
    n, found = per_level(flights), list[Sampled]()
    for k in range(REPEATS):  # what a repeat leaves over is for those that follow
        left = flights - sum(each.flights for each in found)
        found.append((yield from one_subset(d, [seed, k], n, _most(left / (REPEATS - k), n))))
    return pooled(found)


def pooled(found: Sequence[Sampled]) -> Estimate:
    """The estimate of independent repeats."""
    parts = tuple(each.p for each in found)
    flights, levels = sum(e.flights for e in found), tuple(e.levels for e in found)
    if not all(each.reached for each in found):
        limits = [each.levels[-1].limit for each in found]
        warning = (
            f"{sum(e.reached for e in found)} of {len(found)} repeats reached a failure, others "
            f"ended at a margin of {max(limits):.4g} with a probability of {max(parts):.2g}: "
            f"this is an upper bound"
        )
        return Estimate(max(parts), 0.0, max(parts), math.inf, flights, levels, parts, warning)
    logs = np.log(np.maximum(parts, 1e-300))
    scatter = float(logs.std(ddof=1)) if len(logs) > 1 else math.nan
    own = math.sqrt(float(np.mean([each.cov**2 for each in found])))
    astray = scatter > 2 * own
    warning = "the levels of the repeats led to different regions, do not trust this"
    # repeats that differ by more than chance are not normal: the wider quantile
    half = (T99 if astray else T95) * max(scatter, own / 2) / math.sqrt(len(logs))
    middle, p = float(logs.mean()), float(np.mean(parts))
    bounds = min(math.exp(middle - half), p), max(math.exp(middle + half), p)
    cov = max(scatter, own) / math.sqrt(len(logs))
    return Estimate(p, *bounds, cov, flights, levels, parts, warning if astray else "")


# ---- importance sampling


def importance(d: int, seed: int, flights: int, centres: Array, failures: int | None = None) -> Ask:
    """Flights about the centres (k, d), weighted by the ratio of the densities.

    p = mean(fails w),   w = phi(z) / mean over k of phi(z - c_k)

    Centres must be means of failures: a single one that was found carries chance in all numbers
    that do not matter, and a region without a centre is not seen. failures: how many the centres
    are means of; an estimate by less than half of `fewest` is too small more often than not.
    """
    rng = np.random.default_rng([seed, len(centres)])
    z = centres[rng.integers(len(centres), size=flights)] + rng.standard_normal((flights, d))
    y = yield z
    exponents = z @ centres.T - (centres**2).sum(axis=1) / 2  # of phi(z - c) / phi(z)
    largest = exponents.max(axis=1)
    mixture = largest + np.log(np.exp(exponents - largest[:, None]).mean(axis=1))
    weighted = np.where(fails(y), np.exp(-mixture), 0.0)
    p = float(weighted.mean())
    if p == 0:
        none = "no flight near the centres fails"
        return Estimate(0.0, 0.0, 1.0, math.inf, flights, warning=none)
    cov = float(weighted.std(ddof=1)) / p / math.sqrt(flights)
    warning, enough = "", fewest(d) // 2
    if failures is not None and failures < enough:
        warning = (
            f"{failures} failures are too few for centres in {d} numbers, the estimate may be far "
            f"too small: at least {enough}"
        )
    low, high = max(0.0, p * (1 - Z95 * cov)), p * (1 + Z95 * cov)
    return Estimate(p, low, high, cov, flights, warning=warning)


def fewest(d: int) -> int:
    """Flights per level whose failures have means fit for centres in d numbers."""
    return max(50, PER_NUMBER * d)


def regions(failures: Array) -> Array:
    """Means (k, d) of the regions of failures (n, d) that a subset simulation ended with.

    Within a region numbers that do not matter vary by 1; a set that varies by more along some
    direction than chance explains (the edge of Marchenko and Pastur) is split there.
    """
    n, d = failures.shape
    middle = failures.mean(axis=0)
    if n < 10:
        return np.array([middle])
    _, sizes, directions = np.linalg.svd(failures - middle, full_matrices=False)
    if sizes[0] ** 2 / n <= 1.5 * (1 + math.sqrt(4 * d / n)) ** 2:
        return np.array([middle])
    side = (failures - middle) @ directions[0] > 0
    return np.concatenate([regions(failures[side]), regions(failures[~side])])


def centred(d: int, seed: int, flights: int) -> Ask:
    """Independent repeats of importance sampling, each about the means of the failures that a
    subset simulation of half of its flights ends with; the scatter of the repeats shows a region
    that one of them has missed.
    """
    found, pilots, n = [], [], per_level(flights // 2)
    for k in range(REPEATS):
        pilot = yield from one_subset(d, [seed, k], n, _most(flights / REPEATS / 2, n))
        pilots.append(pilot)
        if pilot.reached:
            left = flights // REPEATS - pilot.flights
            each = yield from importance(d, seed + k, left, regions(pilot.failures))
            pilot = pilot._replace(p=each.p, cov=each.cov, flights=pilot.flights + each.flights)
        found.append(pilot)
    estimate, before = pooled(found), pooled(pilots)
    if estimate.warning or (before.low <= estimate.high and estimate.low <= before.high):
        return estimate
    doubt = f"the subset simulations before it say {before.p:.2g}, do not trust this"
    return estimate._replace(warning=doubt)


# ---- the study


def probability(definition: Any, output: str | Path, **how: Any) -> Study:
    """Estimate how probable it is that a requirement fails.

    definition: path of a campaign TOML with a table [probability], or the table itself; output:
    OUT.zarr; how: as for sensitivity(). Raises UsageError, StructureError.
    """
    entry, flights = prepared(Probability, definition, how)
    slope = entry.method != "random"
    ((name, k),) = flights.columns(entry.of, slope, most=1).items()
    method = _method(entry, name, flights.d, flights.plan.table.seed)
    with begun("probability", flights, entry.flights, output, how) as driver:
        say_nominal(driver, {name: k})
        if (margin := driver.nominal[k]) <= 0 and slope:
            raise UsageError(f"{name}: the nominal flight fails, with a margin of {margin:.4g}")
        estimate = driver.answer(method, k)
        found = estimate._asdict() | {"method": entry.method}
        if entry.below:
            found |= {"below": entry.below, "verdict": _verdict(estimate, entry.below)}
        return Study(driver.path, driver.finish({"of": {name: found}}))


def _verdict(estimate: Estimate, below: float) -> str:
    """Whether a probability is below what is required."""
    if estimate.low > below:
        return "NOT MET"
    return "met" if estimate.high < below and not estimate.warning else "undecided"


def _method(entry: Probability, name: str, d: int, seed: int) -> Ask:
    """The method of a table [probability] of a requirement; UsageError if its flights are few."""
    if entry.method == "random":
        return random(d, seed, entry.flights)
    if entry.method == "subset":
        if per_level(entry.flights) < 50:
            raise UsageError("probability.flights: at least 1400, five repeats of 50 per level")
        return subset(d, seed, entry.flights)
    if entry.centres:
        failed = _failed(entry.centres, name, d)
        return importance(d, seed, entry.flights, regions(failed), len(failed))
    if per_level(entry.flights // 2) < fewest(d):
        least = f"{math.ceil(55 * fewest(d) / 100)}00"
        rule = f"{fewest(d)} flights per level for centres in {d} numbers"
        raise UsageError(f"probability.flights: at least {least}, {rule}")
    return centred(d, seed, entry.flights)


def _failed(path: str, name: str, d: int) -> Array:
    """Numbers of the flights of another study that fail a requirement; UsageError if none does."""
    numbers, margins = earlier("probability.centres", Path(path), [name], d)
    if not len(failed := numbers[fails(margins[:, 0])]):
        raise UsageError(f"probability.centres: no flight of {path} fails {name}")
    return failed
