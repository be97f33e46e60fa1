# SPDX-License-Identifier: BSD-2-Clause
"""Pictures of a campaign: histograms of the metrics, the factors that matter, bands over time."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.figures.style import SCREEN, Style, legend_above, new_canvas, save, time_axis
from harness.results.result import Array
from harness.system.units import with_unit

COLUMNS, TICKS = 3, 8
"""Panels side by side; values of a factor up to which each has its tick."""


class Place(NamedTuple):
    """Where the pictures go, as which files, and for what they are drawn."""

    folder: Path
    ending: str = "png"
    style: Style = SCREEN
    units: Mapping[str, str] = {}

    def file(self, stem: str) -> Path:
        """Of a picture; stem: its name, in which only letters, digits, `_`, `.` and `-` stay."""
        plain = re.sub(r"[^\w.-]+", "_", stem)
        return self.folder / f"{plain}.{self.ending}"

    def label(self, name: str) -> str:
        """Of an axis."""
        return with_unit(name, self.units)


def histograms(metrics: Mapping[str, Array], to: Place) -> Path:
    """One histogram per metric."""
    canvas, panels = _grid("Metrics of all runs", len(metrics), to)
    for axes, (name, values) in zip(panels, metrics.items(), strict=True):
        axes.hist(values[np.isfinite(values)], bins="auto", color="C0", edgecolor="white")
        axes.set(xlabel=to.label(name), ylabel="runs")
    return save(canvas, to.file("campaign_histograms"))


def scatter(metric: str, values: Array, factors: Mapping[str, Array], to: Place) -> Path:
    """One metric against factors, those first that matter most."""
    canvas, panels = _grid(metric, len(factors), to)
    for axes, (name, x) in zip(panels, factors.items(), strict=True):
        axes.plot(x, values, ".", markersize=3, alpha=0.5)
        axes.set(xlabel=to.label(name))
        axes.sharey(panels[0])
    for axes in panels[::COLUMNS]:
        axes.set(ylabel=to.label(metric))
    return save(canvas, to.file(f"campaign_{metric}"))


def chart(metric: str, values: Array, factors: Mapping[str, Array], to: Place) -> Path:
    """One metric as colours over a grid of two factors."""
    columns, rows, colours = field(values, factors)
    x_name, y_name = factors
    canvas, panels = _grid(metric, 1, to)
    mesh = panels[0].pcolormesh(columns, rows, colours, shading="nearest")
    panels[0].set(xlabel=to.label(x_name), ylabel=to.label(y_name))
    panels[0].grid(False)
    for axis, places in ((panels[0].xaxis, columns), (panels[0].yaxis, rows)):
        if len(places) <= TICKS:
            axis.set_ticks(places)
    canvas.colorbar(mesh, ax=panels[0], label=to.label(metric))
    return save(canvas, to.file(f"campaign_map_{metric}"))


def field(values: Array, factors: Mapping[str, Array]) -> tuple[Array, Array, Array]:
    """Columns, rows and values of a metric over a grid of two factors; NaN: nothing was run."""
    x, y = factors.values()
    columns, rows = np.unique(x), np.unique(y)
    found = np.full((len(rows), len(columns)), np.nan)
    found[np.searchsorted(rows, y), np.searchsorted(columns, x)] = values
    return columns, rows, found


def pairs(percentiles: Sequence[float]) -> Iterator[tuple[int, int, str]]:
    """Places of the lower and the upper edge of every band, the widest first, and its name."""
    for k in range(len(percentiles) // 2):
        yield k, -1 - k, f"{percentiles[k]:g} to {percentiles[-1 - k]:g} %"


def element(name: str, k: int, count: int) -> str:
    """Of a band, counted from 1; a scalar has none."""
    return f"{name}[{k + 1}]" if count > 1 else name


def bands(name: str, time: Array, percentiles: Sequence[float], band: Array, to: Place) -> Path:
    """Percentiles (percentile, time, element) over time, the outermost pairs filled."""
    canvas, panels = _grid(name, band.shape[2], to)
    clock = time_axis(time)
    for k, axes in enumerate(panels):
        for low, high, label in pairs(percentiles):
            look = {"color": "C0", "alpha": 0.2 * (low + 1), "linewidth": 0, "label": label}
            axes.fill_between(time / clock.seconds, band[low, :, k], band[high, :, k], **look)
        axes.plot(time / clock.seconds, band[len(percentiles) // 2, :, k], "C0", label="median")
        label = to.label(element(name, k, band.shape[2]))
        axes.set(xlabel=clock.label, ylabel=label)
    legend_above(panels[0])
    return save(canvas, to.file(f"campaign_band_{name}"))


def _grid(title: str, count: int, to: Place) -> tuple[Any, list[Any]]:
    columns = min(count, COLUMNS)
    rows = -(-count // columns)
    canvas = new_canvas(title, (1 + 3.4 * columns, 1 + 2.8 * rows), to.style)
    panels = [canvas.add_subplot(rows, columns, k + 1) for k in range(count)]
    for axes in panels:
        axes.locator_params(axis="x", nbins=4)
    return canvas, panels
