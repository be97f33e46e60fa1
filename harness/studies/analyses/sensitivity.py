# SPDX-License-Identifier: BSD-2-Clause
"""Sensitivity of margins to factors: elementary effects (Morris 1991) and variance-based indices
(Sobol 1993, Saltelli et al. 2010).

A factor is drawn from a group of standard normal coordinates, which move together, so that a vector
or an inertia is one factor.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import msgspec
import numpy as np
from msgspec import Meta

from harness.errors import UsageError
from harness.results.result import Array
from harness.studies.analyses.driver import Names, begun, prepared, report_nominal
from harness.studies.analyses.study import Study
from harness.studies.campaign.factors import normal_quantile
from harness.studies.campaign.summary import rank_correlation
from harness.system.tables import Count

Group = Sequence[int]
"""Indices of the standard normal coordinates from which one factor is drawn."""
Design = tuple[Array, Callable[[Array], "Effects"]]
"""Standard normal coordinates (rows, d) of all runs of a method, and the function that computes the
effects of the factors from the margins of a requirement in these runs (rows,).
"""
Method = Annotated[Literal["morris", "sobol"], Meta(description="morris or sobol")]

LEVELS, STEP = np.array([0.125, 0.375]), 0.5
"""Method of Morris: each coordinate of a factor, before it is converted to a standard normal
coordinate, is a number between 0 and 1, one of LEVELS or of LEVELS + STEP. A move of the factor
adds STEP to each of these numbers or subtracts STEP from it.
"""
RESAMPLED = 200
"""Number of resamples of a bootstrap."""


class Sensitivity(msgspec.Struct):
    """Entries of the table [sensitivity]; of: name or names of requirements ("": all); method:
    morris or sobol; runs: about how many runs to perform.
    """

    of: Names = ""
    method: Method = "morris"
    runs: Count = 130


class Effects(NamedTuple):
    """Effects of the factors on the margin of one requirement; all arrays have one element per
    factor.

    value: mean absolute effect in the unit of the margin (Morris), or total index (Sobol); low,
    high: 95 % interval of the value; first: first-order index (Sobol); failed: number of runs
    without a finite margin, which count as runs with the smallest finite margin.
    """

    value: Array
    low: Array
    high: Array
    first: Array | None = None
    failed: int = 0


def with_finite(y: Array) -> tuple[Array, int]:
    """Return the margins y with the smallest finite margin in place of each NaN or infinite one,
    and the number of replaced margins.
    """
    finite = np.isfinite(y)
    least = y[finite].min() if finite.any() else 0.0
    return np.where(finite, y, least), int((~finite).sum())


def morris(groups: Sequence[Group], d: int, paths: int, seed: int) -> Design:
    """Return the design of the method of Morris, which computes the mean absolute effect of each
    factor: mu* = mean |y_after - y_before| / STEP.

    groups: indices of the coordinates of each of the k factors; d: number of coordinates; paths:
    number of paths. A path has k + 1 runs; from one run to the next, one factor is moved. Every
    path moves the factors in another random order.
    """
    rng = np.random.default_rng(seed)
    rows, moved = zip(*(_path(groups, d, rng) for _ in range(paths)), strict=True)

    def effects(margins: Array) -> Effects:
        y, failed = with_finite(margins)
        steps = np.abs(np.diff(y.reshape(paths, -1), axis=1)) / STEP
        each = np.empty((paths, len(groups)))
        np.put_along_axis(each, np.array(moved), steps, axis=1)
        return Effects(each.mean(axis=0), *_resampled(each), failed=failed)

    return normal_quantile(np.concatenate(rows)), effects


def _path(groups: Sequence[Group], d: int, rng: np.random.Generator) -> tuple[Array, Any]:
    """Return the runs of one path (k + 1, d) as numbers between 0 and 1, and the order in which the
    k factors are moved.

    groups: indices of the columns of each factor; d: number of columns.
    """
    low, up = rng.choice(LEVELS, d), rng.random(d) < 0.5
    order = rng.permutation(len(groups))
    rows = [low + STEP * up]
    for k in order:
        up[list(groups[k])] ^= True
        rows.append(low + STEP * up)
    return np.array(rows), order


def _resampled(effects: Array) -> tuple[Array, Array]:
    """Return the lower limits (factors,) and the upper limits (factors,) of the 95 % intervals of
    the mean effects over all paths, by bootstrap; effects: (paths, factors).
    """
    rng = np.random.default_rng(len(effects))
    rows = rng.integers(len(effects), size=(RESAMPLED, len(effects)))
    low, high = np.percentile(effects[rows].mean(axis=1), (2.5, 97.5), axis=0)
    return low, high


def sobol(groups: Sequence[Group], d: int, n: int, seed: int) -> Design:
    """Return the design for the first-order indices S and the total indices T of k factors, with n
    (k + 2) runs.

    S = mean(f_B (f_AB - f_A)) / V,   T = mean((f_A - f_AB)^2) / 2 V,

    with the margins f_A and f_B of two independent samples of n runs, f_AB of sample A with one
    factor from B, and the variance V. groups: indices of the coordinates of each factor; d: number
    of coordinates; n: a power of two.
    """
    from scipy.stats.qmc import Sobol

    u = np.asarray(Sobol(2 * d, rng=seed).random(n)).clip(2**-53, 1 - 2**-53)
    a, b = u[:, :d], u[:, d:]
    rows = [a, b, *(np.where(np.isin(np.arange(d), group), b, a) for group in groups)]

    def effects(margins: Array) -> Effects:
        y, failed = with_finite(margins)
        f_a, f_b, *f_ab = y.reshape(len(rows), n) - y[: 2 * n].mean()
        first, total = _indices(f_a, f_b, np.array(f_ab))
        draws = np.random.default_rng(seed).integers(n, size=(RESAMPLED, n))
        again = [_indices(f_a[k], f_b[k], np.array(f_ab)[:, k])[1] for k in draws]
        low, high = np.percentile(again, (2.5, 97.5), axis=0)
        return Effects(total, low, high, first, failed=failed)

    return normal_quantile(np.concatenate(rows)), effects


def _indices(f_a: Array, f_b: Array, f_ab: Array) -> tuple[Array, Array]:
    variance = np.concatenate([f_a, f_b]).var() or 1.0
    first = (f_b * (f_ab - f_a)).mean(axis=1) / variance
    return first, ((f_a - f_ab) ** 2).mean(axis=1) / (2 * variance)


# ---- analysis


def sensitivity(definition: Any, output: str | Path, **how: Any) -> Study:
    """Estimate the effect of each factor of a campaign on the margin of each requirement, and
    return the study with its runs and these effects.

    definition: path of a campaign TOML with a table [sensitivity], or the table itself; output:
    OUT.zarr; how: workers, lanes, resume, progress and notify as for campaign(). Raises UsageError,
    StructureError.
    """
    entry, evaluator = prepared(Sensitivity, definition, how)
    of, groups = evaluator.columns(entry.of, slope=False), [*evaluator.groups.values()]
    count, per = _count(entry, len(groups))
    method, made = {"morris": (morris, "paths"), "sobol": (sobol, "points")}[entry.method]
    numbers, effects = method(groups, evaluator.d, count, evaluator.plan.table.seed)
    if count * per != entry.runs:
        evaluator.notify(f"{entry.method}: {count} {made} x {per} = {count * per} runs")
    with begun("sensitivity", evaluator, count * per, output, how) as driver:
        report_nominal(driver, of)
        margins, found = driver.evaluate(numbers), {}
        for name, k in of.items():
            y = margins[:, k]
            if not np.isfinite(y).any():
                raise UsageError(f"{name}: no run of {len(y)} has a finite margin")
            found[name] = effects(y)._asdict() | {"signs": _signs(groups, numbers, y)}
        return driver.finish({"of": found, "factors": [*evaluator.groups], "method": entry.method})


def _count(entry: Sensitivity, factors: int) -> tuple[int, int]:
    """Return the number of paths (Morris) or sample points (Sobol: the next power of two) for
    about `entry.runs` runs, and the runs per path or point; raise UsageError for under two paths.
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
    """Return the rank correlation of the margins y (rows,) with each factor. For a factor with
    several coordinates it is the correlation with the largest absolute value.

    groups: indices of the coordinates of each factor; numbers: coordinates (rows, d).
    """
    signs = []
    for group in groups:
        each = np.nan_to_num([rank_correlation(numbers[:, k], y) for k in group])
        signs.append(float(each[np.argmax(np.abs(each))]))
    return signs
