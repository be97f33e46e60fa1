# SPDX-License-Identifier: BSD-2-Clause
"""The page of a campaign: success, metrics, the factors that matter, bands over time, and the runs
that are worth a look.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from harness.errors import ResultsError
from harness.figures.campaign import element, field, pairs
from harness.report import comparison, study
from harness.report.arrays import Arrays, Canvas
from harness.report.plots import Plot, diagram, number
from harness.report.template import render
from harness.results.result import Array
from harness.results.verdict import Verdict
from harness.studies.campaign import summary
from harness.studies.campaign.store import Store
from harness.studies.campaign.worker import COMPLETE, FAILED, PENDING
from harness.system.units import with_unit

DOTS = 3000
"""Runs that a plot shows as dots, at most."""
POINTS = 1500
"""Points of an edge of a band."""


def of_dataset(path: Path) -> str:
    """The page of the Zarr dataset of a campaign as text; ResultsError if it is none."""
    store = Store.open(path)
    try:
        return _page(store, path)
    except (OSError, KeyError, ValueError) as error:
        raise ResultsError(f"{path}: cannot be read ({error})") from error


def _page(store: Store, path: Path) -> str:
    units = store.units()
    found = summary.metric_columns(store).items()
    metrics = {name: x for name, x in found if np.isfinite(x).any()}
    shown = {with_unit(name, units): x for name, x in metrics.items()}
    factors = {with_unit(n, units): x for n, x in summary.varying_factors(store).items()}
    arrays = Arrays()
    canvas, flown = Canvas(arrays, POINTS), study.flights(store, path)
    beside = comparison.canvas_of(flown, arrays)
    pages = _figures(canvas, store, shown, factors)
    pages.append({"name": "beside", "figures": comparison.figures(beside, flown) if flown else []})
    return render(
        "campaign.html",
        canvas,
        comparison.side_by_side(flown, arrays, [page for page in pages if page["figures"]]),
        **_runs(store, metrics, path),
        flown=list(flown),
        study=study.text(store, path),
        **_told(store, shown, factors),
    )


STATES = {"complete": COMPLETE, "failed": FAILED, "pending": PENDING}


def _figures(
    canvas: Canvas, store: Store, shown: Mapping[str, Array], factors: Mapping[str, Array]
) -> list[dict[str, Any]]:
    """The sections that have something to show, each with one figure."""
    plots = {
        "study": list(study.plots(canvas, store)),
        "histograms": [_histogram(canvas, name, x) for name, x in shown.items()],
        "factors": [p for name, x in shown.items() for p in _against(canvas, name, x, factors)],
        "bands": list(_bands(canvas, store)),
    }
    return [
        {"name": name, "figures": [{"name": name, "title": "", "plots": found}]}
        for name, found in plots.items()
        if found
    ]


# ---- numbers


def _told(
    store: Store, shown: Mapping[str, Array], factors: Mapping[str, Array]
) -> dict[str, list[Any]]:
    """The tables of the page."""
    chance = (summary.left_out(name, factors, x) for name, x in shown.items())
    return {
        "metrics": [_metric(name, x) for name, x in shown.items()],
        "shares": [_named(n, s) for n, s in summary.requirements(store).items()],
        "expected": [
            {"text": e.text, "look": e.verdict.value} for e in summary.expectations(store)
        ],
        "chance": [line for line in chance if line],
        "definition": [{"name": k, "value": _text(v)} for k, v in store.definition()[0].items()],
    }


def _success(store: Store) -> dict[str, Any] | None:
    """Share of the runs that have succeeded, with its interval of 95 %."""
    if (found := summary.success(store)) is None or not found.judged:
        return None
    low, high = found.interval()
    share = found.met / found.judged
    return {"count": found.met, "of": found.judged, "share": share, "low": low, "high": high}


def _metric(name: str, values: Array) -> dict[str, Any]:
    finite = values[np.isfinite(values)]
    middle = np.percentile(finite, summary.PERCENTILES)
    numbers = (finite.mean(), finite.std(), finite.min(), *middle, finite.max())
    return {"name": name, "cells": [f"{x:.5g}" for x in numbers]}


def _runs(store: Store, metrics: Mapping[str, Array], path: Path) -> dict[str, Any]:
    """How many runs there are, and the worst, the failed and those without success, each with the
    command that repeats it.
    """
    status, command = store.array("status"), f"harness run {store.system} --like {path}#"
    return {
        "name": path.name,
        "system": str(store.group.attrs["system"]),
        "count": {k: int((status == v).sum()) for k, v in STATES.items()},
        "success": _success(store),
        "worst": _worst(store, metrics, command) if metrics else None,
        "failures": [
            {"run": run, "why": why, "command": f"{command}{run}"}
            for run, why in summary.failures(store).items()
        ],
        "dots": DOTS if len(status) > DOTS else 0,
    }


def _worst(store: Store, metrics: Mapping[str, Array], command: str) -> dict[str, Any]:
    name, found = summary.worst(store, metrics)
    runs = [{"value": f"{metrics[name][k]:.5g}", "command": f"{command}{k}"} for k in found]
    return {"metric": name, "runs": runs}


def _named(name: str, found: summary.Share) -> dict[str, Any]:
    """A requirement: in how many runs it was met."""
    look = Verdict.NOT_MET if found.missed else Verdict.MET
    look = look if found.judged else Verdict.NOT_EXERCISED
    return {"name": name, "text": str(found), "look": look.value}


def _text(value: Any) -> str:
    """A part of the definition for reading."""
    if isinstance(value, Mapping):
        return ", ".join(f"{name}: {_text(each)}" for name, each in value.items())
    return number(value) if isinstance(value, float) else str(value)


# ---- plots


def _histogram(canvas: Canvas, name: str, values: Array) -> Plot:
    """Runs by the value of a metric, as an outline."""
    counts, edges = np.histogram(values[np.isfinite(values)], bins="auto")
    x = np.repeat(edges, 2)
    y = np.concatenate(([0], np.repeat(counts, 2), [0])).astype(np.float64)
    look = {"name": "", "fill": True, "colour": 0, "dash": "solid"}
    return diagram(name, name, "runs", [canvas.line(x, y, **look)])


def _against(
    canvas: Canvas, name: str, values: Array, factors: Mapping[str, Array]
) -> Iterator[Plot]:
    """A metric over the factors that matter most, or as colours over a grid of two."""
    if not factors:
        return
    if summary.is_grid(factors):
        yield _map(canvas, name, values, factors)
        return
    kept = np.linspace(0, len(values) - 1, min(DOTS, len(values))).round().astype(np.intp)
    look = {"name": "", "marker": "dot", "colour": 0, "dash": "solid"}
    for factor, x in summary.ranked(factors, values).items():
        title = f"{name}: rank correlation {summary.rank_correlation(x, values):+.2f}"
        yield diagram(title, factor, name, [canvas.line(x[kept], values[kept], **look)])


def _map(canvas: Canvas, name: str, values: Array, factors: Mapping[str, Array]) -> Plot:
    columns, rows, found = field(values, factors)
    image = {"image": canvas.arrays.keep(found), "columns": columns.tolist(), "rows": rows.tolist()}
    x_name, y_name = factors
    return diagram(name, x_name, y_name, [image | {"name": name}])


def _bands(canvas: Canvas, store: Store) -> Iterator[Plot]:
    """Percentiles over time: the outermost pairs filled, the median as a line."""
    names = store.names("band")
    if not names:
        return
    time, percentiles = store.array("time"), store.array("percentile").tolist()
    units = store.units()
    for name in names:
        band = store.array(name)
        plain = name.removesuffix("_band")
        for k in range(band.shape[2]):
            label = with_unit(element(plain, k, band.shape[2]), units)
            curves = _edges(canvas, time, percentiles, band[:, :, k])
            yield {"title": label, "x": "time [s]", "y": label, "time": True, "curves": curves}


def _edges(canvas: Canvas, time: Array, percentiles: list[float], band: Array) -> list[Plot]:
    there = np.isfinite(band).all(axis=0)
    t, edges = time[there], band[:, there]
    curves = []
    for low, high, name in pairs(percentiles):
        x = np.concatenate((t, t[::-1]))
        y = np.concatenate((edges[low], edges[high][::-1]))
        curves.append(canvas.line(x, y, name=name, fill=True, colour=0, dash="solid"))
    middle = edges[len(percentiles) // 2]
    name = f"{percentiles[len(percentiles) // 2]:g} %"
    return [*curves, canvas.curve(t, middle, name, colour=1, dash="solid")]
