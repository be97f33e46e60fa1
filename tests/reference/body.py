# SPDX-License-Identifier: BSD-2-Clause
"""Shared parts of target and servicer: the orbit of the target, and accelerations in orbit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from .attitude import Array
from .orbit import central_gravity, hill_axes, j2_acceleration, state_of_elements
from .sinusoid import ZERO3, Sinusoid

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class Body(NamedTuple):
    """Body state of X as on the wires: r_XN_N, v_XN_N, q_XN, omega_XN_X."""

    r: Array
    v: Array
    q: Array
    omega: Array


@dataclass(frozen=True)
class Orbit:
    """Orbital elements at t = 0 and planet; a = 0 selects r_0_N, v_0_N, mu = 0 is deep space."""

    mu: float = 3.986004415e14
    R_E: float = 6378136.3
    J2: float = 1.0826360229829945e-3
    a: float = 0.0
    e: float = 0.0
    inc: float = 0.0
    argp: float = 0.0
    raan: float = 0.0
    nu: float = 0.0
    r_0_N: Sequence[float] = ZERO3
    v_0_N: Sequence[float] = ZERO3
    use_J2: float = 0.0
    use_gravity_gradient: float = 0.0
    a_dist: Sinusoid = field(default_factory=Sinusoid)
    a_dist_axes: float = 0.0
    """0: N axes, 1: H axes of the body's own orbit"""
    max_step: float = 0.1

    def start(self) -> tuple[Array, Array]:
        if self.a == 0.0:
            return np.array(self.r_0_N, dtype=float), np.array(self.v_0_N, dtype=float)
        return state_of_elements(self.mu, self.a, self.e, self.inc, self.argp, self.raan, self.nu)

    def acceleration(self, t: float, r: Array, v: Array) -> Array:
        """Gravity and disturbance acceleration, N axes, m/s2."""
        a = central_gravity(r, self.mu) if self.mu else np.zeros(3)
        if self.use_J2:
            a = a + j2_acceleration(r, self.mu, self.R_E, self.J2)
        if self.a_dist.active(t):
            d = self.a_dist(t)
            a = a + (hill_axes(r, v).T @ d if self.a_dist_axes else d)
        return a
