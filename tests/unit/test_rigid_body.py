# SPDX-License-Identifier: BSD-2-Clause
"""rigid_body.h: gravity gradient as a sum over point masses, and what an inertia matrix may be."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.each import each

MU = 3.986004415e14
SYMMETRIC, DEFINITE, TRIANGLE = (
    "must be symmetric",
    "must be positive definite",
    "triangle inequality",
)


def rotated(J, rng):
    R = Rotation.random(random_state=rng).as_matrix()
    return R @ J @ R.T


def test_gravity_gradient_is_the_moment_of_the_attraction_of_point_masses(core, rng):
    """Six masses at +-d on the axes; the truncated series is wrong by (d/r)^2 = 1e-10; exact
    differences of the attraction, taken in extended precision, lose 1e-9.
    """
    mass, d = rng.uniform(1, 50, 3), rng.uniform(1, 70, 3)
    axes = Rotation.random(random_state=rng).as_matrix()
    r = 7e6 * Rotation.random(random_state=rng).as_matrix()[0]
    J, M = np.zeros((3, 3)), np.zeros(3, np.longdouble)
    for m, length, axis in zip(mass, d, axes, strict=True):
        for x in (length * axis, -length * axis):
            J += m * ((x @ x) * np.eye(3) - np.outer(x, x))
            at = (r + x).astype(np.longdouble)
            M += np.cross(x.astype(np.longdouble), -MU * m * at / np.sqrt(at @ at) ** 3)
    found = core.gravity_gradient(MU, r, J)
    assert np.max(np.abs(found - M.astype(float))) <= 1e-7 * np.max(np.abs(found)) + 1e-12
    assert np.array_equal(core.gravity_gradient(0.0, r, J), np.zeros(3))


def test_a_numerically_rotated_inertia_is_accepted(core, rng):
    J = rotated(np.diag([200.0, 250.0, 150.0]), rng)
    assert core.problems_of_inertia(J) == ""


@pytest.mark.parametrize(("row", "column"), [(0, 1), (0, 2), (1, 2), (1, 0), (2, 0), (2, 1)])
def test_symmetry_is_required_within_1e_9_of_the_largest_moment(core, row, column):
    for part, text in ((0.9e-9, ""), (1.1e-9, SYMMETRIC)):
        J = np.diag([200.0, 250.0, 150.0])
        J[row, column] += 250 * part
        problems = core.problems_of_inertia(J)
        assert text in problems
        assert bool(problems) == bool(text)


def test_the_error_of_an_unsymmetric_matrix_names_the_element_above_the_diagonal(core):
    J = np.diag([200.0, 250.0, 150.0])
    J[0, 1] = 7.25
    assert core.problems_of_inertia(J) == "J = 7.25: must be symmetric"


@pytest.mark.parametrize("moments", [(-1, 2, 2), (2, -1, 2), (2, 2, -1), (0, 1, 1)])
def test_moments_that_are_not_positive_are_rejected_with_the_least_of_the_diagonal(core, moments):
    problems = core.problems_of_inertia(np.diag(np.array(moments, float)))
    assert f"J = {min(moments)}: {DEFINITE}" in problems


def test_an_indefinite_matrix_with_positive_diagonal_is_rejected(core, rng):
    J = rotated(np.diag([100.0, 100.0, -1.0]), rng)
    assert DEFINITE in core.problems_of_inertia((J + J.T) / 2)


@each("order", [(0, 1, 2), (1, 2, 0), (2, 0, 1)])
@each(("largest", "holds"), [(2.0, 1), (2.0 - 1e-6, 1), (2.0 + 1e-6, 0), (9.0, 0)])
def test_no_principal_moment_is_above_the_sum_of_the_others(core, rng, order, largest, holds):
    """A flat plate, 1 + 1 = 2, is the limit; in any axes."""
    J = np.diag(np.array([1.0, 1.0, largest])[list(order)])
    assert core.satisfies_triangle_inequality(J) == holds
    turned = rotated(J, rng)
    assert core.satisfies_triangle_inequality((turned + turned.T) / 2) == holds or largest == 2.0


def test_the_error_of_the_triangle_rule_names_the_largest_of_the_diagonal(core):
    problems = core.problems_of_inertia(np.diag([10.0, 30.0, 15.0]))
    assert problems.startswith("J = 30: must satisfy the triangle inequality")
    assert core.problems_of_inertia(np.diag([40.0, 10.0, 15.0])).startswith("J = 40:")
    assert core.problems_of_inertia(np.diag([15.0, 10.0, 50.0])).startswith("J = 50:")
