# SPDX-License-Identifier: BSD-2-Clause
"""Identities of the guidance (docs/models.md A.4.3, A.4.5), each against a derivation of its own.

Exact derivatives come from second-order jets or complex steps, so that tolerances cover rounding
only: EXACT is about a hundred roundings of the largest term. Finite differences are used nowhere.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.each import Each
from tests.reference import attitude, guidance, jet, printed
from tests.reference.attitude import cross
from tests.reference.cases import EXACT, close, direction, tumbling
from tests.reference.jet import Jet
from tests.reference.printed import ORBIT_NORMAL_H


@pytest.fixture
def rng():
    return Each(range(20)).map(np.random.default_rng)


def facing(c, held_H=None):
    """C_DN(t) and |u| by the reference implementation."""
    grasp_N = c.C_HN.T @ c.C_HT @ jet.constant(c.p.p_T)
    return guidance.facing_frame(grasp_N, c.C_HN, held_H, c.p)


def test_rate_of_the_target_relative_to_the_orbit_frame(rng):
    c = tumbling(rng)
    axis = printed.grasp_axis(c.T)
    w, w_dot = attitude.angular_rates(*c.C_HT.T)
    assert close(w, axis.w)
    assert close(w_dot, axis.w_dot, scale=1e-3)


def test_derivatives_of_the_grasp_axis_in_the_orbit_frame(rng):
    c = tumbling(rng)
    p, axis = c.C_HT @ jet.constant(c.p.p_T), printed.grasp_axis(c.T)
    assert close(p.x, axis.p0)
    assert close(p.d, axis.p1)
    assert close(p.dd, axis.p2, scale=1e-3)


def test_reference_published_in_inertial_axes_is_the_printed_one_in_the_orbit_frame(rng):
    """Ports carry derivatives seen in N; (10) has them seen in H."""
    c = tumbling(rng)
    out, _ = guidance.sample(c.t, c.body, c.body, c.p)
    in_H = c.C_HN @ Jet(out["rho_ref_N"], out["drho_ref_N"], out["ddrho_ref_N"])
    expected = printed.reference(c.t, printed.grasp_axis(c.T), c.p.rho_M, c.p.rho_0, c.p.beta)
    assert close(in_H.x, expected[0])
    assert close(in_H.d, expected[1])
    assert close(in_H.dd, expected[2], scale=1e-2)


def test_desired_rates_are_the_derivative_of_the_desired_rotation_matrix(rng):
    """Printed w_DH, w_DH_dot, omega_d, omegaDot_d; the rates grow as 1/|u| and 1/|u|^2, and
    rounding with them.
    """
    c = tumbling(rng)
    d = printed.desired_attitude(printed.grasp_axis(c.T), c.C_HN.x, c.T.w_H, c.T.w_H_dot)
    C_DN, size = facing(c)
    omega, alpha = attitude.angular_rates(*C_DN)
    w, w_dot = attitude.angular_rates(*(C_DN @ c.C_HN.T))
    assert size > np.sin(c.p.guard_angle)
    assert close(C_DN.x, d.C_DN)
    assert close(w, d.w, EXACT / d.n)
    assert close(w_dot, d.w_dot, EXACT / d.n**2)
    assert close(omega, d.omega, EXACT / d.n)
    assert close(alpha, d.alpha, EXACT / d.n**2)


def test_published_attitude_reference_is_the_printed_one(rng):
    c = tumbling(rng)
    d = printed.desired_attitude(printed.grasp_axis(c.T), c.C_HN.x, c.T.w_H, c.T.w_H_dot)
    out, _ = guidance.sample(c.t, c.body, c.body, c.p)
    assert close(attitude.dcm(out["q_DN"]), d.C_DN)
    assert close(out["omega_DN_D"], d.omega, EXACT / d.n)
    assert close(out["alpha_DN_D"], d.alpha, EXACT / d.n**2)


def test_unnormalised_axis_of_the_paper_is_not_a_rotation(rng):
    """Erratum E4: two of its three rows have the length |u| = sin(angle to the orbit normal)."""
    i = direction(rng)
    k = cross(i, ORBIT_NORMAL_H)
    rows = np.array((i, cross(k, i), k))
    assert close(rows @ rows.T, np.diag((1, k @ k, k @ k)))
    assert k @ k == pytest.approx(1 - i[2] ** 2)


def along_the_orbit_normal(c):
    """The same case with the grasp axis on the orbit normal."""
    c.p = guidance.Parameters(J_T=c.p.J_T, p_T=c.C_HT.x.T @ ORBIT_NORMAL_H)
    return c


def test_guard_holds_the_axis_in_the_orbit_frame(rng):
    c = along_the_orbit_normal(tumbling(rng))
    held = np.array((0.6, 0.8, 0.0))
    C_DN, size = facing(c, held)
    assert size < np.sin(c.p.guard_angle)
    assert close(C_DN.x @ c.C_HN.x.T @ held, (0, 0, 1))


def test_held_frame_and_its_derivatives_stay_a_rotation(rng):
    """C C' = I with its first two derivatives."""
    c = along_the_orbit_normal(tumbling(rng))
    C_DN, _ = facing(c, np.array((0.6, 0.8, 0.0)))
    product = C_DN @ C_DN.T
    assert close(product.x, np.eye(3))
    assert close(product.d, np.zeros((3, 3)), scale=0.1)
    assert close(product.dd, np.zeros((3, 3)), scale=0.1)


def test_guard_that_starts_without_a_held_axis_uses_the_radial_direction(rng):
    c = along_the_orbit_normal(tumbling(rng))
    C_DN, _ = facing(c)
    assert close(C_DN.x[2], c.C_HN.x[0])
