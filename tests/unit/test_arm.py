# SPDX-License-Identifier: BSD-2-Clause
"""arm.h: the mass matrix against published reference values and against point masses."""

from __future__ import annotations

import numpy as np
import pytest

from tests.fmu.arm_cases import SHIFT, Published, iiwa, random_arm
from tests.reference import arm as reference


def numbers(arm):
    """An Arm of arm.h, seven rows of everything."""
    values = arm.parameters()
    names = ("joints", *reference.ROWS, "p_EA_A", "q_EA")
    return np.concatenate([np.ravel(values[name]) for name in names])


def mass_matrix(core, arm, q):
    rows = np.zeros(7)
    rows[: arm.n] = q
    return core.mass_matrix(numbers(arm), arm.mass_0, arm.J_S, rows)


def test_mass_matrix_matches_published_values(core):
    """Pinocchio 4.1 and MuJoCo 4.0, speeds of the frame of the root link."""
    T = np.eye(13)
    T[:6, :6] = SHIFT
    H = mass_matrix(core, iiwa(), Published.q)
    assert pytest.approx(Published.H(), abs=1e-11) == T.T @ H @ T


@pytest.mark.parametrize("n", [0, 1, 2, 5, 7])
def test_mass_matrix_matches_point_masses(core, rng, n):
    """Rows of joints that do not exist are 0, for any parameters."""
    arm, q = random_arm(rng, n), rng.uniform(-3, 3, n)
    H = mass_matrix(core, arm, q)
    exist = 6 + n
    assert H[:exist, :exist] == pytest.approx(reference.Vehicle(arm, q).H(), abs=1e-11)
    assert not H[exist:].any()
    assert not H[:, exist:].any()


def test_mass_matrix_is_symmetric_and_positive_definite(core, rng):
    for _ in range(20):
        H = mass_matrix(core, random_arm(rng, 7), rng.uniform(-3, 3, 7))
        assert np.array_equal(H[6:], H[:, 6:].T)
        assert pytest.approx(H.T, abs=1e-11) == H
        assert np.linalg.eigvalsh(H)[0] > 0
