# SPDX-License-Identifier: BSD-2-Clause
"""Displays of the progress of a long run or of many runs."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

Show = Callable[[int], None]
"""Function that is called repeatedly with the number of completed steps."""
MINUTE = 60.0


@dataclass(frozen=True)
class Progress:
    """Progress of a campaign: number of completed runs, of all planned runs, and of failed runs
    among the completed ones.
    """

    done: int
    runs: int
    failed: int


@contextmanager
def progress_bar(title: str, total: int, requested: bool) -> Iterator[Show | None]:
    """Yield a function that draws a bar on stderr, to be called with the number of completed steps;
    the bar vanishes at the end. Yield None if no bar is requested.
    """
    if not requested:
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress as Bar

    with Bar(console=Console(file=sys.stderr), transient=True) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done: bar.update(task, completed=done)


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
        print(f"{title}: {now.done} of {now.runs}, {now.failed} failed{left}", file=sys.stderr)

    return show
