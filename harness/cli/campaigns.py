# SPDX-License-Identifier: BSD-2-Clause
"""Display of the progress of many runs."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import typer

from harness.studies.campaign.campaign import Progress

MINUTE = 60.0

Show = Callable[[Progress], None]


@contextmanager
def counting(title: str, wanted: bool) -> Iterator[Show | None]:
    """Yield a display of progress: a bar on stderr with rate, remaining time and failures, or a
    line a minute without a terminal; None if not requested.
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


def _lines(title: str) -> Show:
    """Return a display that writes a line after a block of runs, at most once a minute."""
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
