# SPDX-License-Identifier: BSD-2-Clause
"""Sensitivity of margins to factors: elementary effects (Morris 1991), variance-based indices
(Sobol 1993, Saltelli et al. 2010), and statistical dependence in completed runs (HSIC,
Hilbert-Schmidt independence criterion, Gretton et al. 2005).

A factor is a group of coordinates that move together, so that a vector or an inertia is one factor.
"""

from __future__ import annotations

from collections.abc import Generator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.results.result import Array
from harness.studies.analyses.driver import run_method, write_estimate
from harness.studies.analyses.evaluator import unjudged
from harness.studies.analyses.study import Sensitivity, Study, begun, prepared, report_nominal
from harness.studies.campaign.factors import normal_quantile
from harness.studies.campaign.store import Store
from harness.studies.campaign.summary import mean_ranks, rank_correlation
from harness.studies.campaign.worker import PENDING

Method = Generator[Array, Array, "Effects"]
Group = Sequence[int]
"""Indices of the coordinates of one factor."""

LEVELS, STEP = np.array([0.125, 0.375]), 0.5
"""Method of Morris: a number between 0 and 1 is moved by STEP, from one of LEVELS up or back."""
RESAMPLED = 200
"""Number of resamples of a bootstrap, and of permutations of a significance test."""
ROWS = 500
"""Largest number of rows that HSIC evaluates: its matrices are (ROWS, ROWS)."""


class Effects(NamedTuple):
    """Effects of factors on a margin; all arrays have one element per factor.

    method: morris, sobol or given (HSIC); value: mean absolute effect in the unit of the margin
    (Morris), total index (Sobol), R2 (HSIC); low, high: 95 % interval of the value (HSIC: the value
    itself); first: first-order index (Sobol); p: probability that a factor without effect has at
    least this value (HSIC); failed: number of runs without a finite margin, which count as runs
    with the smallest finite margin.
    """

    method: str
    value: Array
    low: Array
    high: Array
    first: Array | None = None
    p: Array | None = None
    failed: int = 0


def with_finite(y: Array) -> tuple[Array, int]:
    """Return margins with the smallest finite margin in place of NaN and infinite ones, and the
    number of replaced margins.
    """
    finite = np.isfinite(y)
    least = y[finite].min() if finite.any() else 0.0
    return np.where(finite, y, least), int((~finite).sum())


def morris(groups: Sequence[Group], d: int, paths: int, seed: int) -> Method:
    """Return the mean absolute effects by the method of Morris: mu* = mean |y_after - y_before| /
    STEP.

    groups: indices of the coordinates of each of the k factors; d: number of coordinates; paths:
    number of paths. A path has k + 1 runs, between which one factor after the other is moved, in
    random order.
    """
    rng = np.random.default_rng(seed)
    rows, moved = zip(*(_path(groups, d, rng) for _ in range(paths)), strict=True)
    y, failed = with_finite((yield normal_quantile(np.concatenate(rows))))
    steps = np.abs(np.diff(y.reshape(paths, -1), axis=1)) / STEP
    effects = np.empty((paths, len(groups)))
    np.put_along_axis(effects, np.array(moved), steps, axis=1)
    return Effects("morris", effects.mean(axis=0), *_resampled(effects), failed=failed)


def _path(groups: Sequence[Group], d: int, rng: np.random.Generator) -> tuple[Array, Any]:
    """Return the numbers between 0 and 1 for the runs of one path (k + 1, d), and the order in
    which its k factors are moved.
    """
    low, up = rng.choice(LEVELS, d), rng.random(d) < 0.5
    order = rng.permutation(len(groups))
    rows = [low + STEP * up]
    for k in order:
        up[list(groups[k])] ^= True
        rows.append(low + STEP * up)
    return np.array(rows), order


def _resampled(effects: Array) -> tuple[Array, Array]:
    """Return the limits (factors,) of the 95 % interval of the mean effects over all paths, by
    bootstrap; effects: (paths, factors).
    """
    rng = np.random.default_rng(len(effects))
    rows = rng.integers(len(effects), size=(RESAMPLED, len(effects)))
    low, high = np.percentile(effects[rows].mean(axis=1), (2.5, 97.5), axis=0)
    return low, high


def sobol(groups: Sequence[Group], d: int, n: int, seed: int) -> Method:
    """Return the first-order indices S and the total indices T of k factors, from n (k + 2) runs.

    S = mean(f_B (f_AB - f_A)) / V,   T = mean((f_A - f_AB)^2) / 2 V,

    with the margins f_A and f_B of two independent samples of n runs, f_AB of sample A with one
    factor from B, and the variance V. groups: indices of the coordinates of each factor; d: number
    of coordinates; n: a power of two.
    """
    from scipy.stats.qmc import Sobol

    u = np.asarray(Sobol(2 * d, rng=seed).random(n)).clip(2**-53, 1 - 2**-53)
    a, b = u[:, :d], u[:, d:]
    rows = [a, b, *(np.where(np.isin(np.arange(d), group), b, a) for group in groups)]
    y, failed = with_finite((yield normal_quantile(np.concatenate(rows))))
    f_a, f_b, *f_ab = y.reshape(len(rows), n) - y[: 2 * n].mean()
    first, total = _indices(f_a, f_b, np.array(f_ab))
    draws = np.random.default_rng(seed).integers(n, size=(RESAMPLED, n))
    again = [_indices(f_a[k], f_b[k], np.array(f_ab)[:, k])[1] for k in draws]
    low, high = np.percentile(again, (2.5, 97.5), axis=0)
    return Effects("sobol", total, low, high, first, failed=failed)


def _indices(f_a: Array, f_b: Array, f_ab: Array) -> tuple[Array, Array]:
    variance = np.concatenate([f_a, f_b]).var() or 1.0
    first = (f_b * (f_ab - f_a)).mean(axis=1) / variance
    return first, ((f_a - f_ab) ** 2).mean(axis=1) / (2 * variance)


def hsic(groups: Sequence[Group], x: Array, y: Array) -> Effects:
    """Return the dependence of margins y (rows,) on each factor in completed runs with coordinates
    x (rows, d); groups: indices of the coordinates of each factor.

    R2 = HSIC(x, y) / sqrt(HSIC(x, x) HSIC(y, y)),   HSIC = trace(K_x H K_y H), H = I - 1/n,

    with Gaussian kernels as wide as the median distance. Ranks are used in place of the margins y,
    so that neither a discontinuity nor a failed run (lowest rank) dominates. The p value is the
    share of random permutations of y that give at least this R2.
    """
    rng = np.random.default_rng(0)
    if len(y) > ROWS:
        chosen = rng.choice(len(y), ROWS, replace=False)
        x, y = x[chosen], y[chosen]
    k_y = _kernel(mean_ranks(y)[:, None] / len(y))
    orders = [rng.permutation(len(y)) for _ in range(RESAMPLED)]
    found = [_dependence(_kernel(x[:, list(group)]), k_y, orders) for group in groups]
    value, p = np.array(found).T
    return Effects("given", value, value, value, p=p, failed=int((~np.isfinite(y)).sum()))


def _dependence(k_x: Array, k_y: Array, orders: Sequence[Any]) -> tuple[float, float]:
    """Return R2 of two centred kernel matrices (rows, rows), and its p value: the share of the
    permutations `orders` for which it is at least as large.
    """
    size = np.sqrt((k_x * k_x).sum() * (k_y * k_y).sum()) or 1.0
    value = (k_x * k_y).sum() / size
    by_chance = np.array([(k_x * k_y[np.ix_(o, o)]).sum() / size for o in orders])
    return value, (1 + np.count_nonzero(by_chance >= value)) / (1 + RESAMPLED)


def _kernel(x: Array) -> Array:
    """Return the centred Gaussian kernel matrix (rows, rows) of the points x (rows, elements)."""
    squares = np.zeros((len(x), len(x)))
    for each in x.T:
        squares += np.subtract.outer(each, each) ** 2
    between = squares[np.triu_indices(len(x), 1)]
    k = np.exp(-squares / (np.median(between[between > 0]) if between.any() else 1.0))
    return np.asarray(k - k.mean(axis=0) - k.mean(axis=1)[:, None] + k.mean())


# ---- analysis


def sensitivity(definition: Any, output: str | Path | None = None, **how: Any) -> Study:
    """Estimate the effect of each factor of a campaign on the margin of each requirement.

    definition: path of a campaign TOML with a table [sensitivity], or the table itself; or the
    OUT.zarr of a complete campaign, whose runs are evaluated without further runs. output: OUT.zarr
    of the new runs; how: workers, lanes, resume, progress and notify as for campaign(). Raises
    UsageError, StructureError.
    """
    if not isinstance(definition, Mapping) and Path(definition).suffix == ".zarr":
        return Study(Path(definition), of_dataset(Path(definition)))
    if output is None:
        raise UsageError("an analysis needs a dataset to write: add -o OUT.zarr")
    entry, evaluator = prepared(Sensitivity, definition, how)
    of, groups = evaluator.columns(entry.of, slope=False), [*evaluator.groups.values()]
    count, per = _count(entry, len(groups))
    method = {"morris": morris, "sobol": sobol}[entry.method]
    generate = partial(method, groups, evaluator.d, count, evaluator.plan.table.seed)
    if count * per != entry.runs:
        evaluator.notify(f"{entry.method}: {count} x {per} = {count * per} runs")
    with begun("sensitivity", evaluator, count * per, output, how) as driver:
        report_nominal(driver, of)
        numbers = next(generate())  # the same runs for each requirement
        margins = driver.evaluate(numbers)
        found = {}
        for name, k in of.items():
            if not np.isfinite(margins[:, k]).any():
                raise UsageError(f"{name}: no run of {len(margins)} has a finite margin")
            effects = run_method(generate(), lambda _, k=k: margins[:, k])  # type: ignore[misc]
            found[name] = effects._asdict() | {"signs": _signs(groups, numbers, margins[:, k])}
        estimate = {"of": found, "factors": [*evaluator.groups], "method": entry.method}
        return Study(driver.path, driver.finish(estimate))


def _count(entry: Sensitivity, factors: int) -> tuple[int, int]:
    """Return the number of paths (Morris) or points (Sobol) for the requested runs, and the runs
    that each of them needs; raise UsageError if there are fewer than two paths.
    """
    per = factors + (1 if entry.method == "morris" else 2)
    count = max(1, entry.runs // per)
    if entry.method == "sobol":
        count = 1 << (count - 1).bit_length()
    elif count < 2:
        raise UsageError(
            f"sensitivity.runs: expected at least {2 * per} (two paths of {per} runs), got "
            f"{entry.runs}"
        )
    return count, per


def _signs(groups: list[list[int]], numbers: Array, y: Array) -> list[float]:
    """Return for each factor the rank correlation of the margins y (rows,) with the coordinate of
    the factor that has the largest absolute correlation; numbers: coordinates (rows, d).
    """
    signs = []
    for group in groups:
        each = np.nan_to_num([rank_correlation(numbers[:, k], y) for k in group])
        signs.append(float(each[np.argmax(np.abs(each))]))
    return signs


# ---- analysis of a completed campaign

LEAST = 50
"""Smallest number of completed runs that a campaign must have for this analysis."""


def of_dataset(path: Path) -> Store:
    """Compute the dependence of every margin on every factor in the runs of a completed campaign,
    and store it in the dataset of the campaign as its `estimate`; return the dataset.
    """
    store = Store.open(path)
    if "margin" not in store.group:
        raise UsageError(
            f"{path}: has no margins; add [requirements] to the campaign and run it again"
        )
    completed = store.array("status") != PENDING
    if completed.sum() < LEAST:
        raise UsageError(f"{path}: expected at least {LEAST} completed runs, got {completed.sum()}")
    seeds = store.definition()[0].get("seeds", ())
    names = [n for n in store.names("factor") if n not in seeds]
    scaled = [_scaled(store.array(name), completed) for name in names]
    ends = np.cumsum([each.shape[1] for each in scaled])
    groups = [each.tolist() for each in np.split(np.arange(ends[-1]), ends[:-1])]
    x, margins = np.concatenate(scaled, axis=1), store.array("margin")[completed]
    found, counts = {}, {}
    for name, y in zip(map(str, store.array("requirement")), margins.T, strict=True):
        evidence = ~unjudged(y)
        counts[name] = np.count_nonzero(~evidence)
        if np.isfinite(y).any():
            effects = hsic(groups, x[evidence], y[evidence])
            found[name] = {k: getattr(effects, k) for k in ("method", "value", "p", "failed")}
    write_estimate(store, {"of": found, "factors": names, "method": "given", "unjudged": counts})
    store.group.attrs["kind"] = "given"
    return store


def _scaled(values: Any, completed: NDArray[np.bool_]) -> Array:
    """Return the values of a factor in completed runs (runs, elements), scaled to mean 0 and
    standard deviation 1. Texts are numbered first.
    """
    if values.dtype.kind not in "fiu":
        values = np.unique(values, return_inverse=True)[1]
    flat = values.reshape(len(values), -1)[completed].astype(np.float64)
    deviation = np.where(np.ptp(flat, axis=0) > 0, flat.std(axis=0), 1)
    return np.asarray((flat - flat.mean(axis=0)) / deviation)
