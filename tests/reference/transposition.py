"""Transposition without saturation: planner, tracking law, steering of the gyros and the sampled
closed loop, on the point masses of `assembly`.

The angular velocity of the reference is the antisymmetric part of -dC/dt C' of a matrix that is
differentiated by Leibniz' rule; the tracking law asks for the moment of the accelerations of twelve
points; the gradient of the singularity measure is a complex step.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from . import assembly
from .assembly import TINY, Assembly, momentum, orbital_axes
from .attitude import Array, conjugate, dcm, multiply, positive

# ---- planner


@dataclass(frozen=True)
class Planning:
    """Window [s], nodes, limits; weight_power 0: all instants weigh the same."""

    stop: float = 5400.0
    intervals: int = 90
    fine: int = 4
    H_sat: float = 1500.0
    margin: float = 0.9
    step: float = 0.5
    smoothing: float = 1e20
    delta: float = 1e-5
    weight_power: float = 0.0
    largest: int = 30
    limit: float = np.radians(35.0)


class Plan(NamedTuple):
    """Nodes (N + 1, 3), peak of |h| and largest rotation at each history that was tried."""

    nodes: Array
    peaks: list[float]
    rotations: list[float]

    @property
    def iterations(self) -> int:
        return len(self.peaks) - 1


class Motion(NamedTuple):
    """C_SN with its rate omega and acceleration, S axes; leading axis: instants."""

    C: Array
    omega: Array
    alpha: Array
    q_SO: Array


def vees(M: Array) -> Array:
    return 0.5 * np.stack(
        (M[..., 2, 1] - M[..., 1, 2], M[..., 0, 2] - M[..., 2, 0], M[..., 1, 0] - M[..., 0, 1]), -1
    )


def orbit_jet(n: float, t: Array) -> tuple[Array, Array, Array]:
    """C_ON and two derivatives: cos' = -n sin and so on is a quarter turn ahead."""
    quarter = np.pi / 2 / n
    middle = np.diag((0.0, 1.0, 0.0))
    C, D, E = (orbital_axes(n, t + k * quarter) for k in range(3))
    return C, n * (D - middle), n**2 * (E - middle)


def product(a: tuple[Array, ...], b: tuple[Array, ...]) -> tuple[Array, Array, Array]:
    return (a[0] @ b[0], a[1] @ b[0] + a[0] @ b[1], a[2] @ b[0] + 2 * a[1] @ b[1] + a[0] @ b[2])


def dcm_jet(q: Array, dq: Array, ddq: Array) -> tuple[Array, Array, Array]:
    """C(q) is quadratic in q: C = B(q, q) and its derivatives B(q, q'), B(q, q'') + B(q', q')."""

    def half(p: Array, r: Array) -> Array:
        """Columns e_k of conj(p) (x) e_k (x) r."""
        return np.stack([multiply4(multiply4(conj4(p), unit), r)[..., 1:] for unit in UNITS], -1)

    C = half(q, q)
    D = half(dq, q) + half(q, dq)
    return C, D, half(ddq, q) + 2 * half(dq, dq) + half(q, ddq)


UNITS = np.eye(4)[1:]


def conj4(q: Array) -> Array:
    return q * np.array((1.0, -1, -1, -1))


def multiply4(p: Array, q: Array) -> Array:
    return np.moveaxis(multiply(np.moveaxis(p, -1, 0), np.moveaxis(q, -1, 0)), 0, -1)


def scalar_part(e: Array, de: Array, dde: Array) -> tuple[Array, Array, Array]:
    """sqrt(1 - e.e) and its derivatives from eta^2 + e.e = 1."""
    eta = np.sqrt(1 - np.sum(e * e, -1))
    deta = -np.sum(e * de, -1) / eta
    return eta, deta, -(np.sum(de * de + e * dde, -1) + deta**2) / eta


def reference(n: float, curve: CubicSpline, t: Array) -> Motion:
    """Attitude history whose vector part relative to the orbital frame is the curve."""
    t = np.asarray(t, float)
    vector = [curve(t, k) for k in range(3)]
    scalar = scalar_part(*vector)
    quaternion = [np.concatenate((s[..., None], v), -1) for s, v in zip(scalar, vector, strict=True)]
    C, D, E = product(dcm_jet(*quaternion), orbit_jet(n, t))
    transposed = np.swapaxes(C, -1, -2)
    alpha = vees(-E @ transposed - D @ np.swapaxes(D, -1, -2))
    return Motion(C, vees(-D @ transposed), alpha, quaternion[0])


@dataclass(frozen=True)
class Planner:
    """The assembly as the planner knows it, momentum of the gyros at the start in S axes."""

    a: Assembly = field(default_factory=Assembly)
    p: Planning = field(default_factory=Planning)
    h_0: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @cached_property
    def t(self) -> Array:
        return np.linspace(0.0, self.p.stop, self.p.intervals + 1)

    @cached_property
    def grid(self) -> Array:
        return np.linspace(0.0, self.p.stop, self.p.intervals * self.p.fine + 1)

    def curve(self, nodes: Array) -> CubicSpline:
        return CubicSpline(self.t, nodes, bc_type="clamped")

    def history(self, nodes: Array, grid: Array | None = None) -> Array:
        """Momentum of the gyros, S axes, at the instants of the grid: what the total, driven by the
        torques (trapezoidal rule), does not leave to the motion of the points.
        """
        t = self.grid if grid is None else grid
        alpha, dalpha, _ = self.a.swing_angle(t)
        motion = reference(self.a.n, self.curve(nodes), t)
        x, by_angle = self.a.moved(alpha)
        turning = np.cross(motion.omega[:, None, :], x)
        own = momentum(self.a.masses, x, by_angle * dalpha[:, None, None] + turning)
        C_SO = motion.C @ np.swapaxes(orbital_axes(self.a.n, t), -1, -2)
        tau_N = np.einsum("kij,ki->kj", motion.C, self.a.torque(C_SO, alpha))
        gain = np.diff(t)[:, None] * (tau_N[1:] + tau_N[:-1]) / 2
        H_N = motion.C[0].T @ (own[0] + self.h_0) + np.concatenate(
            (np.zeros((1, 3)), np.cumsum(gain, 0))
        )
        return np.einsum("kij,kj->ki", motion.C, H_N) - own

    def whole(self, free: Array) -> Array:
        """Nodes 0 and N - 1, N are at zero."""
        return np.concatenate((np.zeros((1, 3)), free.reshape(-1, 3), np.zeros((2, 3))))

    def at_nodes(self, free: Array) -> Array:
        """h_1 ... h_N in one column."""
        return self.history(self.whole(free))[self.p.fine :: self.p.fine].ravel()

    def jacobian(self, free: Array) -> Array:
        columns = []
        for k in range(len(free)):
            d = np.zeros(len(free))
            d[k] = self.p.delta
            columns.append((self.at_nodes(free + d) - self.at_nodes(free - d)) / (2 * d[k]))
        return np.array(columns).T

    def improved(self, free: Array) -> Array:
        """A step of regularised least squares, as an overdetermined system instead of its normal
        equations: rows of the weighted history, rows of the second differences of the step.
        """
        h, J = self.at_nodes(free), self.jacobian(free)
        count = len(free) // 3
        second = np.diff(np.eye(count + 2), 2, axis=0)[:, 1:-1] / (self.p.stop / len(self.t[1:])) ** 2
        rough = np.sqrt(self.p.smoothing) * np.kron(second, np.eye(3))
        size = np.linalg.norm(h.reshape(-1, 3), axis=1)
        root = np.repeat((size / size.max()) ** (self.p.weight_power / 2), 3)
        A = np.vstack((root[:, None] * J, rough))
        b = np.concatenate((root * h, np.zeros(len(rough))))
        return free - self.p.step * np.linalg.lstsq(A, b, rcond=None)[0]

    def plan(self) -> Plan:
        """Improve until the history stays below the margin, or a limit is reached."""
        free = np.zeros(3 * (self.p.intervals - 2))
        peaks, rotations = [], []
        while True:
            nodes = self.whole(free)
            peaks.append(np.linalg.norm(self.history(nodes), axis=1).max())
            sizes = np.linalg.norm(self.curve(nodes)(self.grid), axis=1)
            rotations.append(2 * np.arcsin(sizes.max()))
            if peaks[-1] < self.p.margin * self.p.H_sat or len(peaks) > self.p.largest:
                return Plan(nodes, peaks, rotations)
            free = self.improved(free)


# ---- tracking


class Command(NamedTuple):
    hdot: Array
    q_e: Array
    d_omega: Array


@dataclass(frozen=True)
class Tracking:
    """The corrected law; a: the assembly as the flight software knows it."""

    a: Assembly = field(default_factory=Assembly)
    k1: float = 0.036
    k2: float = 8e-4

    def command(self, t: float, q_SN: Array, omega: Array, h_S: Array, ref: Motion) -> Command:
        """What the gyros must take up for the wanted angular acceleration: torques less the moment
        of the accelerations of all points, less omega x h.
        """
        a = self.a
        C_SN, C_ON = dcm(q_SN), orbital_axes(a.n, t)
        C_e = C_SN @ ref.C.T
        q_SO = multiply(conjugate(orbital_attitude(a.n, t)), q_SN)
        q_e = positive(multiply(conjugate(ref.q_SO), q_SO))
        d_omega = omega - C_e @ ref.omega
        wanted = C_e @ ref.alpha - np.cross(d_omega, C_e @ ref.omega)
        wanted = wanted - self.k1 * d_omega - self.k2 * q_e[1:]
        alpha, _, _ = a.swing_angle(t)
        tau = a.torque(C_SN @ C_ON.T, alpha)
        return Command(tau - self.moment(t, omega, wanted) - np.cross(omega, h_S), q_e, d_omega)

    def moment(self, t: float, w: Array, dw: Array) -> Array:
        """Sum of m x cross acceleration of the points."""
        alpha, dalpha, ddalpha = self.a.swing_angle(t)
        x, first = self.a.moved(alpha)
        v = first * dalpha
        relative = first * ddalpha + self.curvature(alpha) * dalpha**2
        inertial = relative + 2 * np.cross(w, v) + np.cross(dw, x) + np.cross(w, np.cross(w, x))
        return momentum(self.a.masses, x, inertial)

    def curvature(self, alpha: float) -> Array:
        """Second derivative of the points by the angle: the part of a position that turns, inwards.
        Half a turn further on it is the opposite.
        """
        return (self.a.points(alpha + np.pi) - self.a.points(alpha)) / 2


def orbital_attitude(n: float, t: float) -> Array:
    """q_ON: O turns against its y axis."""
    return np.array((np.cos(n * t / 2), 0.0, -np.sin(n * t / 2), 0.0))


# ---- gyros


@dataclass(frozen=True)
class Cluster:
    """Six single-gimbal gyros on the axes of an icosahedron."""

    h_w: float = 350.0
    start: tuple[float, ...] = (54, -108, 144, 0, -144, 108)
    """[deg]"""
    damping: float = 0.01
    dither: float = 0.01
    k_null: float = 0.02
    fastest: float = 0.1

    @cached_property
    def frames(self) -> tuple[Array, Array, Array]:
        """Gimbal axis, spin axis at angle 0, third axis: columns (3, 6) each."""
        p = 2 * np.pi * np.arange(5) / 5
        b = np.arctan(2.0)
        ring = np.array((np.sin(b) * np.cos(p), np.sin(b) * np.sin(p), np.cos(b) + 0 * p))
        spin = np.array((-np.sin(p), np.cos(p), 0 * p))
        g = np.column_stack(((0, 0, 1.0), ring))
        s = np.column_stack(((1.0, 0, 0), spin))
        return g, s, np.cross(g, s, axis=0)

    def momentum(self, d: Array) -> Array:
        _, s, t = self.frames
        return self.h_w * (s @ np.cos(d) + t @ np.sin(d))

    def directions(self, d: Array) -> Array:
        """Derivatives of the unit momenta by the gimbal angles, (3, 6)."""
        _, s, t = self.frames
        return t * np.cos(d) - s * np.sin(d)

    def measure(self, d: Array) -> Array:
        """sqrt(det A A'): 0 where a direction of torque is missing; d may be complex."""
        A = self.directions(d)
        return np.sqrt(np.linalg.det(A @ A.T))

    def gradient(self, d: Array) -> Array:
        return np.array([self.measure(d + 1j * TINY * e).imag / TINY for e in np.eye(6)])

    def steer(self, t: float, d: Array, hdot: Array) -> Array:
        """Gimbal rates for a torque: damped inverse with dither, motion without torque uphill."""
        A, m = self.directions(d), self.measure(d)
        e = self.dither * np.sin(0.5 * np.pi * t + np.array((0, np.pi / 2, np.pi)))
        E = np.eye(3) + np.array(((0, e[2], e[1]), (e[2], 0, e[0]), (e[1], e[0], 0)))
        rates = A.T @ np.linalg.solve(A @ A.T + self.damping * np.exp(-m) * E, hdot / self.h_w)
        idle = np.eye(6) - np.linalg.pinv(A, rcond=1e-3) @ A
        rates = rates + self.k_null * idle @ self.gradient(d)
        return rates / max(1.0, np.abs(rates).max() / self.fastest)


# ---- closed loop


@dataclass(frozen=True)
class Loop:
    """World, flight software and its sample period; cluster None: ideal devices that give what is
    asked for.
    """

    world: Assembly = field(default_factory=Assembly)
    law: Tracking = field(default_factory=Tracking)
    cluster: Cluster | None = None
    period: float = 1.0


def fly(loop: Loop, curve: CubicSpline, stop: float) -> dict[str, Array]:
    """Rows at the samples: states at t_k, and the commands that were computed there."""
    a, c = loop.world, loop.cluster
    q, h, d = np.array((1.0, 0, 0, 0)), np.zeros(3), np.radians(c.start) if c else np.zeros(6)
    omega = np.array((0, -a.n, 0))
    H = assembly.total_momentum(a, 0.0, q, omega, h)
    rows: dict[str, list[Array]] = {}
    for k in range(round(stop / loop.period) + 1):
        t = k * loop.period
        h = c.momentum(d) if c else h
        omega = assembly.rate_of(a, t, q, H, h)
        command = loop.law.command(t, q, omega, h, reference(loop.law.a.n, curve, t))
        rates = c.steer(t, d, command.hdot) if c else np.zeros(6)
        for name, value in (("q_SN", q), ("omega", omega), ("h", h), ("H_N", H), ("d", d)):
            rows.setdefault(name, []).append(value)
        for name, value in (("hdot", command.hdot), ("q_e", command.q_e), ("rates", rates)):
            rows.setdefault(name, []).append(value)

        def held(time: float, t=t, h=h, d=d, rates=rates, hdot=command.hdot) -> Array:
            return c.momentum(d + (time - t) * rates) if c else h + (time - t) * hdot

        q, H = assembly.fly(a, q, H, held, t, t + loop.period)
        h, d = h + loop.period * command.hdot, d + loop.period * rates
    return {name: np.array(values) for name, values in rows.items()}


def inexact(a: Assembly, inertia: float = 1.03, density: float = 1.5) -> Assembly:
    """Masses and inertias, and the density of the air, off by these factors."""
    scaled = {name: tuple(map(tuple, inertia * np.array(getattr(a, name)))) for name in ("J0", "J1")}
    mass = (inertia * a.mass[0], inertia * a.mass[1])
    return replace(a, mass=mass, rho=density * a.rho, **scaled)
