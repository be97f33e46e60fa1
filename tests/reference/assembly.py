# SPDX-License-Identifier: BSD-2-Clause
"""Two docked bodies in prescribed relative motion, from point masses alone: positions, their
derivatives and the angular momentum about the common centre of mass.

No inertia of an assembly, no parallel axes, no gyroscopic terms, no gravity-gradient formula: each
body is six point masses on its principal axes, and the momentum of twelve points is integrated.
Everything is in axes of body 0 (S), O is the orbital frame (x along flight, z to the Earth), N its
axes at t = 0. Leading axes of arrays are broadcast: one instant or a whole history.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.integrate import solve_ivp

from .attitude import Array, cross, dcm, rate

J0 = ((9.0e4, 2.0e3, -6.0e3), (2.0e3, 5.4e5, 1.0e3), (-6.0e3, 1.0e3, 5.8e5))
J1 = ((6.0e4, -1.0e3, 2.0e3), (-1.0e3, 3.6e5, 0.0), (2.0e3, 0.0, 3.8e5))
EARTH, RADIUS = 3.9860044e14, 6378137.0
TINY = 1e-30


def six_points(mass: float, J: Array) -> Array:
    """Positions (6, 3) about the centre of mass of equal masses with that inertia."""
    moments, axes = np.linalg.eigh(np.array(J))
    reach = np.sqrt(3 * (moments.sum() / 2 - moments) / mass)
    return np.concatenate((reach * axes, -reach * axes), axis=1).T


def box(size: tuple[float, float, float]) -> list[tuple[Array, Array, float]]:
    """Six faces: outward normal, centre, area."""
    faces = []
    for axis in range(3):
        area = np.prod(size) / size[axis]
        for side in (1.0, -1.0):
            normal = side * np.eye(3)[axis]
            faces.append((normal, normal * size[axis] / 2, area))
    return faces


@dataclass(frozen=True)
class Facet:
    """A flat piece of surface on body 0 or 1; normal and centre (from the centre of mass of that
    body) in its axes; an array takes the stream from both sides.
    """

    body: int
    normal: Array
    centre: Array
    area: float
    two_sided: bool = False


def surfaces() -> tuple[Facet, ...]:
    """The two boxes and their solar arrays."""
    faces = [Facet(0, *face) for face in box((16, 4, 4))]
    faces += [Facet(1, *face) for face in box((14, 4, 4))]
    for y in (12.0, -12.0):
        faces.append(Facet(0, np.array((0.6, 0, 0.8)), np.array((-2, y, 0)), 60.0, True))
    faces.append(Facet(1, np.array((0, 0.6, 0.8)), np.array((-4.0, 0, -6)), 50.0, True))
    return tuple(faces)


def turned(v: Array, angle: Array) -> Array:
    """Vectors (..., 3) turned about z by angles that broadcast against their leading axes."""
    c, s = np.cos(angle), np.sin(angle)
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    return np.stack(np.broadcast_arrays(c * x - s * y, s * x + c * y, z + 0 * c), axis=-1)


def momentum(m: Array, x: Array, v: Array) -> Array:
    """Sum of m x cross v over the points, (..., 3): antisymmetric part of the sum of m x v'."""
    M = np.swapaxes(x * m[..., None], -1, -2) @ v
    return np.stack(
        (M[..., 1, 2] - M[..., 2, 1], M[..., 2, 0] - M[..., 0, 2], M[..., 0, 1] - M[..., 1, 0]), -1
    )


@dataclass(frozen=True)
class Assembly:
    """Parameters of the scenario; swing: begin [s], duration [s], final angle [rad]."""

    mass: tuple[float, float] = (24000.0, 20000.0)
    J0: tuple[tuple[float, ...], ...] = J0
    J1: tuple[tuple[float, ...], ...] = J1
    node: tuple[float, ...] = (9.5, 0.0, 0.10)
    arm: tuple[float, ...] = (8.5, 0.0, 0.05)
    swing: tuple[float, float, float] = (600.0, 3000.0, np.pi / 2)
    mu: float = EARTH
    R_C: float = RADIUS + 390e3
    rho: float = 3.0e-12
    C_D: float = 2.2
    facets: tuple[Facet, ...] = field(default_factory=surfaces)
    gravity: float = 1.0
    air: float = 1.0

    @property
    def n(self) -> float:
        """Orbital rate [rad/s]."""
        return float(np.sqrt(self.mu / self.R_C**3))

    @cached_property
    def masses(self) -> Array:
        return np.repeat(np.array(self.mass) / 6, 6)

    @cached_property
    def bodies(self) -> tuple[Array, Array]:
        """Points of body 0 from its centre of mass, of body 1 from the node, each in its axes."""
        return six_points(self.mass[0], self.J0), six_points(self.mass[1], self.J1) + self.arm

    def swing_angle(self, t: Array) -> tuple[Array, Array, Array]:
        """Angle of the module with rate and acceleration: polynomial of least order at rest at both
        ends, alpha' proportional to s^2 (1 - s)^2.
        """
        begin, duration, _ = self.swing
        s = np.minimum(np.maximum((t - begin) / duration, 0.0), 1.0)
        value, first, second = (np.polyval(p, s) for p in self.polynomials)
        return value, first / duration, second / duration**2

    @cached_property
    def polynomials(self) -> tuple[Array, Array, Array]:
        rest = np.array((1.0, -2, 1, 0, 0))
        whole = np.polyint(rest)
        return tuple(self.swing[2] / whole.sum() * p for p in (whole, rest, np.polyder(rest)))

    def points(self, alpha: Array) -> Array:
        """Positions (..., 12, 3) from the common centre of mass at swing angles (...), which may be
        complex.
        """
        angle = np.asarray(alpha)[..., None]
        base, module = self.bodies
        x = np.concatenate((base + 0 * angle[..., None], self.node + turned(module, angle)), -2)
        return x - (self.masses @ x / sum(self.mass))[..., None, :]

    def moved(self, alpha: Array) -> tuple[Array, Array]:
        """Points and their derivative by the swing angle (complex step)."""
        x = self.points(alpha + 1j * TINY)
        return x.real, x.imag / TINY

    def inertia(self, x: Array) -> Array:
        """Sum m (x.x 1 - x x'), (..., 3, 3)."""
        spread = np.swapaxes(x * self.masses[:, None], -1, -2) @ x
        return np.trace(spread, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - spread

    def swing_momentum(self, alpha: Array, dalpha: Array) -> Array:
        """Momentum of the motion relative to body 0."""
        x, by_angle = self.moved(alpha)
        return momentum(self.masses, x, by_angle) * np.asarray(dalpha)[..., None]

    def tide(self, C_SO: Array, x: Array) -> Array:
        """Moment of the tidal acceleration n^2 (3 (x.a) a - x) of every point, a: direction from
        the Earth.
        """
        a = -C_SO[..., :, 2]
        field = 3 * (x @ a[..., None]) * a[..., None, :] - x
        return self.gravity * self.n**2 * momentum(self.masses, x, field)

    def drag(self, C_SO: Array, alpha: Array) -> Array:
        """Moment of the drag of all facets about the common centre of mass; the gas passes the
        assembly along -x of O.
        """
        wind = -C_SO[..., :, 0]
        pressure = 0.5 * self.rho * self.mu / self.R_C * self.C_D
        share = self.mass[1] / sum(self.mass)
        hub = np.array(self.node) + turned(np.array(self.arm), alpha)
        wide = np.asarray(alpha)[..., None]
        normal, place, area, hinged, two_sided = self.skin
        normal = np.where(hinged, turned(normal, wide), normal)
        place = np.where(hinged, hub[..., None, :] + turned(place, wide), place)
        facing = -(normal @ wind[..., None])[..., 0]
        seen = area * np.where(two_sided, np.abs(facing), np.maximum(0.0, facing))
        lever = place - share * hub[..., None, :]
        return self.air * pressure * momentum(seen, lever, wind[..., None, :] + 0 * lever)

    @cached_property
    def skin(self) -> tuple[Array, ...]:
        """Normals, centres (facets, 3), areas, whether on body 1 (facets, 1), whether an array."""
        rows = [(f.normal, f.centre, f.area, [f.body == 1], f.two_sided) for f in self.facets]
        normal, place, area, hinged, two_sided = (np.array(c) for c in zip(*rows, strict=True))
        return normal.astype(float), place.astype(float), area, hinged, two_sided

    def torque(self, C_SO: Array, alpha: Array) -> Array:
        """Gravity gradient and drag, S axes [N m]."""
        return self.tide(C_SO, self.points(alpha)) + self.drag(C_SO, alpha)


def orbital_axes(n: float, t: Array) -> Array:
    """C_ON (..., 3, 3): x along flight and z to the Earth at t = 0 are the axes of N."""
    c, s = np.cos(n * np.asarray(t)), np.sin(n * np.asarray(t))
    o, i = 0 * c, 0 * c + 1
    return np.stack(
        (np.stack((c, o, s), -1), np.stack((o, i, o), -1), np.stack((-s, o, c), -1)), -2
    )


def rate_of(a: Assembly, t: float, q_SN: Array, H_N: Array, h_S: Array) -> Array:
    """omega_SN_S that the total momentum leaves for the assembly."""
    alpha, dalpha, _ = a.swing_angle(t)
    x, by_angle = a.moved(alpha)
    own = dcm(q_SN) @ H_N - h_S - momentum(a.masses, x, by_angle * dalpha)
    return np.linalg.solve(a.inertia(x), own)


def total_momentum(a: Assembly, t: float, q_SN: Array, omega: Array, h_S: Array) -> Array:
    """H_N of points that move with x' + omega x x, and of the gyros."""
    alpha, dalpha, _ = a.swing_angle(t)
    x, by_angle = a.moved(alpha)
    return dcm(q_SN).T @ (momentum(a.masses, x, by_angle * dalpha + cross(omega, x.T).T) + h_S)


def simulate(
    a: Assembly, q_SN: Array, H_N: Array, h_S: Callable[[float], Array], t0: float, t1: float
) -> tuple[Array, Array]:
    """Attitude and total momentum (N axes) at t1 for a history of the momentum of the gyros."""

    def f(t: float, y: Array) -> Array:
        omega = rate_of(a, t, y[:4], y[4:], h_S(t))
        C_SN = dcm(y[:4])
        tau = a.torque(C_SN @ orbital_axes(a.n, t).T, a.swing_angle(t)[0])
        return np.concatenate((rate(y[:4], omega), C_SN.T @ tau))

    atol = np.array([1e-15] * 4 + [1e-9] * 3)
    found = solve_ivp(
        f,
        (t0, t1),
        np.concatenate((q_SN, H_N)),
        "DOP853",
        rtol=1e-13,
        atol=atol,
        first_step=t1 - t0,
    )
    q = found.y[:4, -1]
    return q / np.sqrt(q @ q), found.y[4:, -1]
