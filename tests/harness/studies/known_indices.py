# SPDX-License-Identifier: BSD-2-Clause
"""Functions of independent normal numbers whose sensitivity indices are known."""

from __future__ import annotations

import math

import numpy as np
from scipy.stats import norm


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


def answer(design, function):
    """Return the effects that a design finds with the margins of a function."""
    numbers, effects = design
    return effects(function(numbers))
