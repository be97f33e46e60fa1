# SPDX-License-Identifier: BSD-2-Clause
"""The docked assembly as point masses: what positions and velocities say about inertia, momentum
and torques, without the formulas of the models under test.

Attitudes are rotation matrices. C_SO maps components in the orbital axes of the patent (X along the
flight, Z to the Earth) to base axes. SI units, radians.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from tests.reference.attitude import cross

MU, R_C = 3.9860044e14, 6768137.0
N_ORBIT = np.sqrt(MU / R_C**3)
Q_FLIGHT = np.array([0.5, -0.5, -0.5, 0.5])
"""q_SH of the flight attitude: X along track, Y against the orbit normal, Z down."""

J0 = np.array([[9.0e4, 2.0e3, -6.0e3], [2.0e3, 5.4e5, 1.0e3], [-6.0e3, 1.0e3, 5.8e5]])
J1 = np.array([[6.0e4, -1.0e3, 2.0e3], [-1.0e3, 3.6e5, 0], [2.0e3, 0, 3.8e5]])
PANELS = [  # body, area, centre, normal
    (0, 60, (-2, 12, 0), (0.6, 0, 0.8)),
    (0, 60, (-2, -12, 0), (0.6, 0, 0.8)),
    (1, 50, (-4, 0, -6), (0, 0.6, 0.8)),
]


def points_of(mass, J):
    """Six equal masses with this mass and inertia: masses, positions."""
    moments, axes = np.linalg.eigh(J)
    squares = (moments.sum() / 2 - moments) / mass * 3  # m/6 * 2 * d^2 = (tr/2 - J_k)
    offsets = np.sqrt(squares) * axes
    return np.full(6, mass / 6), np.concatenate((offsets.T, -offsets.T))


@dataclass
class Assembly:
    m0: float = 24000.0
    m1: float = 20000.0
    J0: np.ndarray = field(default_factory=lambda: J0)
    J1: np.ndarray = field(default_factory=lambda: J1)
    hinge: tuple = (9.5, 0, 0.10)
    module: tuple = (8.5, 0, 0.05)
    mu: float = MU
    rho: float = 3.0e-12

    def parameters(self):
        names = ("m0", "m1", "J0", "J1", "hinge", "module", "mu", "rho")
        return {name: getattr(self, name) for name in names}

    def cloud(self, angle):
        """Masses, positions from the common centre of mass in base axes, and which body."""
        A = Rotation.from_rotvec((0, 0, angle)).as_matrix()
        (ma, ra), (mb, rb) = points_of(self.m0, self.J0), points_of(self.m1, self.J1)
        module = np.array(self.hinge) + (rb + self.module) @ A.T
        m, r = np.concatenate((ma, mb)), np.concatenate((ra, module))
        return m, r - m @ r / m.sum()

    def inertia(self, angle):
        m, r = self.cloud(angle)
        return np.einsum("k,ki,kj", m, r, r).trace() * np.eye(3) - np.einsum("k,ki,kj", m, r, r)

    def momentum(self, omega, angle, rate):
        """About the centre of mass, base axes, without gyros; the motion of the arm by central
        differences of positions.
        """
        d = 1e-5
        m, r = self.cloud(angle)
        v = cross(omega, r)
        v = v + rate * (self.cloud(angle + d)[1] - self.cloud(angle - d)[1]) / (2 * d)
        return (m[:, None] * np.cross(r, v)).sum(axis=0)

    def gravity_torque(self, C_SO, angle):
        """Sum of r x f over the points; f: first-order difference of gravity to that at the centre
        of mass.
        """
        m, r = self.cloud(angle)
        up = C_SO @ (0, 0, -1)
        f = -self.mu / R_C**3 * m[:, None] * (r - 3 * np.outer(r @ up, up))
        return np.cross(r, f).sum(axis=0)

    def aero_torque(self, C_SO, angle):
        q = self.rho * self.mu / R_C / 2 * 2.2
        flow, total = C_SO @ (-1, 0, 0), np.zeros(3)
        A = Rotation.from_rotvec((0, 0, angle)).as_matrix()
        offset = np.array(self.hinge) + A @ self.module
        cm = self.m1 / (self.m0 + self.m1) * offset
        for body, area, centre, normal in faces():
            turn, origin = (A, offset) if body else (np.eye(3), np.zeros(3))
            facing = -(turn @ normal) @ flow
            exposed = area[0] * (max(0, facing) if area[1] else abs(facing))
            total += cross(origin + turn @ centre - cm, q * exposed * flow)
        return total

    def torque(self, C_SO, angle):
        return self.gravity_torque(C_SO, angle) + self.aero_torque(C_SO, angle)


def faces():
    """(body, (area, one-sided), centre, normal) of the boxes and panels."""
    for body, edges in ((0, (16, 4, 4)), (1, (14, 4, 4))):
        for axis in range(3):
            for side in (1, -1):
                n = side * np.eye(3)[axis]
                yield body, (np.prod(np.delete(edges, axis)), True), n * edges[axis] / 2, n
    for body, area, centre, normal in PANELS:
        yield body, (area, False), np.array(centre, float), np.array(normal, float)


def C_of(q):
    """C_BN of q_BN, scalar first."""
    return Rotation.from_quat(np.roll(q, -1)).as_matrix().T


C_HO = np.array([[0, 0, -1], [1, 0, 0], [0, -1, 0]])
"""Columns: X, Y, Z of the orbital axes in H: along track, against the normal, down."""


def C_SO_of(q_SH):
    return C_of(q_SH) @ C_HO


def q_SH_of(eps):
    """Flight attitude, then the rotation with this vector part, as scipy composes them."""
    eps = np.asarray(eps)
    turn = Rotation.from_quat([*eps, np.sqrt(1 - eps @ eps)])  # S components to O components
    return np.roll((Rotation.from_matrix(C_HO) * turn).as_quat(), 1)


def quintic(t, start=600.0, duration=3000.0, final=np.pi / 2):
    """Angle, rate, acceleration of the arm."""
    p = np.polynomial.Polynomial([0, 0, 0, 10, -15, 6])
    u = np.clip((t - start) / duration, 0, 1)
    return final * p(u), final / duration * p.deriv()(u), final / duration**2 * p.deriv(2)(u)
