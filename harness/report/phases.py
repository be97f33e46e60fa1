# SPDX-License-Identifier: BSD-2-Clause
"""Phase plots: a quantity against its rate, for every result that holds both."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from harness.mission import Phase
from harness.mission.library import of_result
from harness.report.plots import AXES, DASHES, Canvas, Plot
from harness.results.result import Result

Array = NDArray[np.float64]


def phases(canvas: Canvas, result: Result) -> Iterator[Plot]:
    """Phase plots of a result whose quantities move."""
    for phase in of_result(result).phases:
        if not result.holds(*phase.needs):
            continue
        first = int(np.searchsorted(result.time, phase.after(result))) if phase.after else 0
        columns = [
            np.atleast_2d(values.T).T[first:]
            for values in (phase.value(result), phase.rate(result))
        ]
        if all(c.size and np.nanmax(c) > np.nanmin(c) for c in columns):
            yield _plot(canvas, phase, *columns)


def _plot(canvas: Canvas, phase: Phase, x: Array, y: Array) -> Plot:
    curves = []
    for k in range(x.shape[1]):
        rows = canvas.rows_of(x[:, k], y[:, k])
        canvas.thinned |= len(rows) < len(x)
        name = "" if x.shape[1] == 1 else AXES[k] if x.shape[1] == 3 else str(k + 1)
        curves.append(
            {
                "name": name,
                "x": canvas.arrays.keep(x[rows, k]),
                "y": canvas.arrays.keep(y[rows, k]),
                "colour": k,
                "dash": DASHES[k],
                "ends": True,
            }
        )
    return {"title": phase.title, "x": phase.x, "y": phase.y, "time": False, "curves": curves}
