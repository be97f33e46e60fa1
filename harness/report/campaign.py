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
from harness.report import comparison, study
from harness.report.arrays import Arrays
from harness.report.plots import Canvas, Plot, number
from harness.report.template import render
from harness.results.result import Array
from harness.results.verdict import Judged, Verdict
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
    status, metrics = store.array("status"), summary.metric_columns(store)
    metrics = {name: x for name, x in metrics.items() if np.isfinite(x).any()}
    units = store.units()
    shown = {with_unit(name, units): x for name, x in metrics.items()}
    factors = {with_unit(n, units): x for n, x in summary.varying_factors(store).items()}
    arrays = Arrays()
    canvas, flown = Canvas(arrays, POINTS), study.flights(store, path)
    beside = comparison.canvas_of(flown, arrays)
    figures = [
        _figure("study", list(study.plots(canvas, store))),
        _figure("histograms", [_histogram(canvas, n, x) for n, x in shown.items()]),
        _figure("factors", [p for n, x in shown.items() for p in _against(canvas, n, x, factors)]),
        _figure("bands", list(_bands(canvas, store))),
    ]
    pages = [{"name": f["name"], "figures": [f]} for f in figures if f["plots"]]
    pages.append({"name": "beside", "figures": comparison.figures(beside, flown) if flown else []})
    return render(
        "campaign.html",
        arrays,
        comparison.side_by_side(flown, arrays, [page for page in pages if page["figures"]]),
        flown=list(flown),
        name=path.name,
        system=str(store.group.attrs["system"]),
        count={k: int((status == v).sum()) for k, v in STATES.items()},
        study=study.text(store, str(path)),
        success=_success(store),
        metrics=[_metric(name, x) for name, x in shown.items()],
        worst=_worst(store, metrics, path) if metrics else None,
        failures=_failures(store, path),
        shares=[_named(n, s) for n, s in summary.requirements(store).items()],
        expected=[_expectation(each) for each in summary.expectations(store)],
        chance=[line for n, x in shown.items() if (line := summary.left_out(n, factors, x))],
        definition=[{"name": k, "value": _text(v)} for k, v in store.definition()[0].items()],
        points=canvas.points if canvas.thinned else 0,
        dots=DOTS if len(status) > DOTS else 0,
    )


STATES = {"complete": COMPLETE, "failed": FAILED, "pending": PENDING}


def _figure(name: str, plots: list[Plot]) -> dict[str, Any]:
    return {"name": name, "title": "", "plots": plots}


# ---- numbers


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


def _worst(store: Store, metrics: Mapping[str, Array], path: Path) -> dict[str, Any]:
    """The worst runs, with the command that repeats each."""
    name, found = summary.worst(store, metrics)
    command = f"harness run {store.system} --like {path}#"
    rows = [{"value": f"{metrics[name][k]:.5g}", "command": f"{command}{k}"} for k in found]
    return {"metric": name, "runs": rows}


def _failures(store: Store, path: Path) -> list[dict[str, Any]]:
    """Every run that has failed or not succeeded, why, and the command that repeats it."""
    command = f"harness run {store.system} --like {path}#"
    return [
        {"run": run, "why": why, "command": f"{command}{run}"}
        for run, why in summary.failures(store).items()
    ]


def _named(name: str, found: summary.Share) -> dict[str, Any]:
    """A requirement: in how many runs it was met."""
    look = Verdict.NOT_MET if found.missed else Verdict.MET
    look = look if found.judged else Verdict.NOT_EXERCISED
    return {"name": name, "text": str(found), "look": look.value}


def _expectation(each: Judged) -> dict[str, str]:
    return {"text": each.text, "look": each.verdict.value}


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
    curve = {"x": canvas.arrays.keep(x), "y": canvas.arrays.keep(y)}
    look = {"name": "", "fill": True, "colour": 0, "dash": "solid"}
    return {"title": name, "x": name, "y": "runs", "time": False, "curves": [curve | look]}


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
        curve = {"x": canvas.arrays.keep(x[kept]), "y": canvas.arrays.keep(values[kept])}
        text = f"rank correlation {summary.rank_correlation(x, values):+.2f}"
        about = {"title": f"{name}: {text}", "x": factor, "y": name, "time": False}
        yield {**about, "curves": [curve | look]}


def _map(canvas: Canvas, name: str, values: Array, factors: Mapping[str, Array]) -> Plot:
    (x_name, x), (y_name, y) = factors.items()
    columns, rows = np.unique(x), np.unique(y)
    field = np.full((len(rows), len(columns)), np.nan)
    field[np.searchsorted(rows, y), np.searchsorted(columns, x)] = values
    curve = {
        "image": canvas.arrays.keep(field),
        "columns": columns.tolist(),
        "rows": rows.tolist(),
        "name": name,
    }
    return {"title": name, "x": x_name, "y": y_name, "time": False, "curves": [curve]}


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
            element = f"{plain}[{k + 1}]" if band.shape[2] > 1 else plain
            label = with_unit(element, units)
            curves = _edges(canvas, time, percentiles, band[:, :, k])
            yield {"title": label, "x": "time [s]", "y": label, "time": True, "curves": curves}


def _edges(canvas: Canvas, time: Array, percentiles: list[float], band: Array) -> list[Plot]:
    there = np.isfinite(band).all(axis=0)
    t, edges = time[there], band[:, there]
    curves = []
    for low in range(len(percentiles) // 2):
        x = np.concatenate((t, t[::-1]))
        y = np.concatenate((edges[low], edges[-1 - low][::-1]))
        name = f"{percentiles[low]:g} to {percentiles[-1 - low]:g} %"
        look = {"name": name, "fill": True, "colour": 0, "dash": "solid"}
        curves.append({"x": canvas.arrays.keep(x), "y": canvas.arrays.keep(y), **look})
    middle = edges[len(percentiles) // 2]
    name = f"{percentiles[len(percentiles) // 2]:g} %"
    return [*curves, canvas.curve(t, middle, name, colour=1, dash="solid")]
