# SPDX-License-Identifier: BSD-2-Clause
"""The bar that a long run or comparison shows on a terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress_bar(title: str, total: int, wanted: bool) -> Iterator[Callable[[int], None] | None]:
    """A bar on stderr that vanishes at the end, as a function of the number of steps done; None if
    unwanted.
    """
    if not wanted:
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(file=sys.stderr), transient=True) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done: bar.update(task, completed=done)
