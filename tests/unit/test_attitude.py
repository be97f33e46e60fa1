# SPDX-License-Identifier: BSD-2-Clause
"""attitude.h against scipy's rotations. R maps body components to N components: C_BN = R^T."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.each import each

CLOSE = 1e-14
HALF_TURNS = [(0, 1, 0, 0), (0, -1, 0, 0), (0, 0, 1, 0), (0, 0, 0, -1), (0, 0, -0.6, 0.8)]


def same(a, b, tolerance=CLOSE):
    return np.max(np.abs(np.asarray(a) - b)) <= tolerance


@pytest.fixture
def R(rng):
    return rng.map(lambda rng: Rotation.random(random_state=rng))


def scalar_first(R):
    q = R.as_quat(scalar_first=True)
    return q if q[0] >= 0 else -q


def test_quaternion_to_matrix_and_back(core, R):
    q, C = scalar_first(R), R.as_matrix().T
    assert same(core.dcm_of_quat(q), C)
    assert same(core.dcm_of_quat(-q), C)
    assert same(core.quat_of_dcm(C), q)


@each("axis", range(3))
@each("angle", [np.pi, np.pi - 1e-9, 3.0, 2.5, 1.0, 1e-9, 0.0])
def test_every_branch_of_the_quaternion_of_a_matrix(core, axis, angle):
    turn = Rotation.from_rotvec(angle * np.eye(3)[axis])
    q = core.quat_of_dcm(turn.as_matrix().T)
    assert same(q, scalar_first(turn))
    assert q[0] >= 0


def test_products_follow_the_order_of_the_frames(core, rng):
    A, B = Rotation.random(2, random_state=rng)
    a, b = scalar_first(A), scalar_first(B)
    assert same(core.dcm_of_quat(core.product(a, b)), (A * B).as_matrix().T)
    assert same(core.product(a, core.conjugate(a)), [1, 0, 0, 0])
    assert np.array_equal(core.vector_part(a), a[1:])


def test_canonical_quaternion_is_of_unit_norm_and_of_one_sign(core, R):
    q = scalar_first(R)
    assert same(core.canonical(3.5 * q), q)
    assert same(core.canonical(-0.2 * q), q)


@pytest.mark.parametrize("q", HALF_TURNS)
def test_half_turns_have_one_sign_too(core, q):
    first = next(x for x in q if x)
    assert same(core.canonical(q), np.sign(first) * np.array(q))
    assert same(core.canonical(-np.array(q)), np.sign(first) * np.array(q))


def test_rodrigues_parameters(core, R):
    s, q = R.as_mrp(), scalar_first(R)
    assert same(core.mrp_of_quat(q), s)
    assert same(core.mrp_of_quat(-q), s)
    assert same(core.quat_of_mrp(s), q)
    assert same(core.dcm_of_mrp(s), R.as_matrix().T)


def test_shadow_set(core, rng):
    s = rng.normal(size=3)
    inside = core.mrp_inside(s)
    assert np.linalg.norm(inside) <= 1
    assert same(core.dcm_of_mrp(inside), core.dcm_of_mrp(s), 1e-13)
    assert np.array_equal(core.mrp_inside(0.5 * s / np.linalg.norm(s)), 0.5 * s / np.linalg.norm(s))


def test_rate_matrix(core, rng):
    s, w = rng.normal(size=(2, 3))
    tilde = np.array([[0, -s[2], s[1]], [s[2], 0, -s[0]], [-s[1], s[0], 0]])
    G = (1 - s @ s) * np.eye(3) + 2 * tilde + 2 * np.outer(s, s)
    assert same(core.mrp_G(s, w), G @ w, 1e-13)
    assert same(core.mrp_G_transposed(s, w), G.T @ w, 1e-13)
    assert same(core.mrp_rate(s, w), G @ w / 4, 1e-13)


def test_rate_is_the_derivative_along_a_rotation(core, rng):
    """sigma of R(t) = R exp(w t): central differences over 2e-4 s, error 1e-8 of their square."""
    R, w, h = Rotation.random(random_state=rng), 0.3 * rng.normal(size=3), 1e-4
    if R.magnitude() > 3.0:
        R = R**0.5
    ahead, behind = ((R * Rotation.from_rotvec(k * h * w)).as_mrp() for k in (1, -1))
    assert same(core.mrp_rate(R.as_mrp(), w), (ahead - behind) / (2 * h), 1e-8)
