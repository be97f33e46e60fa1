# SPDX-License-Identifier: BSD-2-Clause
"""line_of_sight.h: rates and accelerations of range, elevation and azimuth as differences of the
angles themselves, and the divisors that are bounded away from zero.
"""

import numpy as np
import pytest

UP = {1: (2, 0, 1), 2: (0, 1, 2), 3: (1, 2, 0)}
"""Axes in the order first, up, last."""


def coordinates(r, up):
    first, above, last = r[list(UP[up])]
    return np.array(
        [
            np.linalg.norm(r),
            np.arctan2(above, np.hypot(first, last)),
            np.arctan2(-last, first),
        ]
    )


@pytest.mark.parametrize("up", [1, 2, 3])
def test_rates_and_accelerations_are_differences_of_the_coordinates(core, rng, up):
    """Five-point stencils over 2 ms, along a parabola."""
    r = rng.uniform(5, 9, 3) * rng.choice([-1, 1], 3)
    v, a = rng.normal(size=3), rng.normal(size=3)
    h = 2e-3
    y = [coordinates(r + v * t + a * t * t / 2, up) for t in h * np.arange(-2, 3)]
    rate = (y[0] - 8 * y[1] + 8 * y[3] - y[4]) / (12 * h)
    acceleration = (-y[0] + 16 * y[1] - 30 * y[2] + 16 * y[3] - y[4]) / (12 * h * h)
    found = core.los_motion(float(up), np.array([r, v, a]))
    assert found[0] == pytest.approx(y[2], abs=1e-13)
    assert found[1] == pytest.approx(rate, abs=1e-9)
    assert found[2] == pytest.approx(acceleration, abs=1e-7)


@pytest.mark.parametrize(("cosine", "divisor"), [(1e-4, 1e-3), (0.9e-3, 1e-3), (1.1e-3, 1.1e-3)])
def test_the_cosine_of_the_elevation_is_at_least_a_thousandth_as_a_divisor(core, cosine, divisor):
    r = 10 * np.array([cosine, np.sqrt(1 - cosine**2), 0])
    found = core.los_motion(2.0, np.array([r, (0, 0, 0.5), (0, 0, 0.3)]))
    assert found[1][2] == pytest.approx(-0.5 / (10 * divisor), rel=1e-9)
    assert found[2][2] == pytest.approx(-0.3 / (10 * divisor), rel=1e-9)


@pytest.mark.parametrize(("distance", "divisor"), [(0.01, 0.1), (0.09, 0.1), (0.11, 0.11)])
def test_the_range_is_at_least_a_decimetre_as_a_divisor(core, distance, divisor):
    found = core.los_motion(2.0, np.array([(distance, 0, 0), (0, 0.5, 0), (0, 0.3, 0)]))
    assert found[1][1] == pytest.approx(0.5 / divisor, rel=1e-12)
    assert found[2][1] == pytest.approx(0.3 / divisor, rel=1e-12)
