# SPDX-License-Identifier: BSD-2-Clause
"""Where the boundary runs: a map in two factors that is refined where the verdict changes."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError
from harness.studies.campaign.factors import normal_quantile
from harness.studies.inquiry.study import Map, Study, begun, prepared

Array = NDArray[np.float64]

COARSE, GENERATION = np.array([0.001, 0.3, 0.5, 0.7, 0.999]), 12
"""Places of the rows and columns of the first flights; flights of a generation."""


def located(flights: int) -> Generator[Array, Array, tuple[Array, Array]]:
    """Places (rows, 2) between 0 and 1, and their margins.

    After a coarse grid flights go half-way between neighbours (edges of the triangulation of
    Delaunay): the longest edges of unlike verdict first, and those of like verdict that are so long
    that a boundary may lie between, for the steepest slope that was seen.
    """
    from scipy.spatial import Delaunay

    places = np.stack(np.meshgrid(COARSE, COARSE, indexing="ij"), axis=-1).reshape(-1, 2)
    margins = yield normal_quantile(places)
    while len(places) < flights:
        triangles = Delaunay(places).simplices
        edges = np.unique(np.sort(triangles[:, [[0, 1], [1, 2], [0, 2]]].reshape(-1, 2)), axis=0)
        middles = _worthwhile(places, margins, edges)[: min(GENERATION, flights - len(places))]
        if not len(middles):
            break
        told = yield normal_quantile(middles)
        places, margins = np.concatenate([places, middles]), np.concatenate([margins, told])
    return places, margins


def _worthwhile(places: Array, margins: Array, edges: NDArray[np.intp]) -> Array:
    """Middles of the edges worth a flight, the best first, none close to another."""
    a, b = places[edges[:, 0]], places[edges[:, 1]]
    length = np.linalg.norm(a - b, axis=1)
    finite = margins[np.isfinite(margins)]
    y_a, y_b = np.nan_to_num(margins, neginf=finite.min() if len(finite) else -1.0)[edges.T]
    slope = max(float((np.abs(y_a - y_b) / length).max()), 1e-300)
    room = length - (np.abs(y_a) + np.abs(y_b)) / slope
    worth = np.where((y_a < 0) != (y_b < 0), length, room)
    taken: list[Array] = []
    for k in np.argsort(-worth, kind="stable"):
        middle = (a[k] + b[k]) / 2
        if length[k] > 1e-4 and all(np.linalg.norm(middle - t) > length[k] / 4 for t in taken):
            taken.append(middle)
    return np.array(taken).reshape(-1, 2)


# ---- the study


def boundary(definition: Any, output: str | Path, **how: Any) -> Study:
    """Map where a requirement fails over two factors; all others are nominal.

    definition: path of a campaign TOML with a table [map], or the table itself; output: OUT.zarr;
    how: as for sensitivity(). Raises UsageError, StructureError.
    """
    entry, flights = prepared(Map, definition, how)
    ((name, k),) = flights.columns(entry.of, slope=False, most=1).items()
    small = [f for f, places in flights.groups.items() if len(places) == 1]
    chosen = entry.factors or small
    if len(chosen) != 2 or any(f not in small for f in chosen):
        raise UsageError(f"map.factors: expected two of one number each, of {', '.join(small)}")
    if entry.flights < (least := len(COARSE) ** 2):
        raise UsageError(f"map.flights: at least {least}, a coarse grid")
    places = [flights.groups[f][0] for f in chosen]

    def placed(z: Array) -> Array:
        numbers = np.zeros((len(z), flights.d))
        numbers[:, places] = z
        return numbers

    with begun("map", flights, entry.flights, output, how) as driver:
        driver.answer(located(entry.flights), k, placed)
        return Study(driver.path, driver.finish({"of": {name: {"factors": chosen}}}))
