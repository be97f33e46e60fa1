# SPDX-License-Identifier: BSD-2-Clause
"""Kalman filters of the navigation in dense textbook matrices: explicit H and S^-1 of full size,
transitions from a Jacobian by complex steps, delayed poses by filtering the whole history anew.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from .attitude import (
    Array,
    conjugate,
    cross,
    dcm,
    mrp_of_quaternion,
    multiply,
    positive,
    quaternion_of_mrp,
    rate,
    tilde,
)
from .integrate import rk4_step
from .orbit import central_gravity, hill_axes, j2_acceleration

# ---- attitude errors


def canonical(q: Array) -> Array:
    return positive(np.asarray(q) / np.linalg.norm(q))


def rot(a: Array) -> Array:
    """Quaternion of 4 times the Rodrigues parameters."""
    return quaternion_of_mrp(np.asarray(a) / 4)


def err(q: Array) -> Array:
    return 4 * mrp_of_quaternion(canonical(q))


def turn(phi: Array) -> Array:
    """Quaternion of a rotation vector."""
    return Rotation.from_rotvec(phi).as_quat(scalar_first=True)


# ---- one update


def update(P: Array, H: Array, R: Array, y: Array) -> tuple[Array, Array, float]:
    """Correction, covariance (Joseph), normalised innovation squared."""
    S_inverse = np.linalg.inv(H @ P @ H.T + R)
    K = P @ H.T @ S_inverse
    rest = np.eye(len(P)) - K @ H
    P = rest @ P @ rest.T + K @ R @ K.T
    return K @ y, (P + P.T) / 2, float(y @ S_inverse @ y)


def symmetric(P: Array) -> Array:
    return (P + P.T) / 2


def white_noise(q: float, T: float) -> Array:
    """Of a rate that drives three states and their rates."""
    return q * np.kron([[T**3 / 3, T**2 / 2], [T**2 / 2, T]], np.eye(3))


@dataclass
class Track:
    """Delayed measurements that a filter stores."""

    gate: float
    reset_after: float = 10
    acquired: bool = False
    last: float = -1.0
    stamp: float = -1.0
    nis: float = 0.0
    rejected: int = 0
    in_row: int = 0

    def new(self, time: float, valid: float) -> bool:
        found = valid > 0 and time > self.last
        self.last = time if found else self.last
        return found

    def verdict(self, nis: float) -> str:
        self.nis = nis
        if nis <= self.gate:
            self.in_row = 0
            return "accept"
        self.rejected += 1
        self.in_row += 1
        return "acquire" if 0 < self.reset_after <= self.in_row else "reject"


# ---- attitude


@dataclass
class Attitude:
    """Attitude filter; one call of `sample` per T."""

    T: float = 0.1
    sigma_v: float = 2.04e-5
    sigma_u: float = 8e-8
    sigma_A: Array = (1.94e-4, 2.9e-5, 2.9e-5)
    q_AS: Array = (1, 0, 0, 0)
    sigma_att_0: float = 0.1
    sigma_bias_0: float = 1e-3
    q: Array = (1.0, 0.0, 0.0, 0.0)
    track: Track = field(default_factory=lambda: Track(16.27))
    gyro_last: float = -1.0

    def __post_init__(self) -> None:
        self.b = np.zeros(3)
        self.P = np.diag([self.sigma_att_0**2] * 3 + [self.sigma_bias_0**2] * 3)
        self.turns: dict[int, Array] = {}

    def sample(self, k: int, u: dict[str, Array]) -> None:
        self.turns[k] = np.array((1.0, 0, 0, 0))
        if u["gyro_valid"] and u["gyro_time"] > self.gyro_last:
            self.gyro_last = u["gyro_time"]
            self._propagate(k, np.asarray(u["dtheta_S"]))
        if self.track.new(u["star_time"], u["star_valid"]):
            self._star(k, np.asarray(u["q_AN"]), u["star_time"])
        rate = np.asarray(u["dtheta_S"]) / self.T - self.b
        self.omega = rate if u["gyro_valid"] else np.zeros(3)

    def _propagate(self, k: int, dtheta: Array) -> None:
        T, v, w = self.T, self.sigma_v**2, self.sigma_u**2
        phi = dtheta - T * self.b
        self.turns[k] = turn(phi)
        self.q = canonical(multiply(self.q, turn(phi)))
        c, one = tilde(phi), np.eye(3)
        Phi = np.block([[dcm(turn(phi)), -T * (one - c / 2 + c @ c / 6)], [np.zeros((3, 3)), one]])
        Q = np.kron([[v * T + w * T**3 / 3, -w * T**2 / 2], [-w * T**2 / 2, w * T]], one)
        self.P = symmetric(Phi @ self.P @ Phi.T + Q)

    def _star(self, k: int, q_AN: Array, time: float) -> None:
        m = round(time / self.T)
        if not (0 <= k - m <= 15 and m >= min(self.turns)):
            return
        D = np.array((1.0, 0, 0, 0))
        for j in range(m + 1, k + 1):
            D = multiply(D, self.turns[j])
        q_m = multiply(multiply(q_AN, conjugate(self.q_AS)), D)
        C = dcm(self.q_AS) @ dcm(D).T
        R = C.T @ np.diag(np.square(self.sigma_A)) @ C + (
            k - m
        ) * self.T * self.sigma_v**2 * np.eye(3)
        dx, P, nis = update(self.P, np.eye(3, 6), R, err(multiply(conjugate(self.q), q_m)))
        verdict = self.track.verdict(nis) if self.track.acquired else "acquire"
        if verdict == "accept":
            self.q, self.b = canonical(multiply(self.q, rot(dx[:3]))), self.b + dx[3:]
            self.P = P
        elif verdict == "acquire":
            self.q, self.P = canonical(q_m), block_diag(R, self.sigma_bias_0**2 * np.eye(3))
            self.track.nis, self.track.in_row, self.track.acquired = 0.0, 0, True
        if verdict != "reject":
            self.track.stamp = time


# ---- orbit


def gradient(f, x: Array) -> Array:
    """Jacobian by complex steps."""
    h = 1e-20 * (1 + np.linalg.norm(x))
    return np.stack([np.imag(f(x + 1j * h * e)) / h for e in np.eye(len(x))], axis=1)


def gravity(r: Array, planet: dict[str, float]) -> Array:
    if planet["mu"] == 0:
        return 0 * r
    return central_gravity(r, planet["mu"]) + j2_acceleration(r, **planet)


def second_order(A: Array, T: float) -> Array:
    return np.eye(len(A)) + A * T + A @ A * T**2 / 2


@dataclass
class Orbit:
    """Orbit filter; one call of `sample` per T."""

    s: Array
    planet: dict[str, float]
    T: float = 0.1
    mass_hat: float = 95.0
    sigma_a: float = 1e-4
    sigma_r: float = 5.0
    sigma_v: float = 0.05
    sigma_0: tuple[float, float] = (100.0, 0.1)
    track: Track = field(default_factory=lambda: Track(22.46))
    q: Array | None = None

    def __post_init__(self) -> None:
        self.P = np.kron(np.diag(np.square(self.sigma_0)), np.eye(3))

    def sample(self, k: int, u: dict[str, Array]) -> None:
        if self.q is not None:
            self._propagate(dcm(self.q).T @ u["F_cmd_S"] / self.mass_hat)
        self.q = np.asarray(u["q_SN"])
        if self.track.new(u["fix_time"], u["fix_valid"]):
            self._fix(k, np.concatenate((u["r_fix_N"], u["v_fix_N"])), u["fix_time"])

    def _flow(self, s: Array, a: Array, h: float) -> Array:
        def f(_: float, x: Array) -> Array:
            return np.concatenate((x[3:], gravity(x[:3], self.planet) + a))

        return rk4_step(f, s, 0.0, h)

    def _propagate(self, a: Array) -> None:
        A = np.zeros((6, 6))
        A[:3, 3:] = np.eye(3)
        A[3:, :3] = gradient(lambda r: central_gravity(r, self.planet["mu"]), self.s[:3])
        Phi = second_order(A, self.T)
        self.s = self._flow(self.s, a, self.T)
        self.P = symmetric(Phi @ self.P @ Phi.T + white_noise(self.sigma_a**2, self.T))

    def _fix(self, k: int, fix: Array, time: float) -> None:
        late = k - round(time / self.T)
        if not 0 <= late <= 15:
            return
        if late:
            fix = self._flow(fix, np.zeros(3), late * self.T)
        s, P, total = self.s, self.P, 0.0
        R = (self.sigma_r**2 * np.eye(3), self.sigma_v**2 * np.eye(3))
        for part in range(2):
            H = np.eye(6)[3 * part : 3 * part + 3]
            dx, P, nis = update(P, H, R[part], H @ (fix - s))
            s, total = s + dx, total + nis
        verdict = self.track.verdict(total) if self.track.acquired else "acquire"
        if verdict == "accept":
            self.s, self.P = s, P
        elif verdict == "acquire":
            self.s, self.P = fix, block_diag(*R)
            self.track.nis, self.track.in_row, self.track.acquired = 0.0, 0, True
        if verdict != "reject":
            self.track.stamp = time


# ---- relative motion

SLICES = {
    "rho": slice(0, 3),
    "v": slice(3, 6),
    "theta": slice(6, 9),
    "w": slice(9, 12),
    "kappa": slice(12, 17),
    "d": slice(17, 20),
    "a": slice(20, 23),
}


@dataclass
class Relative:
    """Parameters of the relative filter, and its equations on the dictionary of a state."""

    planet: dict[str, float]
    T: float = 0.1
    mass_hat: float = 95.0
    sigma_a: float = 3e-5
    sigma_thrust: float = 0.1
    sigma_alpha: float = 3e-5
    sigma_kappa: float = 0.0
    sigma_d: float = 0.0
    sigma_acc: float = 1e-6
    sigma_0: dict[str, Array] = field(default_factory=dict)
    sigma_mount: float = 1e-4
    noise: tuple[float, ...] = (0.01, 1e-4, 0.002, 5e-4, 0.0087, 4.4e-4)
    p_KS_S: Array = (0.5, 0, 0.3)
    q_KS: Array = (1, 0, 0, 0)
    gradient: float = 1.0
    gate: float = 22.46
    reset_after: float = 10

    # -- motion
    def omega_dot(self, w: Array, kappa: Array, r_T: Array) -> Array:
        """Euler's equations with J/J11; r_T in target axes. Analytic in all arguments."""
        k1, k2, k3, k4, k5 = kappa
        B = np.array(((1 + 0 * k1, k3, k4), (k3, k1, k5), (k4, k5, k2)))
        rr = r_T @ r_T
        tide = self.gradient * 3 * self.planet["mu"] / rr**2.5 if self.planet["mu"] else 0.0
        torque = tide * (tilde(r_T) @ (B @ r_T)) - tilde(w) @ (B @ w)
        return np.linalg.solve(B, torque)

    def derivative(self, s: float, y: Array, x: dict, slot: dict) -> Array:
        rho, v, q, w = y[:3], y[3:6], y[6:10], y[10:]
        r_S = slot["r"] + s * slot["v"]
        pull = gravity(r_S, self.planet) - gravity(r_S - rho, self.planet)
        dw = self.omega_dot(w, x["kappa"], dcm(q) @ (r_S - rho))
        return np.concatenate((v, pull + slot["thrust"] + x["a"], rate(q, w), dw))

    def jacobian(self, x: dict, slot: dict) -> Array:
        """Of the error dynamics: attitude by its definition, the rest by complex steps."""
        r_T, C = slot["r"] - x["rho"], dcm(x["q"])
        A = np.zeros((23, 23))
        A[0:3, 3:6] = A[3:6, 20:23] = A[6:9, 9:12] = np.eye(3)
        if self.planet["mu"]:
            A[3:6, 0:3] = gradient(
                lambda rho: -central_gravity(r_T - rho, self.planet["mu"]), 0 * r_T
            )
        A[6:9, 6:9] = -tilde(x["w"])
        e = C @ r_T
        A[9:12, 6:9] = gradient(
            lambda a: self.omega_dot(x["w"], x["kappa"], e - tilde(a) @ e), np.zeros(3)
        )
        A[9:12, 9:12] = gradient(lambda w: self.omega_dot(w, x["kappa"], e), x["w"])
        A[9:12, 12:17] = gradient(lambda k: self.omega_dot(x["w"], k, e), x["kappa"])
        return A

    def propagate(self, x: dict, P: Array, slot: dict) -> tuple[dict, Array]:
        Phi = second_order(self.jacobian(x, slot), self.T)
        y = rk4_step(
            lambda s, y: self.derivative(s, y, x, slot),
            np.concatenate((x["rho"], x["v"], x["q"], x["w"])),
            0.0,
            self.T,
        )
        thrust = self.sigma_thrust**2 * slot["thrust"] @ slot["thrust"]
        Q = block_diag(
            white_noise(self.sigma_a**2 + thrust, self.T),
            white_noise(self.sigma_alpha**2, self.T),
            self.sigma_kappa**2 * self.T * np.eye(5),
            self.sigma_d**2 * self.T * np.eye(3),
            self.sigma_acc**2 * self.T * np.eye(3),
        )
        moved = {"rho": y[:3], "v": y[3:6], "q": canonical(y[6:10]), "w": y[10:]}
        return x | moved, symmetric(Phi @ P @ Phi.T + Q)

    # -- measurement
    def sigmas(self, R: float) -> tuple[Array, float]:
        g0, g2, b0, b1, c0, c1 = self.noise
        return np.array((g0 + g2 * R**2, b0 + b1 * R, b0 + b1 * R)), c0 + c1 * R

    def covariances(self, R: float) -> tuple[Array, Array]:
        across, attitude = self.sigmas(R)
        mount = self.sigma_mount**2
        return np.diag(across**2 + mount * R**2), (attitude**2 + mount) * np.eye(3)

    def predicted(self, x: dict, q_SN: Array) -> Array:
        q_KN = multiply(q_SN, self.q_KS)
        arm = dcm(x["q"]).T @ x["d"] - x["rho"]
        return dcm(q_KN) @ arm - dcm(self.q_KS) @ np.asarray(self.p_KS_S)

    def position_matrix(self, x: dict, q_SN: Array) -> Array:
        """H_1 by differences of the right error, complex steps where the model is analytic."""
        C_KN, C_NT = dcm(multiply(q_SN, self.q_KS)), dcm(x["q"]).T
        H = np.zeros((3, 23))
        H[:, 0:3] = -C_KN
        turned = gradient(lambda a: C_NT @ (x["d"] + tilde(a) @ x["d"]), np.zeros(3))
        H[:, 6:9], H[:, 17:20] = C_KN @ turned, C_KN @ C_NT
        return H

    def corrected(self, x: dict, dx: Array) -> dict:
        moved = {n: x[n] + dx[SLICES[n]] for n in ("rho", "v", "w", "kappa", "d", "a")}
        return x | moved | {"q": canonical(multiply(x["q"], rot(dx[6:9])))}

    def measured(self, x: dict, P: Array, q_SN: Array, pose: dict) -> tuple[dict, Array, float]:
        R_1, R_2 = self.covariances(float(np.linalg.norm(self.predicted(x, q_SN))))
        y = pose["r"] - self.predicted(x, q_SN)
        dx, P, nis = update(P, self.position_matrix(x, q_SN), R_1, y)
        x = self.corrected(x, dx)
        y = err(multiply(conjugate(x["q"]), self.attitude_of(pose, q_SN)))
        dx, P, second = update(P, np.eye(23)[6:9], R_2, y)
        return self.corrected(x, dx), P, nis + second

    def attitude_of(self, pose: dict, q_SN: Array) -> Array:
        return multiply(multiply(q_SN, self.q_KS), pose["q"])

    def acquired(self, x: dict, q_SN: Array, pose: dict) -> tuple[dict, Array]:
        """State of the pose, covariance by a Jacobian of what it is computed from:
        rho = C_TN^T d - C_KN^T r - C_SN^T p.
        """
        C_KN, q = dcm(multiply(q_SN, self.q_KS)), canonical(self.attitude_of(pose, q_SN))
        C_NT = dcm(q).T
        rho = C_NT @ x["d"] - C_KN.T @ pose["r"] - dcm(q_SN).T @ np.asarray(self.p_KS_S)
        P = self.start_covariance()
        P[0:9, :] = P[:, 0:9] = 0
        P[3:6, 3:6] = np.diag(np.square(self.sigma_0["v"]))
        R_1, R_2 = self.covariances(float(np.linalg.norm(pose["r"])))
        # columns: noise of r, noise of the attitude, error of d; rows: rho, theta, d
        J = np.zeros((9, 9))
        J[0:3, 0:3] = -C_KN.T
        J[0:3, 3:6] = gradient(lambda a: C_NT @ (x["d"] + tilde(a) @ x["d"]), np.zeros(3))
        J[0:3, 6:9], J[3:6, 3:6], J[6:9, 6:9] = C_NT, np.eye(3), np.eye(3)
        joint = J @ block_diag(R_1, R_2, np.diag(np.square(self.sigma_0["d"]))) @ J.T
        at = np.r_[0:3, 6:9, 17:20]
        P[np.ix_(at, at)] = joint
        return x | {"q": q, "rho": rho}, P

    def start_covariance(self) -> Array:
        return np.diag(np.concatenate([np.square(self.sigma_0[name]) for name in SLICES]))

    # -- everything again from the start
    def history(self, start: dict, slots: list[dict], poses: dict[int, dict]) -> tuple:
        """State, covariance and track after all slots, poses by the sample of their stamp."""
        x, P = start, self.start_covariance()
        track = Track(self.gate, self.reset_after)
        for k in range(len(slots)):
            if k:
                x, P = self.propagate(x, P, slots[k - 1])
            if k in poses:
                x, P = self._use(x, P, slots[k]["q"], poses[k], track)
        return x, P, track

    def _use(self, x: dict, P: Array, q_SN: Array, pose: dict, track: Track) -> tuple[dict, Array]:
        verdict = "acquire"
        if track.acquired:
            better, smaller, nis = self.measured(x, P, q_SN, pose)
            verdict = track.verdict(nis)
            if verdict == "accept":
                return better, smaller
        if verdict == "acquire":
            track.nis, track.in_row, track.acquired = 0.0, 0, True
            return self.acquired(x, q_SN, pose)
        return x, P


def start_relative(rho_H: Array, drho_H: Array, r: Array, v: Array, **other: Array) -> dict:
    """Start state; rates of H from r and v alone."""
    C_HN = hill_axes(r, v)
    h = cross(r, v)
    rho = C_HN.T @ rho_H
    turning = cross(h / (r @ r), rho)
    return {"rho": rho, "v": C_HN.T @ drho_H + turning, "a": np.zeros(3), **other}
