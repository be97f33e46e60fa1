# SPDX-License-Identifier: BSD-2-Clause
"""What a Result offers that stands above results: figures, files, the page of HTML. It is attached
to the class here, so that results know nothing of those who draw them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from harness.results.files import save
from harness.results.result import Result

__all__ = ["Result"]


def plot(self: Result, *names: str) -> Any:
    """A matplotlib Figure of variables, of the figure of that name, or of the first figure that the
    result has; UsageError, ResultsError.
    """
    from harness.figures.plots import shown

    return shown(self, names)


def report(self: Result, path: str | Path) -> Path:
    """Write a page of HTML with plots, verdicts and a replay in space; HarnessError."""
    from harness.report.html import write

    return write(self, path)


Result.plot = plot
Result.save = save
Result.report = report
