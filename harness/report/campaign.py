# SPDX-License-Identifier: BSD-2-Clause
"""Page of a campaign: success, metrics, the most influential factors, percentile bands over time,
worst runs and failed runs. The page of a study has further plots: effects of factors as a tornado
diagram, or margins and worst runs of a search.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import ResultsError
from harness.figures import campaign as figures
from harness.figures.style import Style, save
from harness.report import comparison
from harness.report.arrays import Arrays, Canvas
from harness.report.plots import PAGE, Plot, Shown, diagram, painted
from harness.report.template import render
from harness.results.files import read
from harness.results.result import Array, Result
from harness.spelling import file_stem
from harness.studies.analyses.study import SHOWN, Study
from harness.studies.analyses.worst import confirmed
from harness.studies.campaign import summary
from harness.studies.campaign.store import Store
from harness.studies.campaign.worker import COMPLETE, FAILED, PENDING
from harness.system.units import with_unit

POINTS = 3000
"""Approximate largest number of points on each edge of a percentile band, and of runs that a plot
shows as dots.
"""
STATES = {"complete": COMPLETE, "failed": FAILED, "pending": PENDING}
"""Values of the array `status` of a dataset, by the word that the page shows."""


def of_dataset(path: Path) -> str:
    """Return the page of a campaign or study as HTML text; path: its Zarr dataset. Raises
    ResultsError if the dataset cannot be read.
    """
    store = Store.open(path)
    try:
        return _page(store, path)
    except (OSError, KeyError, ValueError) as error:
        raise ResultsError(f"{path}: cannot be read ({error})") from error


def _page(store: Store, path: Path) -> str:
    study = Study(path, store) if "estimate" in store.group.attrs else None
    canvas, confirmed = Canvas(Arrays(), POINTS), confirmed_runs(study) if study else {}
    beside = comparison.canvas_of(confirmed, canvas.arrays)
    compared = comparison.figures(beside, confirmed, "beside") if confirmed else ()
    shown = _figures(canvas, store, study)
    return render(
        "campaign.html",
        canvas,
        comparison.side_by_side(confirmed, canvas.arrays, [*shown, *compared]),
        name=path.name,
        system=store.system,
        command=f"harness run {store.system} --like {path}#",
        confirmed=list(confirmed),
        study=study.summary() if study else "",
        **_texts(store),
    )


def _texts(store: Store) -> dict[str, Any]:
    """Return the texts and tables that the template campaign.html needs, by name."""
    status, (metrics, factors) = store.array("status"), _shown(store)
    return {
        "count": {state: int((status == value).sum()) for state, value in STATES.items()},
        "success": summary.success(store),
        "shares": summary.requirements(store),
        "groups": summary.by_category(store),
        "expected": list(summary.expectations(store)),
        "metrics": {name: summary.statistics(values) for name, values in metrics.items()},
        "lacking": list(summary.lacking(store)),
        "chance": [summary.left_out(name, factors, x) for name, x in metrics.items()],
        "failures": summary.failures_by_category(store),
        "definition": store.definition()[0],
        **_worst(store),
    }


def _worst(store: Store) -> dict[str, Any]:
    """Return the metric that ranks the worst runs, and its value in each of these runs, for the
    template.
    """
    metrics = _finite(store)
    worst, runs = summary.worst(store, metrics) if metrics else ("", [])
    return {"worst": worst, "worst_runs": {run: metrics[worst][run] for run in runs}}


def _finite(store: Store) -> dict[str, Array]:
    """Return the values (runs,) of the metrics that are finite in at least one run."""
    return {n: x for n, x in summary.metric_columns(store).items() if np.isfinite(x).any()}


def _figures(canvas: Canvas, store: Store, study: Study | None) -> Iterator[Shown]:
    """Yield the figures of all sections of the page."""
    yield "study", "study", "", list(study_plots(canvas, study)) if study else []
    with PAGE.used():
        for section, _, drawing in drawings(store, PAGE):
            yield section, section, "", painted(canvas, drawing)


def drawings(store: Store, style: Style) -> Iterator[tuple[str, str, Any]]:
    """Draw the figures of a campaign with matplotlib; yield for each figure the section of the
    page, the stem of a file name, and the figure.

    The figures are: histograms of the metrics; each metric over the two factors of a grid, or over
    its most influential factors; each metric, grouped by the values of every factor whose values
    are texts; percentile bands over time.
    """
    metrics, factors = _shown(store)
    if metrics:
        yield "histograms", "histograms", figures.histograms(metrics, style)
    grouped = summary.categories(store)
    for name, values in metrics.items() if factors or grouped else ():
        plain = name.partition(" [")[0]
        if summary.is_grid(factors) and not grouped:
            yield "factors", f"map_{plain}", figures.chart(name, values, factors, style)
        elif ranked := summary.ranked(factors, values):
            shown = {f: (x, summary.rank_correlation(x, values)) for f, x in ranked.items()}
            yield "factors", plain, figures.scatter(name, values, shown, style)
        for factor, texts in grouped.items():
            drawn = figures.groups(name, values, factor, texts, style)
            yield "factors", f"{plain}_by_{factor}", drawn
    yield from _bands(store, style)


def pictures(path: Path, folder: Path, ending: str, style: Style) -> list[Path]:
    """Draw the figures of a campaign into files in a folder, and return their paths; path: Zarr
    dataset; ending: of the files, such as `png`. Raises ResultsError if the
    dataset cannot be read or a file cannot be written.
    """
    store = Store.open(path)
    with style.used():
        return [
            save(drawing, folder / f"{file_stem(f'campaign_{stem}')}.{ending}")
            for _, stem, drawing in drawings(store, style)
        ]


def _bands(store: Store, style: Style) -> Iterator[tuple[str, str, Any]]:
    """Yield the figures of percentile bands over time, as drawings() does."""
    units = store.units()
    for stored in store.names("band"):
        band, plain = store.array(stored), stored.removesuffix("_band")
        elements = [f"{plain}[{k + 1}]" for k in range(band.shape[2])]
        labels = [with_unit(name, units) for name in (elements if len(elements) > 1 else [plain])]
        time, percentiles = store.array("time"), store.array("percentile").tolist()
        yield "bands", f"band_{plain}", figures.bands(labels, time, percentiles, band, style)


def _shown(store: Store) -> tuple[dict[str, Array], dict[str, Array]]:
    """Return two dictionaries by name with unit: the values (runs,) of the metrics that are finite
    in at least one run, and the values of the factors that differ between runs.
    """
    units = store.units()
    both = (_finite(store), summary.varying_factors(store))
    found = ({with_unit(name, units): x for name, x in each.items()} for each in both)
    return next(found), next(found)


# ---- plots of a study


WORST = 30
"""Number of worst runs in the plot of the standard normal coordinates from which the factors of a
run are computed.
"""


def study_plots(canvas: Canvas, study: Study) -> Iterator[Plot]:
    """Yield the plots of a study."""
    store, estimate = study.store, study.estimate
    names = [str(n) for n in store.array("requirement")]
    for name, found in estimate["of"].items():
        if "value" in found:
            yield _tornado(canvas, name, found, estimate["factors"])
        if "run" in found:
            k = names.index(name)
            yield _convergence(canvas, name, store, k, found)
            yield _parallel(canvas, name, store, k)


def confirmed_runs(study: Study) -> dict[str, Result]:
    """Return the results of the nominal run and of the worst run of each requirement, by label,
    from the files of a search for the worst case. Runs without a results file are left out; a
    study of another kind gives {}.
    """
    if study.kind != "worst":
        return {}
    files = confirmed(study.path, study.estimate["of"])
    return {label: read(file) for label, file in files.items()}


def _line(canvas: Canvas, x: Any, y: Any, **look: Any) -> Plot:
    return canvas.line(x, y, **{"name": "", "colour": 0, "dash": "solid", **look})


def _tornado(canvas: Canvas, name: str, found: Any, factors: list[str]) -> Plot:
    """Return a plot of the effects of the factors as bars, the largest on top, with their 95 %
    intervals as lines.
    """
    order = np.argsort(found["value"])[-SHOWN:]
    curves = []
    for place, k in enumerate(order):
        bar = [0, found["value"][k], found["value"][k], 0, 0]
        edge = np.array([-0.4, -0.4, 0.4, 0.4, -0.4]) + place
        curves.append(_line(canvas, bar, edge, name=factors[k], fill=True, colour=place))
        ends = [found["low"][k], found["high"][k]]
        curves.append(_line(canvas, ends, [float(place)] * 2, colour=place, dash="dash"))
    return diagram(f"{name}: importance, with 95 % intervals", "effect", "factor", curves)


def _convergence(canvas: Canvas, name: str, store: Store, column: int, found: Any) -> Plot:
    """Return a plot of the margins of all runs of a search in the order of the runs, and of the
    smallest margin so far.

    name: requirement; column: its index among the margins; found: estimate for this requirement.
    """
    label = f"margin of {name} [{store.array('margin_units')[column] or '1'}]"
    last = found["run"] - found["place"] + found["runs"]
    y = store.array("margin")[:, column][last - found["runs"] : last]
    y = np.where(np.isfinite(y), y, np.nan)
    run = np.arange(1, len(y) + 1)
    curves = [
        _line(canvas, run, y, name="runs", marker="dot"),
        _line(canvas, run, np.fmin.accumulate(y), name="worst so far", colour=1),
    ]
    return diagram(label, "run", label, curves)


def _parallel(canvas: Canvas, name: str, store: Store, column: int) -> Plot:
    """Return a plot of the standard normal coordinates of the worst runs, a line per run. Runs in
    which the requirement fails have another colour. column: index of the requirement among the
    margins.
    """
    numbers, margins = store.array("numbers"), store.array("margin")[:, column]
    axis = np.arange(1, numbers.shape[1] + 1)
    curves = [
        _line(canvas, axis, numbers[k], colour=int(margins[k] < 0))
        for k in np.argsort(margins, kind="stable")[:WORST]
    ]
    title = f"{name}: the worst {len(curves)} runs (orange: not met)"
    return diagram(title, "coordinate", "standard deviations", curves)
