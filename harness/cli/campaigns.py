# SPDX-License-Identifier: BSD-2-Clause
"""What `harness campaign` shows: its progress, and the pictures of its dataset."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from harness.figures import campaign as figures
from harness.figures.style import style_of
from harness.studies.campaign import summary
from harness.studies.campaign.campaign import Progress
from harness.studies.campaign.store import Store


@contextmanager
def counting(title: str, wanted: bool) -> Iterator[Callable[[Progress], None] | None]:
    """A bar on stderr with rate, remaining time and failures; None if unwanted."""
    if not wanted:
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed} of {task.total}, {task.fields[failed]} failed"),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    with Bar(*columns, console=Console(file=sys.stderr), transient=True) as bar:
        line = bar.add_task(title, total=None, failed=0, rate="")

        def show(now: Progress) -> None:
            speed = bar.tasks[0].finished_speed or bar.tasks[0].speed
            rate = f"{speed:.1f} runs/s" if speed else ""
            bar.update(line, completed=now.done, total=now.runs, failed=now.failed, rate=rate)

        yield show


def pictures(store: Store, folder: Path, ending: str, style: str) -> list[Path]:
    """Histograms of the metrics, each metric against the factors that matter, bands over time."""
    place = figures.Place(folder, ending, style_of(style), store.units())
    with place.style.used():
        return list(_pictures(store, place))


def _pictures(store: Store, to: figures.Place) -> Iterator[Path]:
    metrics = {n: c for n, c in summary.metric_columns(store).items() if np.isfinite(c).any()}
    factors = summary.varying_factors(store)
    if metrics:
        yield figures.histograms(metrics, to)
    for name, column in metrics.items() if factors else ():
        shown = summary.ranked(factors, column)
        draw = figures.chart if summary.is_grid(factors) else figures.scatter
        yield draw(name, column, shown, to)
    for name in store.names("band"):
        numbers: Any = store.array("percentile").tolist()
        band = store.array(name)
        plain = name.removesuffix("_band")
        yield figures.bands(plain, store.array("time"), numbers, band, to)
