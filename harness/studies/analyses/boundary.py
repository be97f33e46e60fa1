# SPDX-License-Identifier: BSD-2-Clause
"""Boundary in the plane of two factors beyond which a requirement fails, by a grid of runs that is
refined where the verdict changes.
"""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.results.result import Array
from harness.studies.analyses.study import Boundary, Study, begun, prepared
from harness.studies.campaign.factors import normal_quantile

COARSE, GENERATION = np.array([0.001, 0.3, 0.5, 0.7, 0.999]), 12
"""Values of both factors in the first grid, as numbers between 0 and 1 that give a factor by its
inverse distribution function; largest number of runs that are requested together.
"""


def located(runs: int) -> Generator[Array, Array, tuple[Array, Array]]:
    """Return the points of at most this number of runs (rows, 2), in numbers between 0 and 1, and
    their margins (rows,).

    After a coarse grid, runs are placed in the middle between neighbouring points, which are edges
    of the Delaunay triangulation: first of the longest edges between different verdicts, then of
    edges between equal verdicts that may cross a boundary if the margin changes along them as
    steeply as on the steepest edge so far.
    """
    from scipy.spatial import Delaunay

    places = np.stack(np.meshgrid(COARSE, COARSE, indexing="ij"), axis=-1).reshape(-1, 2)
    margins = yield normal_quantile(places)
    while len(places) < runs:
        triangles = Delaunay(places).simplices
        edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2)), axis=0)
        middles = _worthwhile(places, margins, edges)[: min(GENERATION, runs - len(places))]
        if not len(middles):
            break
        found = yield normal_quantile(middles)
        places, margins = np.concatenate([places, middles]), np.concatenate([margins, found])
    return places, margins


def _worthwhile(places: Array, margins: Array, edges: NDArray[np.intp]) -> Array:
    """Return the midpoints (rows, 2) of the edges in which a run is useful, the most useful first,
    without points close to one another.

    places, margins: of the runs so far; edges: indices of the two runs of each edge (edges, 2).
    """
    a, b = places[edges[:, 0]], places[edges[:, 1]]
    length = np.linalg.norm(a - b, axis=1)
    finite = np.isfinite(margins)
    known, failed = finite[edges].all(axis=1), (margins < 0)[edges]
    y_a, y_b = np.where(finite, margins, 0.0)[edges.T]
    slope = max(float((np.abs(y_a - y_b) / length)[known].max(initial=0)), 1e-300)
    unexplored = np.where(known, length - (np.abs(y_a) + np.abs(y_b)) / slope, 0.0)
    worth = np.where(failed[:, 0] != failed[:, 1], length, unexplored)
    taken: list[Array] = []
    for k in np.argsort(-worth, kind="stable"):
        middle = (a[k] + b[k]) / 2
        if length[k] > 1e-4 and all(np.linalg.norm(middle - t) > length[k] / 4 for t in taken):
            taken.append(middle)
    return np.array(taken).reshape(-1, 2)


# ---- analysis


def boundary(definition: Any, output: str | Path, **how: Any) -> Study:
    """Map where a requirement fails in the plane of two factors; all other factors have their
    medians.

    definition: path of a campaign TOML with a table [boundary], or the table itself; output:
    OUT.zarr; how: options as for sensitivity(). Raises UsageError, StructureError.
    """
    entry, evaluator = prepared(Boundary, definition, how)
    ((name, k),) = evaluator.columns(entry.of, slope=False, most=1).items()
    small = [f for f, places in evaluator.groups.items() if len(places) == 1]
    chosen = entry.factors or small
    if len(chosen) != 2 or any(f not in small for f in chosen):
        raise UsageError(f"boundary.factors: expected two scalar factors of {', '.join(small)}")
    if entry.runs < (least := len(COARSE) ** 2):
        raise UsageError(
            f"boundary.runs: expected at least {least} (the first grid of runs), got {entry.runs}"
        )
    places = [evaluator.groups[f][0] for f in chosen]

    def placed(z: Array) -> Array:
        numbers = np.zeros((len(z), evaluator.d))
        numbers[:, places] = z
        return numbers

    with begun("boundary", evaluator, entry.runs, output, how) as driver:
        driver.answer(located(entry.runs), k, placed)
        return Study(driver.path, driver.finish({"of": {name: {"factors": chosen}}}))
