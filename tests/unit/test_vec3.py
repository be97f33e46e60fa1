# SPDX-License-Identifier: BSD-2-Clause
"""vec3.h and finite.h against numpy."""

import numpy as np
import pytest

from tests.close import close
from tests.each import each

EXACT = 1e-14
"""Ten roundings of the largest term of a sum of few products."""


def test_sums_and_products_per_axis(core, rng):
    a, b, c, d = rng.normal(size=(4, 3))
    assert np.array_equal(core.add(a, b), a + b)
    assert np.array_equal(core.sub(a, b), a - b)
    assert np.array_equal(core.neg(a), -a)
    assert np.array_equal(core.scale(3.7, a), 3.7 * a)
    assert np.array_equal(core.times(a, b), a * b)
    assert np.array_equal(core.sum3(a, b, c), a + b + c)
    assert np.array_equal(core.sum4(a, b, c, d), a + b + c + d)
    assert np.array_equal(core.unequal(a, [a[0], b[1], a[2]]), [0, 1, 0])


def test_products_of_vectors(core, rng):
    a, b = 10.0 ** rng.uniform(-3, 3) * rng.normal(size=(2, 3))
    size = np.linalg.norm(a) * np.linalg.norm(b)
    close(core.dot(a, b), np.dot(a, b), rel=EXACT, of=size)
    close(core.cross(a, b), np.cross(a, b), rel=EXACT, of=size)
    assert core.norm(a) == pytest.approx(np.linalg.norm(a), rel=EXACT)
    close(core.unit(a), a / np.linalg.norm(a), rel=EXACT)


def test_products_of_matrices(core, rng):
    A, B, a = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), rng.normal(size=3)
    close(core.mul(A, a), A @ a, rel=EXACT, of=9)
    close(core.tmul(A, a), A.T @ a, rel=EXACT, of=9)
    close(core.matmul(A, B), A @ B, rel=EXACT, of=9)
    close(core.matmul_t(A, B), A @ B.T, rel=EXACT, of=9)
    assert np.array_equal(core.transpose(A), A.T)
    assert np.array_equal(core.rows(*A), A)
    assert np.array_equal(core.diagonal(*a), np.diag(a))
    close(core.determinant(A), np.linalg.det(A), rel=EXACT, of=27)


def test_linear_equations(core, rng):
    A, b = rng.normal(size=(3, 3)), rng.normal(size=3)
    x = core.solve(A, b)
    close(x, np.linalg.solve(A, b), rel=1e-14 * np.linalg.cond(A) ** 2)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-3, 1.0, np.pi / 2, 3.0, np.pi - 1e-9, np.pi])
def test_angle_between_directions_is_exact_also_near_its_ends(core, rng, angle):
    i, j = np.linalg.qr(rng.normal(size=(3, 3)))[0][:2]
    found = core.angle(5 * i, 0.1 * (np.cos(angle) * i + np.sin(angle) * j))
    assert abs(found - angle) <= 1e-15 + 2e-15 * angle


def test_angle_to_a_vector_that_vanishes_is_zero(core):
    assert core.angle([0, 0, 0], [1, 2, 3]) == 0


def test_limits(core):
    assert [core.clamp(x, -1, 2) for x in (-3, -1, 0.5, 2, 7)] == [-1, -1, 0.5, 2, 2]
    assert [core.limited(x, 2) for x in (-3, -1, 5)] == [-2, -1, 2]
    assert core.limited(-3, 0) == -3, "a limit of 0 is none"
    assert np.array_equal(core.limited3([-3, 4, 5], [2, 0, 6]), [-2, 4, 5])


@each("count", range(1, 22))
@each("bad", [np.nan, np.inf, -np.inf])
def test_one_number_that_is_not_finite_is_found_in_any_position(core, count, bad):
    for at in range(count):
        x = np.linspace(-1e300, 1e300, count)
        assert core.all_finite(x)
        x[at] = bad
        assert not core.all_finite(x)


def test_two_infinities_do_not_cancel_and_a_sum_that_overflows_is_finite(core):
    assert not core.all_finite([np.inf, -np.inf, 1])
    assert not core.all_finite([np.inf, 1, 1, 1, -np.inf])
    assert core.all_finite([1.7e308] * 9)
    assert not core.all_finite([1.7e308] * 9 + [np.nan])
    assert core.all_finite([])
