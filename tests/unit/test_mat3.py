# SPDX-License-Identifier: BSD-2-Clause
"""mat3.h, symmetric3.h and small_rotation.h against numpy and scipy."""

from itertools import permutations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.each import each

EXACT = 1e-15


def test_sums_and_products(core, rng):
    A, B, (a, b) = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), rng.normal(size=(2, 3))
    assert np.array_equal(core.plus(A, B), A + B)
    assert np.array_equal(core.minus(A, B), A - B)
    assert np.array_equal(core.scaled(2.5, A), 2.5 * A)
    assert np.array_equal(core.outer(a, b), np.outer(a, b))
    assert core.tilde(a) @ b == pytest.approx(np.cross(a, b), abs=EXACT * 10)


def test_inertia_product(core, rng):
    """-([a]x[b]x + [b]x[a]x)/2"""
    a, b = rng.normal(size=(2, 3))
    x, y = (np.cross(np.eye(3), v).T for v in (a, b))
    assert core.inertia_product(a, b) == pytest.approx(-(x @ y + y @ x) / 2, abs=EXACT * 10)


@each("values", list(permutations((5.0, 1.0, 0.4))))
@each(("share", "kept"), [(0.01, 3), (0.1, 2), (0.3, 1)])
def test_pseudo_inverse_leaves_out_what_is_below_its_share_of_the_largest(
    core, rng, values, share, kept
):
    """The order in which the eigenvalues are found does not matter."""
    for axes in (Rotation.random(random_state=rng).as_matrix(), np.eye(3)):
        m = axes @ np.diag(values) @ axes.T
        found = core.pseudo_inverse((m + m.T) / 2, share)
        assert found == pytest.approx(np.linalg.pinv(m, rcond=share), abs=1e-13)
        assert np.linalg.matrix_rank(found, tol=1e-6) == kept


def scipy_of(q):
    return Rotation.from_quat(q, scalar_first=True)


def test_rotations_from_vectors_and_back(core, rng):
    phi = rng.uniform(0, np.pi) * (axis := rng.normal(size=3)) / np.linalg.norm(axis)
    turned = core.turn(phi)
    assert turned == pytest.approx(Rotation.from_rotvec(phi).as_quat(scalar_first=True), abs=1e-15)
    for sign in (1, -1):
        assert core.rotation_vector(sign * turned) == pytest.approx(phi, abs=1e-14)
        error = core.rotation_error(sign * turned)
        assert error == pytest.approx(4 * scipy_of(turned).as_mrp(), abs=1e-14)
    assert core.rotation(error) == pytest.approx(turned, abs=1e-15)


def test_no_rotation(core):
    assert core.turn(np.zeros(3)).tolist() == core.rotation(np.zeros(3)).tolist() == [1, 0, 0, 0]
    assert not core.rotation_vector([1, 0, 0, 0]).any()
