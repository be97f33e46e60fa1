# SPDX-License-Identifier: BSD-2-Clause
"""Summary of a campaign: its rate of success, its metrics, the influential factors, and the most
informative runs.
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
"""Quantile of the normal distribution for 95 %, two-sided."""
WORST = 10
LISTED = 100
"""Runs without success that the summary lists; page and dataset have all."""
DRAWN = 8
"""Factors in the figures of a metric."""
SHOWN = 5
"""Factors in the summary per metric."""
PERCENTILES = (5, 50, 95)


def wilson(successes: int, n: int) -> tuple[float, float]:
    """Return the interval of a probability estimated by successes of n trials (Wilson 1927).

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
    """Return Spearman's rank correlation of the rows where both exist; NaN if one does not vary."""
    both = np.isfinite(x) & np.isfinite(y)
    a, b = mean_ranks(x[both]), mean_ranks(y[both])
    if len(a) < 3 or np.ptp(a) == 0 or np.ptp(b) == 0:
        return math.nan
    return float(np.corrcoef(a, b)[0, 1])


def effect(x: Array, y: Array) -> float:
    """Return the change of y over the middle 90 % of x by the line of least squares, as a share of
    the mean of |y|. A rank correlation of 1 may belong to a change that does not matter.
    """
    both = np.isfinite(x) & np.isfinite(y)
    x, y = x[both], y[both]
    slope = np.sum((x - x.mean()) * (y - y.mean())) / np.sum(np.square(x - x.mean()))
    low, high = np.percentile(x, (5, 95))
    size = np.mean(np.abs(y))
    return float(abs(slope) * (high - low) / size) if size else 0.0


def mean_ranks(x: Array) -> Array:
    """Return ranks from 1 on; equal values have the mean of their ranks (scipy.stats takes half a
    second to import).
    """
    _, place, count = np.unique(x, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(count) - (count - 1) / 2)[place])


def factor_columns(store: Store) -> dict[str, Array]:
    """Return the numbers of all factors, one column per element, by name. A matrix that is
    symmetric in every run has the columns of its upper triangle. Texts are in categories().
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
    """Return the factors whose values are texts, such as the FMUs of a swap, by name, if they have
    more than one value.
    """
    texts = {n: store.array(n) for n in store.names("factor")}
    return {n: x for n, x in texts.items() if x.dtype.kind not in "fiu" and len(np.unique(x)) > 1}


def metric_columns(store: Store) -> dict[str, Array]:
    """Return the metrics of all runs by name, without the success; NaN for failed runs, whose
    values until the failure are not comparable.
    """
    complete = store.array("status") == COMPLETE
    names = (name for name in store.names("metric") if name != SUCCESS)
    return {name: np.where(complete, store.array(name), np.nan) for name in names}


def varying_factors(store: Store) -> dict[str, Array]:
    """Return the columns of the factors that have more than one value."""

    def varies(x: Array) -> bool:
        return bool(np.isfinite(x).any() and np.ptp(x[np.isfinite(x)]) > 0)

    return {name: x for name, x in factor_columns(store).items() if varies(x)}


def is_grid(factors: Mapping[str, Array]) -> bool:
    """Return whether the runs are all combinations of the values of two factors, once each."""
    if len(factors) != 2:
        return False
    pairs = np.stack(list(factors.values()), axis=1)
    sizes = [len(np.unique(column)) for column in pairs.T]
    return len(np.unique(pairs, axis=0)) == len(pairs) == sizes[0] * sizes[1]


def ranked(factors: Mapping[str, Array], column: Array, count: int = DRAWN) -> dict[str, Array]:
    """Return the most influential factors for a metric, by the size of their rank correlation,
    without factors that may correlate by chance.
    """
    size = {n: abs(rank_correlation(x, column)) for n, x in factors.items()}
    least = chance(len(factors), int(np.isfinite(column).sum()))
    beyond = (name for name in factors if size[name] > least)
    return {n: factors[n] for n in sorted(beyond, key=lambda n: -size[n])[:count]}


def chance(factors: int, runs: int) -> float:
    """Return the size that the largest rank correlation of this number of factors without effect
    exceeds in one campaign of twenty (Fieller et al. 1957: artanh(r) is normal, of variance 1.06 /
    (runs - 3)).
    """
    if runs <= 3 or not factors:
        return 1.0
    z = NormalDist().inv_cdf(1 - 0.05 / (2 * factors))
    return math.tanh(z * math.sqrt(1.06 / (runs - 3)))


def left_out(metric: str, factors: Mapping[str, Array], column: Array) -> str:
    """Return how many factors of a metric are left out because of chance, "" if none is."""
    runs = int(np.isfinite(column).sum())
    count = len(factors) - len(ranked(factors, column, len(factors)))
    within = f"within {chance(len(factors), runs):.2f}, which is chance in {runs} runs"
    return f"{metric}: {count} of {len(factors)} factors {within}" if count else ""


def text(store: Store, shown: str) -> str:
    """Return the summary as text; shown: name of the dataset in the commands."""
    status = store.array("status")
    failed = int((status == FAILED).sum())
    count = int((status == COMPLETE).sum()) + failed
    metrics = metric_columns(store)
    lines = [f"{count} runs, {failed} failed", *_shares(store)]
    lines += ["", *_table(metrics, store.units())] if metrics else []
    lines += [*lacking(store), *(each.text for each in expectations(store))]
    lines += _groups(store)
    factors = _varied(store, status != 0)
    if metrics and factors:
        head = (
            "rank correlation with the factors (size: change over 5 to 95 % of the factor / mean)"
        )
        lines += ["", head, *_ranks(metrics, factors)]
    lines += _failures(store, shown)
    lines += ["", *_worst(store, metrics, shown)] if metrics else []
    return "\n".join(lines)


def _varied(store: Store, over: NDArray[np.bool_]) -> dict[str, Array]:
    """Return the columns of the factors that differ between runs, without seeds, whose order has
    no meaning.
    """
    seeds = store.definition()[0].get("seeds", ())
    columns = {n: c for n, c in factor_columns(store).items() if n not in seeds}
    return {name: column for name, column in columns.items() if np.ptp(column[over]) > 0}


class Share(NamedTuple):
    """Number of runs that succeeded or met a requirement, and of runs with a verdict; missed:
    indices of runs that failed; unjudged: indices of runs without a verdict.
    """

    met: int
    evaluated: int
    missed: Sequence[int]
    unjudged: Sequence[int]

    @property
    def share(self) -> float:
        """Return the share of the runs with a verdict; NaN if there are none."""
        return self.met / self.evaluated if self.evaluated else math.nan

    def interval(self) -> tuple[float, float]:
        """Return the 95 % interval of the probability of a success."""
        return wilson(self.met, self.evaluated)

    def short(self) -> str:
        """Return number, share and interval in a few characters, "-" without a verdict."""
        low, high = (100 * bound for bound in self.interval())
        return f"{self.met}/{self.evaluated} ({low:.0f}-{high:.0f} %)" if self.evaluated else "-"

    def __str__(self) -> str:
        low, high = (100 * bound for bound in self.interval())
        bounds = f" (95 %: {low:.1f} to {high:.1f} %)" if self.evaluated else ""
        share = f", {100 * self.share:.1f} %{bounds}" if self.evaluated else ""
        open_ = f", {len(self.unjudged)} not judged" if self.unjudged else ""
        return f"{self.met} of {self.evaluated}{share}{open_}"


def _share(
    status: Array, met: NDArray[np.bool_], missed: NDArray[np.bool_], among: Any = True
) -> Share:
    """Return the share of successes. A failed run meets nothing, regardless of its rows; among: the
    runs that count.
    """
    complete, failed = (status == COMPLETE) & among, (status == FAILED) & among
    met, missed = complete & met, (complete & missed) | failed
    evaluated = int((met | missed).sum())
    unjudged = np.flatnonzero(complete & ~met & ~missed).tolist()
    return Share(int(met.sum()), evaluated, np.flatnonzero(missed).tolist(), unjudged)


def completion(store: Store) -> Share:
    """Return how many runs have completed."""
    status = store.array("status")
    return _share(status, status == COMPLETE, status == FAILED)


def success(store: Store, among: Any = True) -> Share | None:
    """Return the success of a campaign, None if it is not defined; among: the runs that count."""
    if SUCCESS not in store.names("metric"):
        return None
    column = store.array(SUCCESS)
    return _share(store.array("status"), column > 0, column == 0, among)


def requirements(store: Store, among: Any = True) -> dict[str, Share]:
    """Return how often each requirement was met, by name. A requirement that is not exercised is
    not judged; among: the runs that count.
    """
    if "requirement" not in store.group:
        return {}
    status, verdict = store.array("status"), store.array("verdict")
    met, missed = (verdict == VERDICTS.index(v) for v in (Verdict.MET, Verdict.NOT_MET))
    names = store.array("requirement")
    return {n: _share(status, met[:, k], missed[:, k], among) for k, n in enumerate(names)}


def by_category(store: Store) -> dict[str, dict[str, dict[str, Share]]]:
    """Return success and requirements by factor, then by its value, then by name."""
    found: dict[str, dict[str, dict[str, Share]]] = {}
    for factor, texts in categories(store).items():
        for value in np.unique(texts):
            own = success(store, texts == value)
            shares = ({} if own is None else {SUCCESS: own}) | requirements(store, texts == value)
            found.setdefault(factor, {})[str(value)] = shares
    return found


def _groups(store: Store) -> Iterator[str]:
    """Yield a table per factor of texts: its values in rows, requirements in columns."""
    for factor, rows in by_category(store).items():
        heads = [*next(iter(rows.values()))]
        if heads:
            yield ""
            cells = [[name, *(rows[name][head].short() for head in heads)] for name in rows]
            yield from columns([[f"by {factor}", *heads], *cells])


def unjudged(store: Store) -> str:
    """Return why the `success` of the campaign has no verdict on some run, "" if it has all."""
    own = "success" in store.definition()[0]
    return _unjudged(store, SUCCESS, success(store)) if own else ""


def _unjudged(store: Store, name: str, found: Share | None) -> str:
    if found is None or not found.unjudged:
        return ""
    why, word = _why(store, found.unjudged[0], name), "cannot be evaluated"
    if why.startswith(begin := f" ({OPEN[Verdict.NOT_EXERCISED]}, "):
        why, word = f" ({why.removeprefix(begin)}", OPEN[Verdict.NOT_EXERCISED]
    runs = found.evaluated + len(found.unjudged)
    count, first = len(found.unjudged), found.unjudged[0]
    return f"{name}: {word} in {count} of {runs} runs, first run {first}{why}"


def _why(store: Store, run: int, name: str) -> str:
    """Return why a metric of a complete run has no value, if the reason was recorded."""
    name = name.removeprefix("requirement ")
    reasons = dict(part.partition(": ")[::2] for part in store.array("message")[run].splitlines())
    return f" ({one_line(reasons[name])})" if name in reasons else ""


def _shares(store: Store) -> Iterator[str]:
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
    """Yield a line per metric that is missing or infinite in complete runs."""
    complete = store.array("status") == COMPLETE
    for name, column in metric_columns(store).items():
        for word, found in (("no value", np.isnan(column)), ("infinite", np.isinf(column))):
            if len(runs := np.flatnonzero(complete & found)):
                first = f"first run {runs[0]}{_why(store, int(runs[0]), name)}"
                yield f"{name}: {word} in {len(runs)} of {complete.sum()} runs, {first}"


def expectations(store: Store) -> Iterator[Outcome]:
    """Yield the outcome of every entry of `[expected]`: a bound on the mean of a metric, or on the
    share of `success`. It is as expected only if all runs have a finite value.
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
    """Return the mean of a metric over all completed runs, or the share of `success`, and in how
    many of them it is not a finite number.
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
    shown = {name: with_unit(name, units) for name in metrics}
    width = max(map(len, shown.values()))
    heads = ("mean", "std", "least", *(f"{p} %" for p in PERCENTILES), "most")
    yield " " * width + "".join(f"{head:>12}" for head in heads)
    for name, column in metrics.items():
        if np.isfinite(column).any():
            numbers = (f"{number:12.5g}" for number in statistics(column))
            yield f"{shown[name]:{width}}" + "".join(numbers)


def statistics(values: Array) -> list[float]:
    """Return mean, standard deviation, minimum, percentiles and maximum of finite values."""
    finite = values[np.isfinite(values)]
    middle = np.percentile(finite, PERCENTILES)
    return [finite.mean(), finite.std(), finite.min(), *middle, finite.max()]


def _ranks(metrics: Mapping[str, Array], factors: Mapping[str, Array]) -> Iterator[str]:
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
    """Return the reason of every run that failed or did not succeed, by its number."""
    found, messages = success(store), store.array("message")
    runs = found.missed if found else np.flatnonzero(store.array("status") == FAILED).tolist()
    reasons = {run: messages[run].splitlines() or [f"{SUCCESS}: not met"] for run in runs}
    return {
        run: "; ".join([line for line in lines if ": not met" in line] or lines)
        for run, lines in reasons.items()
    }


def failures_by_category(store: Store) -> dict[int, str]:
    """Return failures(), ordered by the values of categories, with these before each reason."""
    found, groups = failures(store), categories(store)
    names = {
        run: ", ".join(f"{name} = {texts[run]}" for name, texts in groups.items()) for run in found
    }
    ordered = sorted(found, key=lambda run: names[run])
    return {run: f"{names[run]}: {found[run]}" if groups else found[run] for run in ordered}


def _failures(store: Store, shown: str) -> Iterator[str]:
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
    """Return metric and numbers of the ten worst runs: largest first, or smallest if the campaign
    has `worst = "-metric"`.
    """
    needed = store.plan().table.worst
    given = needed if needed and isinstance(needed, str) else next(iter(metrics))
    name = given.removeprefix("-")
    sign = 1.0 if given.startswith("-") else -1.0
    order = np.argsort(sign * metrics[name], kind="stable")
    return name, [int(k) for k in order if not np.isnan(metrics[name][k])][:WORST]


def _worst(store: Store, metrics: Mapping[str, Array], shown: str) -> Iterator[str]:
    name, found = worst(store, metrics)
    yield f"worst by {with_unit(name, store.units())}"
    system = store.system
    for run in found:
        yield f"  {metrics[name][run]:12.5g}  harness run {system} --like {shown}#{run}"
