# SPDX-License-Identifier: BSD-2-Clause
"""Figures of a campaign: histograms of metrics, metrics over factors, percentile bands over time.

Names of metrics and factors include their units.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from harness.figures.style import Style, legend_above, new_canvas, time_axis
from harness.results.result import Array

Canvas = Any
"""Figure of matplotlib."""
COLUMNS, TICKS = 3, 8
"""COLUMNS: number of panels side by side. TICKS: if a factor has at most this number of values,
chart() draws a tick at each value.
"""


def histograms(metrics: Mapping[str, Array], style: Style) -> Canvas:
    """Draw one histogram per metric."""
    canvas, panels = _grid("Metrics of all runs", len(metrics), style)
    for axes, (name, values) in zip(panels, metrics.items(), strict=True):
        counts, edges = np.histogram(values[np.isfinite(values)], bins="auto")
        axes.stairs(counts, edges, fill=True, color="C0")
        axes.set(title=name, xlabel=name, ylabel="runs")
    return canvas


def scatter(
    metric: str, values: Array, factors: Mapping[str, tuple[Array, float]], style: Style
) -> Canvas:
    """Draw the values of a metric (runs,) over each factor, one panel per factor.

    factors: values (runs,) of each factor and its rank correlation with the metric, by name of the
    factor, in the order of the panels.
    """
    canvas, panels = _grid(metric, len(factors), style)
    for axes, (name, (x, correlation)) in zip(panels, factors.items(), strict=True):
        axes.plot(x, values, ".", markersize=3, alpha=0.5)
        axes.set(title=f"rank correlation {correlation:+.2f}", xlabel=name)
        axes.sharey(panels[0])
    for axes in panels[::COLUMNS]:
        axes.set(ylabel=metric)
    return canvas


def groups(metric: str, values: Array, factor: str, texts: Any, style: Style) -> Canvas:
    """Draw the values of a metric (runs,) separately for each text that a factor takes: one row per
    text with a dot per run and a line at the median. texts: text of the factor in every run.
    """
    canvas, (axes,) = _grid("", 1, style)
    names = [str(name) for name in np.unique(texts)]
    for k, name in enumerate(names):
        own = values[(texts == name) & np.isfinite(values)]
        axes.plot(own, k + np.linspace(-0.25, 0.25, len(own)), ".", markersize=3, alpha=0.5)
        if len(own):
            axes.plot([np.median(own)] * 2, [k - 0.3, k + 0.3], "C1")
    axes.set(title=f"{metric} by {factor}", xlabel=metric)
    axes.set_yticks(range(len(names)), names)
    return canvas


def chart(metric: str, values: Array, factors: Mapping[str, Array], style: Style) -> Canvas:
    """Draw the values of a metric (runs,) as colours over a grid of two factors. Cells without a
    run are white. factors: values (runs,) of the two factors by name.
    """
    x, y = factors.values()
    columns, rows = np.unique(x), np.unique(y)
    found = np.full((len(rows), len(columns)), np.nan)
    found[np.searchsorted(rows, y), np.searchsorted(columns, x)] = values
    canvas, (axes,) = _grid("", 1, style)
    mesh = axes.pcolormesh(columns, rows, found, shading="nearest")
    axes.set(title=metric, **dict(zip(("xlabel", "ylabel"), factors, strict=True)))
    axes.grid(False)
    for axis, places in ((axes.xaxis, columns), (axes.yaxis, rows)):
        if len(places) <= TICKS:
            axis.set_ticks(places)
    canvas.colorbar(mesh, ax=axes, label=metric)
    return canvas


def bands(
    labels: Sequence[str], time: Array, percentiles: Sequence[float], band: Array, style: Style
) -> Canvas:
    """Draw percentiles of a time series over all runs, one panel per element. The areas between the
    first and the last percentile, the second and the second last, and so on, are filled; the middle
    percentile is a line.

    labels: one label per element; time: [s]; percentiles: [%], in increasing order, odd in number;
    band: values (percentile, time, element).
    """
    canvas, panels = _grid(labels[0].partition("[")[0].strip(), len(labels), style)
    unit, words = time_axis(time).seconds, time_axis(time).label
    for k, (axes, label) in enumerate(zip(panels, labels, strict=True)):
        for low in range(len(percentiles) // 2):
            name = f"{percentiles[low]:g} to {percentiles[-1 - low]:g} %"
            look = {"color": "C0", "alpha": 0.2 * (low + 1), "linewidth": 0, "label": name}
            axes.fill_between(time / unit, band[low, :, k], band[-1 - low, :, k], **look)
        axes.plot(time / unit, band[len(percentiles) // 2, :, k], "C1", label="median")
        axes.set(xlabel=words, ylabel=label)
    legend_above(panels[0])
    return canvas


def _grid(title: str, count: int, style: Style) -> tuple[Canvas, list[Any]]:
    columns = min(count, COLUMNS)
    rows = -(-count // columns)
    canvas = new_canvas(title, (1 + 3.4 * columns, 1 + 2.8 * rows), style)
    panels = [canvas.add_subplot(rows, columns, k + 1) for k in range(count)]
    for axes in panels:
        axes.locator_params(axis="x", nbins=4)
    return canvas, panels
