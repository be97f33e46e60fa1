# SPDX-License-Identifier: BSD-2-Clause
"""mat3.h, symmetric3.h and small_rotation.h against numpy and scipy."""

from itertools import permutations

import numpy as np
from scipy.spatial.transform import Rotation

from tests.close import close
from tests.each import each

EXACT = 1e-14
"""Tens of roundings of the largest element."""


def test_sums_and_products(core, rng):
    A, B, (a, b) = rng.normal(size=(3, 3)), rng.normal(size=(3, 3)), rng.normal(size=(2, 3))
    assert np.array_equal(core.plus(A, B), A + B)
    assert np.array_equal(core.minus(A, B), A - B)
    assert np.array_equal(core.scaled(2.5, A), 2.5 * A)
    assert np.array_equal(core.outer(a, b), np.outer(a, b))
    close(core.tilde(a) @ b, np.cross(a, b), rel=EXACT)


def test_inertia_product(core, rng):
    """-([a]x[b]x + [b]x[a]x)/2"""
    a, b = rng.normal(size=(2, 3))
    x, y = (np.cross(np.eye(3), v).T for v in (a, b))
    close(core.inertia_product(a, b), -(x @ y + y @ x) / 2, rel=EXACT)


@each("values", list(permutations((5.0, 1.0, 0.4))))
@each(("share", "rank"), [(0.01, 3), (0.1, 2), (0.3, 1)])
def test_pseudo_inverse_leaves_out_what_is_below_its_share_of_the_largest(
    core, rng, values, share, rank
):
    """The order in which the eigenvalues are found does not matter."""
    for axes in (Rotation.random(random_state=rng).as_matrix(), np.eye(3)):
        m = axes @ np.diag(values) @ axes.T
        found = core.pseudo_inverse((m + m.T) / 2, share)
        close(found, np.linalg.pinv(m, rcond=share), rel=1e-13)
        assert np.linalg.matrix_rank(found, tol=1e-6) == rank


def scipy_of(q):
    return Rotation.from_quat(q, scalar_first=True)


def test_rotations_from_vectors_and_back(core, rng):
    phi = rng.uniform(0, np.pi) * (axis := rng.normal(size=3)) / np.linalg.norm(axis)
    turned = core.quat_of_rotation_vector(phi)
    close(turned, Rotation.from_rotvec(phi).as_quat(scalar_first=True), rel=EXACT)
    for sign in (1, -1):
        close(core.rotation_vector(sign * turned), phi, rel=EXACT)
        error = core.rotation_error(sign * turned)
        close(error, 4 * scipy_of(turned).as_mrp(), rel=EXACT)
    close(core.rotation(error), turned, rel=EXACT)


def test_no_rotation(core):
    assert (
        core.quat_of_rotation_vector(np.zeros(3)).tolist()
        == core.rotation(np.zeros(3)).tolist()
        == [1, 0, 0, 0]
    )
    assert not core.rotation_vector([1, 0, 0, 0]).any()
