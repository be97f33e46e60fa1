# SPDX-License-Identifier: BSD-2-Clause
"""Servicer with hinged panels and sloshing masses, by Lagrange from the kinetic energy alone.

Bodies with velocities v_i = V + omega x r_i + J_i q', spins w_i = omega + q' a, seen in a frame
that moves with S at the instant (V = 0). With the speeds u = [V, omega, q'], T = u.H(q) u/2:

    d/dt dT/dV  + omega x dT/dV  = F
    d/dt dT/dom + omega x dT/dom = M                     wheels: A_w Omega beside dT/dom
    d/dt dT/dq' - dT/dq          = Q

H is summed over bodies, its derivatives by q are complex steps: none of the terms of the model is
written down. The hub is a body of its own, with its own centre of mass. Springs, dampers and tides
are forces -d(potential)/dq. State: [r, v, sigma, omega, Omega, mass, q (8), q' (8), dissipated].
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from . import attitude, integrate, printed, servicer
from .attitude import Array, cross, tilde

NONE4 = (0.0, 0.0, 0.0, 0.0)
ROWS4 = ((0.0, 0.0, 1.0),) * 4
Q, DQ = slice(16, 24), slice(24, 32)


@dataclass(frozen=True)
class Parameters(servicer.Parameters):
    panel_mass: Sequence[float] = NONE4
    panel_hinge_S: Any = ROWS4
    panel_arm_S: Any = ROWS4
    panel_axis_S: Any = ROWS4
    panel_inertia: Any = ROWS4
    panel_frequency: Sequence[float] = NONE4
    panel_damping_ratio: Sequence[float] = NONE4
    panel_angle_0: Sequence[float] = NONE4
    panel_rate_0: Sequence[float] = NONE4
    slosh_mass_0: Sequence[float] = NONE4
    slosh_position_S: Any = ROWS4
    slosh_axis_S: Any = ROWS4
    slosh_frequency: Sequence[float] = NONE4
    slosh_damping_ratio: Sequence[float] = NONE4
    slosh_displacement_0: Sequence[float] = NONE4
    slosh_rate_0: Sequence[float] = NONE4
    slosh_draw: Sequence[float] = NONE4

    @cached_property
    def parts(self) -> list[Part]:
        """Return the parts that exist."""
        panels = [Panel(self, i) for i in range(4) if self.panel_mass[i] > 0]
        return [*panels, *(Slosh(self, j) for j in range(4) if self.slosh_mass_0[j] > 0)]


class Body(NamedTuple):
    """Mass, centre of mass from S, inertia about it; spin per unit of the coordinate's rate."""

    mass: Any
    r: Array
    inertia: Array
    axis: Array


def unit(a: Any) -> Array:
    return np.asarray(a, dtype=float) / np.linalg.norm(a)


def about(axis: Array, angle: Any) -> Array:
    """Matrix that turns by an angle about a unit axis (Rodrigues)."""
    K = tilde(axis)
    return np.eye(3) + np.sin(angle) * K + (1 - np.cos(angle)) * K @ K


class Panel:
    """A plate, turned from its place at angle 0 by the rotation about its hinge."""

    def __init__(self, p: Parameters, i: int) -> None:
        self.k, self.draw, self.mass_0 = i, 0.0, p.panel_mass[i]
        self.axis, arm = unit(p.panel_axis_S[i]), np.array(p.panel_arm_S[i], dtype=float)
        e = unit(arm)
        frame = np.array([e, self.axis, np.cross(e, self.axis)])
        self.hinge, self.arm = np.array(p.panel_hinge_S[i], dtype=float), arm
        self.inertia = frame.T @ np.diag(p.panel_inertia[i]) @ frame
        # about the hinge axis
        self.M_0 = self.axis @ self.inertia @ self.axis + self.mass_0 * (arm @ arm)
        self.w, self.z = p.panel_frequency[i], p.panel_damping_ratio[i]

    def body(self, q: Any, used: float) -> Body:
        R = about(self.axis, q)
        return Body(self.mass_0, self.hinge + R @ self.arm, R @ self.inertia @ R.T, self.axis)

    def M(self, used: float) -> float:
        return float(self.M_0)


class Slosh:
    """A point mass on a line."""

    def __init__(self, p: Parameters, j: int) -> None:
        self.k, self.draw, self.mass_0 = 4 + j, p.slosh_draw[j], p.slosh_mass_0[j]
        self.place, self.line = (
            np.array(p.slosh_position_S[j], dtype=float),
            unit(p.slosh_axis_S[j]),
        )
        self.w, self.z = p.slosh_frequency[j], p.slosh_damping_ratio[j]

    def body(self, q: Any, used: float) -> Body:
        return Body(self.M(used), self.place + q * self.line, np.zeros((3, 3)), np.zeros(3))

    def M(self, used: float) -> float:
        return self.mass_0 - self.draw * used


Part = Panel | Slosh


def hub(p: Parameters, used: float) -> tuple[float, Array, Array]:
    """Mass, first moment and inertia about S: what the parts leave of the undeformed vehicle; the
    propellant leaves at S.
    """
    mass = p.mass_0 - used
    moment, inertia = np.zeros(3), np.array(p.inertia)
    for part in p.parts:
        b = part.body(0.0, 0.0)
        mass += part.draw * used - b.mass
        moment = moment - b.mass * b.r
        inertia = inertia - b.inertia + b.mass * tilde(b.r) @ tilde(b.r)
    return mass, moment, inertia


def mass_matrix(p: Parameters, q: Array, used: float) -> Array:
    """H(q) of T = u.H u/2, u = [V, omega, q' of the parts]; complex q pass."""
    n, rest = len(p.parts), hub(p, used)
    H = np.zeros((6 + n, 6 + n), dtype=complex)
    H[:3, :3], H[:3, 3:6], H[3:6, :3], H[3:6, 3:6] = (
        rest[0] * np.eye(3),
        -tilde(rest[1]),
        tilde(rest[1]),
        rest[2],
    )
    for i, (part, angle) in enumerate(zip(p.parts, q, strict=True)):
        b = part.body(angle, used)
        own = cross(b.axis, b.r - part.hinge) if isinstance(part, Panel) else part.line
        v, w = np.zeros((3, 6 + n), dtype=complex), np.zeros((3, 6 + n), dtype=complex)
        v[:, :3], v[:, 3:6], v[:, 6 + i] = np.eye(3), -tilde(b.r), own
        w[:, 3:6], w[:, 6 + i] = np.eye(3), b.axis
        H += b.mass * v.T @ v + w.T @ b.inertia @ w
    return H


def complex_step(f: Any, q: Array, i: int) -> Array:
    moved = q.astype(complex)
    moved[i] += 1e-30j
    return np.imag(f(moved)) / 1e-30


def about_centre(H: Array) -> tuple[Array, Array]:
    """Centre of mass from S and inertia about it, of the mass matrix."""
    m, s = H[0, 0], np.array([H[5, 1], H[3, 2], H[4, 0]])
    return s / m, H[3:6, 3:6] + tilde(s) @ tilde(s) / m


def tidal_potential(H: Array, g: float, n: Array) -> Any:
    """g (3/2 n.I n - tr I/2), I about the centre of mass."""
    inertia = about_centre(H)[1]
    return g * (1.5 * n @ inertia @ n - np.trace(inertia) / 2)


@dataclass(frozen=True)
class Moment:
    """Everything at an instant of the motion."""

    p: Parameters
    y: Array
    active: bool
    H: Array = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "H", mass_matrix(self.p, self.q, self.used).real)

    @property
    def used(self) -> float:
        return float(self.p.mass_0 - self.y[15])

    @property
    def q(self) -> Array:
        return np.array([self.y[Q][part.k] for part in self.p.parts])

    @property
    def speeds(self) -> Array:
        rates = [self.y[DQ][part.k] for part in self.p.parts]
        omega = self.y[9:12] if self.active else np.zeros(3)
        return np.concatenate((np.zeros(3), omega, rates))

    @property
    def wheels(self) -> Array:
        return self.p.wheel_inertia @ (self.y[12:15] if self.active else np.zeros(3))

    @property
    def C_SN(self) -> Array:
        return printed.C(self.y[6:9])

    @cached_property
    def centre(self) -> tuple[Array, Array, Array]:
        """r_CS_S, r_CN_N, v_CN_N."""
        c = about_centre(self.H)[0]
        v_c = (self.H @ self.speeds)[:3] / self.H[0, 0]
        return c, self.y[:3] + self.C_SN.T @ c, self.y[3:6] + self.C_SN.T @ v_c

    def field(self) -> tuple[float, Array]:
        """g and n."""
        r = self.centre[1]
        if not (self.p.use_gravity_gradient and self.p.mu):
            return 0.0, np.zeros(3)
        d = np.linalg.norm(r)
        return self.p.mu / d**3, self.C_SN @ r / d

    def elastic(self) -> float:
        return float(
            sum(
                part.M(self.used) * part.w**2 * x**2 / 2
                for part, x in zip(self.p.parts, self.q, strict=True)
            )
        )

    def momentum(self) -> Array:
        """About C, N axes."""
        pi = self.H @ self.speeds
        return self.C_SN.T @ (pi[3:6] + self.wheels - cross(self.centre[0], pi[:3]))

    def kinetic(self) -> float:
        """Of the motion about C, wheels locked."""
        pi = self.H @ self.speeds
        return float(self.speeds @ pi - pi[:3] @ pi[:3] / self.H[0, 0]) / 2


def accelerations(x: Moment, F: Array, M: Array, wheel_accel: Array) -> Array:
    """[A, alpha, q''] under a force at S and a moment about S; a held hub has alpha = 0."""
    p, u, n = x.p, x.speeds, len(x.p.parts)
    slopes = [complex_step(lambda q: mass_matrix(p, q, x.used), x.q, i) for i in range(n)]  # dH/dq
    g, direction = x.field()
    pi, omega = x.H @ u, u[3:6]
    load = np.zeros(6 + n)
    load[:3] = F - cross(omega, pi[:3])
    inertia = about_centre(x.H)[1]
    tide = 3 * g * cross(direction, inertia @ direction)
    load[3:6] = M + tide - cross(omega, pi[3:6] + x.wheels) - p.wheel_inertia @ wheel_accel
    for i, part in enumerate(p.parts):
        pull = -complex_step(
            lambda q: tidal_potential(mass_matrix(p, q, x.used), g, direction), x.q, i
        )
        spring = part.w**2 * x.q[i] + 2 * part.z * part.w * u[6 + i]
        load[6 + i] = u @ slopes[i] @ u / 2 - part.M(x.used) * spring + pull
    load -= sum(
        (rate * slope @ u for rate, slope in zip(u[6:], slopes, strict=True)), np.zeros(6 + n)
    )
    free = [i for i in range(6 + n) if x.active or not 3 <= i < 6]
    found = np.zeros(6 + n)
    found[free] = np.linalg.solve(x.H[np.ix_(free, free)], load[free])
    return found


def initial_state(p: Parameters) -> Array:
    first = servicer.initial_state(p)
    exists = np.isin(np.arange(8), [part.k for part in p.parts])
    q = np.concatenate((p.panel_angle_0, p.slosh_displacement_0)) * exists
    dq = np.concatenate((p.panel_rate_0, p.slosh_rate_0)) * exists
    r_v, rest = first[:6], first[10:17]
    return integrate.joined(r_v, p.sigma_SN_0, rest, q, dq, 0.0)


def rhs(t: float, y: Array, p: Parameters, u: servicer.Input, active: bool) -> Array:
    x = Moment(p, y, active)
    M = np.array(u.M_S, dtype=float) + (p.M_dist_S(t) if p.M_dist_S.active(t) else 0.0)
    wheel_accel = np.array(u.wheel_accel_cmd, dtype=float) if active else np.zeros(3)
    found = accelerations(x, np.array(u.F_S, dtype=float), M, wheel_accel)
    fall = p.acceleration(t, x.centre[1], x.centre[2])
    omega, dy = x.speeds[3:6], np.zeros_like(y)
    dy[:3], dy[3:6] = y[3:6], fall + x.C_SN.T @ found[:3]
    G = attitude.mrp_rate_matrix(attitude.quaternion_of_mrp(y[6:9]))
    dy[6:9], dy[9:12], dy[12:15], dy[15] = G @ omega, found[3:6], wheel_accel, -u.mdot
    for i, part in enumerate(p.parts):
        dy[16 + part.k], dy[24 + part.k] = x.speeds[6 + i], found[6 + i]
        dy[32] += 2 * part.z * part.w * part.M(x.used) * x.speeds[6 + i] ** 2
    return dy


def step(p: Parameters, y: Array, t: float, h: float, u: servicer.Input) -> Array:
    """One step of RK4, within the unit sphere of the Rodrigues parameters."""
    active = servicer.is_active(p, t)
    return integrate.rk4_step(lambda s, x: rhs(s, x, p, u, active), y, t, h)


def outputs(t: float, y: Array, p: Parameters) -> dict[str, Any]:
    x = Moment(p, y, servicer.is_active(p, t))
    c, r, v = x.centre
    drawn = {part.k: part.M(x.used) for part in p.parts}
    return {
        "r_SN_N": y[:3],
        "v_SN_N": y[3:6],
        "sigma_SN": y[6:9],
        "omega_SN_S": x.speeds[3:6],
        "wheel_speed": y[12:15] if x.active else np.zeros(3),
        "mass": y[15],
        "panel_angle": y[16:20],
        "panel_rate": y[24:28],
        "slosh_displacement": y[20:24],
        "slosh_rate": y[28:32],
        "slosh_mass": np.array([drawn.get(k, 0.0) for k in range(4, 8)]),
        "hub_mass": hub(p, x.used)[0],
        "r_CS_S": c,
        "r_CN_N": r,
        "v_CN_N": v,
        "h_N": x.momentum(),
        "kinetic_energy": x.kinetic(),
        "elastic_energy": x.elastic(),
        "dissipated_energy": y[32],
    }
