# SPDX-License-Identifier: BSD-2-Clause
"""Identities of the controller (docs/models.md A.5), each against a derivation of its own.

Exact derivatives come from second-order jets or complex steps, so that tolerances cover rounding
only: EXACT is about a hundred roundings of the largest term. Finite differences are used nowhere.
"""

from __future__ import annotations

from types import SimpleNamespace as Case

import numpy as np
import pytest

from tests.each import Each
from tests.reference import adaptive, attitude, orbit
from tests.reference.attitude import cross
from tests.reference.body import Body
from tests.reference.cases import (
    EXACT,
    MU,
    close,
    complex_step,
    orbits,
    positive_definite,
    quaternion,
)
from tests.reference.jet import Jet
from tests.reference.printed import G, X, Y, f_rel


@pytest.fixture
def rng():
    return Each(range(20)).map(np.random.default_rng)


def six(M):
    return np.array([M[i, j] for i, j in adaptive.PAIRS])


def random_reference(rng):
    return Jet(*(scale * rng.normal(size=3) for scale in (100.0, 1.0, 0.02)))


def translation(rng, damping_in_regressor=0.0):
    """True second derivative of the error under the commanded force, from the inertial motion of
    both bodies.
    """
    c = orbits(rng)
    K, P = positive_definite(rng, (1e-3, 2e-3, 4e-3)), positive_definite(rng, (2e-2, 5e-2, 9e-2))
    m, m_hat, Gamma = 100.0, rng.uniform(60, 140), 10.0
    reference = random_reference(rng)  # in H
    rho = c.C_HN @ (c.S - c.T)
    e1, e2 = rho.x - reference.x, rho.d - reference.d
    Psi = f_rel(rho.x, rho.d, c.r_t, c.th, c.thd, MU) - reference.dd
    F = -m_hat * (K @ e1 + P @ e2 + Psi)
    regressor = Psi + K @ e1 + (P @ e2 if damping_in_regressor else 0.0)
    free = c.S._replace(dd=orbit.central_gravity(c.S.x, MU) + c.C_HN.x.T @ F / m)
    e2_dot = (c.C_HN @ (free - c.T)).dd - reference.dd

    def V(x):
        a, b, mass = x[:3], x[3:6], x[6]
        return m / 2 * (a @ K @ a + b @ b) + (m - mass) ** 2 / (2 * Gamma)

    x = np.concatenate((e1, e2, (m_hat,)))
    x_dot = np.concatenate((e2, e2_dot, (Gamma * e2 @ regressor,)))
    size = abs(m * e1 @ K @ e2) + abs(m * e2 @ e2_dot) + abs((m - m_hat) * e2 @ regressor)
    return Case(V_dot=complex_step(V, x, x_dot), size=size, m=m, m_hat=m_hat, e2=e2, P=P)


def test_translational_lyapunov_rate_uses_the_estimated_mass(rng):
    """V_dot = -m_hat e2' P e2. Rounding 1e-15 m/s2 of the inertial difference over 0.1 m/s2: 1e-12
    of the terms.
    """
    c = translation(rng)
    assert close(c.V_dot, -c.m_hat * c.e2 @ c.P @ c.e2, 1e-12, c.size)


def test_damping_in_the_regressor_makes_the_lyapunov_rate_use_the_true_mass(rng):
    """A.5.1, damping_in_regressor: V_dot = -m e2' P e2 for any sign of m_hat."""
    c = translation(rng, damping_in_regressor=1.0)
    assert close(c.V_dot, -c.m * c.e2 @ c.P @ c.e2, 1e-12, c.size)


def test_mass_error_leaves_a_constant_position_offset(rng):
    """Limit set e2 = 0 = e2_dot: m_hat K e1 = (m - m_hat) Psi."""
    m, m_hat = 100.0, rng.uniform(60, 140)
    K, Psi = positive_definite(rng, (1e-3, 2e-3, 4e-3)), rng.normal(size=3)
    e1 = np.linalg.solve(m_hat * K, (m - m_hat) * Psi)
    assert close(Psi - m_hat / m * (K @ e1 + Psi), np.zeros(3), scale=1.0)


def test_error_and_model_term_of_the_reference_controller_are_the_printed_ones(rng):
    """The controller takes e1, e2, Psi from one jet; here they are put together from the printed
    terms.
    """
    c = orbits(rng)
    reference = random_reference(rng)  # in N
    ports = dict(zip(("rho_ref_N", "drho_ref_N", "ddrho_ref_N"), reference, strict=True))
    T, S = (Body(x.x, x.d, quaternion(rng), np.zeros(3)) for x in (c.T, c.S))
    e, _ = adaptive.translation_error(T, S, ports, MU)
    rho, in_H = c.C_HN @ (c.S - c.T), c.C_HN @ reference
    assert close(e.x, rho.x - in_H.x, scale=100.0)
    assert close(e.d, rho.d - in_H.d, scale=1.0)
    assert close(e.dd, f_rel(rho.x, rho.d, c.r_t, c.th, c.thd, MU) - in_H.dd, 1e-14, scale=1.0)


def test_regressors_times_inertia_elements_are_the_expressions_they_represent(rng):
    S = positive_definite(rng, (1, 2, 3))
    a, b = rng.normal(size=(2, 3))
    assert close(Y(b) @ six(S), S @ b)
    assert close(X(a, b) @ six(S), cross(a, S @ b))


def test_printed_regressor_signs_of_the_paper_are_wrong(rng):
    """Errata E14, E15: element (3,1) printed positive."""
    S = positive_definite(rng, (1, 2, 3))
    a, b = rng.normal(size=(2, 3))
    wrong = X(a, b)
    wrong[2, 0] *= -1
    assert not close(wrong @ six(S), cross(a, S @ b), 1e-6)


def test_regressor_is_the_jacobian_of_the_following_torque(rng):
    wd, wdd, Omega, Omega_dot = rng.normal(size=(4, 3))
    printed = np.hstack((X(wd, wd) + Y(wdd), X(wd, Omega) + Y(Omega_dot)))
    assert close(printed, adaptive.following_jacobian(wd, wdd, Omega, Omega_dot))
    eta = rng.normal(size=12)
    assert close(printed @ eta, adaptive.following_torque(eta, wd, wdd, Omega, Omega_dot))


def slewing(rng, use_wheels):
    """Random attitudes, rates, inertias and estimates; the controller's command and the true motion
    it causes.
    """
    J, A = positive_definite(rng, (200, 250, 150)), positive_definite(rng, (12, 15, 10))
    J_hat, A_hat = positive_definite(rng, (180, 240, 160)), positive_definite(rng, (14, 16, 12))
    eta, eta_hat = np.concatenate((six(J), six(A))), np.concatenate((six(J_hat), six(A_hat)))
    K, P, Gamma = rng.uniform(1, 3, 3), rng.uniform(5, 15, 3), rng.uniform(1e3, 1e5, 12)
    p = adaptive.Parameters(use_wheels=use_wheels, K_att=K, P_att=P, Gamma_eta=Gamma)
    q_SN, q_DN = quaternion(rng), quaternion(rng)
    w, wd_D, wdd_D, Omega = rng.normal(size=(4, 3))
    ports = {"q_DN": q_DN, "omega_DN_D": wd_D, "alpha_DN_D": wdd_D}
    err = adaptive.attitude_error(Body(np.zeros(3), np.zeros(3), q_SN, w), ports, p)
    M, Omega_dot, eta_hat_dot = adaptive.moment(err, Omega, eta_hat, p)
    w_dot = np.linalg.solve(J, M - cross(w, J @ w + A @ Omega) - A @ Omega_dot)
    return Case(**{name: value for name, value in locals().items() if name not in ("rng", "ports")})


def true_error_rates(c):
    """d eps/dt and d dw/dt by complex steps along the motion of both frames, without (16)."""
    q_dot = np.concatenate(
        (attitude.rate(c.q_SN, c.w), attitude.rate(c.q_DN, c.wd_D), c.w_dot, c.wdd_D)
    )

    def errors(x):
        q_SD = attitude.multiply(attitude.conjugate(x[4:8]), x[:4])
        q_SD = q_SD if q_SD[0].real > 0 else -q_SD
        dw = x[8:11] - attitude.dcm(q_SD) @ x[11:14]
        return np.concatenate((q_SD[1:] / (1 + q_SD[0]), dw))

    rates = complex_step(errors, np.concatenate((c.q_SN, c.q_DN, c.w, c.wd_D)), q_dot)
    return rates[:3], rates[3:]


def lyapunov_rate(c):
    """V_dot of V = (K eps.eps + dw.J dw + (eta - eta_hat)' Gamma^-1 (eta - eta_hat))/2, and the
    size of its terms.
    """
    eps_dot, dw_dot = true_error_rates(c)
    x = np.concatenate((c.err.epsilon, c.err.dw, c.eta_hat))

    def V(x):
        e, d, missing = x[:3], x[3:6], c.eta - x[6:]
        return (e @ (c.K * e) + d @ c.J @ d + missing @ (missing / c.Gamma)) / 2

    size = abs(c.err.dw @ c.J @ dw_dot) + abs((c.eta - c.eta_hat) @ (c.eta_hat_dot / c.Gamma)) + 1.0
    return complex_step(V, x, np.concatenate((eps_dot, dw_dot, c.eta_hat_dot))), size


def test_attitude_error_kinematics_follow_the_rate_error(rng):
    c = slewing(rng, use_wheels=1.0)
    eps_dot, _ = true_error_rates(c)
    assert close(eps_dot, G(c.err.epsilon) @ c.err.dw / 4)


def test_attitude_error_dynamics(rng):
    """(16): J dw_dot = -w x J w + M_c - J (wdd - w x wd), M_c = -A Omega_dot - w x A Omega."""
    c = slewing(rng, use_wheels=1.0)
    _, dw_dot = true_error_rates(c)
    M_c = -c.A @ c.Omega_dot - cross(c.w, c.A @ c.Omega)
    printed = -cross(c.w, c.J @ c.w) + M_c - c.J @ (c.err.wdd - cross(c.w, c.err.wd))
    assert close(c.J @ dw_dot, printed)


def test_wheel_law_is_the_printed_one(rng):
    c = slewing(rng, use_wheels=1.0)
    e = c.err
    feedback = G(e.epsilon).T @ (c.K * e.epsilon) / 4 + c.P * e.dw
    bracket = feedback - c.J_hat @ e.wdd - cross(e.wd, c.A_hat @ c.Omega + c.J_hat @ e.wd)
    W = -np.hstack((X(e.wd, e.wd) + Y(e.wdd), X(e.wd, c.Omega) + Y(c.Omega_dot)))
    assert close(c.Omega_dot, np.linalg.solve(c.A_hat, bracket))
    assert close(c.eta_hat_dot, c.Gamma * (W.T @ e.dw))


def test_rotational_lyapunov_rate_with_wheels(rng):
    """V_dot = -dw' P dw for any symmetric J, A, any diagonal K, P, Gamma."""
    c = slewing(rng, use_wheels=1.0)
    V_dot, size = lyapunov_rate(c)
    assert close(V_dot, -c.err.dw @ (c.P * c.err.dw), EXACT, size)


def test_rotational_lyapunov_rate_with_thrusters(rng):
    """M = J_hat wdd + wd x (A_hat Omega + J_hat wd) - G'K eps/4 - P dw without wheel acceleration:
    the same.
    """
    c = slewing(rng, use_wheels=0.0)
    V_dot, size = lyapunov_rate(c)
    assert not c.Omega_dot.any()
    assert close(V_dot, -c.err.dw @ (c.P * c.err.dw), EXACT, size)


def test_isotropic_gain_needs_no_rate_matrix(rng):
    s = rng.normal(size=3)
    k = 2.0
    assert close(G(s).T @ (k * s), k * (1 + s @ s) * s)


def test_lyapunov_function_is_continuous_over_the_shadow_switch_only_for_an_isotropic_gain(rng):
    s = rng.normal(size=3)
    s /= np.linalg.norm(s)
    shadow = -s / (s @ s)
    off = 1.2 * s
    assert close(shadow @ shadow, s @ s)
    assert not close(off @ off, (off / (off @ off)) @ (off / (off @ off)), 1e-3)
