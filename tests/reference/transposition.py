# SPDX-License-Identifier: BSD-2-Clause
"""Transposition without saturation: planner, tracking law, steering of the gyros and the sampled
closed loop, on the point masses of `assembly`.

The angular velocity of the reference is the antisymmetric part of -dC/dt C' of a matrix that is
differentiated by Leibniz' rule; the tracking law uses the moment of the accelerations of twelve
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
from .attitude import Array, conjugate, cross, dcm, multiply, positive

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
    return moving(n, t, tuple(curve(t, k) for k in range(3)))


def moving(n: float, t: Array, vector: tuple[Array, Array, Array]) -> Motion:
    """Motion of which the vector part of the quaternion and two derivatives are known."""
    scalar = scalar_part(*vector)
    quaternion = [
        np.concatenate((s[..., None], v), -1) for s, v in zip(scalar, vector, strict=True)
    ]
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
        motion, own = self.own(nodes, t)
        tau_N = self.torque_N(motion.C, t)
        return left(motion, own, self.h_0, np.diff(t)[:, None] * (tau_N[1:] + tau_N[:-1]) / 2)

    def predicted(self, nodes: Array, period: float = 1.0, points: int = 3) -> Array:
        """The same at multiples of a period, the torques integrated by Gauss' rule in every
        period.
        """
        t = np.linspace(0.0, self.p.stop, round(self.p.stop / period) + 1)
        roots, weights = np.polynomial.legendre.leggauss(points)
        between = (t[:-1, None] + period / 2 * (1 + roots)).ravel()
        C = reference(self.a.n, self.curve(nodes), between).C
        tau_N = self.torque_N(C, between).reshape(-1, points, 3)
        gain = period / 2 * np.einsum("g,kgi->ki", weights, tau_N)
        return left(*self.own(nodes, t), self.h_0, gain)

    def own(self, nodes: Array, t: Array) -> tuple[Motion, Array]:
        """Reference, and momentum of the points that move with it, S axes."""
        alpha, dalpha, _ = self.a.swing_angle(t)
        motion = reference(self.a.n, self.curve(nodes), t)
        x, by_angle = self.a.moved(alpha)
        turning = cross(motion.omega[:, None, :], x)
        return motion, momentum(self.a.masses, x, by_angle * dalpha[:, None, None] + turning)

    def torque_N(self, C_SN: Array, t: Array) -> Array:
        C_SO = C_SN @ np.swapaxes(orbital_axes(self.a.n, t), -1, -2)
        return np.einsum("kij,ki->kj", C_SN, self.a.torque(C_SO, self.a.swing_angle(t)[0]))

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
        peak = np.linalg.norm(self.history(self.whole(free)), axis=1).max()
        count = len(free) // 3
        second = (
            np.diff(np.eye(count + 2), 2, axis=0)[:, 1:-1] / (self.p.stop / len(self.t[1:])) ** 2
        )
        rough = np.sqrt(self.p.smoothing) * np.kron(second, np.eye(3))
        size = np.linalg.norm(h.reshape(-1, 3), axis=1)
        root = np.repeat((size / peak) ** (self.p.weight_power / 2), 3)
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


def left(motion: Motion, own: Array, h_0: Array, gain: Array) -> Array:
    """What the total, which gains that much (N axes) between the instants, leaves for the gyros, S
    axes.
    """
    gained = np.concatenate((np.zeros((1, 3)), np.cumsum(gain, 0)))
    H_N = motion.C[0].T @ (own[0] + h_0) + gained
    return np.einsum("kij,kj->ki", motion.C, H_N) - own


# ---- tracking


class Command(NamedTuple):
    hdot: Array
    q_e: Array
    d_omega: Array


class Aim(NamedTuple):
    """Reference at a sample; h, hdot: momentum of the plan in its axes, and its mean rate until the
    next sample, if the law is to use it.
    """

    motion: Motion
    h: Array | None = None
    hdot: Array | None = None


@dataclass(frozen=True)
class Guide:
    """The planned history as the law sees it; h: at multiples of the period, if it is to be
    used.
    """

    n: float
    curve: CubicSpline
    period: float = 1.0
    h: Array | None = None

    def aim(self, t: float) -> Aim:
        motion, k = reference(self.n, self.curve, t), round(t / self.period)
        if self.h is None or k + 1 >= len(self.h):
            return Aim(motion)
        return Aim(motion, self.h[k], (self.h[k + 1] - self.h[k]) / self.period)


@dataclass(frozen=True)
class Tracking:
    """The corrected law; a: the assembly as the flight software knows it."""

    a: Assembly = field(default_factory=Assembly)
    k1: float = 0.036
    k2: float = 8e-4

    def command(self, t: float, q_SN: Array, omega: Array, h_S: Array, ref: Aim) -> Command:
        """What the gyros must take up for the wanted angular acceleration, and what the plan takes
        up on average until the next sample more than at the instant.
        """
        C_SN = dcm(q_SN)
        C_e = C_SN @ ref.motion.C.T
        q_e = positive(multiply(conjugate(ref.motion.q_SO), self.relative(t, q_SN)))
        d_omega = omega - C_e @ ref.motion.omega
        required = C_e @ ref.motion.alpha - cross(d_omega, C_e @ ref.motion.omega)
        required = required - self.k1 * d_omega - self.k2 * q_e[1:]
        hdot = self.taken(t, C_SN, omega, required, h_S)
        if ref.hdot is not None:
            m = ref.motion
            hdot = hdot + C_e @ (ref.hdot - self.taken(t, m.C, m.omega, m.alpha, ref.h))
        return Command(hdot, q_e, d_omega)

    def relative(self, t: float, q_SN: Array) -> Array:
        return multiply(conjugate(orbital_attitude(self.a.n, t)), q_SN)

    def taken(self, t: float, C_SN: Array, w: Array, dw: Array, h_S: Array) -> Array:
        """Torques less the moment of the accelerations of all points, less omega x h."""
        C_SO = C_SN @ orbital_axes(self.a.n, t).T
        tau = self.a.torque(C_SO, self.a.swing_angle(t)[0])
        return tau - self.moment(t, w, dw) - cross(w, h_S)

    def moment(self, t: float, w: Array, dw: Array) -> Array:
        """Sum of m x cross acceleration of the points."""
        alpha, dalpha, ddalpha = self.a.swing_angle(t)
        x, first = self.a.moved(alpha)
        v = first * dalpha
        relative = first * ddalpha + self.curvature(alpha) * dalpha**2
        inertial = relative + 2 * cross(w, v) + cross(dw, x) + cross(w, cross(w, x))
        return momentum(self.a.masses, x, inertial)

    def curvature(self, alpha: float) -> Array:
        """Second derivative of the points by the angle: the part of a position that turns, inwards.
        Half a turn further on it is the opposite.
        """
        return (self.a.points(alpha + np.pi) - self.a.points(alpha)) / 2


@dataclass(frozen=True)
class Printed(Tracking):
    """The law as printed; k2 [N m]."""

    k2: float = 3000.0

    def command(self, t: float, q_SN: Array, omega: Array, h_S: Array, ref: Aim) -> Command:
        plain = super().command(t, q_SN, omega, h_S, ref)
        damping = self.inertia(t) @ (omega - np.array((0, -self.a.n, 0)))
        eps = positive(self.relative(t, q_SN))[1:]
        return plain._replace(
            hdot=self.k1 * damping + self.k2 * (eps - positive(ref.motion.q_SO)[1:])
        )

    def inertia(self, t: float) -> Array:
        return self.a.inertia(self.a.points(self.a.swing_angle(t)[0]))


def orbital_attitude(n: float, t: float) -> Array:
    """q_ON: O turns against its y axis."""
    return np.array((np.cos(n * t / 2), 0.0, -np.sin(n * t / 2), 0.0))


# ---- the patent's own discretisation


@dataclass(frozen=True)
class PatentPlanner(Planner):
    """Forward and second differences of the nodes, explicit Euler for the momentum; printed: the
    second difference with the signs of the patent.
    """

    printed: bool = False

    def history(self, nodes: Array, grid: Array | None = None) -> Array:
        dt, law = self.t[1], Tracking(self.a)
        before, after = np.vstack((nodes[:1], nodes[:-2])), nodes[1:]
        now = nodes[:-1]
        bend = after + 2 * now - before if self.printed else after - 2 * now + before
        motion = moving(self.a.n, self.t[:-1], (now, (after - now) / dt, bend / dt**2))
        h = [np.array(self.h_0)]
        for t, C, w, dw in zip(self.t, motion.C, motion.omega, motion.alpha, strict=False):
            h.append(h[-1] + dt * law.taken(t, C, w, dw, h[-1]))
        return np.array(h)

    def at_nodes(self, free: Array) -> Array:
        return self.history(self.whole(free))[1:].ravel()


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

    def singularity(self, d: Array) -> Array:
        """sqrt(det A A'): 0 where a direction of torque is missing; d may be complex."""
        A = self.directions(d)
        return np.sqrt(np.linalg.det(A @ A.T))

    def gradient(self, d: Array) -> Array:
        return np.array([self.singularity(d + 1j * TINY * e).imag / TINY for e in np.eye(6)])

    def steer(self, t: float, d: Array, hdot: Array) -> Array:
        """Gimbal rates for a torque: damped inverse with dither, motion without torque uphill."""
        A, m = self.directions(d), self.singularity(d)
        e = self.dither * np.sin(0.5 * np.pi * t + np.array((0, np.pi / 2, np.pi)))
        E = np.eye(3) + np.array(((0, e[2], e[1]), (e[2], 0, e[0]), (e[1], e[0], 0)))
        rates = A.T @ np.linalg.solve(A @ A.T + self.damping * np.exp(-m) * E, hdot / self.h_w)
        idle = np.eye(6) - np.linalg.pinv(A, rcond=1e-3) @ A
        rates = rates + self.k_null * idle @ self.gradient(d)
        return rates / max(1.0, np.abs(rates).max() / self.fastest)


# ---- closed loop


@dataclass(frozen=True)
class Loop:
    """World, flight software and its sample period; cluster None: ideal devices that deliver the
    command.
    """

    world: Assembly = field(default_factory=Assembly)
    law: Tracking = field(default_factory=Tracking)
    cluster: Cluster | None = None
    period: float = 1.0


class Recording(NamedTuple):
    """Instant of a run: attitude, total momentum (N axes), momentum of ideal devices, gimbal
    angles.
    """

    t: float
    q_SN: Array
    H_N: Array
    h_S: Array
    gimbals: Array


def at_rest(loop: Loop) -> Recording:
    """Flight attitude and the rate of the orbit at t = 0."""
    q, omega = np.array((1.0, 0, 0, 0)), np.array((0, -loop.world.n, 0))
    gimbals = np.radians(loop.cluster.start) if loop.cluster else np.zeros(6)
    h = loop.cluster.momentum(gimbals) if loop.cluster else np.zeros(3)
    H = assembly.total_momentum(loop.world, 0.0, q, omega, h)
    return Recording(0.0, q, H, h, gimbals)


def coasted(loop: Loop, x: Recording, hdot: Array, rates: Array) -> Recording:
    """One sample later, with the rate of the momentum or the gimbal rates held."""
    cluster, t1 = loop.cluster, x.t + loop.period

    def gimbals(t: float) -> Array:
        return x.gimbals + (t - x.t) * rates

    def held(t: float) -> Array:
        return cluster.momentum(gimbals(t)) if cluster else x.h_S + (t - x.t) * hdot

    q, H = assembly.simulate(loop.world, x.q_SN, x.H_N, held, x.t, t1)
    return Recording(t1, q, H, held(t1), gimbals(t1))


def simulate(loop: Loop, guide: Guide, stop: float, x: Recording | None = None) -> dict[str, Array]:
    """Rows at the samples up to a time: states at t_k, and the commands that were computed
    there.
    """
    x = x or at_rest(loop)
    rows: dict[str, list[Array]] = {}
    for _ in range(round((stop - x.t) / loop.period) + 1):
        omega = assembly.rate_of(loop.world, x.t, x.q_SN, x.H_N, x.h_S)
        command = loop.law.command(x.t, x.q_SN, omega, x.h_S, guide.aim(x.t))
        steer = loop.cluster.steer if loop.cluster else lambda *_: np.zeros(6)
        rates = steer(x.t, x.gimbals, command.hdot)
        row = {**x._asdict(), **command._asdict(), "omega": omega, "rates": rates}
        for name, value in row.items():
            rows.setdefault(name, []).append(value)
        x = coasted(loop, x, command.hdot, rates)
    return {name: np.array(values) for name, values in rows.items()}


def inexact(a: Assembly, inertia: float = 1.03, density: float = 1.5) -> Assembly:
    """Masses and inertias, and the density of the air, off by these factors."""
    scaled = {
        name: tuple(map(tuple, inertia * np.array(getattr(a, name)))) for name in ("J0", "J1")
    }
    mass = (inertia * a.mass[0], inertia * a.mass[1])
    return replace(a, mass=mass, rho=density * a.rho, **scaled)
