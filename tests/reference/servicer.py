# SPDX-License-Identifier: BSD-2-Clause
"""Servicer: oblate-planet orbit, rigid body with three momentum wheels, mass flow.

Total momentum H = J omega + A Omega in S axes (J with the wheels locked, Omega relative to the
body), dH/dt = M in N. Before t_att the attitude is frozen, the published rate is zero and the
wheels are at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from . import attitude, integrate
from .attitude import Array
from .body import IDENTITY, Body, Orbit
from .orbit import gravity_gradient_torque, hill_frame
from .sinusoid import ZERO3, Sinusoid

ATOL = np.array([1e-9] * 3 + [1e-12] * 3 + [1e-15] * 4 + [1e-17] * 3 + [1e-15] * 3 + [1e-12])
"""m, m/s, 1, rad/s, rad/s, kg: what rounding leaves of the components"""


@dataclass(frozen=True)
class Parameters(Orbit):
    rho_0_H: Sequence[float] = ZERO3
    drho_0_H: Sequence[float] = ZERO3
    mass_0: float = 1.0
    J_S: Any = IDENTITY
    A_w: Any = IDENTITY
    sigma_SN_0: Sequence[float] = ZERO3
    omega_SN_S_0: Sequence[float] = ZERO3
    wheel_speed_0: Sequence[float] = ZERO3
    t_att: float = 0.0
    M_dist_S: Sinusoid = field(default_factory=Sinusoid)

    @cached_property
    def inertia(self) -> Array:
        return np.array(self.J_S, dtype=float)

    @cached_property
    def inverse_inertia(self) -> Array:
        return np.linalg.inv(self.inertia)

    @cached_property
    def wheel_inertia(self) -> Array:
        return np.array(self.A_w, dtype=float)


@dataclass(frozen=True)
class Input:
    F_S: Sequence[float] = ZERO3
    M_S: Sequence[float] = ZERO3
    mdot: float = 0.0
    wheel_accel_cmd: Sequence[float] = ZERO3


def initial_state(p: Parameters) -> Array:
    """[r_SN_N, v_SN_N, q_SN, omega_SN_S, wheel_speed, mass]"""
    r, v = p.start()
    if p.a != 0.0:
        C_HN = hill_frame(r, v, p.mu)
        rho, drho = np.array(p.rho_0_H), np.array(p.drho_0_H)
        r, v = r + C_HN.x.T @ rho, v + C_HN.x.T @ drho + C_HN.d.T @ rho
    q = attitude.quaternion_of_mrp(p.sigma_SN_0)
    return integrate.joined(r, v, q, p.omega_SN_S_0, p.wheel_speed_0, p.mass_0)


def body(y: Array, active: bool = True) -> Body:
    omega = y[10:13] if active else np.zeros(3)
    return Body(y[0:3], y[3:6], y[6:10] / np.sqrt(y[6:10] @ y[6:10]), omega)


def rhs(t: float, y: Array, p: Parameters, u: Input, active: bool) -> Array:
    r, v, q, omega, wheel_speed, mass = y[0:3], y[3:6], y[6:10], y[10:13], y[13:16], y[16]
    C_SN = attitude.dcm(q)
    a = p.acceleration(t, r, v) + np.array(u.F_S) @ C_SN / mass
    if not active:
        return np.concatenate((v, a, np.zeros(10), (-u.mdot,)))
    wheel_accel = np.array(u.wheel_accel_cmd, dtype=float)
    H = p.inertia @ omega + p.wheel_inertia @ wheel_speed
    dH = torque(t, C_SN @ r, p, u) + attitude.cross(H, omega)
    alpha = p.inverse_inertia @ (dH - p.wheel_inertia @ wheel_accel)
    return np.concatenate((v, a, attitude.rate(q, omega), alpha, wheel_accel, (-u.mdot,)))


def torque(t: float, r_S: Array, p: Parameters, u: Input) -> Array:
    M = np.array(u.M_S, dtype=float)
    if p.use_gravity_gradient:
        M = M + gravity_gradient_torque(r_S, p.inertia, p.mu)
    return M + p.M_dist_S(t) if p.M_dist_S.active(t) else M


def is_active(p: Parameters, t: float) -> bool:
    """Attitude motion is free from t_att on; a rounding of the time grid must not decide."""
    return t >= p.t_att - 1e-9 * p.max_step


def outputs(t: float, y: Array, p: Parameters) -> dict[str, Array]:
    active = is_active(p, t)
    b = body(y, active)
    return {
        "r_SN_N": b.r,
        "v_SN_N": b.v,
        "q_SN": b.q,
        "omega_SN_S": b.omega,
        "sigma_SN": attitude.mrp_of_quaternion(b.q),
        "wheel_speed": y[13:16] if active else np.zeros(3),
        "mass": y[16],
    }


def truth(p: Parameters, y: Array, t0: float, t1: float, u: Input = Input()) -> Array:
    """State at t1, tight tolerance, constant inputs; t_att and switch-on times are step ends."""
    times = integrate.breakpoints(t0, t1, (p.t_att, p.M_dist_S.start, p.a_dist.start))
    for a, b in pairwise(times):
        active = is_active(p, a)
        y = integrate.truth(lambda t, x, on=active: rhs(t, x, p, u, on), y, a, b, ATOL)
    return y


def step(p: Parameters, y: Array, t0: float, t1: float, u: Input = Input()) -> Array:
    """State at t1 by RK4 on the absolute grid of max_step, constant inputs."""
    for a, b in integrate.grid(t0, t1, p.max_step):
        active = is_active(p, a)
        y = integrate.rk4_step(lambda t, x, on=active: rhs(t, x, p, u, on), y, a, b - a)
    y[6:10] /= np.sqrt(y[6:10] @ y[6:10])
    return y
