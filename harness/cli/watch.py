# SPDX-License-Identifier: BSD-2-Clause
"""Displays of progress: of one run (`harness run --watch`), and of the many runs of a campaign.

The display of one run is a table on a terminal, which is updated during the run; elsewhere a line
is printed after each tenth of the run. It reads recorded rows while no component steps, so the
results have the same bits with and without a display.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from operator import itemgetter
from time import perf_counter
from typing import TYPE_CHECKING, Any

import typer

from harness.master.progress import Running, Show
from harness.mission import WatchedMetric
from harness.mission.library import of_result
from harness.results.result import Result
from harness.spelling import printable

if TYPE_CHECKING:
    from harness.studies.campaign.campaign import Progress

SECONDS = 0.25
"""Least wall-clock time between two updates on a terminal [s]."""
PARTS = 10
"""Number of lines that are printed during a run without a terminal."""
OTHERS = 6
"""Number of variables that are shown for a system without watched metrics."""


def watched_metrics(result: Result) -> list[WatchedMetric]:
    """Return the watched metrics of the mission whose variables the result has, or if there are
    none, the first OTHERS variables as metrics.
    """
    fitting = [metric for metric in of_result(result).watched if not metric.lacks(result)]
    return fitting or [
        WatchedMetric(name, unit if unit != "1" else "", (name,), itemgetter(name))
        for name, unit in zip(result.columns[:OTHERS], result.units, strict=False)
    ]


class Watcher:
    """Reader of the time, the pace and the watched metrics of a run in progress."""

    def __init__(self, run: Running) -> None:
        self.run = run
        self.name = printable(run.system.name)
        self.began = perf_counter()

    def part(self, done: int) -> float:
        """Return the completed share of the run, 0 to 1; done: number of completed macro steps."""
        return done / max(self.run.steps, 1)

    def lines(self, done: int) -> list[tuple[str, str]]:
        """Return pairs of name and value as text: time, pace, and the watched metrics in the last
        recorded row. done: number of completed macro steps.
        """
        now, experiment = _ends(self.run.result()), self.run.system.experiment
        start, step = experiment.start, experiment.step or 0.0
        factor = done * step / max(perf_counter() - self.began, 1e-9)
        read = ((metric.name, metric.text(now)) for metric in watched_metrics(now))
        return [
            ("time", f"{start + done * step:g} of {start + self.run.steps * step:g} s"),
            ("real time", f"x {factor:,.0f}" if factor >= 10 else f"x {factor:.2g}"),
            *((printable(name), printable(value)) for name, value in read if value),
        ]


def _ends(result: Result) -> Result:
    """Return a result with only its first two and last two rows. From the first two, metrics find
    whether the outputs for a row are in the next row.
    """
    rows = len(result.time)
    chosen = [0, 1, rows - 2, rows - 1] if rows > 3 else list(range(rows))
    return replace(result, time=result.time[chosen], values=result.values[chosen])


@contextmanager
def watched(run: Running) -> Iterator[Show]:
    """Yield a function that shows the state of a run on stdout after `done` macro steps."""
    if sys.stdout.isatty():
        with _on_terminal(Watcher(run)) as show:
            yield show
    else:
        yield _in_lines(Watcher(run))


def _in_lines(watcher: Watcher) -> Show:
    """Return a function that prints a line each time another of PARTS parts of the run is done."""
    due = 0

    def show(done: int) -> None:
        nonlocal due
        if (part := watcher.part(done)) * PARTS >= due:
            due = int(part * PARTS) + 1
            words = ", ".join(f"{label} {value}" for label, value in watcher.lines(done))
            print(f"{watcher.name} {100 * part:3.0f} %: {words}", flush=True)

    return show


@contextmanager
def _on_terminal(watcher: Watcher) -> Iterator[Show]:
    from rich.console import Console
    from rich.live import Live

    last = 0.0
    with Live(console=Console(file=sys.stdout), auto_refresh=False) as live:

        def show(done: int) -> None:
            nonlocal last
            if done == watcher.run.steps or perf_counter() - last > SECONDS:
                live.update(_table(watcher, done), refresh=True)
                last = perf_counter()

        yield show


def _table(watcher: Watcher, done: int) -> Any:
    from rich.progress_bar import ProgressBar
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2))
    table.add_column(no_wrap=True, overflow="ellipsis")
    table.add_column(no_wrap=True, overflow="ellipsis", min_width=24)
    table.add_row(Text(watcher.name, "bold"), ProgressBar(1.0, watcher.part(done), width=24))
    for label, value in watcher.lines(done):
        table.add_row(Text(label), Text(value))
    return table


# ---- many runs

MINUTE = 60.0


@contextmanager
def counting(title: str, wanted: bool) -> Iterator[Callable[[Progress], None] | None]:
    """Yield a function that shows the progress of many runs on stderr, or None if not `wanted`.

    On a terminal it updates a bar with rate, remaining time and number of failed runs, elsewhere it
    prints a line at most once a minute.
    """
    if not wanted:
        yield None
        return
    if not sys.stderr.isatty():
        yield _minutely(title)
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


def _minutely(title: str) -> Callable[[Progress], None]:
    """Return a function that prints the progress of many runs, at most one line a minute."""
    begin = last = time.monotonic()
    first: int | None = None  # completed runs at the first call

    def show(now: Progress) -> None:
        nonlocal begin, last, first
        clock = time.monotonic()
        if first is None:
            begin, first = clock, now.done
        if clock - last < MINUTE:
            return
        last = clock
        rate = (now.done - first) / (clock - begin) if clock > begin else 0.0
        left = f", {(now.runs - now.done) / rate / MINUTE:.0f} min left" if rate else ""
        typer.echo(f"{title}: {now.done} of {now.runs}, {now.failed} failed{left}", err=True)

    return show
