# SPDX-License-Identifier: BSD-2-Clause
"""Numbers between 0 and 1 for all draws of a campaign, and the seeds of its runs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from harness.studies.campaign.factors import SMALLEST

Array = NDArray[np.float64]

LARGEST_SEED = 2**31
"""Seeds lie below, so that every FMU holds them exactly."""


def _random(n: int, d: int, seed: int) -> Array:
    """Row k depends on seed and k alone: a longer campaign begins with the runs of a shorter
    one.
    """
    rows = (np.random.default_rng([seed, k]).random(d) for k in range(n))
    return np.array(list(rows)).reshape(n, d)


def _latin_hypercube(n: int, d: int, seed: int) -> Array:
    from scipy.stats.qmc import LatinHypercube

    return np.asarray(LatinHypercube(d, rng=seed).random(n))


def _sobol(n: int, d: int, seed: int) -> Array:
    from scipy.stats.qmc import Sobol

    return np.asarray(Sobol(d, rng=seed).random_base2(max(n - 1, 0).bit_length())[:n])


SAMPLERS: dict[str, Callable[[int, int, int], Array]] = {
    "random": _random,
    "latin-hypercube": _latin_hypercube,
    "sobol": _sobol,
}


def numbers(sampler: str, n: int, d: int, seed: int) -> Array:
    """Numbers between 0 and 1, (n, d), never 0 or 1."""
    if d == 0:
        return np.empty((n, 0))
    return np.clip(SAMPLERS[sampler](n, d, seed), SMALLEST, 1 - SMALLEST)


def run_seed(seed: int, k: int, place: int) -> int:
    """Seed of draw k for the parameter in this place of the list."""
    return int(np.random.default_rng([seed, k, place + 1]).integers(LARGEST_SEED))
