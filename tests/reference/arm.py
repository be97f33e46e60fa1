# SPDX-License-Identifier: BSD-2-Clause
"""A base with an arm, from point masses alone: no inertia matrices, no composite bodies, no
gyroscopic terms, no gravity-gradient torques.

Every body is six point masses on its principal axes. Their places in base axes are an analytic
function of the joint angles, so derivatives come from its values in the complex plane. D'Alembert's
principle for the velocities of the points gives H and the loads.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from .attitude import cross
from .attitude import rate as quaternion_rate

Array = np.ndarray
STEP = 1e-30
CIRCLE = np.exp(2j * np.pi * np.arange(8) / 8)
RADIUS = 0.05


@dataclass(frozen=True)
class Arm:
    """Rows as on the interface; quaternion scalar first; n joints are the rows there are."""

    joint_axis: Array
    joint_offset: Array
    link_mass: Array
    link_centre: Array
    link_inertia: Array
    link_products: Array
    joint_inertia: Array
    p_EA_A: Array
    q_EA: Array
    mass_0: float
    J_S: Array

    @property
    def n(self) -> int:
        return len(self.link_mass)

    def inertia(self, i: int) -> Array:
        xx, yy, zz = self.link_inertia[i]
        xy, xz, yz = self.link_products[i]
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])

    def parameters(self) -> dict:
        """For the interface: seven rows, those above n absurd, because they must not be read."""
        rows = {"joints": self.n, "p_EA_A": self.p_EA_A, "q_EA": self.q_EA}
        rows |= {"mass_0": self.mass_0, "J_S": self.J_S}
        for name in ROWS:
            value = np.asarray(getattr(self, name), float)
            rest = np.full((7 - self.n, *value.shape[1:]), -0.7)
            rows[name] = np.concatenate((value.reshape(self.n, *value.shape[1:]), rest))
        return rows


ROWS = (
    *("joint_axis", "joint_offset", "link_mass", "link_centre", "link_inertia", "link_products"),
    "joint_inertia",
)
DEFAULT = Arm(
    joint_axis=np.eye(3)[[2, 1, 0, 1, 0, 1, 0]],
    joint_offset=np.array([(x, 0, 0) for x in (0.5, 0.1, 0.1, 0.75, 0.1, 0.65, 0.1)])
    + np.outer(np.eye(7)[0], (0, 0, -0.3)),
    link_mass=np.array((4, 3.5, 5, 3.5, 3.5, 2.5, 3)),
    link_centre=np.array([(x, 0, 0) for x in (0.05, 0.05, 0.35, 0.05, 0.3, 0.05, 0.12)]),
    link_inertia=np.array(
        [
            (a, b, b)
            for a, b in zip(
                (0.015, 0.012, 0.015, 0.012, 0.008, 0.006, 0.008),
                (0.02, 0.015, 0.24, 0.015, 0.125, 0.007, 0.03),
                strict=True,
            )
        ]
    ),
    link_products=np.zeros((7, 3)),
    joint_inertia=np.array((0.8, 0.8, 0.5, 0.5, 0.2, 0.2, 0.2)),
    p_EA_A=np.array((0.3, 0, 0)),
    q_EA=np.array((1.0, 0, 0, 0)),
    mass_0=100.0,
    J_S=np.diag((200.0, 250, 150)),
)
STOWED = np.array([np.pi / 2, 0.3, 0, -2.7, 0, 1.2, 0])
READY = np.array([0.15, 0.54, 0.19, -2.15, -0.05, 1.6, -0.16])


def first(arm: Arm, n: int) -> Arm:
    """The same arm, cut off behind joint n."""
    return replace(arm, **{name: getattr(arm, name)[:n] for name in ROWS})


def turned(axis: Array, angle: Array) -> Array:
    """Rotation matrices (..., 3, 3) about a unit vector; angles may be complex."""
    K = cross(np.eye(3), np.asarray(axis, float))
    s, c = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    return np.eye(3) + s * K + (1 - c) * (K @ K)


def points_of(mass: float, inertia: Array) -> Array:
    """(6, 3): six equal masses with this inertia about their centre."""
    moments, axes = np.linalg.eigh(inertia)
    reach = np.sqrt(np.maximum(0, 3 * (moments.sum() / 2 - moments) / mass))
    return np.concatenate([s * reach[:, None] * axes.T for s in (1, -1)])


class Vehicle:
    """Arm in a pose: masses (K,), places and derivatives by the joint angles, base axes."""

    def __init__(self, arm: Arm, q: Array) -> None:
        self.arm, self.q = arm, np.asarray(q, float)[: arm.n]
        base = points_of(arm.mass_0, arm.J_S)
        bodies = [points_of(arm.link_mass[i], arm.inertia(i)) for i in range(arm.n)]
        self.own = [base, *(p + arm.link_centre[i] for i, p in enumerate(bodies))]
        masses = [arm.mass_0, *arm.link_mass]
        self.m = np.repeat(np.array(masses) / 6, 6)
        self.p = self.places(self.q)[0]
        directions = self.q + 1j * STEP * np.eye(arm.n)
        self.by_angle = self.places(directions)[0].imag / STEP
        self.c = self.m @ self.p / self.m.sum()

    def places(self, q: Array) -> tuple[Array, Array, Array]:
        """Points (..., K, 3), end effector (..., 3), its axes to base axes; q (..., n)."""
        q = np.asarray(q)
        R = np.broadcast_to(np.eye(3), (*q.shape[:-1], 3, 3)) + 0 * q.sum(axis=-1)[..., None, None]
        o, found = 0 * R[..., 0], [self.own[0] + 0 * R[..., :1, :]]
        for i in range(self.arm.n):
            o = o + R @ self.arm.joint_offset[i]
            R = R @ turned(self.arm.joint_axis[i], q[..., i])
            found.append(o[..., None, :] + self.own[1 + i] @ np.swapaxes(R, -1, -2))
        E = Rotation.from_quat(np.roll(self.arm.q_EA, -1)).as_matrix()
        return np.concatenate(found, axis=-2), o + R @ self.arm.p_EA_A, R @ E

    def second(self, dq: Array) -> Array:
        """Second time derivative of the places at constant joint rates: Cauchy's integral."""
        on_circle = self.places(self.q + RADIUS * CIRCLE[:, None] * dq)[0]
        return 2 * np.einsum("t,tki->ki", CIRCLE**-2, on_circle).real / 8 / RADIUS**2

    def columns(self) -> Array:
        """(K, 3, 6 + n): velocities of the points for unit speeds v, w, dq."""
        unit = np.broadcast_to(np.eye(3), (len(self.p), 3, 3))
        turning = np.stack([cross(e, self.p) for e in np.eye(3)], axis=-1)
        return np.concatenate((unit, turning, np.moveaxis(self.by_angle, 0, -1)), axis=-1)

    def H(self) -> Array:
        J = self.columns()
        rotors = np.concatenate((np.zeros(6), self.arm.joint_inertia))
        return np.einsum("k,kia,kib->ab", self.m, J, J) + np.diag(rotors)

    def b(self, w: Array, dq: Array) -> Array:
        """sum m J^T a with du/dt = 0, in turning base axes."""
        relative = np.einsum("kij,j->ki", self.columns()[:, :, 6:], dq)
        a = cross(w, cross(w, self.p)) + 2 * cross(w, relative) + self.second(dq)
        return np.einsum("k,kia,ki->a", self.m, self.columns(), a)

    def gradient(self, g: float, a: Array) -> Array:
        """Loads of the field of a point mass beside that at C: g m (3 a (a.x) - x)."""
        x = self.p - self.c
        f = g * self.m[:, None] * (3 * np.outer(x @ a, a) - x)
        return np.einsum("kia,ki->a", self.columns(), f)

    def tip(self) -> tuple[Array, Array]:
        """End effector and its axes to base axes."""
        _, p, R = self.places(self.q)
        return p, R

    def tip_columns(self) -> Array:
        """J_E (6, 6 + n): velocity and rate of E for unit speeds, base axes."""
        p, R = self.tip()
        J = np.zeros((6, 6 + self.arm.n))
        J[:3, :3] = J[3:, 3:6] = np.eye(3)
        J[:3, 3:6] = np.stack([cross(e, p) for e in np.eye(3)], axis=-1)
        _, dp, dR = self.places(self.q + 1j * STEP * np.eye(self.arm.n))
        spin = dR.imag / STEP @ R.T
        J[:3, 6:] = dp.imag.T / STEP
        J[3:, 6:] = (spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0])
        return J

    def generalized_jacobian(self) -> Array:
        """J_m - J_0 H_00^-1 H_0m."""
        H, J = self.H(), self.tip_columns()
        return J[:, 6:] - J[:, :6] @ np.linalg.solve(H[:6, :6], H[:6, 6:])


@dataclass(frozen=True)
class Loads:
    """Loads that are constant over a run: on base, tip (its axes) and joints; wheels; friction."""

    F_S: Array
    M_S: Array
    F_E: Array
    M_E: Array
    torque: Array
    wheel_accel: Array
    A_w: Array
    damping: Array
    friction: Array
    friction_rate: float = 0.005


def simulate(arm: Arm, y: Array, seconds: float, loads: Loads, mu: float = 0.0) -> Array:
    """State [r, v, q_SN, w, wheel speeds, q, dq] after some seconds; a point-mass planet."""

    def derivative(_: float, y: Array) -> Array:
        r, v, w, wheels = y[:3], y[3:6], y[10:13], y[13:16]
        q, dq = np.split(y[16:], 2)
        C = Rotation.from_quat(np.roll(y[6:10], -1)).as_matrix().T
        vehicle = Vehicle(arm, q)
        R = vehicle.tip()[1]
        Q = vehicle.tip_columns().T @ np.concatenate((R @ loads.F_E, R @ loads.M_E))
        momentum = cross(w, loads.A_w @ wheels) + loads.A_w @ loads.wheel_accel
        Q[:3] += loads.F_S
        Q[3:6] += loads.M_S - momentum
        Q[6:] += loads.torque - loads.damping * dq
        Q[6:] -= loads.friction * dq / np.hypot(dq, loads.friction_rate)
        field = np.zeros(3)
        if mu:
            r_C = r + C.T @ vehicle.c
            distance = np.linalg.norm(r_C)
            field = -mu / distance**3 * r_C
            Q += vehicle.gradient(mu / distance**3, C @ r_C / distance)
        du = np.linalg.solve(vehicle.H(), Q - vehicle.b(w, dq))
        turning = quaternion_rate(y[6:10], w)
        return np.concatenate(
            (v, field + C.T @ du[:3], turning, du[3:6], loads.wheel_accel, dq, du[6:])
        )

    done = solve_ivp(derivative, (0, seconds), y, method="DOP853", rtol=1e-12, atol=1e-13)
    return np.asarray(done.y[:, -1])


def rigid_capture(H: Array, J: Array, M_t: Array, J_t: Array, u: Array, u_t: Array):
    """Impulse on the target, speeds of both afterwards: end effector and target become one."""
    slip = J @ u - J_t @ u_t
    softness = J @ np.linalg.solve(H, J.T) + J_t @ np.linalg.solve(M_t, J_t.T)
    impulse = np.linalg.solve(softness, slip)
    after = u - np.linalg.solve(H, J.T @ impulse)
    return impulse, after, u_t + np.linalg.solve(M_t, J_t.T @ impulse)
