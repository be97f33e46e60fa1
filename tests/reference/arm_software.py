# SPDX-License-Identifier: BSD-2-Clause
"""Guidance and control of the arm on rotation matrices, full matrices and point masses.

Nothing of quaternions, composite bodies or Cholesky. Attitudes are matrices that turn body
components into N components; inputs and outputs carry the names of the interface.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.linalg import pinvh
from scipy.spatial.transform import Rotation

from .arm import READY, STOWED, Arm, Array, Vehicle
from .attitude import cross

SEVEN = np.ones(7)
GUIDANCE: dict[str, Any] = {
    "p_QT_T": np.array((0.6, 0, 0)),
    "q_QT": np.array((1.0, 0, 0, 0)),
    "standoff": 0.3,
    "seat_depth": 0.05,
    "joint_angle_stowed": STOWED,
    "joint_angle_ready": READY,
    "T_deploy": 60,
    "T_align": 30,
    "T_close": 30,
    "T_rest": 1,
    "deploy_from": 10,
    "track_from": 90,
    "gate_distance": 0.03,
    "gate_angle": 0.05,
    "K_E": np.array((0.5, 0.5)),
    "K_posture": 0.02,
    "K_limit": 1,
    "damping_max": 0.1,
    "manipulability_min": 0.05,
    "joint_angle_min": -3.1 * SEVEN,
    "joint_angle_max": 3.1 * SEVEN,
    "joint_rate_max": 0.2 * SEVEN,
    "base_floats": 1,
    "grip_distance": 0.01,
    "grip_angle": 0.035,
    "grip_speed": 0.005,
    "grip_rate": 0.005,
    "grip_dwell": 0.5,
}
CONTROL: dict[str, Any] = {
    "A_w": np.diag((12.0, 15, 10)),
    "joint_damping": 0 * SEVEN,
    "joint_friction": 0 * SEVEN,
    "friction_rate": 0.005,
    "joint_torque_max": 0 * SEVEN,
    "omega_joint": 5,
    "omega_rest": 1.5,
    "zeta": 1,
    "T_lock": 2,
    "lock_rate": 0.02,
    "compensate_torque": 1,
    "compensate_force": 0,
    "M_ff_max": np.zeros(3),
    "use_wheels": 1,
    "base_rest": 1,
}
STOW, DEPLOY, ALIGN, CLOSE, REST, FOLD = range(6)


def attitude(q: Array) -> Array:
    """Body to N."""
    return np.asarray(Rotation.from_quat(np.roll(q, -1)).as_matrix())


def log(R: Array) -> Array:
    return np.asarray(Rotation.from_matrix(R).as_rotvec())


def exp(a: Array) -> Array:
    return np.asarray(Rotation.from_rotvec(a).as_matrix())


def rise(since: float, T: float) -> tuple[float, float, float]:
    """10 x^3 - 15 x^4 + 6 x^5 and its time derivatives."""
    p = np.polynomial.Polynomial((0, 0, 0, 10, -15, 6))
    x = min(max(since / T, 0), 1)
    return p(x), p.deriv()(x) / T, p.deriv(2)(x) / T**2


def shortest_arc(a: Array, b: Array) -> Array:
    """Turns the unit vector a to b."""
    axis, c = cross(a, b), float(a @ b)
    s = float(np.linalg.norm(axis))
    if s < 2e-6 and c < 0:
        return np.diag((-1.0, -1, 1))
    return exp(axis * (np.arctan2(s, c) / s if s else 0))


class Guidance:
    """arm_guidance for one arm; `sample` takes and gives dictionaries."""

    def __init__(self, arm: Arm, **p: Any) -> None:
        self.arm, self.n, self.p = arm, arm.n, GUIDANCE | p
        self.mode, self.t_m, self.grip, self.good = STOW, 0.0, 0, None
        self.ref = np.array(self.p["joint_angle_stowed"][: arm.n], float)

    def look(self, u: dict) -> None:
        """Return the position of E relative to Q."""
        p, n = self.p, self.n
        self.u = u
        self.S, self.T = attitude(u["q_SN"]), attitude(u["q_TN"])
        self.Q = self.T @ attitude(p["q_QT"])
        self.q, self.dq = u["joint_angle"][:n], u["joint_rate"][:n]
        self.vehicle = Vehicle(self.arm, self.q)
        tip, R = self.vehicle.tip()
        motion = self.vehicle.tip_columns()[:, 3:] @ np.concatenate((u["omega_SN_S"], self.dq))
        self.r_E, self.E = u["r_SN_N"] + self.S @ tip, self.S @ R
        v_E, w_E = u["v_SN_N"] + self.S @ motion[:3], self.S @ motion[3:]
        self.w_T = self.T @ u["omega_TN_T"]
        self.e = self.Q.T @ (self.r_E - u["r_TN_N"] - self.T @ p["p_QT_T"])
        from_T = self.r_E - u["r_TN_N"]
        self.speed = np.linalg.norm(v_E - u["v_TN_N"] - cross(self.w_T, from_T))
        self.rate = np.linalg.norm(w_E - self.w_T)
        self.X = self.Q.T @ self.E[:, 0]
        self.misalignment = np.arctan2(np.hypot(self.X[1], self.X[2]), -self.X[0])

    @property
    def stand(self) -> Array:
        return np.array((self.p["standoff"], 0, 0))

    @property
    def seat(self) -> Array:
        return np.array((-self.p["seat_depth"], 0, 0))

    def next_mode(self, t: float, cmd: float, held: bool) -> int:  # noqa: PLR0911
        p, passed = self.p, lambda T: t >= self.t_m + T - 1e-9
        if self.mode not in (STOW, REST) and (cmd == 3 or held):
            return REST
        if self.mode == STOW:
            return DEPLOY if cmd in (1, 2) else STOW
        if self.mode == FOLD:
            return DEPLOY if cmd >= 1 else STOW if passed(p["T_deploy"]) else FOLD
        if self.mode == DEPLOY:
            return FOLD if cmd == 0 else ALIGN if cmd == 2 and passed(p["T_deploy"]) else DEPLOY
        if self.mode == REST and held:
            return REST
        if cmd in (0, 1):
            return (FOLD, DEPLOY)[int(cmd)]
        if self.mode == ALIGN:
            there = np.linalg.norm(self.e - self.stand) <= p["gate_distance"]
            ready = passed(p["T_align"]) and there and self.misalignment <= p["gate_angle"]
            return CLOSE if ready else ALIGN
        if self.mode == CLOSE and self.dwelt(t):
            self.grip = 1
            return REST
        return self.mode

    def dwelt(self, t: float) -> bool:
        p = self.p
        good = (
            np.linalg.norm(self.e - self.seat) <= p["grip_distance"]
            and self.misalignment <= p["grip_angle"]
            and self.speed <= p["grip_speed"]
            and self.rate <= p["grip_rate"]
        )
        self.good = None if not good else t if self.good is None else self.good
        return good and t >= self.good + p["grip_dwell"] - 1e-9

    def enter(self, mode: int, t: float) -> None:
        self.mode, self.t_m, self.good = mode, t, None
        self.from_q, self.from_dq = self.ref, self.dq
        if mode == REST:
            self.from_q = self.q
        if mode in (DEPLOY, FOLD):
            self.grip = 0
        if mode == ALIGN:
            E_Q = self.Q.T @ self.E
            self.e_0, self.mated = self.e, shortest_arc(self.X, np.array((-1.0, 0, 0))) @ E_Q
            self.phi_0 = log(self.mated.T @ E_Q)
        if mode == CLOSE:
            self.e_0, self.phi_0 = self.stand, np.zeros(3)

    def desired(self, since: float) -> tuple[Array, Array, Array, Array]:
        """x_r - r_T, v_r - v_T, E's attitude, w_r; N axes."""
        closing = self.mode == CLOSE
        s, ds, _ = rise(since, self.p["T_close" if closing else "T_align"])
        goal = self.seat if closing else self.stand
        x = self.T @ self.p["p_QT_T"] + self.Q @ (self.e_0 + s * (goal - self.e_0))
        v = cross(self.w_T, x) + self.Q @ (ds * (goal - self.e_0))
        R = self.Q @ self.mated @ exp((1 - s) * self.phi_0)
        return x, v, R, self.w_T + self.Q @ self.mated @ (-ds * self.phi_0)

    def rates(self, since: float) -> dict:
        p, u, n = self.p, self.u, self.n
        x, v, R, w = self.desired(since)
        miss, angle = u["r_TN_N"] + x - self.r_E, log(R @ self.E.T)
        linear = v + u["v_TN_N"] - u["v_SN_N"] + p["K_E"][0] * miss
        xd = np.concatenate((self.S.T @ linear, self.S.T @ (w + p["K_E"][1] * angle)))
        H, J, v_0 = self.vehicle.H(), self.vehicle.tip_columns(), np.zeros(6)
        v_0[3:] = u["omega_SN_S"]
        J_m = J[:, 6:]
        if p["base_floats"]:
            B = np.linalg.solve(H[:6, :6], H[:6, 6:])
            v_0, J_m = v_0 + B @ self.dq, J_m - J[:, :6] @ B
        y, z = xd - J[:, :6] @ v_0, p["K_posture"] * (p["joint_angle_ready"][:n] - self.q)
        low, high = (
            p["K_limit"] * (p[name][:n] - self.q) for name in ("joint_angle_min", "joint_angle_max")
        )
        fixed, dq, metrics = np.zeros(n, bool), np.zeros(n), None
        while True:
            free = ~fixed
            A, rest = J_m[:, free], y - J_m[:, fixed] @ dq[fixed]
            m = np.sqrt(max(0.0, np.linalg.det(A @ A.T))) if free.sum() >= 6 else 0.0
            least = p["manipulability_min"]
            damping = p["damping_max"] * (1 - m / least) if m < least else 0.0
            metrics = metrics or (m, damping)
            G = A @ A.T + damping**2 * np.eye(6)
            dq[free] = z[free] + A.T @ np.linalg.solve(G, rest - A @ z[free])
            broken = free & ((dq < low) | (dq > high))
            if not broken.any():
                break
            dq[broken] = np.clip(dq, low, high)[broken]
            fixed |= broken
        scale = min([1.0, *(p["joint_rate_max"][:n] / np.abs(dq))])
        return {
            "dq": scale * dq,
            "limited": fixed,
            "manipulability": metrics[0],
            "damping": metrics[1],
            "rate_scale": scale,
            "position_error": np.linalg.norm(miss),
            "angle_error": np.linalg.norm(angle),
            "J": J_m,
            "y": y,
        }

    def sample(self, t: float, u: dict, period: float) -> dict:
        p, n = self.p, self.n
        cmd = u["arm_mode_cmd"]
        if cmd < 0:
            cmd = 2 if t >= p["track_from"] - 1e-9 else float(t >= p["deploy_from"] - 1e-9)
        self.look(u)
        mode = self.next_mode(t, cmd, u["capture_phase"] in (2, 3))
        if mode != self.mode:
            self.enter(mode, t)
        since, step, zero = t - self.t_m, 0.0, np.zeros(n)
        y = {"q": np.array(p["joint_angle_stowed"][:n], float), "dq": zero, "ddq": zero}
        y |= dict.fromkeys(("manipulability", "damping", "rate_scale"), 0.0)
        y |= {"position_error": 0.0, "angle_error": 0.0, "limited": zero}
        if mode in (DEPLOY, FOLD):
            goal = p["joint_angle_ready" if mode == DEPLOY else "joint_angle_stowed"][:n]
            s, ds, dds = rise(since, p["T_deploy"])
            way = goal - self.from_q
            y |= {"q": self.from_q + s * way, "dq": ds * way, "ddq": dds * way}
        if mode == REST:
            T, f = p["T_rest"], min(since / p["T_rest"], 1)
            y["q"] = self.from_q + self.from_dq * T * (f - f * f / 2)
            y["dq"] = self.from_dq * (1 - f)
            y["ddq"] = -self.from_dq / T if f < 1 else zero
        if mode in (ALIGN, CLOSE):
            y |= self.rates(since)
            y["q"], step = self.ref, period
        self.ref = y["q"] + step * y["dq"]
        names = {"q": "joint_angle_ref", "dq": "joint_rate_ref", "ddq": "joint_accel_ref"}
        seven = {name: np.append(y[key], np.zeros(7 - n)) for key, name in names.items()}
        seven["limited"] = np.append(y["limited"], np.zeros(7 - n))
        plain = ("manipulability", "damping", "rate_scale", "position_error", "angle_error")
        return (
            seven
            | {name: y[name] for name in plain}
            | {"arm_mode": mode, "grip": self.grip, "tip_Q": self.e, "tip_rate": self.rate}
            | {"misalignment": self.misalignment, "tip_speed": self.speed}
        )


class Controller:
    """arm_controller for one arm."""

    def __init__(self, arm: Arm, **p: Any) -> None:
        self.arm, self.n, self.p = arm, arm.n, CONTROL | p
        self.since, self.locked = None, False

    def brake(self, t: float, u: dict) -> None:
        resting = u["arm_mode"] == REST
        self.since = None if not resting else t if self.since is None else self.since
        slow = np.abs(u["joint_rate"][: self.n]).max(initial=0) <= self.p["lock_rate"]
        if not resting:
            self.locked = False
        elif slow and t >= self.since + self.p["T_lock"] - 1e-9:
            self.locked = True

    def sample(self, t: float, u: dict) -> dict:
        p, n, mode = self.p, self.n, u["arm_mode"]
        self.brake(t, u)
        command = [u[name] for name in ("F_cmd_S", "M_cmd_S", "wheel_accel_cmd")]
        if mode == REST and p["base_rest"]:
            command = [np.zeros(3)] * 3
        F, M, accel = command
        names = ("F_sum_S", "M_sum_S", "wheel_accel_sum")
        y: dict = {"joint_torque": np.zeros(7), "saturated": np.zeros(7), "joint_error": 0.0}
        y |= {"F_ff_S": np.zeros(3), "M_ff_S": np.zeros(3), "joint_lock": np.ones(7)}
        if mode == STOW or self.locked:
            return y | dict(zip(names, command, strict=True))
        q, dq, w = u["joint_angle"][:n], u["joint_rate"][:n], u["omega_SN_S"]
        r, dr, ddr = (u[f"joint_{name}_ref"][:n] for name in ("angle", "rate", "accel"))
        v = Vehicle(self.arm, q)
        H, b, A_w = v.H(), v.b(w, dq), p["A_w"]
        o = p["omega_rest" if mode == REST else "omega_joint"]
        required = ddr + 2 * p["zeta"] * o * (dr - dq) + o**2 * (r - q)
        if mode != REST:
            reaction = H[:6, 6:] @ ddr + b[:6] - v.b(w, 0 * dq)[:6]
            if p["compensate_force"]:
                y["F_ff_S"] = reaction[:3]
            if p["compensate_torque"]:
                balance = cross(v.c, F + y["F_ff_S"] - reaction[:3])
                limit = np.where(p["M_ff_max"] > 0, p["M_ff_max"], np.inf)
                y["M_ff_S"] = np.clip(reaction[3:] + balance, -limit, limit)
        F = F + y["F_ff_S"]
        if p["use_wheels"]:
            accel = accel - np.linalg.solve(A_w, y["M_ff_S"])
        else:
            M = M + y["M_ff_S"]
        loads = np.append(F, M - A_w @ accel - cross(w, A_w @ u["wheel_speed"]))
        du = pinvh(H[:6, :6]) @ (loads - b[:6] - H[:6, 6:] @ required)
        tau = H[6:, :6] @ du + H[6:, 6:] @ required + b[6:] + p["joint_damping"][:n] * dr
        tau += p["joint_friction"][:n] * dr / np.hypot(dr, p["friction_rate"])
        limit = np.where(p["joint_torque_max"][:n] > 0, p["joint_torque_max"][:n], np.inf)
        y["joint_torque"][:n] = np.clip(tau, -limit, limit)
        y["saturated"][:n] = np.abs(tau) > limit
        y["joint_error"], y["joint_lock"] = np.abs(r - q).max(initial=0), np.zeros(7)
        return y | dict(zip(names, (F, M, accel), strict=True))
