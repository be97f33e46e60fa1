# SPDX-License-Identifier: BSD-2-Clause
"""Functions of independent normal numbers whose failure probabilities and indices are known."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import quad
from scipy.stats import chi2, norm

K = 7.0


class Case(NamedTuple):
    """d numbers, margins of rows (failure where not positive), and the probability of a failure."""

    d: int
    margin: Callable[[Any], Any]
    p: float


def _four_branches(z):
    across, along = z[:, 0] - z[:, 1], (z[:, 0] + z[:, 1]) / math.sqrt(2)
    near = 3 + 0.1 * across**2
    edge = K / math.sqrt(2)
    return np.min([near - along, near + along, across + edge, edge - across], axis=0)


def _of_four_branches():
    inside, _ = quad(lambda b: norm.pdf(b) * (2 * norm.cdf(3 + 0.2 * b * b) - 1), -K / 2, K / 2)
    return 1 - inside


def _trap(z):
    """The slope near the origin leads to the region that hardly counts."""
    x, y = z.T
    return np.minimum(
        np.where(x > 3.5, 4 - x, 0.85 - 0.1 * x), np.where(y > 2, 0.5 - 0.1 * y, 2.3 - y)
    )


def _valley(z):
    """The slope near the origin leads away from the region that fails 2 000 times as often."""
    return np.minimum((5 - z[:, 0]) / 10, 3.2 + z[:, 0])


def linear(d, beta):
    """One plane at the distance beta from the origin."""
    return Case(d, lambda z: beta - z.sum(axis=1) / math.sqrt(d), float(norm.sf(beta)))


CASES = {
    "linear": linear(10, 3.5),
    "two sides": Case(
        2, lambda z: np.minimum(4 - z[:, 0], 3 + z[:, 0]), float(norm.sf(4) + norm.sf(3))
    ),
    "valley": Case(2, _valley, float(norm.sf(5) + norm.sf(3.2))),
    "linear, rare": linear(38, 4.753424308822899),
    "four branches": Case(2, _four_branches, _of_four_branches()),
    "outside a circle": Case(2, lambda z: 4.29193 - np.linalg.norm(z, axis=1), 1e-4),
    "outside a sphere": Case(38, lambda z: chi2.isf(1e-4, 38) - (z**2).sum(axis=1), 1e-4),
    "trap": Case(2, _trap, float(norm.sf(4) * norm.cdf(5) + norm.sf(5))),
}


def ishigami(z):
    """With a = 7, b = 0.1 over (-pi, pi)."""
    x = (2 * norm.cdf(z) - 1) * math.pi
    return np.sin(x[:, 0]) + 7 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


A = np.array([0, 1, 4.5, 9, 99, 99, 99, 99])


def sobol_g(z):
    """Of Sobol, with the weights A."""
    return np.prod((np.abs(4 * norm.cdf(z) - 2) + A) / (1 + A), axis=1)


def indices_of_sobol_g():
    """First-order and total ones: V_i = 1/3 / (1 + a_i)^2, V = prod(1 + V_i) - 1."""
    v = 1 / 3 / (1 + A) ** 2
    whole = np.prod(1 + v)
    return v / (whole - 1), v * whole / (1 + v) / (whole - 1)


def answer(method, function):
    """Return the result of a method whose requests a function answers."""
    try:
        z = next(method)
        while True:
            z = method.send(function(z))
    except StopIteration as end:
        return end.value
