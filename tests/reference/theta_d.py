# SPDX-License-Identifier: BSD-2-Clause
"""Theta-D control in line-of-sight coordinates (docs/models.md C.5).

The Riccati equation is scipy's, the Lyapunov equations are solved by Kronecker products. The
factorisation A x = f(x) - f(0) has the terms of the specification and those that a reference of
moving range adds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import cos, exp, pi, sin
from typing import Any

import numpy as np
from scipy.linalg import solve_continuous_are

from . import attitude
from .attitude import Array
from .body import Body
from .los import ZERO3, Los, kinematic_acceleration
from .orbit import central_gravity
from .ppc import Common, Error, T_matrix, command, errors


@dataclass(frozen=True)
class Weights:
    Q_error: float
    Q_rate: float
    R: float


@dataclass(frozen=True)
class ThetaD(Common):
    mu: float = 3.986004418e14
    J_hat: Any = ((50.0, 0.0, 0.0), (0.0, 45.0, 0.0), (0.0, 0.0, 60.0))
    A_hat: Any = ((10.0, 0.0, 0.0), (0.0, 10.0, 0.0), (0.0, 0.0, 10.0))
    range: Weights = Weights(0.04, 1.0884, 1.0)
    elevation: Weights = Weights(100.0, 2900.0, 1e4)
    azimuth: Weights = Weights(100.0, 2900.0, 1e4)
    attitude: Weights = Weights(900.0, 2100.0, 1.0)
    k_1: float = 0.9
    k_2: float = 0.9
    l_1: float = 0.1
    l_2: float = 0.1
    k_att: float = 0.9
    l_att: float = 0.1


@dataclass(frozen=True)
class Regulator:
    """A linear quadratic regulator, and the corrections that theta-D adds to its cost matrix."""

    A0: Array
    B: Array
    Q: Array
    R: Array
    S: Array = field(init=False)
    T0: Array = field(init=False)
    lyapunov: Array = field(init=False)

    def __post_init__(self) -> None:
        S = self.B @ np.linalg.solve(self.R, self.B.T)
        T0 = solve_continuous_are(self.A0, self.B, self.Q, self.R)
        Ac, one = self.A0 - S @ T0, np.eye(6)
        M = np.linalg.inv(np.kron(Ac.T, one) + np.kron(one, Ac.T))
        for name, value in (("S", S), ("T0", T0), ("lyapunov", M)):
            object.__setattr__(self, name, value)

    def solve(self, right: Array) -> Array:
        """T with T Ac + Ac' T = right."""
        return (self.lyapunov @ right.ravel(order="F")).reshape(6, 6, order="F")

    def cost_matrix(self, A: Array, eps_1: float, eps_2: float) -> Array:
        T1 = self.solve(-eps_1 * (self.T0 @ A + A.T @ self.T0))
        T2 = self.solve(-eps_2 * (T1 @ A + A.T @ T1 - T1 @ self.S @ T1))
        return self.T0 + T1 + T2

    def control(self, T: Array, x: Array) -> Array:
        return -np.linalg.solve(self.R, self.B.T @ T @ x)


def blocks(a: Array, b: Array, c: Array, d: Array) -> Array:
    return np.block([[a, b], [c, d]])


O3, I3 = np.zeros((3, 3)), np.eye(3)


def position_regulator(p: ThetaD) -> Regulator:
    ws = (p.range, p.elevation, p.azimuth)
    Q = np.diag([w.Q_error for w in ws] + [w.Q_rate for w in ws])
    return Regulator(blocks(O3, I3, O3, O3), np.vstack((O3, I3)), Q, np.diag([w.R for w in ws]))


def attitude_regulator(p: ThetaD) -> Regulator:
    w = p.attitude
    Q = np.diag([w.Q_error] * 3 + [w.Q_rate] * 3)
    B = np.vstack((O3, np.linalg.inv(np.array(p.J_hat, dtype=float))))
    return Regulator(blocks(O3, 0.5 * I3, O3, O3), B, Q, w.R * I3)


def kinematic_matrix(now: Los, ref: Los) -> Array:
    """Lower three rows of A with A x = f(x) - f(0), f without gravity; drho_d is not 0 for a moving
    range.
    """
    (rho, e, _), (drho_d, de_d, db_d) = now.q.x, ref.q.d
    (_, de, db), (rho_d, e_d, _) = now.q.d, ref.q.x
    ce, ce_d, tan = cos(e), cos(e_d), sin(e) / cos(e)
    S = np.sinc((e - e_d) / pi)
    turn_e, turn_b, closing = de + de_d, db + db_d, -2 * drho_d / rho
    c_2, c_3, c_6 = -closing * de_d / rho_d, -closing * db_d / rho_d, -0.5 * sin(2 * e)
    row_1 = (
        de**2 + db**2 * ce**2,
        -rho_d * db_d**2 * sin(e + e_d) * S,
        0,
        0,
        rho_d * turn_e,
        rho_d * ce**2 * turn_b,
    )
    row_2 = (c_2, -(db_d**2) * cos(e + e_d) * S, 0, -2 * de / rho, closing, c_6 * turn_b)
    row_3 = (
        c_3,
        2 * de_d * db_d * S / (ce * ce_d),
        0,
        -2 * db / rho,
        2 * tan * db,
        closing + 2 * tan * de_d,
    )
    return np.array((row_1, row_2, row_3))


def bias(T: Body, S: Body, now: Los, ref: Los, mu: float) -> Array:
    """f(0): kinematics of the reference, gravity where the servicer is, minus the acceleration of
    the reference.
    """
    Dg = now.C_LN @ (central_gravity(T.r, mu) - central_gravity(S.r, mu)) if mu else ZERO3
    rho = now.q.x[0]
    return (
        kinematic_acceleration(ref.q.x, ref.q.d)
        + np.array((1, 1 / rho, -1 / (rho * now.ce))) * Dg
        - ref.q.dd
    )


class ThetaDLaw:
    """Regulators of one parameter set; t_0: start of the run, the attitude starts at t_att."""

    def __init__(self, p: ThetaD, t_0: float = 0.0) -> None:
        self.p, self.t_0 = p, t_0
        self.position, self.attitude = position_regulator(p), attitude_regulator(p)

    def __call__(
        self, t: float, T: Body, S: Body, wheel_speed: Array, ref: Mapping[str, Any]
    ) -> dict[str, Any]:
        e = errors(T, S, ref, self.p.up_axis)
        u, M = self.generalised_control(t, T, S, e), self.torque(t, S, wheel_speed, e)
        return command(t, e, u, M, np.array(self.p.A_hat, dtype=float), self.p)

    def generalised_control(self, t: float, T: Body, S: Body, e: Error) -> Array:
        p, age = self.p, t - self.t_0
        eps_1, eps_2 = 1 - p.k_1 * exp(-p.l_1 * age), 1 - p.k_2 * exp(-p.l_2 * age)
        A = np.vstack((np.zeros((3, 6)), kinematic_matrix(e.now, e.ref)))
        v = self.position.control(
            self.position.cost_matrix(A, eps_1, eps_2), np.concatenate((e.x1, e.x2))
        )
        rho = e.now.q.x[0]
        return np.array((1, rho, rho * e.now.ce)) * (v - bias(T, S, e.now, e.ref, p.mu))

    def torque(self, t: float, S: Body, wheel_speed: Array, e: Error) -> Array:
        p, age = self.p, max(t - max(self.t_0, self.p.t_att), 0.0)
        J = np.array(p.J_hat, dtype=float)
        eps = 1 - p.k_att * exp(-p.l_att * age)
        A = blocks(O3, (T_matrix(e.q_SD) - I3) / 2, O3, O3)
        feedback = self.attitude.control(
            self.attitude.cost_matrix(A, eps, eps), np.concatenate((e.q_SD[1:], e.w))
        )
        gyroscopic = attitude.cross(S.omega, J @ S.omega + np.array(p.A_hat) @ wheel_speed)
        return feedback + gyroscopic + J @ (e.wdd - attitude.cross(e.w, e.wd))
