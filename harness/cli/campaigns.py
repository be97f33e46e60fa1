# SPDX-License-Identifier: BSD-2-Clause
"""What `harness campaign` shows: its progress, and the pictures of its dataset."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import typer

from harness.figures.style import Style, get_ready, save
from harness.report.campaign import drawings
from harness.spelling import file_stem
from harness.studies.campaign.campaign import Progress
from harness.studies.campaign.store import Store

MINUTE = 60.0

Show = Callable[[Progress], None]


@contextmanager
def counting(title: str, wanted: bool) -> Iterator[Show | None]:
    """A bar on stderr with rate, remaining time and failures, a line a minute where that is no
    terminal; None if unwanted.
    """
    if not wanted:
        yield None
        return
    if not sys.stderr.isatty():
        yield _lines(title)
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


def drawing_soon(show: Show | None) -> Show:
    """The same, and what draws is ready after the first call: while runs fly, not after them."""

    def shown(now: Progress) -> None:
        with suppress(ImportError):  # which is told when all runs are kept
            get_ready()
        if show is not None:
            show(now)

    return shown


def _lines(title: str) -> Show:
    """What writes a line after a block if the last one is a minute old."""
    begin = last = time.monotonic()
    first: int | None = None  # runs of an earlier session, and of the first block

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


def pictures(store: Store, folder: Path, ending: str, style: Style) -> list[Path]:
    """Histograms of the metrics, each metric against the factors that matter, bands over time."""
    with style.used():
        return [
            save(drawing, folder / f"{file_stem(f'campaign_{stem}')}.{ending}")
            for _, stem, drawing in drawings(store, style)
        ]
