# SPDX-License-Identifier: BSD-2-Clause
"""riccati.h against scipy's solvers, which work by Schur decomposition."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are, solve_continuous_lyapunov


def close(a, b, tolerance):
    return np.max(np.abs(a - b)) <= tolerance * np.max(np.abs(b))


def test_algebra(core, rng):
    a, b = rng.normal(size=(2, 6, 6))
    assert np.array_equal(core.sum6(2.5, a, -0.5, b), 2.5 * a - 0.5 * b)
    assert close(core.product6(a, b), a @ b, 1e-14)
    assert np.array_equal(core.transpose6(a), a.T)
    assert core.largest6(a) == np.max(np.abs(a))


def test_linear_equations(core, rng):
    a, b = rng.normal(size=(2, 6, 6))
    assert close(core.solve6(a, b), np.linalg.solve(a, b), 1e-15 * np.linalg.cond(a))


def test_a_zero_on_the_diagonal_is_pivoted_away(core, rng):
    order, b = rng.permutation(6), rng.normal(size=(6, 6))
    assert np.array_equal(core.solve6(np.eye(6)[order], b), b[np.argsort(order)])


def test_lyapunov_equation(core, rng):
    A, C = rng.normal(size=(2, 6, 6))
    A, C = A - (np.max(np.linalg.eigvals(A).real) + 0.5) * np.eye(6), C + C.T
    T = core.lyapunov(A, C)
    assert np.array_equal(T, T.T)
    assert close(T, solve_continuous_lyapunov(A.T, C), 1e-9)
    assert close(T @ A + A.T @ T, C, 1e-9)


@pytest.mark.parametrize("stiffness", [1.0, 1e3])
def test_riccati_equation(core, rng, stiffness):
    A, B, W = rng.normal(size=(6, 6)), rng.normal(size=(6, 3)), rng.normal(size=(6, 6))
    S, Q = stiffness * B @ B.T, W @ W.T + 0.1 * np.eye(6)
    X = core.riccati(A, S, Q)
    assert np.array_equal(X, X.T)
    assert close(X, solve_continuous_are(A, np.sqrt(stiffness) * B, Q, np.eye(3)), 1e-8)
    assert np.all(np.linalg.eigvals(A - S @ X).real < 0)


@pytest.mark.parametrize("stiffness", [1e3, 1e6])
def test_stiff_riccati_equations_are_solved_to_their_rounding(core, rng, stiffness):
    A, B, W = rng.normal(size=(6, 6)), rng.normal(size=(6, 3)), rng.normal(size=(6, 6))
    S, Q = stiffness * B @ B.T, W @ W.T + 0.1 * np.eye(6)
    X = core.riccati(A, S, Q)
    largest_term = np.max(np.abs(X)) ** 2 * np.max(np.abs(S))
    assert np.max(np.abs(A.T @ X + X @ A - X @ S @ X + Q)) <= 1e-15 * largest_term


def test_double_integrators_in_closed_form(core):
    """Per axis A = [0 1; 0 0], S = diag(0, 1/r), Q = diag(q, 0): X12 = sqrt(q r),
    X22 = sqrt(2 r X12), X11 = X12 X22 / r.
    """
    q, r = 4.0, 0.25
    zero, one = np.zeros((3, 3)), np.eye(3)
    A = np.block([[zero, one], [zero, zero]])
    X12 = np.sqrt(q * r)
    X22 = np.sqrt(2 * r * X12)
    expected = np.block([[X12 * X22 / r * one, X12 * one], [X12 * one, X22 * one]])
    X = core.riccati(A, np.block([[zero, zero], [zero, one / r]]), np.diag([q] * 3 + [0] * 3))
    assert close(X, expected, 1e-12)
