# SPDX-License-Identifier: BSD-2-Clause
"""Adaptive controller: mass-adaptive force, inertia-adaptive wheel acceleration or torque.

Translation. e_N = rho - rho_ref seen in H is the jet C_HN e_N; without control its second
derivative is Psi:
    (e1, e2, Psi) = (C_HN e_N, its rate, its acceleration),   F = -m_hat (K e1 + P e2 + Psi)

Attitude. J wdd + wd x (J wd + A Omega) + A Omega_dot is the rate of momentum of a servicer that
follows D; it is linear in eta = (J, A), and its Jacobian is the regressor.  Feedback: f = (d
eps_dot/d omega)' K eps + P dw.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from . import attitude
from .attitude import Array
from .body import Body
from .jet import Jet
from .orbit import central_gravity, hill_frame

PAIRS = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
BASIS = np.zeros((6, 3, 3))
for _k, (_i, _j) in enumerate(PAIRS):
    BASIS[_k, _i, _j] = BASIS[_k, _j, _i] = 1.0
DIAGONAL = np.array([i == j for i, j in PAIRS] * 2)


@dataclass(frozen=True)
class Parameters:
    mu: float = 3.986004415e14
    K_rho: Sequence[float] = (2e-3, 2e-3, 2e-3)
    P_rho: Sequence[float] = (5e-2, 5e-2, 5e-2)
    Gamma_m: float = 10.0
    m_hat_0: float = 95.0
    K_att: Sequence[float] = (2.0, 2.0, 2.0)
    P_att: Sequence[float] = (10.0, 10.0, 10.0)
    Gamma_eta: Sequence[float] = (0.0,) * 12
    eta_hat_0: Sequence[float] = (1.0, 0.0, 0.0, 1.0, 0.0, 1.0) * 2
    Gamma_scale: float = 1.0
    use_wheels: float = 1.0
    t_att: float = 0.0
    projection: float = 0.0
    m_hat_range: float = 0.3
    """estimate stays within m_hat_0 (1 -+ range)"""
    eta_hat_range: float = 0.3
    """the same for the diagonal elements of both inertia matrices"""
    J_offdiag_max: float = 20.0
    A_offdiag_max: float = 2.0
    damping_in_regressor: float = 0.0


class Estimate(NamedTuple):
    m_hat: float
    eta_hat: Array


def initial_estimate(p: Parameters) -> Estimate:
    return Estimate(p.m_hat_0, np.array(p.eta_hat_0, dtype=float))


def matrix(six: Array) -> Array:
    """Symmetric matrix of its elements 11 12 13 22 23 33."""
    return np.tensordot(six, BASIS, 1)


def following_torque(
    eta: Array, wd: Array, wdd: Array, wheel_speed: Array, wheel_accel: Array
) -> Array:
    """J wdd + wd x (J wd + A Omega) + A Omega_dot, S axes, N.m"""
    J, A = matrix(eta[:6]), matrix(eta[6:])
    return J @ wdd + attitude.cross(wd, J @ wd + A @ wheel_speed) + A @ wheel_accel


def following_jacobian(wd: Array, wdd: Array, wheel_speed: Array, wheel_accel: Array) -> Array:
    """d following_torque / d eta, 3 x 12: the torque of each of the twelve unit inertias."""
    w = attitude.tilde(wd)
    of_J = (BASIS @ wdd).T + w @ (BASIS @ wd).T
    of_A = (BASIS @ wheel_accel).T + w @ (BASIS @ wheel_speed).T
    return np.hstack((of_J, of_A))


def translation_error(T: Body, S: Body, ref: Mapping[str, Any], mu: float) -> tuple[Jet, Array]:
    """(e1, e2, Psi) in H axes, and C_HN."""
    C_HN = hill_frame(T.r, T.v, mu)
    gravity = central_gravity(S.r, mu) - central_gravity(T.r, mu)
    e_N = Jet(
        S.r - T.r - ref["rho_ref_N"], S.v - T.v - ref["drho_ref_N"], gravity - ref["ddrho_ref_N"]
    )
    return C_HN @ e_N, C_HN.x


def force(e: Jet, m_hat: float, p: Parameters) -> tuple[Array, float]:
    """F in H axes and the rate of m_hat."""
    feedback = np.array(p.K_rho) * e.x
    damping = np.array(p.P_rho) * e.d
    regressor = e.dd + feedback + (damping if p.damping_in_regressor else 0.0)
    return -m_hat * (feedback + damping + e.dd), p.Gamma_m * float(e.d @ regressor)


class AttitudeError(NamedTuple):
    epsilon: Array
    dw: Array
    wd: Array
    wdd: Array
    feedback: Array


def attitude_error(S: Body, ref: Mapping[str, Any], p: Parameters) -> AttitudeError:
    """Error of S relative to D; desired rates in S components."""
    q_SD = attitude.positive(attitude.multiply(attitude.conjugate(ref["q_DN"]), S.q))
    C_SD = attitude.dcm(q_SD)
    wd, wdd = C_SD @ ref["omega_DN_D"], C_SD @ ref["alpha_DN_D"]
    epsilon = q_SD[1:] / (1.0 + q_SD[0])
    dw = S.omega - wd
    feedback = (
        attitude.mrp_rate_matrix(q_SD).T @ (np.array(p.K_att) * epsilon) + np.array(p.P_att) * dw
    )
    return AttitudeError(epsilon, dw, wd, wdd, feedback)


def moment(
    err: AttitudeError, wheel_speed: Array, eta_hat: Array, p: Parameters
) -> tuple[Array, Array, Array]:
    """Torque command, wheel acceleration command, rate of eta_hat."""
    none = np.zeros(3)
    required = following_torque(eta_hat, err.wd, err.wdd, wheel_speed, none)
    if p.use_wheels:
        M, wheel_accel = none, np.linalg.solve(matrix(eta_hat[6:]), err.feedback - required)
    else:
        M, wheel_accel = required - err.feedback, none
    W = -following_jacobian(err.wd, err.wdd, wheel_speed, wheel_accel)
    return M, wheel_accel, p.Gamma_scale * np.array(p.Gamma_eta) * (W.T @ err.dw)


def projected(m_hat: float, eta_hat: Array, p: Parameters) -> Estimate:
    """Clipping into a box about the start values."""
    if not p.projection:
        return Estimate(m_hat, eta_hat)
    start = np.array(p.eta_hat_0)
    off_diagonal = np.array([p.J_offdiag_max] * 6 + [p.A_offdiag_max] * 6)
    space = np.where(DIAGONAL, p.eta_hat_range * np.abs(start), off_diagonal)
    m = np.clip(m_hat, p.m_hat_0 * (1.0 - p.m_hat_range), p.m_hat_0 * (1.0 + p.m_hat_range))
    return Estimate(float(m), np.clip(eta_hat, start - space, start + space))


def sample(
    t: float,
    T: Body,
    S: Body,
    wheel_speed: Array,
    ref: Mapping[str, Any],
    x: Estimate,
    p: Parameters,
    period: float,
) -> tuple[dict[str, Any], Estimate]:
    """Outputs at t (the command used the estimates before the update) and the estimates after
    it.
    """
    e, C_HN = translation_error(T, S, ref, p.mu)
    F_H, dm_hat = force(e, x.m_hat, p)
    err = attitude_error(S, ref, p)
    M, wheel_accel, deta_hat = np.zeros(3), np.zeros(3), np.zeros(12)
    if t >= p.t_att - 1e-9 * max(1.0, period):
        M, wheel_accel, deta_hat = moment(err, wheel_speed, x.eta_hat, p)
    x = projected(x.m_hat + period * dm_hat, x.eta_hat + period * deta_hat, p)
    outputs = {
        "F_cmd_S": attitude.dcm(S.q) @ (F_H @ C_HN),
        "M_cmd_S": M,
        "wheel_accel_cmd": wheel_accel,
        "m_hat": x.m_hat,
        "eta_hat": x.eta_hat,
        "e1_H": e.x,
        "e2_H": e.d,
        "epsilon": err.epsilon,
        "domega_S": err.dw,
        "F_cmd_H": F_H,
    }
    return outputs, x
