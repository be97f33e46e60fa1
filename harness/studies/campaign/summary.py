# SPDX-License-Identifier: BSD-2-Clause
"""Summary of a campaign from its dataset: share of successful runs, statistics of the metrics, most
influential factors, failed runs and worst runs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from statistics import NormalDist
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.results.result import Array
from harness.results.verdict import OPEN, Kind, Outcome, Verdict
from harness.spelling import columns, one_line
from harness.studies.campaign.plan import SUCCESS
from harness.studies.campaign.store import Store
from harness.studies.campaign.worker import COMPLETE, FAILED, PENDING, VERDICTS
from harness.system.units import with_unit

Z95 = 1.959963984540054
"""Quantile of the standard normal distribution for a two-sided interval of 95 %."""
WORST = 10
"""Number of worst runs in the summary."""
LISTED = 100
"""Largest number of runs without success that the summary lists; page and dataset contain all such
runs.
"""
DRAWN = 8
"""Largest number of factors in the figures of one metric."""
SHOWN = 5
"""Largest number of factors per metric in the summary."""
PERCENTILES = (5, 50, 95)
"""Percentages of the percentiles in the table of metrics."""


def wilson(successes: int, n: int) -> tuple[float, float]:
    """Return the 95 % interval of a probability, given the successes in n trials (Wilson 1927).

    centre = (p + z^2 / 2n) / (1 + z^2 / n)
    half   = z sqrt(p (1 - p) / n + z^2 / 4n^2) / (1 + z^2 / n)
    """
    if n == 0:
        return 0.0, 1.0
    p = successes / n
    scale = 1 + Z95 * Z95 / n
    centre = (p + Z95 * Z95 / (2 * n)) / scale
    half = Z95 * math.sqrt(p * (1 - p) / n + Z95 * Z95 / (4 * n * n)) / scale
    return max(0.0, centre - half), min(1.0, centre + half)


def rank_correlation(x: Array, y: Array) -> float:
    """Return Spearman's rank correlation of x (rows,) and y (rows,), without rows in which x or y
    is not finite; NaN if fewer than three rows remain, or if x or y is constant.
    """
    both = np.isfinite(x) & np.isfinite(y)
    a, b = _mean_ranks(x[both]), _mean_ranks(y[both])
    if len(a) < 3 or np.ptp(a) == 0 or np.ptp(b) == 0:
        return math.nan
    return float(np.corrcoef(a, b)[0, 1])


def effect(x: Array, y: Array) -> float:
    """Return the absolute change of y on the least-squares line when x rises from its 5th to its
    95th percentile, relative to the mean of |y|. Unlike a rank correlation it shows whether the
    change is large enough to matter.
    """
    both = np.isfinite(x) & np.isfinite(y)
    x, y = x[both], y[both]
    slope = np.sum((x - x.mean()) * (y - y.mean())) / np.sum(np.square(x - x.mean()))
    low, high = np.percentile(x, (5, 95))
    size = np.mean(np.abs(y))
    return float(abs(slope) * (high - low) / size) if size else 0.0


def _mean_ranks(x: Array) -> Array:
    """Return the ranks of the elements of x, counted from 1; equal elements get the mean of their
    ranks. The function of scipy.stats is not used, because its import takes half a second.
    """
    _, place, count = np.unique(x, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(count) - (count - 1) / 2)[place])


def factor_columns(store: Store) -> dict[str, Array]:
    """Return the values of all numeric factors as columns (runs,) by name, one column per element
    of a vector or matrix; for a matrix that is symmetric in every run, only its upper triangle.
    Factors whose values are texts are in categories().
    """
    columns = {}
    for name in store.names("factor"):
        values = store.array(name)
        if values.dtype.kind not in "fiu":
            continue
        square = values.ndim == 3 and values.shape[1] == values.shape[2]
        mirrored = square and np.array_equal(values, np.swapaxes(values, 1, 2))
        for place in np.ndindex(values.shape[1:]):
            if not (mirrored and place[0] > place[1]):
                element = ",".join(str(k + 1) for k in place)
                columns[f"{name}[{element}]" if place else name] = values[:, *place]
    return columns


def categories(store: Store) -> dict[str, NDArray[Any]]:
    """Return the factors whose values are texts, such as swapped FMUs, and differ between runs:
    values (runs,) by name.
    """
    texts = {n: store.array(n) for n in store.names("factor")}
    return {n: x for n, x in texts.items() if x.dtype.kind not in "fiu" and len(np.unique(x)) > 1}


def metric_columns(store: Store) -> dict[str, Array]:
    """Return the values (runs,) of all metrics except `success` by name. Values of failed runs are
    NaN, because they describe a shorter run.
    """
    complete = store.array("status") == COMPLETE
    names = (name for name in store.names("metric") if name != SUCCESS)
    return {name: np.where(complete, store.array(name), np.nan) for name in names}


def varying_factors(store: Store) -> dict[str, Array]:
    """Return those columns of factor_columns() whose values differ between runs."""

    def varies(x: Array) -> bool:
        return bool(np.isfinite(x).any() and np.ptp(x[np.isfinite(x)]) > 0)

    return {name: x for name, x in factor_columns(store).items() if varies(x)}


def is_grid(factors: Mapping[str, Array]) -> bool:
    """Return whether there are two factors, and the runs contain every combination of their values
    exactly once; factors: columns (runs,) by name.
    """
    if len(factors) != 2:
        return False
    pairs = np.stack(list(factors.values()), axis=1)
    sizes = [len(np.unique(column)) for column in pairs.T]
    return len(np.unique(pairs, axis=0)) == len(pairs) == sizes[0] * sizes[1]


def ranked(factors: Mapping[str, Array], column: Array, count: int = DRAWN) -> dict[str, Array]:
    """Return at most `count` factors with the largest absolute rank correlation with a metric, the
    largest first, without factors whose correlation may be due to chance.

    factors: columns (runs,) by name; column: values of the metric (runs,).
    """
    size = {n: abs(rank_correlation(x, column)) for n, x in factors.items()}
    least = chance(len(factors), int(np.isfinite(column).sum()))
    beyond = (name for name in factors if size[name] > least)
    return {n: factors[n] for n in sorted(beyond, key=lambda n: -size[n])[:count]}


def chance(factors: int, runs: int) -> float:
    """Return the absolute rank correlation up to which the correlation of a factor may be due to
    chance.

    If none of the factors has an effect, the largest of their correlations exceeds this value in
    only one campaign of twenty (Fieller et al. 1957: artanh(r) is normal with variance 1.06 / (runs
    - 3)).
    """
    if runs <= 3 or not factors:
        return 1.0
    z = NormalDist().inv_cdf(1 - 0.05 / (2 * factors))
    return math.tanh(z * math.sqrt(1.06 / (runs - 3)))


def left_out(metric: str, factors: Mapping[str, Array], column: Array) -> str:
    """Return a line that states how many factors ranked() leaves out for a metric, "" if none."""
    runs = int(np.isfinite(column).sum())
    count = len(factors) - len(ranked(factors, column, len(factors)))
    within = f"correlate by at most {chance(len(factors), runs):.2f}, as {runs} runs may by chance"
    return f"{metric}: {count} of {len(factors)} factors {within}" if count else ""


def text(store: Store, shown: str) -> str:
    """Return the summary of a campaign as text; shown: path of the dataset, as commands name it."""
    status = store.array("status")
    failed = int((status == FAILED).sum())
    count = int((status == COMPLETE).sum()) + failed
    metrics = metric_columns(store)
    lines = [f"{count} runs, {failed} failed", *_shares(store)]
    lines += ["", *_table(metrics, store.units())] if metrics else []
    lines += [*lacking(store), *(each.text for each in expectations(store))]
    lines += _groups(store)
    seeds = store.definition()[0].get("seeds", ())  # a rank correlation with a seed means nothing
    factors = {name: x for name, x in varying_factors(store).items() if name not in seeds}
    if metrics and factors:
        head = (
            "rank correlation with factors (change of the metric from the 5th to the 95th "
            "percentile of the factor, relative to the mean absolute value of the metric)"
        )
        lines += ["", head, *_ranks(metrics, factors)]
    lines += _failures(store, shown)
    lines += ["", *_worst(store, metrics, shown)] if metrics else []
    return "\n".join(lines)


class Share(NamedTuple):
    """Share of runs that succeeded or that met a requirement.

    met: number of runs that succeeded or met the requirement; evaluated: number of runs with a
    verdict; missed: indices of the runs that did not succeed or did not meet the requirement;
    unjudged: indices of the runs without a verdict.
    """

    met: int
    evaluated: int
    missed: Sequence[int]
    unjudged: Sequence[int]

    @property
    def share(self) -> float:
        """Return the share of successes among the runs with a verdict; NaN if there are none."""
        return self.met / self.evaluated if self.evaluated else math.nan

    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval of the probability of a success."""
        return wilson(self.met, self.evaluated)

    def short(self) -> str:
        """Return the share as short text such as `48/50 (87-99 %)`, with its 95 % interval; "-" if
        no run has a verdict.
        """
        low, high = (100 * bound for bound in self.interval())
        return f"{self.met}/{self.evaluated} ({low:.0f}-{high:.0f} %)" if self.evaluated else "-"

    def __str__(self) -> str:
        low, high = (100 * bound for bound in self.interval())
        bounds = f" (95 %: {low:.1f} to {high:.1f} %)" if self.evaluated else ""
        share = f", {100 * self.share:.1f} %{bounds}" if self.evaluated else ""
        open_ = f", {len(self.unjudged)} without a verdict" if self.unjudged else ""
        return f"{self.met} of {self.evaluated}{share}{open_}"


def _share(
    status: Array, met: NDArray[np.bool_], missed: NDArray[np.bool_], among: Any = True
) -> Share:
    """Return the share of runs that succeeded. A run with status FAILED counts as missed in any
    case.

    met, missed: whether each run has succeeded, and whether it has not; if both are false, it has
    no verdict; among: mask of the runs that count (True: all).
    """
    complete, failed = (status == COMPLETE) & among, (status == FAILED) & among
    met, missed = complete & met, (complete & missed) | failed
    evaluated = int((met | missed).sum())
    unjudged = np.flatnonzero(complete & ~met & ~missed).tolist()
    return Share(int(met.sum()), evaluated, np.flatnonzero(missed).tolist(), unjudged)


def completion(store: Store) -> Share:
    """Return the share of runs that have completed without failing."""
    status = store.array("status")
    return _share(status, status == COMPLETE, status == FAILED)


def success(store: Store, among: Any = True) -> Share | None:
    """Return the share of successful runs, None if the campaign does not define success; among:
    mask of the runs that count (True: all).
    """
    if SUCCESS not in store.names("metric"):
        return None
    column = store.array(SUCCESS)
    return _share(store.array("status"), column > 0, column == 0, among)


def requirements(store: Store, among: Any = True) -> dict[str, Share]:
    """Return the share of runs that met each requirement, by name. A run that did not exercise a
    requirement has no verdict on it; among: mask of the runs that count (True: all).
    """
    if "requirement" not in store.group:
        return {}
    status, verdict = store.array("status"), store.array("verdict")
    met, missed = (verdict == VERDICTS.index(v) for v in (Verdict.MET, Verdict.NOT_MET))
    names = store.array("requirement")
    return {n: _share(status, met[:, k], missed[:, k], among) for k, n in enumerate(names)}


def by_category(store: Store) -> dict[str, dict[str, dict[str, Share]]]:
    """Return the shares of success and requirements separately for each value of each factor whose
    values are texts: by factor, then by value, then by `success` or name of the requirement.
    """
    found: dict[str, dict[str, dict[str, Share]]] = {}
    for factor, texts in categories(store).items():
        for value in np.unique(texts):
            own = success(store, texts == value)
            shares = ({} if own is None else {SUCCESS: own}) | requirements(store, texts == value)
            found.setdefault(factor, {})[str(value)] = shares
    return found


def _groups(store: Store) -> Iterator[str]:
    """Yield the lines of one table for each factor whose values are texts: a row per value of the
    factor, columns for `success` and for each requirement.
    """
    for factor, rows in by_category(store).items():
        heads = [*next(iter(rows.values()))]
        if heads:
            yield ""
            cells = [[name, *(rows[name][head].short() for head in heads)] for name in rows]
            yield from columns([[f"by {factor}", *heads], *cells])


def unjudged(store: Store) -> str:
    """Return a line that states in how many runs `success` has no verdict, and why in the first of
    these; "" if there are none or the file of the campaign does not define `success`.
    """
    own = "success" in store.definition()[0]
    return _unjudged(store, SUCCESS, success(store)) if own else ""


def _unjudged(store: Store, name: str, found: Share | None) -> str:
    """Return a line that states in how many runs a share has no verdict, and why; "" if in none."""
    if found is None or not found.unjudged:
        return ""
    why, word = _why(store, found.unjudged[0], name), "cannot be evaluated"
    if why.startswith(begin := f" ({OPEN[Verdict.NOT_EXERCISED]}, "):
        why, word = f" ({why.removeprefix(begin)}", OPEN[Verdict.NOT_EXERCISED]
    runs = found.evaluated + len(found.unjudged)
    count, first = len(found.unjudged), found.unjudged[0]
    return f"{name}: {word} in {count} of {runs} runs, first run {first}{why}"


def _why(store: Store, run: int, name: str) -> str:
    """Return the recorded reason why a metric or requirement has no value in a run, in parentheses;
    "" if no reason was recorded.
    """
    name = name.removeprefix("requirement ")
    reasons = dict(part.partition(": ")[::2] for part in store.array("message")[run].splitlines())
    return f" ({one_line(reasons[name])})" if name in reasons else ""


def _shares(store: Store) -> Iterator[str]:
    """Yield the lines on the stopping rule (`until`) of the campaign, and for `success` and each
    requirement the share of runs that met it and the number of runs without a verdict.
    """
    shares = {SUCCESS: success(store)}
    shares |= {f"requirement {name}": share for name, share in requirements(store).items()}
    rule = store.plan().table.until
    if rule is not None and (own := shares[SUCCESS]) is not None:
        failures = len(own.missed) + len(own.unjudged)
        yield f"until: {rule.verdict(failures, own.met + failures)}"
    for name, found in shares.items():
        if found is not None and found.evaluated:
            yield f"{name}: {found._replace(unjudged=())}"
        if found is not None and found.unjudged:
            yield _unjudged(store, name, found)


def lacking(store: Store) -> Iterator[str]:
    """Yield a line per metric that has no value, or an infinite one, in some complete runs."""
    complete = store.array("status") == COMPLETE
    for name, column in metric_columns(store).items():
        for word, found in (("no value", np.isnan(column)), ("infinite", np.isinf(column))):
            if len(runs := np.flatnonzero(complete & found)):
                first = f"first run {runs[0]}{_why(store, int(runs[0]), name)}"
                yield f"{name}: {word} in {len(runs)} of {complete.sum()} runs, {first}"


def expectations(store: Store) -> Iterator[Outcome]:
    """Yield the verdict on every entry of `[expected]`, which bounds the mean of a metric or the
    share of `success`. A mean counts as met only if no run has failed and all values are finite.
    """
    for name, (low, high) in store.definition()[0].get("expected", {}).items():
        mean, lacks = _mean(store, name)
        verdict = Verdict.MET if low <= mean <= high else Verdict.NOT_MET
        if math.isnan(mean) or (lacks and verdict is Verdict.MET):
            verdict = Verdict.NOT_EXERCISED
        what = f"mean {mean:.5g}{lacks}, expected {low:g} to {high:g}"
        line = f"{name}: {what}: {Kind.EXPECTATION.word(verdict)}"
        yield Outcome(Kind.EXPECTATION, name, verdict, line)


def _mean(store: Store, name: str) -> tuple[float, str]:
    """Return the mean of a metric over all ended runs in which it has a value, or the share of
    `success`; also a text that states in how many ended runs the value is missing or infinite.
    """
    if name == SUCCESS and (share := success(store)) is not None:
        count, runs = {"not judged": len(share.unjudged)}, share.evaluated + len(share.unjudged)
        mean = share.share
    else:
        values = metric_columns(store)[name][store.array("status") != PENDING]
        missing, infinite = np.isnan(values), np.isinf(values)
        count, runs = {"missing": missing.sum(), "infinite": infinite.sum()}, len(values)
        with np.errstate(invalid="ignore"):  # inf - inf
            mean = float(values[~missing].mean()) if not missing.all() else math.nan
    return mean, "".join(f", {word} in {n} of {runs} runs" for word, n in count.items() if n)


def _table(metrics: Mapping[str, Array], units: Mapping[str, str]) -> Iterator[str]:
    """Yield the lines of the table of statistics: headings, and a line per metric with a finite
    value.
    """
    shown = {name: with_unit(name, units) for name in metrics}
    width = max(map(len, shown.values()))
    heads = ("mean", "std", "least", *(f"{p} %" for p in PERCENTILES), "most")
    yield " " * width + "".join(f"{head:>12}" for head in heads)
    for name, column in metrics.items():
        if np.isfinite(column).any():
            numbers = (f"{number:12.5g}" for number in statistics(column))
            yield f"{shown[name]:{width}}" + "".join(numbers)


def statistics(values: Array) -> list[float]:
    """Return mean, standard deviation, minimum, PERCENTILES, and maximum of the finite values."""
    finite = values[np.isfinite(values)]
    middle = np.percentile(finite, PERCENTILES)
    return [finite.mean(), finite.std(), finite.min(), *middle, finite.max()]


def _ranks(metrics: Mapping[str, Array], factors: Mapping[str, Array]) -> Iterator[str]:
    """Yield a line per metric with its most influential factors, their rank correlation and effect,
    then a line per metric for which factors are left out.
    """
    for name, column in metrics.items():
        best = ranked(factors, column, SHOWN)
        found = [
            f"{f} {rank_correlation(x, column):+.2f} ({100 * effect(x, column):.2g} %)"
            for f, x in best.items()
        ]
        if found:
            yield f"  {name}: " + ", ".join(found)
    lines = (left_out(name, factors, column) for name, column in metrics.items())
    yield from (f"  left out: {line}" for line in lines if line)


def failures(store: Store) -> dict[int, str]:
    """Return the reason, by number of the run, for all runs that failed or missed the success
    criterion of the campaign.
    """
    found, messages = success(store), store.array("message")
    runs = found.missed if found else np.flatnonzero(store.array("status") == FAILED).tolist()
    reasons = {run: messages[run].splitlines() or [f"{SUCCESS}: not met"] for run in runs}
    return {
        run: "; ".join([line for line in lines if ": not met" in line] or lines)
        for run, lines in reasons.items()
    }


def failures_by_category(store: Store) -> dict[int, str]:
    """Return failures(), ordered by the values of the factors whose values are texts; these values
    precede each reason.
    """
    found, groups = failures(store), categories(store)
    names = {
        run: ", ".join(f"{name} = {texts[run]}" for name, texts in groups.items()) for run in found
    }
    ordered = sorted(found, key=lambda run: names[run])
    return {run: f"{names[run]}: {found[run]}" if groups else found[run] for run in ordered}


def _failures(store: Store, shown: str) -> Iterator[str]:
    """Yield the reason for each run without success, at most LISTED, and the command that repeats
    the run; then a line on further such runs.
    """
    found = failures_by_category(store)
    for run, why in list(found.items())[:LISTED]:
        yield f"failed: run {run}: {one_line(why)}"
        yield f"    harness run {store.system} --like {shown}#{run}"
    if len(found) > LISTED:
        yield (
            f"failed: {len(found) - LISTED} more runs; the array `message` of the dataset has "
            "all reasons"
        )


def worst(store: Store, metrics: Mapping[str, Array]) -> tuple[str, list[int]]:
    """Return the metric that ranks the worst runs, and the numbers of the worst runs, at most
    WORST: those with the largest values, or with the smallest if a minus precedes the metric.

    The entry `worst` in the file of the campaign names the metric (default: the first metric).
    """
    needed = store.plan().table.worst
    given = needed if needed and isinstance(needed, str) else next(iter(metrics))
    name = given.removeprefix("-")
    sign = 1.0 if given.startswith("-") else -1.0
    values = metrics.get(name, np.empty(0))
    order = np.argsort(sign * values, kind="stable")
    return name, [int(k) for k in order if not np.isnan(values[k])][:WORST]


def _worst(store: Store, metrics: Mapping[str, Array], shown: str) -> Iterator[str]:
    """Yield the value of each of the worst runs, and the command that repeats the run."""
    name, found = worst(store, metrics)
    yield f"worst by {with_unit(name, store.units())}"
    system = store.system
    for run in found:
        yield f"  {metrics[name][run]:12.5g}  harness run {system} --like {shown}#{run}"
