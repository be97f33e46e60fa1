# SPDX-License-Identifier: BSD-2-Clause
"""Second-order jets: a quantity together with its first and second time derivative.

Leibniz' rule for any bilinear product carries the derivatives exactly, so that no rate formula is
written by hand: (a * b)' = a' * b + a * b',   (a * b)'' = a'' * b + 2 a' * b' + a * b''.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from .attitude import cross as cross_product


class Jet(NamedTuple):
    """Value, first and second time derivative of a scalar, vector or matrix."""

    x: Any
    d: Any
    dd: Any

    def __add__(self, other: Jet) -> Jet:  # type: ignore[override]
        return Jet(*(a + b for a, b in zip(self, other, strict=True)))

    def __sub__(self, other: Jet) -> Jet:
        return Jet(*(a - b for a, b in zip(self, other, strict=True)))

    def __neg__(self) -> Jet:
        return Jet(-self.x, -self.d, -self.dd)

    def __mul__(self, other: Jet) -> Jet:  # type: ignore[override]
        return leibniz(operator.mul, self, other)

    def __matmul__(self, other: Jet) -> Jet:
        return leibniz(operator.matmul, self, other)

    @property
    def T(self) -> Jet:
        return Jet(self.x.T, self.d.T, self.dd.T)


def constant(x: Any) -> Jet:
    return Jet(x, 0.0 * x, 0.0 * x)


def leibniz(product: Callable[[Any, Any], Any], a: Jet, b: Jet) -> Jet:
    return Jet(
        product(a.x, b.x),
        product(a.d, b.x) + product(a.x, b.d),
        product(a.dd, b.x) + 2.0 * product(a.d, b.d) + product(a.x, b.dd),
    )


def cross(a: Jet, b: Jet) -> Jet:
    return leibniz(cross_product, a, b)


def dot(a: Jet, b: Jet) -> Jet:
    return leibniz(operator.matmul, a, b)


def power(s: Jet, n: float) -> Jet:
    """s^n of a positive scalar."""
    x = s.x**n
    return Jet(x, n * x / s.x * s.d, n * x / s.x * (s.dd + (n - 1.0) * s.d**2 / s.x))


def unit(a: Jet) -> Jet:
    return power(dot(a, a), -0.5) * a


def rows(*vectors: Jet) -> Jet:
    """Matrix whose rows are the given vectors."""
    return Jet(*(np.array(parts) for parts in zip(*vectors, strict=True)))
