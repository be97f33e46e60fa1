# SPDX-License-Identifier: BSD-2-Clause
"""cholesky.h: elimination by the upper half against numpy."""

import numpy as np
import pytest


@pytest.mark.parametrize("n", range(1, 8))
def test_solution_equals_numpys_for_any_lower_half(core, rng, n):
    for _ in range(10):
        root, b = rng.normal(size=(n, n)), rng.normal(size=n)
        A = root @ root.T + 0.1 * np.eye(n)
        expected = np.linalg.solve(A, b)
        tolerance = 1e-14 * np.linalg.cond(A) * np.linalg.norm(expected)
        assert core.solve_upper(A, b) == pytest.approx(expected, rel=0, abs=tolerance)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_matrix_that_is_not_positive_definite_has_no_solution(core, rng, n):
    turn = np.linalg.qr(rng.normal(size=(n, n)))[0]
    for least in (0.0, -1e-3):
        A = turn @ np.diag((*np.ones(n - 1), least)) @ turn.T if least else np.zeros((n, n))
        assert core.solve_upper(A, np.ones(n)) is None
