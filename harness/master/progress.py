# SPDX-License-Identifier: BSD-2-Clause
"""Progress of a long run or comparison: no display, a bar on a terminal, or a function of the
caller.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

from harness.results.result import Result
from harness.system.model import System


class Running(Protocol):
    """Run in progress, as the display of its progress sees it."""

    system: System
    steps: int

    def result(self) -> Result:
        """Return the result so far."""


Show = Callable[[int], None]
"""Function that is called repeatedly with the number of complete steps."""
Watch = Callable[[Running], AbstractContextManager[Show]]
"""Function that opens the display of a run in progress; the display closes at the end of the `with`
block.
"""


@contextmanager
def shown(run: Running, progress: bool | Watch) -> Iterator[Show | None]:
    """Yield the function that updates the display of a run: a bar if `progress` is True, none
    (None) if False, or the display that a Watch opens.
    """
    if callable(progress):
        with progress(run) as show:
            yield show
    else:
        with progress_bar(run.system.name, run.steps, progress) as show:
            yield show


@contextmanager
def progress_bar(title: str, total: int, requested: bool) -> Iterator[Show | None]:
    """Yield a function of the number of completed steps that draws a bar on stderr; the bar
    vanishes at the end. Yield None if no bar is requested.
    """
    if not requested:
        yield None
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(file=sys.stderr), transient=True) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done: bar.update(task, completed=done)
