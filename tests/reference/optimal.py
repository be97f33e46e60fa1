# SPDX-License-Identifier: BSD-2-Clause
"""Law of optimal_controller with dense matrices: the accelerations of an iteration solve one linear
system per axis, instead of a recursion. Time in seconds, positions in metres except in a solve.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from math import ceil, cos, floor, pi, sin, tan
from typing import Any

import numpy as np

from .attitude import cross

RP, RV, END = 480.0, 30.0, 3e3
PLAN, LAST, BRAKE, FIRST = range(4)

DEFAULTS: dict[str, Any] = {
    "mu": 3.986004415e14, "p_T": (1.0, 0, 0), "J_T": np.diag([100.0, 150, 90]),
    "F_max": (1.9, 0.95, 0.95), "duration": (475.0, 203, 600), "L_end": (20, 19.5, 4.02),
    "line": (0, -1.0, 0), "keep_out": (12, 12.3), "cone": 0.14660765716752369,
    "cone_hold": 0.005235987755982988, "hold_lead": 5.0, "slab": (0.015, 0.015), "T_min": 120.0,
    "speed_limit": 0, "v_0": 0.06, "v_slope": 0.0185, "iterations": 50, "iterations_first": 50,
    "kappa": 0.005, "k_d": 0.02, "tol": (0.05, 0.04), "bad_max": 5, "age_max": 20.0, "K_b": 0.01,
    "P_b": 0.2, "tumble_step": 5.0, "turn": (0, 1, 1), "omega_rest": 1e-6, "relax_time": 30.0,
    "arrive_radius": 0.3,
}  # fmt: skip


def double_integrator(n):
    """Positions and velocities at the ends of n nodes of 1/n from accelerations held over them."""
    h = 1 / n
    k, j = np.mgrid[:n, :n]
    held = np.where(j <= k, 1.0, 0.0)
    return held * h * h * (k - j + 0.5), held * h


@cache
def matrices(n, speed_limit):
    """Positions and velocities per acceleration, and the matrix of an iteration."""
    Phi, Psi = double_integrator(n)
    H = np.eye(n) + 2 * RP * Phi.T @ Phi + RV * speed_limit * Psi.T @ Psi
    H += END * RP * np.outer(Phi[-1], Phi[-1]) + END * RV * np.outer(Psi[-1], Psi[-1])
    return Phi, Psi, H


def lengths(a):
    return np.linalg.norm(a, axis=-1)


def cone_projection(x, a, t, o):
    """Nearest points with |p - (p.a) a| <= t (p.a) + o, of solid cones; a row per node."""
    apex = (o / t)[:, None] * a
    y = x + apex
    along = np.sum(y * a, axis=1)
    side = y - along[:, None] * a
    n = lengths(side)
    edge = a + (t / np.where(n > 0, n, 1))[:, None] * side
    edge /= lengths(edge)[:, None]
    on_edge = np.sum(y * edge, axis=1)[:, None] * edge
    beyond = (along + t * n <= 0)[:, None]
    nearest = np.where(beyond, 0.0, on_edge) - apex
    return np.where((n <= t * along)[:, None], x, nearest)


def ball_projection(x, centre, radius):
    e = x - centre
    n = lengths(e)
    inside = centre + (radius / np.where(n > 0, n, 1))[:, None] * e
    return np.where((n <= radius)[:, None], x, inside)


@dataclass
class Solve:
    """One problem in units of its horizon, and its iterates."""

    T: float
    n: int
    C: np.ndarray
    most: np.ndarray
    threshold: float
    pf: np.ndarray
    vf: np.ndarray
    p_end: np.ndarray
    v_end: np.ndarray
    cone: tuple | None  # axes, tangents, openings
    band: tuple  # normals, low, high of the slab; which nodes have a ball, centres, radius
    speed: tuple | None = None  # centres, radii
    z: dict = field(default_factory=dict)
    y: dict = field(default_factory=dict)

    def start(self):
        """Start cold."""
        self.z = {"u": 0 * self.pf, "c": self.pf.copy(), "h": self.pf.copy(), "v": self.vf.copy()}
        self.y = {name: np.zeros_like(self.pf) for name in "uchv"}

    def project(self, block, x):
        if block == "u":
            b = np.einsum("kij,kj->ki", self.C, x)
            b = np.sign(b) * np.maximum(np.abs(b) - self.threshold, 0)
            return np.einsum("kji,kj->ki", self.C, np.clip(b, -self.most, self.most))
        if block == "c":
            return cone_projection(x, *self.cone) if self.cone else x
        if block == "v":
            return ball_projection(x, *self.speed)
        normal, low, high, has_ball, centre, radius = self.band
        l = np.sum(x * normal, axis=1)  # noqa: E741
        slab = x + (np.clip(l, low, high) - l)[:, None] * normal
        slab = np.where(((low <= l) & (l <= high))[:, None], x, slab)
        return np.where(has_ball[:, None], ball_projection(x, centre, radius), slab)

    def iterate(self):
        Phi, Psi, H = matrices(self.n, bool(self.speed))
        z, y = self.z, self.y
        tp = RP * (z["c"] - y["c"] + z["h"] - y["h"] - 2 * self.pf)
        tv = RV * (z["v"] - y["v"] - self.vf) if self.speed else 0 * self.vf
        tp[-1] += END * RP * (self.p_end - self.pf[-1])
        tv[-1] += END * RV * (self.v_end - self.vf[-1])
        u = np.linalg.solve(H, z["u"] - y["u"] + Phi.T @ tp + Psi.T @ tv)
        p, v = self.pf + Phi @ u, self.vf + Psi @ u
        old = {name: value.copy() for name, value in z.items()}
        moved = {}
        for block, q in {"u": u, "c": p, "h": p, "v": v}.items():
            if block == "v" and not self.speed:
                continue
            x = 1.6 * q - 0.6 * z[block] + y[block]
            z[block] = self.project(block, x)
            y[block] = x - z[block]
            moved[block] = np.sum(np.any(z[block] != x, axis=1))
        at_limit = np.abs(np.einsum("kij,kj->ki", self.C, z["u"])) >= (1 - 1e-12) * self.most
        largest = lambda a: np.max(np.linalg.norm(a, axis=1))  # noqa: E731
        self.u, self.p = u, p
        self.report = {
            "residual_p": max(largest(p - z["c"]), largest(p - z["h"])) * self.T**2,
            "residual_u": largest(u - z["u"]),
            "change_p": max(largest(z[b] - old[b]) for b in "ch") * self.T**2,
            "change_u": largest(z["u"] - old["u"]),
            "miss": np.linalg.norm(p[-1] - self.p_end) * self.T**2,
            "count_box": np.sum(at_limit.any(axis=1)),
            "count_cone": moved["c"],
            "count_slab": moved["h"],
        }


def matrix_of(q):
    """C_BN of a quaternion with the scalar first."""
    w, v = q[0], np.asarray(q[1:])
    tilde = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) - 2 * w * tilde + 2 * tilde @ tilde


def tumble(J, q, w, h):
    """One Runge-Kutta step of a body without torque."""

    def rate(x):
        (a, *v), w = x[:4], x[4:]
        v = np.array(v)
        dq = 0.5 * np.concatenate(([-v @ w], a * w + cross(v, w)))
        return np.concatenate((dq, np.linalg.solve(J, cross(J @ w, w))))

    x = np.concatenate((q, w))
    k1 = rate(x)
    k2 = rate(x + h / 2 * k1)
    k3 = rate(x + h / 2 * k2)
    k4 = rate(x + h * k3)
    x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return x[:4] / np.linalg.norm(x[:4]), x[4:]


class OptimalLaw:
    """Force of optimal_controller, sample by sample (0.1 s)."""

    def __init__(self, **changes):
        p = DEFAULTS | changes
        arrays = ("p_T", "F_max", "line", "J_T", "duration", "L_end", "keep_out", "slab", "tol")
        self.p = p | {name: np.array(p[name], float) for name in arrays}
        self.rest()

    def rest(self):
        self.goal, self.d_hat, self.mode, self.plan = 0, np.zeros(3), FIRST, None
        self.out = {}

    # ---- surroundings

    def read(self, u):
        r, v = np.asarray(u["r_TN_N"], float), np.asarray(u["v_TN_N"], float)
        if self.p["mu"] == 0:
            axes, rate, k = np.eye(3), 0.0, 0.0
        else:
            h = cross(r, v)
            x, z = r / np.linalg.norm(r), h / np.linalg.norm(h)
            axes = np.array([x, cross(z, x), z])
            rate, k = np.linalg.norm(h) / (r @ r), self.p["mu"] / np.linalg.norm(r) ** 3
        self.axes, self.rate, self.k = axes, rate, k
        self.rho = np.asarray(u["r_SN_N"]) - r
        self.v = np.asarray(u["v_SN_N"]) - v
        self.q_T = np.asarray(u["q_TN"]) / np.linalg.norm(u["q_TN"])
        self.w_T = np.asarray(u["omega_TN_T"], float)
        self.C_SN = matrix_of(np.asarray(u["q_SN"]) / np.linalg.norm(u["q_SN"]))
        self.w_S, self.m = np.asarray(u["omega_SN_S"]), u["mass"]

    def hill(self, after):
        a = self.rate * after
        return np.array([[cos(a), sin(a), 0], [-sin(a), cos(a), 0], [0, 0, 1]]) @ self.axes

    def tide(self, x, after):
        r = self.hill(after)[0]
        return self.k * (3 * r * (r @ x) - x)

    # ---- forces

    def acceleration(self, t, rho, v, q, w, after):
        if self.mode == FIRST:
            return np.zeros(3)
        if self.mode != BRAKE:
            t_plan, dt, u, _ = self.plan
            return u[int(np.clip(floor((t - t_plan) / dt + 1e-9), 0, 59))]
        turning, place = self.hold
        C = matrix_of(q) if turning else self.hill(after)
        rate = C.T @ w if turning else self.rate * self.axes[2]
        J = self.p["J_T"]
        change = C.T @ np.linalg.solve(J, cross(J @ w, w)) if turning else np.zeros(3)
        rho_r = C.T @ place
        to_hold = cross(change, rho_r) + cross(rate, cross(rate, rho_r))
        error, d_error = rho - rho_r, v - cross(rate, rho_r)
        to_hold -= self.tide(rho, after) + self.d_hat
        return to_hold - self.p["K_b"] * error - self.p["P_b"] * d_error

    # ---- a solve

    def set_up(self, t, seconds, first):
        p, g = self.p, self.goal
        rho, v, q, w = self.rho, self.v, self.q_T, self.w_T
        for j in range(seconds):
            f = self.acceleration(t + j, rho, v, q, w, j) + self.d_hat + self.tide(rho, j)
            rho, v = rho + v + f / 2, v + f
            q, w = tumble(p["J_T"], q, w, 1.0)
        t_p, t_arr = t + seconds, self.t_goal + p["duration"][g - 1]
        T = max(t_arr - t_p, p["T_min"])
        dt, h = T / 60, 1 / 60
        turns = np.linalg.norm(self.w_S) >= p["omega_rest"] and p["turn"][g - 1]
        C, a, at = [], [], (q, w)
        steps = int(min(4, max(1, ceil(dt / p["tumble_step"]))))
        for _ in range(60):
            C.append(self.C_SN @ matrix_of(self.q_T).T @ matrix_of(at[0]) if turns else self.C_SN)
            for _ in range(steps):
                at = tumble(p["J_T"], *at, dt / steps)
            a.append(matrix_of(at[0]).T @ p["p_T"])
        L, ends = p["L_end"][g - 1], (np.arange(60) + 1) * dt
        if g == 1:
            places = np.array([L * self.hill(seconds + s).T @ p["line"] for s in ends])
            w_end = self.rate * self.axes[2]
        else:
            places, w_end = L * np.array(a), matrix_of(at[0]).T @ at[1]
        way = self.first_way(rho, places[-1]) if first else self.moved_path(t_p, dt)
        x, xv, before, pf, vf = rho / T**2, v / T, rho, [], []
        for k in range(60):
            d = self.d_hat + self.tide((before + way[k]) / 2, seconds + (k + 0.5) * dt)
            x, xv, before = x + h * xv + h * h / 2 * d, xv + h * d, way[k]
            pf.append(x)
            vf.append(xv)
        cone, band = self.bands(t_p, t_arr, T, rho, q, w, ends, a, places, way)
        speed = None
        if p["speed_limit"]:
            w_H = self.rate * self.axes[2]
            limit = p["v_0"] + p["v_slope"] * np.linalg.norm(way, axis=1)
            speed = (cross(w_H, way) / T, limit / T)
        most = p["F_max"] / self.m
        new = Solve(
            T, 60, np.array(C), most, p["kappa"] * max(most), np.array(pf), np.array(vf),
            places[-1] / T**2, cross(w_end, places[-1]) / T, cone, band, speed,
        )  # fmt: skip
        new.start()
        if self.has_iterates:
            self.start_from_last(new, t_p, dt)
        self.has_iterates, self.solve, self.t_p, self.dt = True, new, t_p, dt
        self.range, self.places, self.left = np.linalg.norm(rho), places, seconds

    def bands(self, t_p, t_arr, T, rho, q, w, ends, a, places, way):
        p, g, T2 = self.p, self.goal, T * T
        fade = np.maximum(0, 1 - ends / p["relax_time"])
        near = 1e-6
        arrived = t_p + ends >= t_arr - near
        if g != 3:
            out = p["keep_out"][g - 1]
            normal = way / lengths(way)[:, None]
            low = out - max(0, out - lengths(rho)) * fade
            high, radius = np.full(60, 1e6), np.full(60, p["arrive_radius"])
            return None, (normal, low / T2, high / T2, arrived, places / T2, radius / T2)
        a_0 = matrix_of(q).T @ p["p_T"]
        along = rho @ a_0
        across = lengths(rho - along * a_0)
        sag = (lengths(w) * T / 60) ** 2 / 8
        narrow = t_p + ends >= t_arr - p["hold_lead"] - near
        t, L = np.where(narrow, tan(p["cone_hold"]), tan(p["cone"] - sag)), p["L_end"][2]
        o = np.maximum(0, across - t * along) * fade
        low = L - p["slab"][0]
        high = np.where(arrived, L + p["slab"][1], 1e6)
        low = low - max(0, low - along) * fade
        high = high + np.maximum(0, along - high) * fade
        a, no_ball = np.array(a), np.zeros(60, bool)
        return (a, t, o / T2), (a, low / T2, high / T2, no_ball, 0 * a, np.ones(60))

    def first_way(self, start, end):
        part = (np.arange(60)[:, None] + 1) / 60
        angle = np.arctan2(np.linalg.norm(cross(start, end)), start @ end)
        if self.goal != 2 or not 1e-6 <= angle <= pi - 1e-3:
            return start + part * (end - start)
        r = np.linalg.norm(start), np.linalg.norm(end)
        way = np.sin((1 - part) * angle) * start / r[0] + np.sin(part * angle) * end / r[1]
        return (r[0] + part * (r[1] - r[0])) * way / sin(angle)

    def resampled(self, values, t_p, dt, f):
        s = ((t_p - self.t_p) + (np.arange(60) + f) * dt) / self.dt - f
        s = np.clip(s, 0, 59)
        return np.array([np.interp(s, np.arange(60), column) for column in values.T]).T

    def moved_path(self, t_p, dt):
        return self.resampled(self.solve.p * self.solve.T**2, t_p, dt, 1)

    def start_from_last(self, new, t_p, dt):
        ratio = self.solve.T / new.T
        for name, factor in {"u": 1, "c": ratio**2, "h": ratio**2, "v": ratio}.items():
            f = 0.5 if name == "u" else 1
            new.z[name] = self.resampled(self.solve.z[name], t_p, dt, f) * factor
            new.y[name] = self.resampled(self.solve.y[name], t_p, dt, f) * factor

    def evaluate(self, t):
        s, p = self.solve, self.p
        bound = p["tol"][0] + p["tol"][1] * self.range
        good = s.report["residual_p"] <= bound and s.report["miss"] <= bound
        path = s.p * s.T**2
        near = np.linalg.norm(path - self.places, axis=1) <= 0.1 + p["arrive_radius"]
        ends = self.t_p + (np.arange(60) + 1) * self.dt
        force = np.abs(np.einsum("kij,kj->ki", s.C, s.z["u"]))
        self.out |= s.report | {
            "feasible": float(good),
            "dv_left": force.sum() * self.dt,
            "t_arrival": ends[np.argmax(near)] if near.any() else 0.0,
        }
        if good:
            self.plan, self.mode, self.bad = (self.t_p, self.dt, s.z["u"].copy(), path), PLAN, 0
            self.out |= {
                "plan_time": self.t_p, "plan_step": self.dt, "plan_rho_N": path[9::10].ravel(),
            }  # fmt: skip
            return
        self.bad += 1
        if self.plan is None:
            mode = FIRST if self.bad < p["bad_max"] else BRAKE
        else:
            mode = LAST if t - self.plan[0] <= p["age_max"] else BRAKE
        if mode == BRAKE and self.mode != BRAKE:
            C = matrix_of(self.q_T) if self.goal == 3 else self.axes
            self.hold = (self.goal == 3, C @ self.rho)
        self.mode = mode
        if self.bad % p["bad_max"] == 0:
            self.has_iterates = False

    # ---- a sample

    def __call__(self, t, u, goal):
        """Return the outputs of the sample at t; u: inputs by name."""
        p = self.p
        self.read(u)
        if goal == 0:
            self.rest()
            return {"F_cmd_S": np.zeros(3), "mode": FIRST}
        if goal != self.goal:
            self.goal, self.t_goal, self.count, self.left = goal, t, 0, 0
            self.has_iterates, self.bad, self.last = False, 0, None
        c = self.count % 10
        if c == 0:
            if self.last:
                rho_1, v_1, forces = self.last
                res = self.v - v_1 - sum(forces) / 10 / self.m
                res = res - self.tide((self.rho + rho_1) / 2, 0)
                self.d_hat = self.d_hat + p["k_d"] * (res - self.d_hat)
            self.last = (self.rho, self.v, [])
            self.out["d_hat_N"] = self.d_hat
            if self.left > 1:
                self.left -= 1
            else:
                first = self.left == 0
                if not first:
                    self.evaluate(t)
                seconds = p["iterations_first"] // p["iterations"] if first else 1
                self.set_up(t, seconds, first)
        else:
            n = p["iterations"]
            for _ in range(n * c // 9 - n * (c - 1) // 9):
                self.solve.iterate()
        F = self.m * self.acceleration(t, self.rho, self.v, self.q_T, self.w_T, 0)
        F_cmd = np.clip(self.C_SN @ F, -p["F_max"], p["F_max"])
        self.last[2].append(self.C_SN.T @ F_cmd)
        self.count += 1
        return self.out | {"F_cmd_S": F_cmd, "mode": self.mode, "braking": self.mode == BRAKE}
