# SPDX-License-Identifier: BSD-2-Clause
"""The docking mechanism, derived apart from its C: absolute motion of two bodies with rotation
matrices, an adaptive integrator, contact by distances to lines, the latch by its potential.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from .attitude import cross

PARAMETERS = {
    "mass_S": 100.0, "J_S": np.diag((200.0, 250, 150)),
    "mass_T": 150.0, "J_T": np.diag((100.0, 150, 90)),
    "p_PS_S": np.array((1.1, 0, 0)), "q_PS": np.array((1.0, 0, 0, 0)),
    "p_QT_T": np.array((0.6, 0, 0)), "q_QT": np.array((1.0, 0, 0, 0)),
    "mouth_radius": 0.08, "floor_radius": 0.01, "cone_depth": 0.12,
    "face_radius": 0.15, "depth_max": 0.02,
    "k_contact": 1e5, "n_contact": 1.5, "damping_contact": 40.0,
    "friction": 0.1, "friction_speed": 1e-3,
    "k_soft": 100.0, "c_soft": 120.0, "k_rot_soft": 40.0, "c_rot_soft": 60.0,
    "k_hard": 20000.0, "c_hard": 110.0, "k_rot_hard": 20000.0, "c_rot_hard": 140.0,
    "draw_delay": 10.0, "draw_time": 20.0,
    "k_sep": 60.0, "stroke_sep": 0.05,
    "latch_depth": 0.11, "latch_offset": 0.02, "latch_angle": 0.0873,
    "latch_speed": 0.06, "latch_rate": 0.035, "latch_dwell": 0.1, "trip_force": 3.0,
    "hard_distance": 0.002, "hard_angle": 0.01, "hard_speed": 0.002, "hard_rate": 0.002,
    "break_force": 200.0, "break_moment": 100.0, "latency": 0.0, "max_step": 1e-3,
}  # fmt: skip
FREE, CONTACT, SOFT, HARD, RELEASED, BROKEN = range(6)


def rotation(q):
    """Body to N, of a quaternion with the scalar first."""
    return Rotation.from_quat(np.roll(np.asarray(q, float), -1))


def quaternion(turn):
    """Scalar first, scalar part not negative."""
    q = np.roll(turn.as_quat(), 1)
    return q if q[0] >= 0 else -q


@dataclass
class Bodies:
    """Positions and velocities in N, attitudes as Rotation body to N, rates in body axes."""

    r: dict
    v: dict
    turn: dict
    omega: dict

    def inputs(self):
        """As they are on the wires."""
        return {
            name: value
            for x in "ST"
            for name, value in (
                (f"r_{x}N_N", self.r[x]),
                (f"v_{x}N_N", self.v[x]),
                (f"q_{x}N", quaternion(self.turn[x])),
                (f"omega_{x}N_{x}", self.omega[x]),
            )
        }

    def flat(self):
        parts = [np.r_[self.r[x], self.v[x], self.turn[x].as_quat(), self.omega[x]] for x in "ST"]
        return np.concatenate(parts)

    @classmethod
    def of(cls, y):
        parts = {"S": y[:13], "T": y[13:26]}
        return cls(
            {x: p[:3] for x, p in parts.items()},
            {x: p[3:6] for x, p in parts.items()},
            {x: Rotation.from_quat(p[6:10]) for x, p in parts.items()},
            {x: p[10:13] for x, p in parts.items()},
        )

    def moved(self, turn, shift):
        """The same situation, moved and turned as a whole."""
        return Bodies(
            {x: turn.apply(self.r[x]) + shift for x in "ST"},
            {x: turn.apply(self.v[x]) for x in "ST"},
            {x: turn * self.turn[x] for x in "ST"},
            dict(self.omega),
        )


@dataclass
class Ports:
    """Relative motion of the ports: tip from both centres of mass (N), e, u, w, P to Q (Q axes)."""

    d_S: np.ndarray
    d_T: np.ndarray
    e: np.ndarray
    u: np.ndarray
    w: np.ndarray
    P_to_Q: Rotation
    Q_to_N: Rotation


def ports(p, b):
    tip = b.r["S"] + b.turn["S"].apply(p["p_PS_S"])
    mouth = b.r["T"] + b.turn["T"].apply(p["p_QT_T"])
    w = {x: b.turn[x].apply(b.omega[x]) for x in "ST"}
    Q_to_N = b.turn["T"] * rotation(p["q_QT"])
    P_to_N = b.turn["S"] * rotation(p["q_PS"])
    # velocity of the tip less the velocity of the material point of T at the same place
    at_tip = {x: b.v[x] + cross(w[x], tip - b.r[x]) for x in "ST"}
    to_Q = Q_to_N.inv()
    return Ports(
        tip - b.r["S"],
        tip - b.r["T"],
        to_Q.apply(tip - mouth),
        to_Q.apply(at_tip["S"] - at_tip["T"]),
        to_Q.apply(w["S"] - w["T"]),
        to_Q * P_to_N,
        Q_to_N,
    )


# ---- contact: distances in the plane through the axis and the tip


def contacts(p, e):
    """(depth, unit normal) of each contact, None where the tip is too deep."""
    x, r = e[0], np.hypot(e[1], e[2])
    out = np.array((0, *e[1:])) / r if r > 1e-12 else np.array((0.0, 1, 0))
    if x >= 0 or r >= p["face_radius"]:
        return []
    floor_end = np.array((-p["cone_depth"], p["floor_radius"]))
    mouth_end = np.array((0.0, p["mouth_radius"]))
    along = (mouth_end - floor_end) / np.linalg.norm(mouth_end - floor_end)
    inwards = np.array((along[1], -along[0]))  # out of the material: towards the axis, forwards
    wall = -inwards @ (np.array((x, r)) - floor_end)
    found = []
    if wall > 0:
        slanted = inwards[0] * np.array((1.0, 0, 0)) + inwards[1] * out
        found.append((wall, slanted) if wall <= -x else (-x, np.array((1.0, 0, 0))))
    if -p["cone_depth"] - x > 0:
        found.append((-p["cone_depth"] - x, np.array((1.0, 0, 0))))
    return None if any(d > p["depth_max"] for d, _ in found) else found


def contact(p, e, u):
    """Force (Q), stored energy, power lost, sum of normal forces."""
    F, U, lost, normal = np.zeros(3), 0.0, 0.0, 0.0
    for d, n in contacts(p, e) or ():
        spring = p["k_contact"] * d ** p["n_contact"]
        F_n = max(0.0, spring * (1 - p["damping_contact"] * (u @ n)))
        slip = u - (u @ n) * n
        rub = -p["friction"] * F_n * slip / np.sqrt(slip @ slip + p["friction_speed"] ** 2)
        F = F + F_n * n + rub
        U += spring * d / (p["n_contact"] + 1)
        lost += -(F_n - spring) * (u @ n) - rub @ slip
        normal += F_n
    return F, U, lost, normal


# ---- latch


@dataclass
class Memory:
    phase: int = FREE
    t_phase: float = 0.0
    e_c: np.ndarray = field(default_factory=lambda: np.zeros(3))
    rest: Rotation = field(default_factory=Rotation.identity)


def caught(p, s, phase, t):
    """Values stored at a change of phase. Rest: the probe turned by the shortest arc."""
    axis = s.P_to_Q.apply((1, 0, 0))
    normal, angle = cross(axis, (-1, 0, 0)), np.arccos(np.clip(-axis[0], -1, 1))
    size = np.linalg.norm(normal)
    arc = Rotation.from_rotvec(angle * normal / size) if size > 0 else Rotation.identity()
    return Memory(phase, t, s.e.copy(), arc * s.P_to_Q)


def drawn(p, m, t):
    """Rest point and its velocity."""
    seat = np.array((-p["cone_depth"], 0, 0))
    if m.phase == HARD:
        return seat, np.zeros(3)
    x = np.clip((t - m.t_phase - p["draw_delay"]) / p["draw_time"], 0, 1)
    s, ds = np.polyval((6, -15, 10, 0, 0, 0), x), np.polyval((30, -60, 30, 0, 0), x)
    return m.e_c + s * (seat - m.e_c), ds / p["draw_time"] * (seat - m.e_c)


def latch_energy(p, m, e, P_to_Q, t):
    name = "soft" if m.phase == SOFT else "hard"
    angle = (P_to_Q * m.rest.inv()).magnitude()
    stretch = e - drawn(p, m, t)[0]
    return p[f"k_{name}"] * stretch @ stretch / 2 + 8 * p[f"k_rot_{name}"] * np.tan(angle / 4) ** 2


def latch(p, m, s, t):
    """Force and couple (Q), stored energy, power lost and put in."""
    name = "soft" if m.phase == SOFT else "hard"
    k, c, k_r, c_r = (p[f"{x}_{name}"] for x in ("k", "c", "k_rot", "c_rot"))
    e_r, de_r = drawn(p, m, t)
    phi = (s.P_to_Q * m.rest.inv()).as_rotvec()
    angle = np.linalg.norm(phi)
    # dU/dangle = 4 k_r tan(angle/4) sec(angle/4)^2, along the axis of the turn
    slope = 4 * k_r * np.tan(angle / 4) / np.cos(angle / 4) ** 2
    M = -slope * phi / angle if angle > 0 else np.zeros(3)
    F = -k * (s.e - e_r) - c * (s.u - de_r)
    U = latch_energy(p, m, s.e, s.P_to_Q, t)
    lost = c * (s.u - de_r) @ (s.u - de_r) + c_r * s.w @ s.w
    return F, M - c_r * s.w, U, lost, F @ de_r


def load(p, m, s, t):
    """F, M (Q), U, P_diss, P_drive, sum of normal forces."""
    if m.phase in (SOFT, HARD):
        return *latch(p, m, s, t), 0.0
    F, U, lost, normal = contact(p, s.e, s.u)
    if m.phase == RELEASED:
        push = max(0.0, p["stroke_sep"] - (s.e[0] - m.e_c[0]))
        F = F + np.array((p["k_sep"] * push, 0, 0))
        U += p["k_sep"] * push**2 / 2
    return F, np.zeros(3), U, lost, 0.0, normal


# ---- prediction


def motion(p, b, h, wrench_at, t=0.0, extra=0):
    """Both bodies over h under forces and torques in N axes; further integrals behind them."""

    def rate(time, y):
        now = Bodies.of(y[:26])
        forces, torques, more = wrench_at(now, time)
        parts = []
        for x in "ST":
            J, w = p[f"J_{x}"], now.omega[x]
            torque = now.turn[x].inv().apply(torques[x])
            q = y[:26].reshape(2, 13)["ST".index(x), 6:10]
            dq = np.r_[q[3] * w + cross(q[:3], w), -q[:3] @ w] / 2
            dw = np.linalg.solve(J, torque - cross(w, J @ w))
            parts.append(np.r_[now.v[x], forces[x] / p[f"mass_{x}"], dq, dw])
        return np.concatenate((*parts, more))

    start = np.r_[b.flat(), np.zeros(extra)]
    found = solve_ivp(rate, (t, t + h), start, method="DOP853", rtol=1e-13, atol=1e-15)
    return Bodies.of(found.y[:26, -1]), found.y[26:, -1]


def step(p, m, b, t, h, held=None):
    """Outputs of one step from t with the phase held. held: wrench in force (F, M_S, M_T in N),
    with which the bodies are first carried over h (latency 1).
    """
    if held is not None:
        F, M_S, M_T = held
        b, _ = motion(p, b, h, lambda *_: ({"S": F, "T": -F}, {"S": M_S, "T": M_T}, ()))
        t = t + h

    def acting(now, time):
        s = ports(p, now)
        F, M, _, lost, driven, _ = load(p, m, s, time)
        F, M = s.Q_to_N.apply(F), s.Q_to_N.apply(M)
        on_S, on_T = cross(s.d_S, F) + M, -cross(s.d_T, F) - M
        more = np.r_[F, on_S, on_T, M, lost, driven]
        return {"S": F, "T": -F}, {"S": on_S, "T": on_T}, more

    end, integrals = motion(p, b, h, acting, t, 14)
    F, M_S, M_T, couple = integrals[:12].reshape(4, 3) / h
    m_red = p["mass_S"] * p["mass_T"] / (p["mass_S"] + p["mass_T"])
    rho, drho = b.r["S"] - b.r["T"], b.v["S"] - b.v["T"]
    # mean over the step of rho + drho s + F s^2/(2 m_red)
    line = rho + drho * h / 2 + F * h**2 / (6 * m_red)
    gap = M_S + M_T + cross(line, F)
    M_S, M_T = M_S - gap / 2, M_T - gap / 2
    mean = {}
    for x in "ST":
        a = h * (2 * b.omega[x] + end.omega[x]) / 6
        sigma = a / 4
        half = np.r_[2 * sigma, 1 - sigma @ sigma] / (1 + sigma @ sigma)
        mean[x] = (b.turn[x] * Rotation.from_quat(half)).inv()
    return {
        "F_contact_S": mean["S"].apply(F),
        "M_contact_S": mean["S"].apply(M_S),
        "F_T": mean["T"].apply(-F),
        "M_T": mean["T"].apply(M_T),
        "load_force": np.linalg.norm(F),
        "load_moment": np.linalg.norm(couple),
        "energy_elastic": load(p, m, ports(p, end), t + h)[2],
        "lost": integrals[12],
        "driven": integrals[13],
        "wrench": (F, M_S, M_T),
        "end": end,
    }
