# SPDX-License-Identifier: BSD-2-Clause
"""What is the worst: a search for the least margin in a box of the numbers, by the evolution
strategy CMA-ES (Hansen & Ostermeier 2001). What it finds is a bound, and no proof that there is
nothing worse.
"""

from __future__ import annotations

import math
from collections.abc import Generator
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.errors import UsageError

Array = NDArray[np.float64]
Ask = Generator[Array, Array, "Found"]

LEAST_GENERATION = 12


class Found(NamedTuple):
    """The worst flight of a search: its numbers (d,), its margin, its place and that of the first
    failure (-1: none) among the flights.
    """

    numbers: Array
    margin: float
    place: int
    first: int


def needs_cma() -> None:
    """UsageError if the package is not there."""
    if find_spec("cma") is None:
        raise UsageError("this needs the package cma: pip install 'servicing-fmus[verify]'")


def generation(d: int) -> int:
    """Flights of a generation of a search in d numbers."""
    return max(LEAST_GENERATION, 4 + int(3 * math.log(d)))


def search(d: int, seed: int, flights: int, box: float = 3.0, sigma: float = 1.0) -> Ask:
    """The least margin that so many flights find within |z| <= box, from the middle on; a search
    that has converged begins again elsewhere.
    """
    rng = np.random.default_rng(seed)
    rows, margins = np.empty((0, d)), np.empty(0)
    wide = max(d, 2)  # the package knows no search in one number: a second one means nothing
    start = np.zeros(wide)
    while flights - len(margins) >= generation(d):
        engine = _engine(start, sigma, box, rng)
        while flights - len(margins) >= generation(d) and not engine.stop():
            z = np.array(engine.ask())
            y = yield z[:, :d]
            engine.tell(list(z), _ranked(y))
            rows, margins = np.concatenate([rows, z[:, :d]]), np.concatenate([margins, y])
        start = rng.uniform(-box, box, wide) / 2
    if flights > len(margins):  # too few for a generation: about the best so far
        spread = rng.standard_normal((flights - len(margins), d)) * sigma / 2
        middle = rows[np.argmin(margins)] if len(margins) else start[:d]
        z = (middle + spread).clip(-box, box)
        y = yield z
        rows, margins = np.concatenate([rows, z]), np.concatenate([margins, y])
    place = int(np.argmin(margins))
    failed = np.flatnonzero(margins < 0)
    return Found(rows[place], float(margins[place]), place, int(failed[0]) if len(failed) else -1)


def _engine(start: Array, sigma: float, box: float, rng: np.random.Generator) -> Any:
    """CMA-ES with a generator of its own: its seed would be numpy's for everybody."""
    import cma  # type: ignore[import-untyped]

    def normal(*shape: int) -> Array:
        return np.asarray(rng.standard_normal(shape))

    options = {
        "bounds": [-box, box],
        "popsize": generation(len(start)),
        "randn": normal,
        "seed": math.nan,
        "verbose": -9,
        "verb_log": 0,
        "verb_disp": 0,
    }
    return cma.CMAEvolutionStrategy(start, sigma, options)


def _ranked(y: Array) -> list[float]:
    """Margins with those of flights that died below all others."""
    finite = y[np.isfinite(y)]
    low = float(finite.min() - 1 - np.ptp(finite)) if len(finite) else -1.0
    high = float(finite.max() + 1) if len(finite) else 1.0
    ranked: list[float] = np.nan_to_num(y, nan=high, neginf=low, posinf=high).tolist()
    return ranked
