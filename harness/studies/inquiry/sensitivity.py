# SPDX-License-Identifier: BSD-2-Clause
"""What matters: elementary effects (Morris 1991), variance-based indices (Sobol 1993, Saltelli et
al. 2010), dependence in rows that are there already (HSIC, Gretton et al. 2005).

A factor is a group of numbers that move together, so that a vector or an inertia is one factor.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.studies.campaign.factors import normal_quantile

Array = NDArray[np.float64]
Ask = Generator[Array, Array, "Effects"]
Group = Sequence[int]
"""Columns of the numbers of one factor."""

LEVELS, STEP = np.array([0.125, 0.375]), 0.5
"""Morris moves numbers between 0 and 1 by STEP, from one of the lower levels up or back."""
RESAMPLED = 200
"""Resamples of a bootstrap, permutations of a test."""
ROWS = 500
"""Rows that HSIC looks at: its matrices have so many squared."""


class Effects(NamedTuple):
    """What factors do to a margin, one element per factor.

    value: mean absolute effect (Morris, in the unit of the margin), total index (Sobol), R2 (HSIC);
    low, high: interval of 95 % (HSIC: value itself); first: first-order index (Sobol); p:
    probability of such a value for a factor without effect (HSIC); died: flights without a margin.
    """

    method: str
    value: Array
    low: Array
    high: Array
    first: Array | None = None
    p: Array | None = None
    died: int = 0


def alive(y: Array) -> tuple[Array, int]:
    """Margins with the least finite one in place of flights that died, and how many did."""
    dead = ~np.isfinite(y)
    least = y[~dead].min() if (~dead).any() else 0.0
    return np.where(dead, least, y), int(dead.sum())


def morris(groups: Sequence[Group], d: int, paths: int, seed: int) -> Ask:
    """Mean absolute effect of each factor over paths of k + 1 flights, each of which moves one
    factor after the other, in random order: mu* = mean |y_after - y_before| / STEP.
    """
    rng = np.random.default_rng(seed)
    rows, moved = [], []
    for _ in range(paths):
        low, up = rng.choice(LEVELS, d), rng.random(d) < 0.5
        order = rng.permutation(len(groups))
        rows.append(low + STEP * up)
        for k in order:
            up[list(groups[k])] ^= True
            rows.append(low + STEP * up)
        moved.append(order)
    y, died = alive((yield normal_quantile(np.array(rows))))
    steps = np.abs(np.diff(y.reshape(paths, -1), axis=1)) / STEP
    effects = np.empty((paths, len(groups)))
    np.put_along_axis(effects, np.array(moved), steps, axis=1)
    return Effects("morris", effects.mean(axis=0), *_resampled(effects), died=died)


def _resampled(effects: Array) -> tuple[Array, Array]:
    """Interval of 95 % of the mean over rows, by bootstrap."""
    rng = np.random.default_rng(len(effects))
    rows = rng.integers(len(effects), size=(RESAMPLED, len(effects)))
    low, high = np.percentile(effects[rows].mean(axis=1), (2.5, 97.5), axis=0)
    return low, high


def sobol(groups: Sequence[Group], d: int, n: int, seed: int) -> Ask:
    """First-order and total indices by n (k + 2) flights, n a power of two.

    S = mean(f_B (f_AB - f_A)) / V,   T = mean((f_A - f_AB)^2) / 2 V.
    """
    from scipy.stats.qmc import Sobol

    u = np.asarray(Sobol(2 * d, rng=seed).random(n)).clip(2**-53, 1 - 2**-53)
    a, b = u[:, :d], u[:, d:]
    rows = [a, b]
    for group in groups:
        mixed = a.copy()
        mixed[:, list(group)] = b[:, list(group)]
        rows.append(mixed)
    y, died = alive((yield normal_quantile(np.concatenate(rows))))
    f_a, f_b, *f_ab = y.reshape(len(rows), n) - y[: 2 * n].mean()
    first, total = _indices(f_a, f_b, np.array(f_ab))
    draws = np.random.default_rng(seed).integers(n, size=(RESAMPLED, n))
    again = [_indices(f_a[k], f_b[k], np.array(f_ab)[:, k])[1] for k in draws]
    low, high = np.percentile(again, (2.5, 97.5), axis=0)
    return Effects("sobol", total, low, high, first, died=died)


def _indices(f_a: Array, f_b: Array, f_ab: Array) -> tuple[Array, Array]:
    variance = np.concatenate([f_a, f_b]).var() or 1.0
    first = (f_b * (f_ab - f_a)).mean(axis=1) / variance
    return first, ((f_a - f_ab) ** 2).mean(axis=1) / (2 * variance)


def hsic(groups: Sequence[Group], x: Array, y: Array, seed: int = 0) -> Effects:
    """Dependence of margins y (rows,) on factors in numbers x (rows, d) that have flown.

    R2 = HSIC(x, y) / sqrt(HSIC(x, x) HSIC(y, y)),   HSIC = trace(K_x H K_y H), H = I - 1/n,

    with Gaussian kernels as wide as the median distance, of the ranks of y, so that neither a cliff
    nor a flight that died (the lowest rank) decides alone; p by permutations.
    """
    rng = np.random.default_rng(seed)
    if len(y) > ROWS:
        chosen = rng.choice(len(y), ROWS, replace=False)
        x, y = x[chosen], y[chosen]
    k_y = _kernel(_ranks(y)[:, None])
    orders = [rng.permutation(len(y)) for _ in range(RESAMPLED)]
    value, p = np.zeros(len(groups)), np.ones(len(groups))
    for k, group in enumerate(groups):
        k_x = _kernel(x[:, list(group)])
        size = np.sqrt((k_x * k_x).sum() * (k_y * k_y).sum()) or 1.0
        value[k] = (k_x * k_y).sum() / size
        by_chance = [(k_x * k_y[np.ix_(o, o)]).sum() / size for o in orders]
        p[k] = (1 + np.count_nonzero(np.array(by_chance) >= value[k])) / (1 + RESAMPLED)
    return Effects("given", value, value, value, p=p, died=int((~np.isfinite(y)).sum()))


def _ranks(y: Array) -> Array:
    """Between 0 and 1, equal ones share theirs."""
    _, place, count = np.unique(y, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(count) - (count - 1) / 2)[place] / len(y))


def _kernel(x: Array) -> Array:
    """Centred Gaussian kernel matrix of rows."""
    squares = np.zeros((len(x), len(x)))
    for column in x.T:
        squares += np.subtract.outer(column, column) ** 2
    between = squares[np.triu_indices(len(x), 1)]
    k = np.exp(-squares / (np.median(between[between > 0]) if between.any() else 1.0))
    return np.asarray(k - k.mean(axis=0) - k.mean(axis=1)[:, None] + k.mean())
