# SPDX-License-Identifier: BSD-2-Clause
"""The safety filter (docs/models.md M), written from its equations for comparison with the FMU.

One sample: rows n.u >= c of the rules, the point nearest to the command by the incremental method,
relaxation by rank, rows of the drift on demand, the two switching filters. Vectors are arrays of
three numbers; a matrix C_AB maps components in B to components in A.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import combinations, pairwise

import numpy as np
from numpy.linalg import norm

from .attitude import cross

BOX, KEEP_OUT, CORRIDOR, SPEED, DRIFT, PLUME = 6, 1, 2, 3, 4, 5
PASSES, FILTERED, BACKUP, RELAXED = 0, 1, 2, 3
NONE, EXPLICIT, IMPLICIT, ASIF = range(4)
RESTING = 1e9


@dataclass(frozen=True)
class Settings:
    """Parameters with the start values of the FMU."""

    filter: float = 3
    mu: float = 3.986004415e14
    mass: float = 100
    mass_error: float = 0.1
    F_max: tuple = (2, 1, 1)
    a_dist: float = 1e-4
    position_error: float = 0
    velocity_error: float = 0
    attitude_error: float = 0
    rate_error: float = 0
    reaction: float = 0
    keep_out_radius: float = 4
    brake_keep_out: float = 4.5e-3
    keep_out_opens: float = 0
    use_corridor: float = 0
    corridor_half_angle: float = np.pi / 18
    corridor_axis: tuple = (1, 0, 0)
    corridor_apex: tuple = (0, 0, 0)
    corridor_length: float = 0
    brake_corridor: float = 3e-3
    alpha_T_max: float = 2e-5
    use_speed_limit: float = 0
    speed_at_zero: float = 0.02
    speed_slope: float = 0.0185
    speed_max: float = 1e9
    passive_time: float = 0
    passive_points: float = 20
    passive_margin: float = 0.15
    plume_range: float = 0
    plume_force: float = 0.5
    recover_speed: float = 0.02
    dwell: float = 5
    sample_period: float = 0.1


@dataclass(frozen=True)
class Inputs:
    """One sample of the inputs."""

    r_TN_N: np.ndarray
    v_TN_N: np.ndarray
    q_TN: np.ndarray
    omega_TN_T: np.ndarray
    r_SN_N: np.ndarray
    v_SN_N: np.ndarray
    q_SN: np.ndarray
    omega_SN_S: np.ndarray
    F_cmd_S: np.ndarray
    approaching: float = 1
    relative_valid: float = 1


@dataclass(frozen=True)
class Row:
    """A half space n.u >= c of a rule; n and u in servicer axes."""

    rule: int
    n: np.ndarray
    c: float


@dataclass
class Answer:
    """Outputs of one sample."""

    F_safe_S: np.ndarray
    mode: int = PASSES
    active: int = 0
    feasible: int = 1
    relaxed: int = 0
    barrier: np.ndarray = field(default_factory=lambda: np.full(5, RESTING))


# ---- 3.1 geometry ----
def dcm(q):
    """Return C_XN of a unit quaternion, scalar first."""
    w, v = q[0], np.asarray(q[1:])
    K = np.array(((0, -v[2], v[1]), (v[2], 0, -v[0]), (-v[1], v[0], 0)))
    return (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) - 2 * w * K


def rotating(g, w, rho, velocity):
    """Return the acceleration as seen in a frame of constant rate w."""
    return g - 2 * cross(w, velocity) - cross(w, cross(w, rho))


class Geometry:
    """(1) to (4)."""

    def __init__(self, p: Settings, u: Inputs, P: float) -> None:
        self.p, self.P = p, P
        self.rho, self.v = u.r_SN_N - u.r_TN_N, u.v_SN_N - u.v_TN_N
        self.R = norm(self.rho)
        self.C_SN, self.C_TN = dcm(u.q_SN), dcm(u.q_TN)
        self.out = self.rho / self.R if self.R > 0 else self.C_SN[0]
        self.g = gravity(p.mu, u.r_SN_N) - gravity(p.mu, u.r_TN_N)
        self.W = self.C_TN.T @ u.omega_TN_T
        self.v_T = self.v - cross(self.W, self.rho)
        self.a_T = rotating(self.g, self.W, self.rho, self.v_T)
        h = cross(u.r_TN_N, u.v_TN_N)
        self.w_H = h / (u.r_TN_N @ u.r_TN_N) if p.mu else np.zeros(3)
        self.v_H = self.v - cross(self.w_H, self.rho)
        self.a_H = rotating(self.g, self.w_H, self.rho, self.v_H)
        x = u.r_TN_N / norm(u.r_TN_N) if p.mu else None
        z = h / norm(h) if p.mu else None
        self.C_HN = np.array((x, cross(z, x), z)) if p.mu else np.eye(3)
        self.a_F = norm(p.F_max) / (p.mass * (1 - p.mass_error))
        self.e_p = p.position_error + self.a_F * p.reaction**2 / 2
        self.e_v = p.velocity_error + self.a_F * p.reaction
        self.turn_S = P * norm(u.omega_SN_S) * self.a_F
        self.w_r = norm(u.omega_SN_S - self.C_SN @ self.W)
        resting = p.keep_out_opens and u.approaching
        self.has_sphere = p.keep_out_radius > 0 and not resting
        self.has_corridor = bool(p.use_corridor and u.approaching)
        self.has_speed = bool(p.use_speed_limit and u.approaching)
        self.has_drift = p.passive_time > 0 and self.has_sphere

    def row(self, rule, n_N, beta):
        """(5) and the masses of (9)."""
        p = self.p
        share = 1 + p.mass_error if beta > 0 else 1 - p.mass_error
        return Row(rule, self.C_SN @ n_N, beta * p.mass * share)


def gravity(mu, r):
    """Return the acceleration of a point mass."""
    return -mu * r / norm(r) ** 3 if mu else np.zeros(3)


# ---- 3.2 one channel ----
def barrier(d, w, a_b):
    """(6)."""
    return d - w * w / (2 * a_b) if w < 0 else d


def least_acceleration(d, w, a_b, P, recover_speed):
    """(7)."""
    r = 2 * d + P * w
    if d <= 0:
        return min((recover_speed - w) / P, a_b + max(-w, 0) / P)
    if r < 0:
        return w * w / (2 * d)
    x = a_b * P / 2
    return (x - np.sqrt(x * x + a_b * r) - w) / P


def channel(d, w, a_b, P, recover_speed, e_p, e_v):
    """(7) and (8), with the barrier."""
    h, alpha = barrier(d, w, a_b), least_acceleration(d, w, a_b, P, recover_speed)
    if h >= -2 * (e_p + e_v * (max(-w, 0) + e_v) / a_b):
        alpha = min(alpha, a_b)
    return h, alpha


# ---- 3.3 rows ----
def box_rows(p):
    for i, most in enumerate(p.F_max):
        for sign in (1, -1):
            yield Row(BOX, sign * np.eye(3)[i], -most)


def keep_out_row(g: Geometry):
    """(10), (11)."""
    p, T, n = g.p, g.p.reaction, g.out
    d = g.R - p.keep_out_radius + T * n @ g.v + T**2 / 2 * n @ g.g - g.e_p
    w = n @ g.v + T * n @ g.g - g.e_v
    bend = (g.P * g.a_F) ** 2 / (4 * max(g.R, p.keep_out_radius))
    D = p.a_dist + g.turn_S + bend
    h, alpha = channel(d, w, p.brake_keep_out, g.P, p.recover_speed, g.e_p, g.e_v)
    return h, g.row(KEEP_OUT, n, alpha + D - n @ g.g)


def speed_row(g: Geometry):
    """(12) to (14)."""
    p, P, T = g.p, g.P, g.p.reaction
    ahead = g.v_H + T * g.a_H
    s, c_P, D = norm(ahead), P * (g.a_F + norm(g.a_H)), p.a_dist + g.turn_S
    range_ = g.R + (T + P) * min(0, g.out @ g.v) - (T + P) ** 2 / 2 * g.a_F - p.position_error
    most = min(p.speed_at_zero + p.speed_slope * max(range_, 0), p.speed_max)
    L = most - c_P**2 / p.speed_at_zero - g.e_v - P * D
    h = min(p.speed_at_zero + p.speed_slope * g.R, p.speed_max) - norm(g.v_H) - p.velocity_error
    if not (s > 0 and s + c_P > L):
        return h, None
    n = -ahead / s
    beta = (s - P * n @ g.a_H - L) / P
    certain, full = (g.row(SPEED, n, b) for b in (beta - 2 * g.e_v / P, beta))
    return h, replace(full, c=max(certain.c, min(full.c, min(p.F_max) / np.sqrt(3))))


def pyramid(p):
    """(15): inner normals of the eight faces, and of the end if there is one, target axes."""
    axis = np.asarray(p.corridor_axis, float)
    t = np.tan(p.corridor_half_angle) * np.cos(np.pi / 8)
    e_1 = cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    e_1 /= norm(e_1)
    e_2, length = cross(axis, e_1), np.hypot(1, t)
    for j in range(8):
        side = np.cos(j * np.pi / 4) * e_1 + np.sin(j * np.pi / 4) * e_2
        yield (t * axis - side) / length, 0.0
    if p.corridor_length > 0:
        yield -axis, p.corridor_length


def corridor_rows(g: Geometry):
    """(16), (17)."""
    p, T, W = g.p, g.p.reaction, norm(g.W)
    x = g.rho - g.C_TN.T @ np.asarray(p.corridor_apex, float)
    e_p = g.e_p + p.attitude_error * g.R
    e_v = g.e_v + p.rate_error * g.R + p.attitude_error * norm(g.v)
    turning = g.P * (2 * W * g.a_F + 3 * W**2 * norm(g.v_T))
    D = p.a_dist + g.P * g.w_r * g.a_F + turning + p.alpha_T_max * g.R
    for n_T, offset in pyramid(p):
        n = g.C_TN.T @ n_T
        d = offset + n @ x + T * n @ g.v_T + T**2 / 2 * n @ g.a_T - e_p
        w = n @ g.v_T + T * n @ g.a_T - e_v
        h, alpha = channel(d, w, p.brake_corridor, g.P, p.recover_speed, e_p, e_v)
        yield h, g.row(CORRIDOR, n, alpha + D - n @ g.a_T)


def rows_of(g: Geometry):
    """Return barriers and rows in rank order, without the drift."""
    p, h, rows = g.p, np.full(5, RESTING), list(box_rows(g.p))
    if g.has_sphere:
        h[KEEP_OUT - 1], row = keep_out_row(g)
        rows.append(row)
    if g.has_speed:
        h[SPEED - 1], row = speed_row(g)
        rows += [row] if row else []
    if g.has_corridor:
        heights, faces = zip(*corridor_rows(g), strict=True)
        h[CORRIDOR - 1] = min(heights)
        rows += faces
    if p.plume_range > 0:
        h[PLUME - 1] = g.R - p.plume_range
    if p.plume_range > g.R:
        rows.append(Row(PLUME, -g.C_SN @ g.out, -p.plume_force))
    return h, rows


# ---- 3.4 drift ----
class Drift:
    """(18): points of the drift without force, and the matrices by which a force moves them."""

    def __init__(self, g: Geometry) -> None:
        p, P = g.p, g.P
        self.p = p
        n, K = norm(g.w_H), int(p.passive_points)
        x = g.C_HN @ (g.rho + P * g.v_H + P * P / 2 * g.a_H)
        v = g.C_HN @ (g.v_H + P * g.a_H)
        self.clear = p.keep_out_radius + p.passive_margin
        self.q, self.B = [], []
        for j in range(K + 1):
            rr, rv = clohessy_wiltshire(n, j * p.passive_time / K)
            self.q.append(rr @ x + rv @ v)
            self.B.append((P * P / 2 * rr + P * rv) @ g.C_HN @ g.C_SN.T / p.mass)
        self.q, self.B = np.array(self.q), np.array(self.B)

    def chords(self, u):
        """(19): nearest points of the chords, larger sags, margins."""
        q = self.q + self.B @ u
        inner = norm(q[:-2] - 2 * q[1:-1] + q[2:], axis=1) / 8
        sag = np.concatenate((inner[:1], inner, inner[-1:]))
        nearest = np.array([nearest_point(a, b) for a, b in pairwise(q)])
        larger = np.maximum(sag[:-1], sag[1:])
        return nearest, larger, norm(nearest, axis=1) - larger - self.clear

    def worst(self, u):
        """Return the least margin over both masses, and its chord."""
        each = [self.chords(u * k)[2] for k in self.lightest_and_heaviest()]
        least = min(each, key=np.min)
        return np.min(least), int(np.argmin(least))

    def lightest_and_heaviest(self):
        return 1 / (1 - self.p.mass_error), 1 / (1 + self.p.mass_error)

    def rows(self, f):
        """(20): rows of the two ends of chord f."""
        nearest, larger, _ = self.chords(np.zeros(3))
        n = nearest[f] / norm(nearest[f])
        for j in (f, f + 1):
            along = self.B[j].T @ n
            s = norm(along)
            if j == 0 or s < 1e-12:
                continue
            b = (self.clear + larger[f] - n @ self.q[j]) / s
            share = 1 + self.p.mass_error if b > 0 else 1 - self.p.mass_error
            yield Row(DRIFT, along / s, b * share)


def clohessy_wiltshire(n, t):
    """Return Phi_rr and Phi_rv."""
    if n == 0:
        return np.eye(3), t * np.eye(3)
    s, c = np.sin(n * t), np.cos(n * t)
    rr = np.array(((4 - 3 * c, 0, 0), (6 * (s - n * t), 1, 0), (0, 0, c)))
    rv = np.array(((s, 2 * (1 - c), 0), (2 * (c - 1), 4 * s - 3 * n * t, 0), (0, 0, s))) / n
    return rr, rv


def nearest_point(a, b):
    """Return the point of the chord a..b nearest to the origin."""
    along = b - a
    square = along @ along
    return a + along * np.clip(-(a @ along) / square, 0, 1) if square > 0 else a


# ---- 3.5 the nearest point ----
def nearest(rows, u_0, tol):
    """(21): return the point nearest to u_0, and the first row that the rows before exclude."""
    u = np.asarray(u_0, float)
    for i, row in enumerate(rows):
        if row.n @ u >= row.c - tol:
            continue
        u = on_plane(rows[:i], row, np.asarray(u_0, float), tol)
        if u is None:
            return None, i
    return u, None


def on_plane(before, row, u_0, tol):
    """Return the nearest point on the plane of a row that satisfies the rows before, or None."""
    p = u_0 + row.n * (row.c - row.n @ u_0)
    u = p
    for j, other in enumerate(before):
        if other.n @ u >= other.c - tol:
            continue
        u = on_line(before[:j], row, other, p, tol)
        if u is None:
            return None
    return u


def on_line(before, row, other, p, tol):
    h = other.n - row.n * (row.n @ other.n)
    square = h @ h
    if square < 1e-12:
        return None
    line, t = p + h * (other.c - other.n @ p) / square, cross(row.n, other.n)
    lo, hi = -1e30, 1e30
    for k in before:
        q, e = k.n @ t, k.c - k.n @ line
        if q * q < 1e-18 * square:
            if e > tol:
                return None
        elif q > 0:
            lo = max(lo, e / q)
        else:
            hi = min(hi, e / q)
    return None if lo > hi + tol else line + t * min(max(0, lo), hi)


# ---- 3.6 relaxation ----
class Program:
    """Rows with their relaxations."""

    def __init__(self, p, rows, command) -> None:
        self.p, self.rows, self.command = p, list(rows), np.asarray(command, float)
        self.tol = 1e-9 * norm(p.F_max)
        self.relaxed, self.failed = 0, set()

    def solve(self):
        u = None
        for _ in range(2 * len(self.rows) + 1):
            u, i = nearest(self.rows, self.command, self.tol)
            if i is None:
                break
            self.relax(i)
        return u

    def relax(self, i):
        row = self.rows[i]
        self.relaxed = self.relaxed or row.rule
        c = -1e30
        if i not in self.failed:
            far = 1e3 * norm(self.p.F_max) * row.n
            c = row.n @ nearest(self.rows[:i], far, self.tol)[0] - 2 * self.tol
        self.failed.add(i)
        self.rows[i] = replace(row, c=c)


def filtered(p, u: Inputs, P):
    """Return the answer of the ASIF."""
    g = Geometry(p, u, P)
    h, rows = rows_of(g)
    program = Program(p, rows, u.F_cmd_S)
    force = program.solve()
    if g.has_drift:
        drift = Drift(g)
        h[DRIFT - 1] = drift.chords(np.zeros(3))[2].min()
        for _ in range(4):
            least, f = drift.worst(force)
            if least >= 0:
                break
            program.rows += drift.rows(f)
            force = program.solve()
    same = np.array_equal(force, u.F_cmd_S)
    edge = (r.rule for r in program.rows if r.rule != BOX and r.n @ force <= r.c + 10 * program.tol)
    return Answer(
        force,
        PASSES if same else RELAXED if program.relaxed else FILTERED,
        0 if same else next(edge, BOX),
        int(not program.relaxed),
        program.relaxed,
        h,
    )


# ---- 4 simplex ----
def after_hold(g: Geometry, boxed):
    """(22): x_1, v_1, e and s/(2 a_B)."""
    p, P = g.p, g.P
    v, a = (g.v_T, g.a_T) if g.has_corridor else (g.v, g.g)
    force = g.C_SN.T @ boxed / p.mass
    x_1, v_1 = g.rho + P * v + P * P / 2 * (a + force), v + P * (a + force)
    D_s = p.a_dist + g.turn_S
    spread = norm(force) * p.mass_error
    s = norm(v_1) + p.velocity_error + P * (D_s + spread)
    e = p.position_error + P * P / 2 * (D_s + spread)
    a_b = min(p.brake_keep_out, p.brake_corridor) if g.has_corridor else p.brake_keep_out
    return x_1, v_1, e, s / (2 * a_b)


def stops(g: Geometry, boxed):
    """(23), (24): whether the servicer can stop straight ahead after one hold of a force."""
    p = g.p
    x_1, v_1, e, t = after_hold(g, boxed)
    gaps = []
    if g.has_sphere and p.filter == EXPLICIT:
        closing = min(x_1 @ v_1 / norm(x_1), 0)
        gaps.append(norm(x_1) - p.keep_out_radius - e + closing * t)
    if g.has_sphere and p.filter == IMPLICIT:
        gaps.append(norm(nearest_point(x_1, x_1 + v_1 * t)) - p.keep_out_radius - e)
    if g.has_corridor:
        x = x_1 - g.C_TN.T @ np.asarray(p.corridor_apex, float)
        for n_T, offset in pyramid(p):
            n = g.C_TN.T @ n_T
            closing = min(n @ v_1 - p.rate_error * g.R, 0)
            gaps.append(offset + n @ x - e - p.attitude_error * g.R + closing * t)
    return all(gap >= 0 for gap in gaps)


@dataclass
class Memory:
    """State of the switching filters."""

    backup: bool = False
    passed: float = 0


def switched(p, u: Inputs, P, memory: Memory):
    """Return the answer of the explicit or implicit simplex filter."""
    g = Geometry(p, u, P)
    h, rows = rows_of(g)
    most, tol = np.asarray(p.F_max, float), 1e-9 * norm(p.F_max)
    boxed = np.clip(u.F_cmd_S, -most, most)
    broken = next((r.rule for r in rows if r.n @ boxed < r.c - tol), 0)
    stop, drifts = stops(g, boxed), True
    if g.has_drift:
        drift = Drift(g)
        h[DRIFT - 1] = drift.chords(np.zeros(3))[2].min()
        drifts = drift.worst(boxed)[0] >= 0
    passes = not broken and stop and drifts
    memory.passed = memory.passed + P if passes and memory.backup else 0
    memory.backup = not passes or (memory.backup and memory.passed < p.dwell - 1e-9)
    if not memory.backup:
        same = np.array_equal(boxed, u.F_cmd_S)
        return Answer(boxed, PASSES if same else FILTERED, 0 if same else BOX, barrier=h)
    if not broken and stop and not drifts:
        return Answer(np.zeros(3), BACKUP, DRIFT, barrier=h)
    v, a = (g.v_T, g.a_T) if g.has_corridor else (g.v, g.g)
    brake = -p.mass * g.C_SN @ (v / P + a)
    return Answer(brake / max(1, np.max(np.abs(brake) / most)), BACKUP, broken, barrier=h)


# ---- the optimum by enumeration ----
def by_enumeration(rows, u_0, slack=1e-9):
    """Return the nearest point by trying every set of up to three active rows, or None."""
    N, c = np.array([r.n for r in rows]), np.array([r.c for r in rows])
    u_0 = np.asarray(u_0, float)
    best, least = None, np.inf
    for count in range(4):
        for chosen in map(list, combinations(range(len(rows)), count)):
            A = N[chosen]
            if count and np.linalg.svd(A, compute_uv=False)[-1] < 1e-9:
                continue
            step = A.T @ np.linalg.solve(A @ A.T, c[chosen] - A @ u_0) if count else np.zeros(3)
            u = u_0 + step
            if np.all(N @ u >= c - slack) and norm(step) < least:
                best, least = u, norm(step)
    return best
