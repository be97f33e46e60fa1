# SPDX-License-Identifier: BSD-2-Clause
"""Space robot from point masses alone: no inertia matrices, no gyroscopic terms, no
gravity-gradient torques.

Every body is six point masses on its principal axes. Where they are follows from base attitude and
joint angles; how they move with the generalised speeds is differentiated by complex steps.
D'Alembert's principle for the virtual displacements gives the equations of motion, scipy integrates
them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from .attitude import cross

Array = np.ndarray
AXES = np.eye(3)
STEP = 1e-30


@dataclass(frozen=True)
class Robot:
    """Base, link 1, link 2; lengths [m], masses [kg], moments of inertia about the own centre of
    mass [kg m2].
    """

    mass: tuple[float, ...] = (5799.28, 68.68, 68.68)
    Ixx: tuple[float, ...] = (4124.83, 0.38, 0.38)
    Iyy: tuple[float, ...] = (4124.83, 22.84, 22.84)
    Izz: tuple[float, ...] = (4124.83, 22.84, 22.84)
    l: tuple[float, ...] = (1.0, 1.0, 1.0)  # noqa: E741
    r: tuple[float, ...] = (1.0, 1.0, 1.0)

    def points(self, q: Array) -> tuple[Array, Array]:
        """Masses (18,) and positions (18, 3) in base axes from the centre of mass of the robot; q
        may be complex.
        """
        g1, g2 = q[0], q[0] + q[1]
        e1 = np.array([np.cos(g1), np.sin(g1), 0 * g1])
        e2 = np.array([np.cos(g2), np.sin(g2), 0 * g2])
        joint_1 = np.array([self.r[0], 0, 0])
        joint_2 = joint_1 + (self.l[1] + self.r[1]) * e1
        centres = (0 * e1, joint_1 + self.l[1] * e1, joint_2 + self.l[2] * e2)
        masses, places = [], []
        for k, (centre, along) in enumerate(zip(centres, (AXES[0] + 0 * e1, e1, e2), strict=True)):
            across = np.array([-along[1], along[0], 0 * g1])
            half = (self.Ixx[k] + self.Iyy[k] + self.Izz[k]) / 2
            for axis, inertia in (
                (along, self.Ixx[k]),
                (across, self.Iyy[k]),
                (AXES[2], self.Izz[k]),
            ):
                reach = np.sqrt(3 * (half - inertia) / self.mass[k])
                masses += 2 * [self.mass[k] / 6]
                places += [centre + reach * axis, centre - reach * axis]
        m, p = np.array(masses), np.array(places)
        return m, p - m @ p / m.sum()

    def derivative(self, q: Array, direction: Array) -> Array:
        """Derivative of the positions along a direction of the joint angles, by a complex step."""
        return np.asarray(
            self.points(np.asarray(q) + 1j * STEP * np.asarray(direction))[1].imag / STEP
        )

    def second(self, q: Array, dq: Array, step: float = 1e-5) -> Array:
        """Second derivative along dq: central difference of complex steps."""
        size = np.linalg.norm(dq)
        if size == 0:
            return np.zeros((18, 3))
        u = np.asarray(dq) / size
        return np.asarray(
            (self.derivative(q + step * u, u) - self.derivative(q - step * u, u))
            / (2 * step)
            * size**2
        )


def turned(q: Array, v: Array) -> Array:
    """Vectors (n, 3) in base axes to N axes: v_N = q v q*."""
    w, u = q[0], q[1:]
    return v + 2 * cross(u, cross(u, v) + w * v)


def accelerations(
    robot: Robot,
    w: Array,
    q: Array,
    dq: Array,
    field: Callable[[Array], Array],
    loads: Array,
    tau: Array,
    locked: bool,
) -> Array:
    """[d omega; ddq] in base axes; field: acceleration of gravity at positions (n, 3); loads: force
    and torque on the base.
    """
    m, rho = robot.points(np.asarray(q, dtype=float))
    D = [robot.derivative(q, e) for e in np.eye(2)]
    moves = [cross(e, rho) for e in AXES] + D
    relative = D[0] * dq[0] + D[1] * dq[1]
    rest = cross(w, cross(w, rho)) + 2 * cross(w, relative) + robot.second(q, dq) - field(rho)
    H = np.array([[np.sum(m[:, None] * a * b) for b in moves] for a in moves])
    work = np.array([a[:6].mean(axis=0) @ loads[:3] for a in moves]) + np.concatenate(
        (loads[3:], tau)
    )
    right = work - np.array([np.sum(m[:, None] * a * rest) for a in moves])
    n = 3 if locked else 5
    return np.concatenate((np.linalg.solve(H[:n, :n], right[:n]), np.zeros(5 - n)))


@dataclass(frozen=True)
class Orbit:
    """Kepler orbit in the x-y plane of N, perigee on x; nu: true anomaly at t = 0."""

    a: float = 7.0e6
    e: float = 0.0
    nu: float = 0.0
    mu: float = 3.986004418e14

    def anomaly(self, t: float) -> float:
        """True anomaly at a time, unwrapped, from Kepler's equation by Newton's method."""
        n = np.sqrt(self.mu / self.a**3)
        root = np.sqrt((1 - self.e) / (1 + self.e))
        turns, nu = divmod(self.nu + np.pi, 2 * np.pi)
        E0 = 2 * np.arctan(root * np.tan((nu - np.pi) / 2))
        M = E0 - self.e * np.sin(E0) + n * t
        turn, M = divmod(M + np.pi, 2 * np.pi)
        M, E = M - np.pi, M - np.pi
        for _ in range(30):
            E -= (E - self.e * np.sin(E) - M) / (1 - self.e * np.cos(E))
        return float(2 * np.arctan(np.tan(E / 2) / root) + 2 * np.pi * (turn + turns))

    def rate(self, nu: float) -> float:
        """Rate of the true anomaly [rad/s]."""
        return float(
            np.sqrt(self.mu / (self.a * (1 - self.e**2)) ** 3) * (1 + self.e * np.cos(nu)) ** 2
        )

    def strength(self, nu: float) -> float:
        """mu/r^3 [1/s2]."""
        return float(self.mu * ((1 + self.e * np.cos(nu)) / (self.a * (1 - self.e**2))) ** 3)


def simulate(
    robot: Robot,
    orbit: Orbit,
    start: Array,
    times: Array,
    *,
    loads: Callable[[float], Array] = lambda t: np.zeros(6),
    tau: Callable[[float, Array, Array], Array] = lambda t, q, dq: np.zeros(2),
    locked: bool = False,
    gravity: bool = True,
) -> Array:
    """States (n, 11) at the times: quaternion base to N, omega in base axes, joint angles, joint
    rates.
    """

    def rate(t: float, x: Array) -> Array:
        q, w, angles, rates = x[:4], x[4:7], x[7:9], x[9:11]
        nu = orbit.anomaly(t)
        back = q * np.array([1, -1, -1, -1]) / np.sqrt(q @ q)
        a = turned(back, np.array([[np.cos(nu), np.sin(nu), 0]]))[0]
        g = orbit.strength(nu) if gravity else 0.0

        def field(rho: Array) -> Array:
            return np.asarray(g * (3 * np.outer(rho @ a, a) - rho))

        du = accelerations(robot, w, angles, rates, field, loads(t), tau(t, angles, rates), locked)
        dq = 0.5 * np.array([-q[1:] @ w, *(q[0] * w + cross(q[1:], w))])
        return np.concatenate((dq, du[:3], rates, du[3:]))

    found = solve_ivp(rate, (times[0], times[-1]), start, "DOP853", times, rtol=1e-12, atol=1e-13)
    return np.asarray(found.y.T)
