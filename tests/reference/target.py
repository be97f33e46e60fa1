# SPDX-License-Identifier: BSD-2-Clause
"""Target: oblate-planet orbit and rigid body.  dh/dt = M in inertial axes, h = J omega."""

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
from .orbit import gravity_gradient_torque
from .sinusoid import ZERO3, Sinusoid

ATOL = np.array([1e-9] * 3 + [1e-12] * 3 + [1e-15] * 4 + [1e-17] * 3)
"""m, m/s, 1, rad/s: what rounding leaves of the components"""


@dataclass(frozen=True)
class Parameters(Orbit):
    mass: float = 1.0
    J_T: Any = IDENTITY
    sigma_TN_0: Sequence[float] = ZERO3
    omega_TN_T_0: Sequence[float] = ZERO3
    M_dist_T: Sinusoid = field(default_factory=Sinusoid)
    a_manoeuvre_N: Sinusoid = field(default_factory=Sinusoid)

    @cached_property
    def inertia(self) -> Array:
        return np.array(self.J_T, dtype=float)

    @cached_property
    def inverse_inertia(self) -> Array:
        return np.linalg.inv(self.inertia)


@dataclass(frozen=True)
class Input:
    F_T: Sequence[float] = ZERO3
    M_T: Sequence[float] = ZERO3


def initial_state(p: Parameters) -> Array:
    """[r_TN_N, v_TN_N, q_TN, omega_TN_T]"""
    return integrate.joined(*p.start(), attitude.quaternion_of_mrp(p.sigma_TN_0), p.omega_TN_T_0)


def body(y: Array) -> Body:
    return Body(y[0:3], y[3:6], y[6:10] / np.sqrt(y[6:10] @ y[6:10]), y[10:13])


def rhs(t: float, y: Array, p: Parameters, u: Input) -> Array:
    r, v, q, omega = y[0:3], y[3:6], y[6:10], y[10:13]
    C_TN = attitude.dcm(q)
    a = p.acceleration(t, r, v)
    if p.a_manoeuvre_N.active(t):
        a = a + p.a_manoeuvre_N(t)
    if any(u.F_T):
        a = a + np.array(u.F_T) @ C_TN / p.mass
    M = torque(t, C_TN @ r, p, u)
    alpha = p.inverse_inertia @ (M + attitude.cross(p.inertia @ omega, omega))
    return np.concatenate((v, a, attitude.rate(q, omega), alpha))


def torque(t: float, r_T: Array, p: Parameters, u: Input) -> Array:
    M = np.array(u.M_T, dtype=float)
    if p.use_gravity_gradient:
        M = M + gravity_gradient_torque(r_T, p.inertia, p.mu)
    return M + p.M_dist_T(t) if p.M_dist_T.active(t) else M


def outputs(y: Array, p: Parameters) -> dict[str, Array]:
    b = body(y)
    M_gg = (
        gravity_gradient_torque(attitude.dcm(b.q) @ b.r, p.inertia, p.mu)
        if p.use_gravity_gradient
        else np.zeros(3)
    )
    sigma = attitude.mrp_of_quaternion(b.q)
    return {
        "r_TN_N": b.r,
        "v_TN_N": b.v,
        "q_TN": b.q,
        "omega_TN_T": b.omega,
        "sigma_TN": sigma,
        "M_gg_T": M_gg,
    }


def truth(p: Parameters, y: Array, t0: float, t1: float, u: Input = Input()) -> Array:
    """State at t1, tight tolerance, constant inputs; the switch-on times of the disturbances are
    step ends.
    """
    starts = (p.M_dist_T.start, p.a_dist.start, p.a_manoeuvre_N.start)
    times = integrate.breakpoints(t0, t1, starts)
    for a, b in pairwise(times):
        y = integrate.truth(lambda t, x: rhs(t, x, p, u), y, a, b, ATOL)
    return y


def step(p: Parameters, y: Array, t0: float, t1: float, u: Input = Input()) -> Array:
    """State at t1 by RK4 on the absolute grid of max_step, constant inputs."""
    for a, b in integrate.grid(t0, t1, p.max_step):
        y = integrate.rk4_step(lambda t, x: rhs(t, x, p, u), y, a, b - a)
    y[6:10] /= np.sqrt(y[6:10] @ y[6:10])
    return y
