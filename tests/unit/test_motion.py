# SPDX-License-Identifier: BSD-2-Clause
"""motion.h on motions whose derivatives are known in closed form: polynomials and rotations."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

CLOSE = 1e-13


def same(a, b):
    return np.max(np.abs(np.asarray(a) - b)) <= CLOSE * (1 + np.max(np.abs(b)))


def turning(e, w, alpha):
    """A vector fixed in a frame that turns: value, w x e, alpha x e + w x (w x e)."""
    return np.array([e, np.cross(w, e), np.cross(alpha, e) + np.cross(w, np.cross(w, e))])


def scaled(f, m):
    """Product of a scalar (f, f', f'') and a motion."""
    return np.array(
        [f[0] * m[0], f[1] * m[0] + f[0] * m[1], f[2] * m[0] + 2 * f[1] * m[1] + f[0] * m[2]]
    )


@pytest.fixture
def w_alpha(rng):
    return rng.map(lambda rng: rng.normal(size=(2, 3)))


def test_product_of_two_polynomials(core, rng):
    a, b = rng.normal(size=(2, 3, 3))  # coefficients of 1, t, t^2
    motions = [np.array([p[0], p[1], 2 * p[2]]) for p in (a, b)]
    c = [sum(np.cross(a[i], b[n - i]) for i in range(n + 1)) for n in range(3)]
    assert same(core.cross_motion(*motions), [c[0], c[1], 2 * c[2]])
    assert np.array_equal(core.neg_motion(motions[0]), -motions[0])


def test_direction_of_a_vector_of_changing_length(core, rng, w_alpha):
    direction = turning(Rotation.random(random_state=rng).as_matrix()[0], *w_alpha)
    length = [rng.uniform(1, 5), *rng.normal(size=2)]
    assert same(core.normalised(scaled(length, direction)), direction)


def test_part_normal_to_a_turning_direction(core, rng, w_alpha):
    e, fixed = Rotation.random(random_state=rng).as_matrix()[0], rng.normal(size=3)
    i = turning(e, *w_alpha)
    along = scaled([fixed @ i[0], fixed @ i[1], fixed @ i[2]], i)
    expected = np.array([fixed, np.zeros(3), np.zeros(3)]) - along
    assert same(core.perpendicular_part(fixed, i), expected)
    assert abs(core.perpendicular_part(fixed, i)[0] @ e) < CLOSE


def test_turning_of_a_frame_in_its_own_components(core, rng, w_alpha):
    axes = Rotation.random(random_state=rng).as_matrix()  # rows i, j, k
    w, alpha = w_alpha
    i, j, k = (turning(e, w, alpha) for e in axes)
    assert same(core.frame_rate(i, j, k), axes @ w)
    assert same(core.frame_acceleration(i, j, k), axes @ alpha)
