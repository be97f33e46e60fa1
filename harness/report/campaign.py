# SPDX-License-Identifier: BSD-2-Clause
"""The page of a campaign: success, metrics, the factors that matter, bands over time, and the runs
that are worth a look.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import ResultsError
from harness.figures import campaign as figures
from harness.figures.style import Style
from harness.report import comparison, study
from harness.report.arrays import Arrays, Canvas
from harness.report.plots import PAGE, Shown, painted
from harness.report.template import render
from harness.results.result import Array
from harness.studies.campaign import summary
from harness.studies.campaign.store import Store
from harness.studies.campaign.worker import COMPLETE, FAILED, PENDING
from harness.system.units import with_unit

POINTS = 3000
"""Points of an edge of a band, and runs that a plot shows as dots, at most."""
STATES = {"complete": COMPLETE, "failed": FAILED, "pending": PENDING}


def of_dataset(path: Path) -> str:
    """The page of the Zarr dataset of a campaign as text; ResultsError if it is none."""
    store = Store.open(path)
    try:
        return _page(store, path)
    except (OSError, KeyError, ValueError) as error:
        raise ResultsError(f"{path}: cannot be read ({error})") from error


def _page(store: Store, path: Path) -> str:
    canvas, flown = Canvas(Arrays(), POINTS), study.flights(store, path)
    beside = comparison.canvas_of(flown, canvas.arrays)
    compared = comparison.figures(beside, flown, "beside") if flown else ()
    return render(
        "campaign.html",
        canvas,
        comparison.side_by_side(flown, canvas.arrays, [*_figures(canvas, store), *compared]),
        name=path.name,
        system=store.system,
        command=f"harness run {store.system} --like {path}#",
        flown=list(flown),
        study=study.text(store, path),
        **_told(store),
    )


def _told(store: Store) -> dict[str, Any]:
    """What the page says in words and tables."""
    status, (metrics, factors) = store.array("status"), _shown(store)
    return {
        "count": {state: int((status == value).sum()) for state, value in STATES.items()},
        "success": summary.success(store),
        "shares": summary.requirements(store),
        "expected": list(summary.expectations(store)),
        "metrics": {name: _numbers(values) for name, values in metrics.items()},
        "chance": [summary.left_out(name, factors, x) for name, x in metrics.items()],
        "failures": summary.failures(store),
        "definition": store.definition()[0],
        **_worst(store),
    }


def _worst(store: Store) -> dict[str, Any]:
    """The metric of which the worst runs are told, and its value in them."""
    metrics = _finite(store)
    worst, runs = summary.worst(store, metrics) if metrics else ("", [])
    return {"worst": worst, "worst_runs": {run: metrics[worst][run] for run in runs}}


def _finite(store: Store) -> dict[str, Array]:
    """Metrics that are a number in some run."""
    return {n: x for n, x in summary.metric_columns(store).items() if np.isfinite(x).any()}


def _numbers(values: Array) -> list[float]:
    """Mean, spread, least, percentiles and most."""
    finite = values[np.isfinite(values)]
    middle = np.percentile(finite, summary.PERCENTILES)
    return [finite.mean(), finite.std(), finite.min(), *middle, finite.max()]


def _figures(canvas: Canvas, store: Store) -> Iterator[Shown]:
    """What the sections show."""
    yield "study", "study", "", list(study.plots(canvas, store))
    with PAGE.used():
        for section, _, drawing in drawings(store, PAGE):
            yield section, section, "", painted(canvas, drawing)


def drawings(store: Store, style: Style) -> Iterator[tuple[str, str, Any]]:
    """Section of the page, name of the file and figure of matplotlib of all that there is to see:
    metrics, each of them against the factors that matter or over a grid of two, bands over time.
    """
    metrics, factors = _shown(store)
    if metrics:
        yield "histograms", "histograms", figures.histograms(metrics, style)
    for name, values in metrics.items() if factors else ():
        plain = name.partition(" [")[0]
        if summary.is_grid(factors):
            yield "factors", f"map_{plain}", figures.chart(name, values, factors, style)
        elif ranked := summary.ranked(factors, values):
            told = {f: (x, summary.rank_correlation(x, values)) for f, x in ranked.items()}
            yield "factors", plain, figures.scatter(name, values, told, style)
    yield from _bands(store, style)


def _bands(store: Store, style: Style) -> Iterator[tuple[str, str, Any]]:
    units = store.units()
    for stored in store.names("band"):
        band, plain = store.array(stored), stored.removesuffix("_band")
        elements = [f"{plain}[{k + 1}]" for k in range(band.shape[2])]
        labels = [with_unit(name, units) for name in (elements if len(elements) > 1 else [plain])]
        time, percentiles = store.array("time"), store.array("percentile").tolist()
        yield "bands", f"band_{plain}", figures.bands(labels, time, percentiles, band, style)


def _shown(store: Store) -> tuple[dict[str, Array], dict[str, Array]]:
    """Metrics that are a number in some run, and factors that vary, by name and unit."""
    units = store.units()
    both = (_finite(store), summary.varying_factors(store))
    found = ({with_unit(name, units): x for name, x in each.items()} for each in both)
    return next(found), next(found)
