# SPDX-License-Identifier: BSD-2-Clause
"""What a campaign says: how often it succeeds, what its metrics are, which factor matters, and
which runs are worth a look.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.results.verdict import OPEN, Judged, Kind, Verdict
from harness.spelling import one_line
from harness.studies.campaign.plan import SUCCESS, Plan
from harness.studies.campaign.store import Store
from harness.studies.campaign.worker import COMPLETE, FAILED, VERDICTS
from harness.system.units import with_unit

Array = NDArray[np.float64]

Z95 = 1.959963984540054
"""Quantile of the normal distribution for 95 %, two-sided."""
WORST = 10
LISTED = 100
"""Runs without success that the summary lists; page and dataset have all."""
DRAWN = 8
"""Factors that a metric is drawn against."""
SHOWN = 5
"""Factors that are shown per metric."""
PERCENTILES = (5, 50, 95)


def wilson(successes: int, n: int, z: float = Z95) -> tuple[float, float]:
    """Interval of a probability estimated by successes of n trials (Wilson 1927).

    centre = (p + z^2 / 2n) / (1 + z^2 / n)
    half   = z sqrt(p (1 - p) / n + z^2 / 4n^2) / (1 + z^2 / n)
    """
    if n == 0:
        return 0.0, 1.0
    p = successes / n
    scale = 1 + z * z / n
    centre = (p + z * z / (2 * n)) / scale
    half = z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n)) / scale
    return max(0.0, centre - half), min(1.0, centre + half)


def rank_correlation(x: Array, y: Array) -> float:
    """Spearman's rank correlation of the rows where both exist; NaN where one does not vary."""
    both = np.isfinite(x) & np.isfinite(y)
    a, b = mean_ranks(x[both]), mean_ranks(y[both])
    if len(a) < 3 or np.ptp(a) == 0 or np.ptp(b) == 0:
        return math.nan
    return float(np.corrcoef(a, b)[0, 1])


def mean_ranks(x: Array) -> Array:
    """From 1 on; equal values share the mean of theirs (scipy.stats takes half a second to
    import).
    """
    _, place, count = np.unique(x, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(count) - (count - 1) / 2)[place])


def factor_columns(store: Store) -> dict[str, Array]:
    """Numbers of all factors, one column per element, by name, of matrices that are symmetric in
    every run those of the upper triangle; texts are numbered.
    """
    columns = {}
    for name in store.names("factor"):
        values = store.array(name)
        if values.dtype.kind not in "fiu":
            values = np.unique(values, return_inverse=True)[1].astype(np.float64)
        square = values.ndim == 3 and values.shape[1] == values.shape[2]
        mirrored = square and np.array_equal(values, np.swapaxes(values, 1, 2))
        for place in np.ndindex(values.shape[1:]):
            if not (mirrored and place[0] > place[1]):
                element = ",".join(str(k + 1) for k in place)
                columns[f"{name}[{element}]" if place else name] = values[:, *place]
    return columns


def metric_columns(store: Store) -> dict[str, Array]:
    """Metrics of all runs by name, without the success; NaN for runs that have failed: what they
    had until then compares with nothing.
    """
    complete = store.array("status") == COMPLETE
    names = (name for name in store.names("metric") if name != SUCCESS)
    return {name: np.where(complete, store.array(name), np.nan) for name in names}


def varying_factors(store: Store) -> dict[str, Array]:
    """Columns of the factors that have more than one value."""

    def varies(x: Array) -> bool:
        return bool(np.isfinite(x).any() and np.ptp(x[np.isfinite(x)]) > 0)

    return {name: x for name, x in factor_columns(store).items() if varies(x)}


def is_grid(factors: Mapping[str, Array]) -> bool:
    """Whether the runs are all combinations of the values of two factors, once each."""
    if len(factors) != 2:
        return False
    pairs = np.stack(list(factors.values()), axis=1)
    sizes = [len(np.unique(column)) for column in pairs.T]
    return len(np.unique(pairs, axis=0)) == len(pairs) == sizes[0] * sizes[1]


def ranked(factors: Mapping[str, Array], column: Array, count: int = DRAWN) -> dict[str, Array]:
    """The factors that matter most for a metric, by the size of their rank correlation, without
    those of which it may be chance.
    """
    size = {n: abs(rank_correlation(x, column)) for n, x in factors.items()}
    least = chance(len(factors), int(np.isfinite(column).sum()))
    beyond = (name for name in factors if size[name] > least)
    return {n: factors[n] for n in sorted(beyond, key=lambda n: -size[n])[:count]}


def chance(factors: int, runs: int) -> float:
    """Size that the largest rank correlation of so many factors that do not matter exceeds in one
    campaign of twenty (Fieller et al. 1957: artanh(r) is normal, of variance 1.06 / (runs - 3)).
    """
    if runs <= 3 or not factors:
        return 1.0
    z = NormalDist().inv_cdf(1 - 0.05 / (2 * factors))
    return math.tanh(z * math.sqrt(1.06 / (runs - 3)))


def left_out(metric: str, factors: Mapping[str, Array], column: Array) -> str:
    """How many factors of a metric are not named because of chance, "" if none is."""
    runs = int(np.isfinite(column).sum())
    count = len(factors) - len(ranked(factors, column, len(factors)))
    within = f"within {chance(len(factors), runs):.2f}, which is chance in {runs} runs"
    return f"{metric}: {count} of {len(factors)} factors {within}" if count else ""


def text(store: Store, shown: str) -> str:
    """The summary for reading; shown: name of the dataset in the commands."""
    status = store.array("status")
    failed = int((status == FAILED).sum())
    flown = int((status == COMPLETE).sum()) + failed
    metrics = metric_columns(store)
    lines = [f"{flown} runs, {failed} failed", *_shares(store)]
    lines += ["", *_table(metrics, store.units())] if metrics else []
    lines += [*_missing(store, metrics, status), *(each.text for each in expectations(store))]
    factors = _varied(store, status != 0)
    if metrics and factors:
        lines += ["", "rank correlation with the factors", *_ranks(metrics, factors)]
    lines += _failures(store, shown)
    lines += ["", *_worst(store, metrics, shown)] if metrics else []
    return "\n".join(lines)


def _varied(store: Store, flown: NDArray[np.bool_]) -> dict[str, Array]:
    """Columns of the factors that differ from run to run; the order of seeds means nothing."""
    seeds = store.definition()[0].get("seeds", ())
    columns = {n: c for n, c in factor_columns(store).items() if n not in seeds}
    return {name: column for name, column in columns.items() if np.ptp(column[flown]) > 0}


class Share(NamedTuple):
    """Runs that have succeeded or met a requirement, of those that could be judged; the numbers of
    those that have not and of those that could not be judged.
    """

    met: int
    judged: int
    missed: Sequence[int]
    unjudged: Sequence[int]

    @property
    def share(self) -> float:
        """Of the runs that could be judged; NaN if there are none."""
        return self.met / self.judged if self.judged else math.nan

    def interval(self) -> tuple[float, float]:
        """Of 95 %, for the probability of a success."""
        return wilson(self.met, self.judged)

    def __str__(self) -> str:
        low, high = (100 * bound for bound in self.interval())
        bounds = f" (95 %: {low:.1f} to {high:.1f} %)" if self.judged else ""
        share = f", {100 * self.share:.1f} %{bounds}" if self.judged else ""
        open_ = f", {len(self.unjudged)} not judged" if self.unjudged else ""
        return f"{self.met} of {self.judged}{share}{open_}"


def _share(status: Array, met: NDArray[np.bool_], missed: NDArray[np.bool_]) -> Share:
    """A run that has failed has met nothing, whatever it has recorded."""
    complete, failed = status == COMPLETE, status == FAILED
    met, missed = complete & met, (complete & missed) | failed
    judged = int((met | missed).sum())
    unjudged = np.flatnonzero(complete & ~met & ~missed).tolist()
    return Share(int(met.sum()), judged, np.flatnonzero(missed).tolist(), unjudged)


def success(store: Store) -> Share | None:
    """How often a campaign has succeeded, None if nothing says what that is."""
    if SUCCESS not in store.names("metric"):
        return None
    column = store.array(SUCCESS)
    return _share(store.array("status"), column > 0, column == 0)


def requirements(store: Store) -> dict[str, Share]:
    """How often each requirement was met, by name; one that is not exercised is not judged."""
    if "requirement" not in store.group:
        return {}
    status, verdict = store.array("status"), store.array("verdict")
    met, missed = (verdict == VERDICTS.index(v) for v in (Verdict.MET, Verdict.NOT_MET))
    names = store.array("requirement")
    return {n: _share(status, met[:, k], missed[:, k]) for k, n in enumerate(names)}


def unjudged(store: Store) -> str:
    """What is wrong with a success of the campaign's own that some run could not be judged by, ""
    if nothing is.
    """
    own = "success" in store.definition()[0]
    return _unjudged(store, SUCCESS, success(store)) if own else ""


def _unjudged(store: Store, name: str, found: Share | None) -> str:
    if found is None or not found.unjudged:
        return ""
    why, word = _why(store, found.unjudged[0], name), "cannot be evaluated"
    if why.startswith(begin := f" ({OPEN[Verdict.NOT_EXERCISED]}, "):
        why, word = f" ({why.removeprefix(begin)}", OPEN[Verdict.NOT_EXERCISED]
    flown = found.judged + len(found.unjudged)
    count, first = len(found.unjudged), found.unjudged[0]
    return f"{name}: {word} in {count} of {flown} runs, first run {first}{why}"


def _why(store: Store, run: int, name: str) -> str:
    """Why a metric of a complete run has no value, if that was said."""
    name = name.removeprefix("requirement ")
    reasons = dict(part.partition(": ")[::2] for part in store.array("message")[run].splitlines())
    return f" ({one_line(reasons[name])})" if name in reasons else ""


def _shares(store: Store) -> Iterator[str]:
    shares = {SUCCESS: success(store)}
    shares |= {f"requirement {name}": share for name, share in requirements(store).items()}
    rule = Plan(*store.definition()).table.until
    if rule is not None and (flown := shares[SUCCESS]) is not None:
        failures = len(flown.missed) + len(flown.unjudged)
        yield f"until: {rule.verdict(failures, flown.met + failures)}"
    for name, found in shares.items():
        if found is not None and found.judged:
            yield f"{name}: {found._replace(unjudged=())}"
        if found is not None and found.unjudged:
            yield _unjudged(store, name, found)


def _missing(store: Store, metrics: Mapping[str, Array], status: Array) -> Iterator[str]:
    """Metrics that complete runs have no value of."""
    complete = status == COMPLETE
    for name, column in metrics.items():
        if len(found := np.flatnonzero(complete & np.isnan(column))):
            first = f"first run {found[0]}{_why(store, int(found[0]), name)}"
            yield f"{name}: no value in {len(found)} of {complete.sum()} runs, {first}"


def expectations(store: Store) -> Iterator[Judged]:
    """A verdict on the mean of every metric that the campaign expects something of; of `success` it
    is the share of the runs.
    """
    metrics = metric_columns(store)
    for name, (low, high) in store.definition()[0].get("expected", {}).items():
        share = success(store) if name == SUCCESS else None
        values = metrics[name][np.isfinite(metrics[name])] if share is None else np.empty(0)
        mean = float(np.mean(values)) if len(values) else math.nan
        mean = mean if share is None else share.share
        verdict = Verdict.MET if low <= mean <= high else Verdict.NOT_MET
        if math.isnan(mean) or (share is not None and share.unjudged):
            verdict = Verdict.NOT_EXERCISED
        what = f"mean {mean:.5g}, expected {low:g} to {high:g}"
        line = f"{name}: {what}: {Kind.EXPECTATION.word(verdict)}"
        yield Judged(Kind.EXPECTATION, name, verdict, line)


def _table(metrics: Mapping[str, Array], units: Mapping[str, str]) -> Iterator[str]:
    shown = {name: with_unit(name, units) for name in metrics}
    width = max(map(len, shown.values()))
    heads = ("mean", "std", "least", *(f"{p} %" for p in PERCENTILES), "most")
    yield " " * width + "".join(f"{head:>12}" for head in heads)
    for name, column in metrics.items():
        values = column[np.isfinite(column)]
        if len(values):
            middle = np.percentile(values, PERCENTILES)
            numbers = (values.mean(), values.std(), values.min(), *middle, values.max())
            yield f"{shown[name]:{width}}" + "".join(f"{number:12.5g}" for number in numbers)


def _ranks(metrics: Mapping[str, Array], factors: Mapping[str, Array]) -> Iterator[str]:
    for name, column in metrics.items():
        best = ranked(factors, column, SHOWN)
        found = [f"{f} {rank_correlation(x, column):+.2f}" for f, x in best.items()]
        if found:
            yield f"  {name}: " + ", ".join(found)
    lines = (left_out(name, factors, column) for name, column in metrics.items())
    yield from (f"  left out: {line}" for line in lines if line)


def failures(store: Store) -> dict[int, str]:
    """Why each run that has failed or not succeeded did so, by its number."""
    found, messages = success(store), store.array("message")
    runs = found.missed if found else np.flatnonzero(store.array("status") == FAILED).tolist()
    told = {run: messages[run].splitlines() or [f"{SUCCESS}: not met"] for run in runs}
    return {
        run: "; ".join([line for line in lines if ": not met" in line] or lines)
        for run, lines in told.items()
    }


def _failures(store: Store, shown: str) -> Iterator[str]:
    found = failures(store)
    system = store.system
    for run, why in [*found.items()][:LISTED]:
        yield f"failed: run {run}: {one_line(why)}"
        yield f"    harness run {system} --like {shown}#{run}"
    if len(found) > LISTED:
        yield f"failed: and {len(found) - LISTED} more: `message` of the dataset, harness report"


def worst(store: Store, metrics: Mapping[str, Array]) -> tuple[str, list[int]]:
    """Metric and numbers of the ten worst runs: largest first, or smallest if the campaign says
    `worst = "-metric"`.
    """
    wanted = Plan(*store.definition()).table.worst
    given = wanted if wanted and isinstance(wanted, str) else next(iter(metrics))
    name = given.removeprefix("-")
    sign = 1.0 if given.startswith("-") else -1.0
    order = np.argsort(sign * metrics[name], kind="stable")
    return name, [int(k) for k in order if np.isfinite(metrics[name][k])][:WORST]


def _worst(store: Store, metrics: Mapping[str, Array], shown: str) -> Iterator[str]:
    name, found = worst(store, metrics)
    yield f"worst by {with_unit(name, store.units())}"
    system = store.system
    for run in found:
        yield f"  {metrics[name][run]:12.5g}  harness run {system} --like {shown}#{run}"
