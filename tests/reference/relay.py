# SPDX-License-Identifier: BSD-2-Clause
"""The relay approach of Kozlova & Fomichev as one program, written from docs/models.md B.

The coordinates of the paper: ISK, whose origin is the servicer at t = 0 (in orbit: a reference
point on a circular orbit, with the exact difference of gravity). The body velocity u is a state of
its own for the paper's kinematics; the required attitude is two turns, not a matrix; the shortest
arc is the half-way quaternion; thrusters are looped over with the printed recursion. Plain tuples
of floats: numpy on three numbers would cost minutes.

Row k of a history holds the plant at t_k and what the software and the propulsion unit made of the
tick before; row 0 is the start, before any tick.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import atan2, cos, exp, hypot, radians, sin, sqrt
from typing import Any

import numpy as np

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
COAST, ALIGN, BURN = 0, 1, 2
ENGINES = 13
MAIN = 12
"""index of P'5; the brakes P'1..P'4 are 8..11, the attitude thrusters P1..P8 are 0..7"""
# B.6: position from O [m], direction of the force
GEOMETRY: tuple[tuple[Vector, Vector], ...] = (
    ((-0.5, 1, 0), (0, -1, 0)),
    ((-0.5, 0, 1), (0, 0, -1)),
    ((-0.5, -1, 0), (0, 1, 0)),
    ((-0.5, 0, -1), (0, 0, 1)),
    ((0.5, 1, 0), (0, 0, -1)),
    ((0.5, 1, 0), (0, 0, 1)),
    ((0.5, -1, 0), (0, 0, 1)),
    ((0.5, -1, 0), (0, 0, -1)),
    ((1.5, 0.7, 0.7), (-1, 0, 0)),
    ((1.5, -0.7, 0.7), (-1, 0, 0)),
    ((1.5, -0.7, -0.7), (-1, 0, 0)),
    ((1.5, 0.7, -0.7), (-1, 0, 0)),
    ((-0.5, 0, 0), (1, 0, 0)),
)
CENTRE_OF_MASS = (0.5, 0.0, 0.0)
ROLL, PITCH, YAW = ((5, 7), (4, 6)), ((3,), (1,)), ((0,), (2,))
"""thrusters of positive and negative torque (P6,P8 / P5,P7; P4 / P2; P1 / P3)"""


@dataclass(frozen=True)
class Parameters:
    """The defaults are the parameter set `newton`."""

    kin: int = 1
    law: int = 1
    att: int = 1
    brake: float = 1.0
    main: float = 5.0
    attitude_thrust: float = 0.5
    mass: float = 1000.0
    J: float = 600.0
    T0: float = 0.1
    T2up: float = 0.3
    T2dn: float = 0.7
    Tl: float = 0.1
    latch: bool = False
    exact_lag: bool = False
    rho1: float = 4e-3
    rho2: float = 5e-3
    xi1: float = 3e-2
    xi2: float = 5e-2
    zeta1: float = 50.0
    zeta2: float = 10.0
    zhys: float = 0.0
    vlog: int = 0
    Kp_v: float = 1.0
    Kd_v: float = 0.8
    Kp_w: float = 50.0
    Kd_w: float = 40.0
    k_q: float = 0.02
    omega_max: float = 0.004
    k_r: float = 2e-3
    alpha_fire: float = radians(10)
    R0: float = 0.0
    """radius of the circular orbit of the reference point; 0 = no gravity"""
    mu: float = 3.986004415e14
    r_tar: Vector = (500.0, -100.0, 0.0)
    v_tar: Vector = (0.0, 0.008, 0.006)

    @property
    def nominal(self) -> list[float]:
        return [self.attitude_thrust] * 8 + [self.brake] * 4 + [self.main]


BN = Parameters()
BP = Parameters(kin=0, law=0, att=0, brake=10.0, main=50.0, k_q=0.05, omega_max=0.02)
BPZ = replace(BP, brake=1.0, main=5.0, zhys=1.0)
BG = replace(BN, R0=42164e3)


# ---- vectors and quaternions


def plus(a: Vector, b: Vector, k: float = 1.0) -> Vector:
    """a + k b"""
    return (a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2])


def dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def norm(a: Vector) -> float:
    return sqrt(dot(a, a))


def unit(a: Vector) -> Vector:
    n = norm(a)
    return (a[0] / n, a[1] / n, a[2] / n)


def times(p: Quaternion, q: Quaternion) -> Quaternion:
    a, b, c, d = p
    e, f, g, h = q
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    )


def conjugate(q: Quaternion) -> Quaternion:
    return (q[0], -q[1], -q[2], -q[3])


def turn(q: Quaternion, v: Vector) -> Vector:
    """v_ISK = q o v_SSK o q~"""
    return times(times(q, (0.0, *v)), conjugate(q))[1:]


# ---- B.4: guidance


def two_turns(q: Quaternion, d: Vector) -> Quaternion:
    """B.4.1: +b about X, then +g about the new Z brings X to d; the transition quaternion from the
    attitude q.
    """
    g, b = atan2(hypot(d[1], d[2]), d[0]), atan2(d[2], d[1]) if (d[1], d[2]) != (0, 0) else 0.0
    required = times((cos(b / 2), sin(b / 2), 0.0, 0.0), (cos(g / 2), 0.0, 0.0, sin(g / 2)))
    L = times(conjugate(q), required)
    return L if L[0] >= 0 else (-L[0], -L[1], -L[2], -L[3])


def shortest_arc(q: Quaternion, d: Vector) -> Quaternion:
    """B.4.2: the half-way quaternion 1 + X~ b, b the pointing vector in SSK."""
    b1, b2, b3 = turn(conjugate(q), unit(d))
    n = sqrt((1 + b1) ** 2 + b2 * b2 + b3 * b3)
    return ((1 + b1) / n, 0.0, -b3 / n, b2 / n) if n > 0 else (0.0, 0.0, 1.0, 0.0)


def required_rate(L: Quaternion, p: Parameters) -> Vector:
    k = 2 * p.k_q * min(1.0, p.omega_max / max(2 * p.k_q * norm(L[1:]), 1e-300))
    return (k * L[1], k * L[2], k * L[3])


class Guidance:
    """B.4: the only memory is the mode, the frozen direction, the time of ignition, and
    "far".
    """

    def __init__(self, p: Parameters) -> None:
        self.p, self.mode, self.ignition, self.frozen = p, COAST, 0, (1.0, 0.0, 0.0)
        self.far: bool | None = None

    def scalar_speed(self, distance: float, v_tar: float) -> float:
        """B.4.4"""
        p = self.p
        if self.far is None or p.zhys == 0:
            self.far = distance > p.zeta1
        elif distance > p.zeta1 + p.zhys:
            self.far = True
        elif distance <= p.zeta1 - p.zhys:
            self.far = False
        if self.far:
            return 2 * v_tar
        return v_tar if distance <= p.zeta2 or p.vlog else 0.5 * v_tar

    def velocity_error(self, dr: Vector, v: Vector, v_T: Vector) -> Vector:
        """B.4.5: v_r - v"""
        r, speed = norm(dr), norm(v_T)
        s = min(max(self.p.k_r * (r - self.p.zeta1), -speed), 2 * speed)
        return plus(plus(v_T, dr, s / r), v, -1.0)

    def modes(
        self, k: int, dr: Vector, e_v: Vector, X: Vector, omega: Vector, firing: bool
    ) -> Vector:
        """B.4.5, the three transitions in the printed order; returns the pointing vector"""
        p, d, error = self.p, dr, norm(e_v)
        if self.mode == COAST and error >= p.rho2:
            self.mode = ALIGN
        if self.mode == ALIGN:
            if error < p.rho1:
                self.mode = COAST
            else:
                d = unit(e_v) if dot(e_v, X) / error >= -0.01 else unit((-e_v[0], -e_v[1], -e_v[2]))
                if dot(d, X) > cos(p.alpha_fire) and norm(omega) < 2e-3:
                    self.mode, self.ignition, self.frozen = BURN, k, d
        if self.mode == BURN:
            d = self.frozen
            if k - self.ignition > 5 and not firing and abs(dot(e_v, X)) < p.rho2:
                self.mode, d = COAST, dr
        return d


# ---- B.5: relays


def relay(s: float, on: float, off: float, before: int, off_at_threshold: bool = False) -> int:
    if s >= on:
        return 1
    if s < off or (off_at_threshold and s == off):
        return 0
    return before


class Relays:
    def __init__(self, p: Parameters) -> None:
        self.p, self.flags = p, [0] * ENGINES
        self.dw: Vector | None = None
        self.speed: float | None = None

    def sigma_v(self, error: float, differentiated: float) -> float:
        """Kp_v error + Kd_v d(differentiated)/dt"""
        slope = 0.0 if self.speed is None else (differentiated - self.speed) / self.p.T0
        self.speed = differentiated
        return self.p.Kp_v * error + self.p.Kd_v * slope

    def sigma_w(self, dw: Vector) -> Vector:
        before, self.dw = self.dw or dw, dw
        p = self.p
        return tuple(p.Kp_w * a + p.Kd_w * (a - b) / p.T0 for a, b in zip(dw, before, strict=True))

    def switch(self, sigma_v: float, sigma_w: Vector) -> None:
        p, f = self.p, self.flags
        f[MAIN] = relay(sigma_v, p.rho2, p.rho1, f[MAIN], True)
        for i in range(8, 12):
            f[i] = relay(-sigma_v, p.rho2, p.rho1, f[i], True)
        for s, (positive, negative) in zip(sigma_w, (ROLL, PITCH, YAW), strict=True):
            for i in positive:
                f[i] = relay(s, p.xi2, p.xi1, f[i])
            for i in negative:
                f[i] = relay(-s, p.xi2, p.xi1, f[i])


# ---- B.6: propulsion unit


class Engines:
    def __init__(self, p: Parameters) -> None:
        self.p, self.nominal = p, p.nominal
        self.delayed, self.counter, self.thrust = [0.0] * ENGINES, [0] * ENGINES, [0.0] * ENGINES
        self.impulse, self.switches, self.was = [0.0] * ENGINES, [0] * ENGINES, [0] * ENGINES
        self.lever = [np.cross(np.subtract(L, CENTRE_OF_MASS), R).tolist() for L, R in GEOMETRY]

    def delay(self, i: int, cmd: float) -> None:
        ripe = self.counter[i] >= self.p.Tl / self.p.T0 - 1e-9
        if (cmd == self.delayed[i] and not self.p.latch) or ripe:
            self.delayed[i], self.counter[i] = cmd, 0
        else:
            self.counter[i] += 1

    def lag(self, i: int) -> None:
        p = self.p
        T2 = p.T2up if self.delayed[i] != 0 else p.T2dn
        part = p.T0 / T2 if T2 >= p.T0 else 1.0
        if p.exact_lag:
            part = 1 - exp(-p.T0 / T2) if T2 > 0 else 1.0
        self.thrust[i] += part * (self.delayed[i] - self.thrust[i])

    def call(self, flags: list[int]) -> tuple[Vector, Vector]:
        """One call; force and torque about the centre of mass, SSK."""
        for i, flag in enumerate(flags):
            self.delay(i, self.nominal[i] * flag)
            self.lag(i)
            self.impulse[i] += self.thrust[i] * self.p.T0
            self.switches[i] += flag > self.was[i]
            self.was[i] = flag
        return self.wrench()

    def wrench(self) -> tuple[Vector, Vector]:
        F, M = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
        for P, (_, R), lever in zip(self.thrust, GEOMETRY, self.lever, strict=True):
            F, M = plus(F, R, P), plus(M, lever, P)
        return F, M


# ---- B.2: plants


def tide(t: float, r: Vector, p: Parameters) -> Vector:
    """Gravity at displacement r from the reference point, less gravity at that point."""
    if not p.R0:
        return (0.0, 0.0, 0.0)
    n = sqrt(p.mu / p.R0**3)
    R = (p.R0 * cos(n * t), p.R0 * sin(n * t), 0.0)
    A = plus(R, r)
    return plus((0.0, 0.0, 0.0), plus(A, R, -((norm(A) / p.R0) ** 3)), -p.mu / norm(A) ** 3)


State = tuple[float, ...]
"""r, v (kin = 1, ISK) or u (kin = 0, SSK), L0, omega"""


def body_rate(t: float, y: State, F: Vector, M: Vector, p: Parameters) -> State:
    r, v, q, w = y[0:3], y[3:6], y[6:10], y[10:13]
    a = (F[0] / p.mass, F[1] / p.mass, F[2] / p.mass)
    dq = times(q, (0.0, 0.5 * w[0], 0.5 * w[1], 0.5 * w[2]))  # type: ignore[arg-type]
    dw = (M[0] / p.J, M[1] / p.J, M[2] / p.J)
    if p.kin:
        return (*v, *plus(turn(q, a), tide(t, r, p)), *dq, *dw)  # type: ignore[arg-type]
    return (*turn(q, v), *a, *dq, *dw)  # type: ignore[arg-type]


def rk4(f: Any, t: float, y: State, h: float) -> State:
    k1 = f(t, y)
    k2 = f(t + h / 2, [a + h / 2 * b for a, b in zip(y, k1, strict=True)])
    k3 = f(t + h / 2, [a + h / 2 * b for a, b in zip(y, k2, strict=True)])
    k4 = f(t + h, [a + h * b for a, b in zip(y, k3, strict=True)])
    return tuple(
        a + h / 6 * (b + 2 * c + 2 * d + e) for a, b, c, d, e in zip(y, k1, k2, k3, k4, strict=True)
    )


def move_target(t: float, y: State, p: Parameters) -> State:
    if p.R0:
        return rk4(lambda s, x: (*x[3:6], *tide(s, tuple(x[0:3]), p)), t, y, p.T0)
    return (*plus(y[0:3], y[3:6], p.T0), *y[3:6])  # type: ignore[arg-type]


# ---- the whole


class Mission:
    """One tick: measure, guidance, relays, propulsion unit, plants."""

    def __init__(self, p: Parameters) -> None:
        self.p, self.guidance, self.relays, self.engines = p, Guidance(p), Relays(p), Engines(p)
        self.servicer: State = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self.target: State = (*p.r_tar, *p.v_tar)
        self.sigma_v, self.sigma_w, self.L = 0.0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)

    @property
    def velocity(self) -> Vector:
        v, q = self.servicer[3:6], self.servicer[6:10]
        return v if self.p.kin else turn(q, v)  # type: ignore[return-value, arg-type]

    def firing(self) -> bool:
        """A translational flag, or a main engine or brake above 1 % of nominal, before this tick's
        update.
        """
        on = any(self.relays.flags[8:])
        return on or any(
            self.engines.thrust[i] > 0.01 * self.engines.nominal[i] for i in range(8, ENGINES)
        )

    def scalar(self, dr: Vector, v: Vector, X: Vector) -> Vector:
        v_x = dot(v, X)
        error = self.guidance.scalar_speed(norm(dr), norm(self.target[3:6])) - v_x
        self.sigma_v = self.relays.sigma_v(error, -v_x)
        return dr

    def vector(self, k: int, dr: Vector, v: Vector, X: Vector) -> Vector:
        e_v = self.guidance.velocity_error(dr, v, self.target[3:6])  # type: ignore[arg-type]
        d = self.guidance.modes(k, dr, e_v, X, self.servicer[10:13], self.firing())
        sigma_v = self.relays.sigma_v(dot(e_v, X), dot(e_v, X))
        self.sigma_v = sigma_v if self.guidance.mode == BURN else 0.0
        return d

    def tick(self, k: int) -> None:
        p, q, w = self.p, self.servicer[6:10], self.servicer[10:13]
        dr, v = plus(self.target[0:3], self.servicer[0:3], -1.0), self.velocity
        X = turn(q, (1.0, 0.0, 0.0))  # type: ignore[arg-type]
        d = self.vector(k, dr, v, X) if p.law else self.scalar(dr, v, X)
        self.L = shortest_arc(q, d) if p.att else two_turns(q, d)  # type: ignore[arg-type]
        self.sigma_w = self.relays.sigma_w(plus(required_rate(self.L, p), w, -1.0))
        self.relays.switch(self.sigma_v, self.sigma_w)
        F, M = self.engines.call(self.relays.flags)
        self.servicer = rk4(lambda t, y: body_rate(t, y, F, M, p), k * p.T0, self.servicer, p.T0)
        self.target = move_target(k * p.T0, self.target, p)

    def row(self) -> list[float]:
        e = self.engines
        body = (*self.servicer[0:3], *self.velocity, *self.servicer[6:13], *self.target)
        engines = (*self.relays.flags, *e.thrust, *e.impulse, *e.switches)
        return [*body, *engines, self.guidance.mode, self.sigma_v, *self.sigma_w, *self.L]


PLANTS = {"r_S": 3, "v_S": 3, "q_S": 4, "omega_S": 3, "r_T": 3, "v_T": 3}
UNITS = {"flags": ENGINES, "thrust": ENGINES, "impulse": ENGINES, "switches": ENGINES}
LAYOUT = {**PLANTS, **UNITS, "mode": 1, "sigma_v": 1, "sigma_w": 3, "L": 4}


def run(p: Parameters = BN, stop: float = 40000.0, every: int = 1) -> dict[str, Any]:
    """Histories by name, one row every `every` ticks, and `time`."""
    mission, steps = Mission(p), round(stop / p.T0)
    rows = [mission.row()]
    for k in range(steps):
        mission.tick(k)
        if (k + 1) % every == 0:
            rows.append(mission.row())
    table = np.array(rows)
    ends = np.cumsum(list(LAYOUT.values()))
    columns = {
        name: table[:, end - size : end]
        for (name, size), end in zip(LAYOUT.items(), ends, strict=True)
    }
    return {"time": p.T0 * every * np.arange(len(rows)), **columns}
