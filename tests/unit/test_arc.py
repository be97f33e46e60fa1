# SPDX-License-Identifier: BSD-2-Clause
"""arc.h against scipy's Bernstein polynomials."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BPoly

SHARES = np.linspace(0, 1, 101)


@pytest.mark.parametrize("offset", [0.0, 30.0])
def test_square_of_an_arc_is_the_polynomial_of_its_coefficients_and_lies_within_them(
    core, rng, offset
):
    p = rng.normal(size=(4, 3)) + np.array((offset, 0, 0))
    points = BPoly(p[:, None, :], [0, 1])(SHARES)
    square = np.sum(points**2, axis=1)
    *c, least, most = core.square_along(*p)
    assert BPoly(np.array(c)[:, None], [0, 1])(SHARES) == pytest.approx(square, rel=1e-13)
    assert (least, most) == (min(c), max(c))
    assert least <= square.min() <= square.max() <= most
