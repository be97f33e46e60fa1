# SPDX-License-Identifier: BSD-2-Clause
"""Reference of the mission: phases, range profile, retreat; selection between laws.

Written as a reader would describe it: each phase is a line of `PHASES`, conditions are closures
over the geometry of the sample, polynomials are numpy polynomials and their derivatives, the drift
after a retreat is the matrix exponential of the Clohessy-Wiltshire equations.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from math import inf, nan

import numpy as np
from numpy.polynomial import Polynomial
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from .attitude import Array, angle_between, cross, dcm, quaternion_of_dcm

STEP = Polynomial([0, 0, 0, 10, -15, 6])
"""From rest to rest in 0..1."""

PARAMETERS = {
    "mu": 3.986004415e14, "p_T": (1.0, 0, 0), "line_angle": -np.pi / 2,
    "R_1": 100, "R_2": 20, "L_3": 3, "L_end": 1.48,
    "tol_1": 5, "v_1": 0.03, "tol_2": 1, "v_2": 0.03, "angle_2": 0.06,
    "tol_3": 0.05, "v_3": 0.01, "angle_3": 0.0524, "rate_3": 0.005,
    "v_final": 0.1, "v_mate": 0.03, "ramp_mate": 10, "v_back": 0.05,
    "capture_time": 20, "settle_rate": 2e-4,
    "v_retreat": 0.1, "v_drift": 0.05, "F_retreat": 0.9, "R_safe": 200,
    "dwell": (30, 60, 30, 30, 30, 10, 20, 0, 0, 0, 0, 10, 0, 0, 0),
    "time_out": (7200, 3600, 3600, 3600, 3600, 1200, 1800, 120, 0, 1200, 0, 600, 0, 0, 0),
    "attempts": 2, "mass_dry": 85, "reserve": 1, "nav_far": 10, "nav_near": 2,
    "d_abort": (0.2, 0.1), "angle_abort": 0.2618, "error_dwell": 3,
    "v_0": (0.6, 0.06), "v_slope": (0.01, 0.0083), "tumble_max": 0.04, "speed_dwell": 5,
    "budget": 0, "F_axis": 2, "R_around": 14, "w_steer": 0.005, "steer_least": 0.002, "rate_2": 0,
    "rate_probe": 0, "Isp": 220, "A_w": np.diag((12.0, 15, 10)), "wheel_speed_max": 0.3,
    "bias_max": 0.65, "bias_tol": 0.1, "await_axis": 0, "spin_time": 60, "spin_accel": 0,
    "drift_time": 86400, "drift_step": 120, "sample_period": 0.1,
    "by_arm": 0, "momentum_max": 0, "mass_T": 150,
    "J_T": np.diag((100.0, 150, 90)), "J_S": np.diag((200.0, 250, 150)),
    "abort_relative": 1, "axis_radius": 3, "aim_radius": 0, "use_optimal": 0, "far_time": 1200,
    "monitor_stack": 1,
}  # fmt: skip

FORCE = (1, 1, 2, 2, 3, 3, 3, 3, 0, 4, 4, 3, 5, 0, 0)
ARM = (0, 0, 0, 0, 0, 0, 1, 2, 3, 3, 3, 1, 0, 0, 0)
TORQUE = (1, 1, 2, 2, 3, 3, 3, 3, 0, 4, 4, 3, nan, nan, nan)
NEXT = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, nan, 6, 13, 0, nan)
NEAR, BEFORE = (5, 6, 7, 11), (0, 1, 2, 3, 4, 5, 6, 7, 11)


@dataclass
class Seen:
    """The relative state of one sample in the frames of the conditions."""

    C_HN: Array
    w: float
    rho: Array
    """H axes; drho as seen in H."""
    drho: Array
    C_SN: Array
    R: float
    l: float  # noqa: E741
    d: float
    los: float
    v_rel: float
    pointing: float
    w_rel: float
    momentum: float
    axis: Array
    """Grasp axis, H axes."""
    w_T: Array
    """Rate of the target, S axes."""
    h_T: Array
    """Direction of its angular momentum, S axes."""


def seen(p: dict, u: dict) -> Seen:
    r, v = np.array(u["r_TN_N"]), np.array(u["v_TN_N"])
    rho, drho = u["r_SN_N"] - r, u["v_SN_N"] - v
    h = cross(r, v) if p["mu"] else np.array((0, 0, 1.0))
    C_HN = np.eye(3)
    if p["mu"]:
        z, x = h / np.linalg.norm(h), r / np.linalg.norm(r)
        C_HN = np.array((x, cross(z, x), z))
    w = np.linalg.norm(h) / (r @ r) if p["mu"] else 0.0
    C_TN, C_SN = dcm(u["q_TN"]), dcm(u["q_SN"])
    a = C_TN.T @ p["p_T"]
    w_T, w_S = C_TN.T @ u["omega_TN_T"], C_SN.T @ u["omega_SN_S"]
    momentum = about_centre(
        (u["mass"], p["mass_T"]), (u["r_SN_N"], r), (u["v_SN_N"], v),
        (C_SN.T @ p["J_S"] @ C_SN @ w_S, C_TN.T @ p["J_T"] @ C_TN @ w_T),
    )  # fmt: skip
    return Seen(
        C_HN, w, C_HN @ rho, C_HN @ (drho - cross(w * C_HN[2], rho)), C_SN,
        np.linalg.norm(rho), rho @ a, np.linalg.norm(cross(rho, a)), angle_between(rho, a),
        np.linalg.norm(drho - cross(w_T, rho)), angle_between(C_SN[0], -a),
        np.linalg.norm(w_S - w_T), momentum, C_HN @ a, C_SN @ w_T,
        C_SN @ C_TN.T @ direction(p["J_T"] @ u["omega_TN_T"]),
    )  # fmt: skip


def direction(a: Array) -> Array:
    return a / (np.linalg.norm(a) or 1.0)


def about_centre(masses, places, speeds, spins) -> float:
    """Angular momentum of bodies about their common centre of mass: spins and what they carry."""
    m, r, v = np.array(masses, float), np.array(places), np.array(speeds)
    r_C, v_C = m @ r / m.sum(), m @ v / m.sum()
    return float(np.linalg.norm(sum(spins) + m @ cross(r - r_C, v - v_C)))


# ---- range profile ----
def moved(start: float, end: float, T: float, tau: float) -> tuple[float, float, float]:
    if tau >= T:
        return end, 0.0, 0.0
    return tuple(
        (start if k == 0 else 0) + (end - start) * STEP.deriv(k)(tau / T) / T**k for k in range(3)
    )


def profile(p: dict, kind: int, start: float, end: float, tau: float) -> tuple[float, float, float]:
    """L, dL, ddL of the profile from `start` to `end` that began with phase `kind`, tau seconds
    ago.
    """
    T = duration(p, kind, start, end)
    if kind == 0:
        return p["R_2"], 0.0, 0.0
    if kind == 7 and p["by_arm"]:
        return p["L_3"], 0.0, 0.0
    if kind == 7:
        ramp, v = p["ramp_mate"], p["v_mate"]
        rate = STEP.integ()
        if tau < ramp:
            x = tau / ramp
            L = p["L_3"] - v * ramp * rate(x), -v * STEP(x), -v / ramp * STEP.deriv()(x)
        else:
            L = p["L_3"] - v * ramp * rate(1) - v * (tau - ramp), -v, 0.0
        return L if L[0] > p["L_end"] else (p["L_end"], 0.0, 0.0)
    return moved(start, end, T, tau)


def duration(p: dict, kind: int, start: float, end: float) -> float:
    way = 1.875 * abs(start - end)
    back = p["v_back"] if end == p["L_3"] else p["v_final"]
    times = {4: way / p["v_back"], 5: way / p["v_final"], 11: max(way / back, 1.0)}
    return times.get(kind, 0.0)


# ---- what turning with the target needs ----
@dataclass
class Plan:
    """The budget of one sample: range of the fly-around, wheels before it, verdict."""

    R: float
    bias: Array
    verdict: int
    dv: float


def steering(p: dict, mass: float, w: float, R: float) -> float:
    """What the centripetal force mass (w + steer)^2 R leaves of its share."""
    if not p["budget"]:
        return p["w_steer"]
    whole = np.sqrt(p["budget"] * p["F_axis"] / (mass * R))
    return min(max(whole - w, 0.0), p["w_steer"])


def plan(p: dict, u: dict, g: Seen) -> Plan:
    w, m = np.linalg.norm(g.w_T), u["mass"]
    if not p["budget"]:
        return Plan(p["R_2"], np.zeros(3), 0, increment_ahead(p, w, p["R_2"], p["w_steer"]))
    R = p["budget"] * p["F_axis"] / (m * (w + p["w_steer"]) ** 2)
    R = min(max(R, p["R_around"]), p["R_2"])
    left = steering(p, m, w, R)
    dv = increment_ahead(p, w, R, left) if left > 0 else 0.0
    pair = np.linalg.norm(p["J_T"] @ u["omega_TN_T"]) + w * np.diag(p["J_S"]).max()
    pair += w * p["L_3"] ** 2 / (1 / m + 1 / p["mass_T"])
    against = (
        left < p["steer_least"],
        0 < p["momentum_max"] < pair,
        dv > 9.80665 * p["Isp"] * (m - p["mass_dry"] - p["reserve"]) / m,
        0 < p["rate_probe"] < w and not p["by_arm"],
    )
    return Plan(R, bias_for(p, mean(g)), 1 + against.index(True) if any(against) else 0, dv)


def axis_passes(p: dict, g: Seen, since: float) -> bool:
    """Whether the grasp axis, once the servicer turns with it, is as near to the line of sight as
    it comes in a turn of the target; in axes of H.
    """
    w = g.C_HN @ g.C_SN.T @ g.w_T
    rate = np.linalg.norm(w)
    if not p["await_axis"] or not rate or since >= 2 * np.pi / rate:
        return True
    spin = p["spin_time"]
    if p["spin_accel"]:
        spin = max(spin, 15 / 8 * rate / p["spin_accel"])
    then = Rotation.from_rotvec(w * spin / 2).apply(g.axis)
    # spherical triangle of rate, axis and line of sight: the third side is least on one meridian
    best = abs(angle_between(w, g.rho) - angle_between(w, g.axis))
    return angle_between(then, g.rho) <= best + p["await_axis"]


def mean(g: Seen) -> Array:
    """Part of the rate along the angular momentum, which both stay."""
    return g.h_T * (g.h_T @ g.w_T)


def bias_for(p: dict, w: Array) -> Array:
    """Half of the momentum that turning with w takes along w, as speeds of the wheels."""
    along = w / np.linalg.norm(w)
    bias = np.linalg.inv(p["A_w"]) @ (along * (along @ p["J_S"] @ w)) / 2
    most = p["bias_max"] * p["wheel_speed_max"]
    return bias * min(1.0, most / np.abs(bias).max())


def wheels_with(p: dict, bias: Array, w_S: Array) -> Array:
    """Speeds of the wheels for the same momentum of body and wheels, up to the largest bias."""
    momentum = p["A_w"] @ bias - p["J_S"] @ w_S
    most = p["bias_max"] * p["wheel_speed_max"]
    return np.clip(np.linalg.inv(p["A_w"]) @ momentum, -most, most)


def increment_ahead(p: dict, w: float, R: float, steer: float) -> float:
    """Centripetal acceleration times time: half a turn at R, then inwards, then at L_3."""
    inwards = duration(p, 5, R, p["L_3"])
    there = p["dwell"][5] + p["dwell"][6] + (p["L_3"] - p["L_end"]) / p["v_mate"]
    return w**2 * (R * np.pi / steer + (R + p["L_3"]) / 2 * inwards + p["L_3"] * there)


# ---- retreat ----
def hill_matrix(n: float) -> Array:
    """d/dt of (position, velocity) relative to a circular orbit."""
    A = np.zeros((6, 6))
    A[:3, 3:] = np.eye(3)
    A[3, 0], A[3, 4], A[4, 3], A[5, 2] = 3 * n * n, 2 * n, -2 * n, -n * n
    return A


def clearance(p: dict, n: float, rho: Array, v: Array) -> float:
    count = int(np.floor(p["drift_time"] / p["drift_step"] * (1 + 1e-12)))
    over = expm(hill_matrix(n) * p["drift_step"])
    state, least = np.concatenate((rho, v)), inf
    for _ in range(count):
        state = over @ state
        least = min(least, np.linalg.norm(state[:3]))
    return least


def drifted(g: Seen, tau: float) -> Seen:
    """The state tau later without thrust, in the Hill axes of that time."""
    state = expm(hill_matrix(g.w) * tau) @ np.concatenate((g.rho, g.drho))
    turn = expm(tau * g.w * np.array(((0, 1, 0), (-1, 0, 0), (0, 0, 0.0))))
    return replace(g, C_HN=turn @ g.C_HN, rho=state[:3], drho=state[3:])


def escape(p: dict, g: Seen, age: float, near: bool) -> tuple[Array, float]:
    """dv_N and the clearance of the better sign; age: of the last valid state g."""
    if p["abort_relative"]:
        g = drifted(g, age)
    out = g.rho / np.linalg.norm(g.rho)
    if p["abort_relative"] and near and np.linalg.norm(g.rho) <= p["axis_radius"]:
        out = g.axis
    ways = [p["v_retreat"] * out + np.array((0, s * p["v_drift"], 0)) for s in (1, -1)]
    clear = [clearance(p, g.w, g.rho, v) for v in ways]
    best = 0 if clear[0] >= clear[1] else 1
    return g.C_HN.T @ (ways[best] - g.drho), clear[best]


# ---- closing beside the zone ----
@dataclass
class Line:
    """The tangent from the start of the closing, then the turn to the hold; H axes."""

    p: dict
    start: Array
    left: float = nan
    """When the tangent was left, at `end`."""
    end: Array | None = None

    def __post_init__(self) -> None:
        p, R = self.p, np.linalg.norm(self.start)
        self.hold = np.array((np.cos(p["line_angle"]), np.sin(p["line_angle"]), 0))
        self.normal = self._normal(self.start / R)
        inwards, aside = -self.start / R, cross(self.normal, self.start / R)
        off = np.arcsin(p["aim_radius"] / R)
        self.along = np.cos(off) * inwards + np.sin(off) * aside

    def _normal(self, d: Array) -> Array:
        n = cross(d, self.hold)
        return n / np.linalg.norm(n) if np.linalg.norm(n) > 1e-3 else np.array((0, 0, 1.0))

    def _at(self, R: float) -> Array:
        """The point of the line with the range R, on the near side."""
        middle = self.start @ self.along
        way = -middle - np.sqrt(middle**2 - self.start @ self.start + R * R)
        return self.start + way * self.along

    def frame(self, g: Seen, t: float) -> tuple[Array, Array]:
        """Axes of V as rows and its rate relative to H, both in H axes."""
        if np.isnan(self.left) and self.p["R_2"] + 1 < g.R:
            at = self._at(g.R)
            speed = g.rho @ g.drho / (at @ self.along)
            rate = cross(at, speed * self.along) / g.R**2
            return axes(at / g.R, self.normal), rate
        if np.isnan(self.left):
            self.left, self.end = t, self._at(self.p["R_2"] + 1)
            self.end /= np.linalg.norm(self.end)
            self.normal = self._normal(self.end)
        whole = angle_between(self.end, self.hold)
        T = 1.875 * whole * self.p["R_2"] / (2 * self.p["v_2"])
        angle, rate, _ = moved(0, whole, T, t - self.left)
        turn = Rotation.from_rotvec(angle * self.normal)
        return axes(turn.apply(self.end), self.normal), rate * self.normal


def axes(x: Array, z: Array) -> Array:
    return np.array((x, cross(z, x), z))


# ---- the manager ----
def later(t: float, mark: float) -> bool:
    """t has reached the mark, in the sense of all comparisons of times."""
    return t >= mark - 1e-9 * (1 + abs(mark))


@dataclass
class Manager:
    p: dict
    phase: int = -1
    t_phase: float = 0.0
    reason: int = 0
    attempt: int = 0
    t_valid: float = 0.0
    valid: Seen | None = None
    ok_since: float = nan
    touched: float = nan
    error_since: float = nan
    fast_since: float = nan
    profile: tuple = (0, 0.0, 0.0, 0.0)
    plan: Plan | None = None
    doomed_since: float = nan
    spins: bool = False
    torque: int = 1
    dv: Array = field(default_factory=lambda: np.zeros(3))
    clear: float = -1.0
    line: Line | None = None

    def sample(self, u: dict, t: float) -> dict[str, Array]:
        g = seen(self.p, u)
        if self.phase < 0:
            self.phase, self.t_phase, self.t_valid, self.valid = 0, t, t, g
            self.torque = self._torque(0)
        if u["relative_valid"]:
            self.t_valid, self.valid = t, g
        if self.plan is None or (u["relative_valid"] and self.phase <= 3):
            self.plan = plan(self.p, u, g)
        elif u["relative_valid"] and self.phase == 4 and not self.spins and self.p["budget"]:
            self.plan = replace(self.plan, bias=bias_for(self.p, mean(g)))
        self._clocks(g, t)
        self._change(u, g, t)
        self._spin(u, g, t)
        return self._outputs(u, g, t)

    def _spin(self, u: dict, g: Seen, t: float) -> None:
        arrived = self.t_phase + duration(self.p, 4, self.p["R_2"], self.profile[3])
        if self.phase < 4:
            self.spins = False
        elif self.phase == 4 and later(t, arrived) and u["relative_valid"]:
            self.spins |= axis_passes(self.p, g, t - arrived)

    def _clocks(self, g: Seen, t: float) -> None:
        p, near = self.p, self.phase in NEAR
        d = p["d_abort"][0] + p["d_abort"][1] * max(g.l - p["L_3"], 0)
        tumble = min(np.linalg.norm(g.w_T), p["tumble_max"]) if FORCE[self.phase] == 3 else 0.0
        v = p["v_0"][near] + (p["v_slope"][near] + tumble) * g.R
        wrong = near and (g.d > d or g.pointing > p["angle_abort"])
        fast = self.phase in BEFORE and np.linalg.norm(g.drho) > v
        self.error_since = started(self.error_since, wrong, t)
        self.fast_since = started(self.fast_since, fast, t)
        doomed = self.phase == 3 and self.plan.verdict > 0
        self.doomed_since = started(self.doomed_since, doomed, t)

    def _retreat_reason(self, u: dict, t: float) -> int:
        p, limit = self.p, self.p["time_out"][self.phase]
        nav = p["nav_near"] if self.phase in NEAR else p["nav_far"]
        reasons = {
            2: u["retreat"],
            3: t > self.t_valid + nav + 1e-9 * (1 + abs(t)),
            4: u["mass"] - p["mass_dry"] < p["reserve"],
            5: later(t, self.error_since + p["error_dwell"]),
            6: later(t, self.fast_since + p["speed_dwell"]),
            7: limit > 0 and self.phase != 7 and later(t, self.t_phase + limit),
            8 + self.plan.verdict: later(t, self.doomed_since + p["dwell"][3]),
        }
        return next((k for k, holds in reasons.items() if holds), 0)

    def _change(self, u: dict, g: Seen, t: float) -> None:
        reason = self._retreat_reason(u, t) if self.phase in BEFORE else 0
        if u["abort"] and self.phase not in (8, 9, 10, 14):
            self._enter(14, 1, g, t)
        elif reason == 7 and self._may_begin_anew(u, g):
            self._enter(11, 7, g, t)
            self.attempt += 1
            self.profile = (*self.profile[:3], self.plan.R)
        elif reason:
            self._enter(12, reason, g, t)
        elif self.phase == 7:
            self._mate(u, g, t)
        else:
            self.ok_since = started(self.ok_since, self._row(u, g, t), t)
            if later(t, self.ok_since + self.p["dwell"][self.phase]):
                self._enter(5 if self._far_back() else NEXT[self.phase], 0, g, t)

    def _may_begin_anew(self, u: dict, g: Seen) -> bool:
        """Only where nobody else is waited for."""
        waits = self.phase == 6 and not (u["go_3"] and self._may_grasp(g))
        return self.phase in (5, 6) and not waits and self.attempt < self.p["attempts"] - 1

    def _may_grasp(self, g: Seen) -> bool:
        return g.momentum <= (self.p["momentum_max"] or inf)

    def _far_back(self) -> bool:
        return self.phase == 11 and self.profile[3] != self.p["L_3"]

    def _row(self, u: dict, g: Seen, t: float) -> bool:
        p, v = self.p, bool(u["relative_valid"])
        line = np.array((np.cos(p["line_angle"]), np.sin(p["line_angle"]), 0))
        speed, k = np.linalg.norm(g.drho), self.phase
        on_line = v and np.linalg.norm(g.rho - p["R_2"] * line) <= p["tol_2"] and speed <= p["v_2"]
        kind, _, *ends = self.profile
        over = later(t, self.t_phase + duration(p, kind, *ends))
        fullest = np.abs(u.get("wheel_speed", np.zeros(3))).max() / p["wheel_speed_max"]
        wheels = not p["budget"] or fullest <= p["budget"]
        off_bias = np.abs(u.get("wheel_speed", np.zeros(3)) - self.plan.bias).max()
        ready = not p["budget"] or off_bias <= p["bias_tol"] * p["wheel_speed_max"]
        on_axis = (
            over and v and g.d <= p["tol_3"] and abs(g.l - p["L_3"]) <= p["tol_3"]
            and g.v_rel <= p["v_3"] and g.pointing <= p["angle_3"] and g.w_rel <= p["rate_3"]
        )  # fmt: skip
        off = abs(g.R - p["R_1"])
        around = (
            over and v and wheels and (self.spins or k > 4) and g.los <= p["angle_2"]
            and abs(g.R - ends[1]) <= p["tol_2"] and g.v_rel <= p["v_2"]
            and g.pointing <= p["angle_abort"] and g.w_rel <= (p["rate_2"] or inf)
        )  # fmt: skip
        rows = {
            0: v and off <= p["tol_1"] and speed <= p["v_1"],
            1: v and u["go_1"] and off <= 2 * p["tol_1"],
            2: on_line,
            3: on_line and u["go_2"] and ready and not self.plan.verdict,
            4: around,
            5: on_axis,
            6: on_axis and u["go_3"] and self._may_grasp(g) and wheels,
            8: u["hard"],
            9: u["done"] and np.linalg.norm(u["omega_SN_S"]) <= p["settle_rate"],
            11: around if self._far_back() else on_axis,
            12: not self.dv.any() and p["R_safe"] <= g.R,
            13: u["resume"] and v,
        }
        return bool(rows.get(k, False))

    def _mate(self, u: dict, g: Seen, t: float) -> None:
        p, limit = self.p, self.p["time_out"][7]
        if np.isnan(self.touched) and u["contact"]:
            self.touched = t
        failed = later(t, self.touched + p["capture_time"]) or (
            limit > 0 and later(t, self.t_phase + limit)
        )
        if u["soft"]:
            self._enter(8, 0, g, t)
        elif failed and self.attempt < p["attempts"]:
            self._enter(11, 0, g, t)
        elif failed:
            self._enter(12, 8, g, t)

    def _enter(self, phase: int, reason: int, g: Seen, t: float) -> None:
        near = self.phase in NEAR
        self.phase, self.reason, self.t_phase = phase, reason, t
        self.ok_since = self.touched = nan
        self.attempt = 0 if phase == 0 else self.attempt + (phase == 7)
        if phase in (0, 5, 6, 7, 11):
            self.profile = phase, t, g.l, self.p["L_3"]
        if phase == 4:
            self.profile = phase, t, self.p["R_2"], self.plan.R
        if TORQUE[phase] > 0:
            self.torque = self._torque(phase)
        beside = phase == 2 and self.p["aim_radius"] and self.p["R_2"] + 1 < g.R
        self.line = Line(self.p, g.rho) if beside else None
        if phase == 12:
            self.dv, self.clear = escape(self.p, self.valid, t - self.t_valid, near)

    def _torque(self, phase: int) -> int:
        """Towards the target where no thrust axis is needed."""
        return 2 if TORQUE[phase] == 1 and self.p["use_optimal"] else TORQUE[phase]

    def _goal(self) -> int:
        """Goal of the fuel-optimal law: hold, axis, along the axis; 0: another law."""
        far = self.p["R_2"] == self.plan.R
        goals = {0: 1, 1: 1, 2: 1, 3: 1, 4: far * (1 + self.spins), 5: 3 * far, 6: 3 * far}
        return goals.get(self.phase, 0) * self.p["use_optimal"]

    def _burn(self, u: dict) -> Array:
        left, period = np.linalg.norm(self.dv), self.p["sample_period"]
        if left == 0:
            return np.zeros(3)
        F = min(self.p["F_retreat"], u["mass"] * left / period) * self.dv / left
        self.dv = self.dv - F * period / u["mass"]
        if np.linalg.norm(self.dv) < 1e-12:
            self.dv = np.zeros(3)
        return F

    def _outputs(self, u: dict, g: Seen, t: float) -> dict[str, Array]:
        p, k = self.p, self.phase
        goal = self._goal()
        force = 6 if goal else FORCE[k]
        torque = self.torque if k >= 12 else self._torque(k)
        leg = p["use_optimal"] * (k < 2)
        F = self._burn(u) if k == 12 else np.zeros(3)
        psi = p["line_angle"]
        turn = np.array(
            ((np.cos(psi), np.sin(psi), 0), (-np.sin(psi), np.cos(psi), 0), (0, 0, 1.0))
        )
        omega = np.array((0, 0, g.w))
        if self.line:
            turn, rate = self.line.frame(g, t)
            omega = turn @ (omega + rate)
        hidden = k in (12, 13) and p["R_2"] > g.R
        waits = k == 4 and not self.spins
        prepares = p["budget"] > 0 and k in (2, 3, 4)
        w_S = np.array(u.get("omega_SN_S", np.zeros(3)))
        names = ("far", "close", "sync", "stack")
        return {
            "phase": k, "t_phase": self.t_phase, "reason": self.reason, "attempt": self.attempt,
            "select_force": force, "select_torque": torque,
            **{f"active_{name}": float(i in (force, torque)) for i, name in enumerate(names, 1)},
            **dict(zip(("L_ref", "dL_ref", "ddL_ref"),
                       profile(p, self.profile[0], *self.profile[2:], t - self.profile[1]),
                       strict=True)),
            "q_VN": quaternion_of_dcm(turn @ g.C_HN), "omega_VN_V": omega,
            "approaching": float(5 <= k <= 11),
            "monitor_valid": float(
                p["monitor_stack"] if 8 <= k <= 10 else (bool(u["relative_valid"]) and not hidden)
            ),
            "latch_enable": float(7 <= k <= 10), "release": 0.0,
            "push": float(k == 7 and not p["by_arm"] and not np.isnan(self.touched)),
            "arm_mode_cmd": ARM[k] * p["by_arm"] * (not self._far_back()), "momentum": g.momentum,
            "F_retreat_S": g.C_SN @ F, "dv_left_N": self.dv, "clearance": self.clear,
            "verdict": self.plan.verdict, "dv_ahead": self.plan.dv,
            "steer_max": steering(p, u["mass"], np.linalg.norm(g.w_T), max(g.R, p["L_3"])),
            "prepare": float(prepares), "spin": float(not waits),
            "wheel_bias": wheels_with(p, self.plan.bias, w_S) * prepares, "goal": goal,
            "L_goal": leg * p["R_1"], "T_goal": leg * p["far_time"],
        }  # fmt: skip


def started(since: float, holds: bool, t: float) -> float:
    """When a condition began to hold; NaN where it does not."""
    return (t if np.isnan(since) else since) if holds else nan


# ---- the selector ----
@dataclass
class Selector:
    """Commands as one vector of nine: force, torque, wheels."""

    p: dict
    last: tuple[int, int] | None = None
    out: Array = field(default_factory=lambda: np.zeros(9))
    D: Array = field(default_factory=lambda: np.zeros(9))
    unloading: bool = False

    def unload(self, u: dict, law: int) -> Array:
        """Torque that empties the wheels in laws 1 to 3, and the part that the wheels take up."""
        to = u["wheel_bias"] if u.get("prepare") else self.p["wheel_speed_ref"]
        excess = np.array(u["wheel_speed"]) - to
        full = np.abs(excess).max() / self.p["wheel_speed_max"]
        before = self.unloading or (law == 1 and not self.p.get("far_wheels"))
        level = self.p["unload_off"] if before else self.p["unload_on"]
        may = law in (1, 2, 3) and self.p["k_unload"] > 0
        beyond = full > level or (full == level and not before)
        self.unloading = bool(may and beyond and not u.get("prepare"))
        on = self.unloading or bool(may and u.get("prepare"))
        A, most = np.reshape(self.p["A_w"], (3, 3)), self.p["M_unload_max"]
        M = np.clip(-self.p["k_unload"] * A @ excess, -most, most) * on
        return np.concatenate((np.zeros(3), M, np.linalg.solve(A, M)))

    def required(self, u: dict) -> Array:
        th, A = np.array(u["throttle"]), np.reshape(self.p["A_w"], (3, 3))
        zero, force, torque = np.zeros(3), int(u["select_force"]), int(u["select_torque"])
        F_1 = np.array((self.p["main_thrust"] * th[12] - self.p["brake_thrust"] * th[8:12].mean(),
                        0, 0))  # fmt: skip
        M_1 = np.array(((th[5] + th[7] - th[4] - th[6]) / 2, th[3] - th[1], th[0] - th[2]))
        M_1 = M_1 * self.p["relay_torque"]
        F = (zero, F_1, u["F_close_S"], u["F_sync_S"], zero, u["F_retreat_S"], u["F_opt_S"])[force]
        W_1 = zero
        if self.p.get("far_wheels"):  # the body is turned against the wheels
            M_1, W_1 = zero, -np.linalg.inv(A) @ M_1
        M = (zero, M_1, u["M_close_S"], u["M_sync_S"], u["M_unload_S"])[torque]
        stack = u["wheel_stack"] + np.linalg.inv(A) @ u["M_unload_S"]
        W = (zero, W_1, u["wheel_close"], u["wheel_sync"], stack)[torque]
        return np.concatenate((F, M, W))

    def sample(self, u: dict) -> dict[str, Array]:
        now, tau = self.required(u), self.p["blend_time"]
        now = now + self.unload(u, int(u["select_torque"]))
        laws = int(u["select_force"]), int(u["select_torque"])
        self.D = self.D * (np.exp(-self.p["sample_period"] / tau) if tau else 0)
        for part, of, retained in ((slice(0, 3), 0, (1, 2, 3, 6)), (slice(3, 9), 1, (1, 2, 3, 4))):
            if self.last and laws[of] != self.last[of]:
                blends = tau > 0 and laws[of] in retained and self.last[of] in retained
                self.D[part] = (self.out - now)[part] if blends else 0
        self.out, self.last = now + self.D, laws
        F, M, W = self.out[:3].copy(), self.out[3:6], self.out[6:]
        if laws[0] == 3:
            F[0] += u["push"] * self.p["push_force"]
        return {"F_cmd_S": F, "M_cmd_S": M, "wheel_accel_cmd": W}
