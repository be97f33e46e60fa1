# SPDX-License-Identifier: BSD-2-Clause
"""Prescribed performance and PID control in line-of-sight coordinates: docs/models.md C.1
and C.3 to C.5.

Fields of the parameter classes bear the names of the ports: settings() of one of them is a
parameter set of the FMU.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from math import exp, log
from typing import Any, NamedTuple

import numpy as np

from . import attitude
from .attitude import Array
from .body import Body
from .jet import Jet
from .los import ZERO3, Los, line_of_sight, wrapped

SIGMA = np.diag((-1.0, -1.0, 1.0))


def settings(p: Any) -> dict[str, Any]:
    """Parameters by the names of the FMU; records become nested dictionaries."""

    def renamed(value: Any) -> Any:
        return (
            {k.rstrip("_"): renamed(v) for k, v in value.items()}
            if isinstance(value, dict)
            else value
        )

    result: dict[str, Any] = renamed(asdict(p))
    return result


# ---- what the controllers share (C.1, C.3, C.4) ----


@dataclass(frozen=True)
class Common:
    M_max: Sequence[float] = (10.0, 10.0, 10.0)
    up_axis: float = 2.0
    a_max: float = 4.9
    force_scale: float = 100.0
    use_wheels: float = 0.0
    t_att: float = 0.0


class Error(NamedTuple):
    now: Los
    ref: Los
    x1: Array
    x2: Array
    q_SD: Array
    w: Array
    wd: Array
    wdd: Array
    C_SN: Array


def errors(T: Body, S: Body, ref: Mapping[str, Any], up_axis: float) -> Error:
    now = line_of_sight(Jet(T.r - S.r, T.v - S.v, ZERO3), up_axis)
    required = line_of_sight(
        Jet(-ref["rho_ref_N"], -ref["drho_ref_N"], -ref["ddrho_ref_N"]), up_axis
    )
    x1 = now.q.x - required.q.x
    x1[2] = wrapped(x1[2])
    q_SD = attitude.positive(attitude.multiply(attitude.conjugate(ref["q_DN"]), S.q))
    C_SD = attitude.dcm(q_SD)
    wd, wdd = C_SD @ ref["omega_DN_D"], C_SD @ ref["alpha_DN_D"]
    C_SN = attitude.dcm(S.q)
    return Error(now, required, x1, now.q.d - required.q.d, q_SD, S.omega - wd, wd, wdd, C_SN)


def T_matrix(q: Array) -> Array:
    """dq_vec/dt = T(q) w / 2, from the vector part of the Hamilton product q (x) [0, w]."""
    return np.array([attitude.multiply(q, (0.0, *e))[1:] for e in np.eye(3)]).T


def limited(a: Array, limit: Any) -> Array:
    bound = np.broadcast_to(np.asarray(limit, dtype=float), 3)
    return np.where(bound > 0, np.clip(a, -bound, bound), a)


def command(t: float, e: Error, u: Array, M: Array, A_w: Array, p: Common) -> dict[str, Any]:
    """Generalised control and torque of a law, limited and turned into the command ports."""
    a_L = limited(SIGMA @ u, p.a_max)
    M = limited(M, p.M_max) if t >= p.t_att - 1e-9 else ZERO3
    return {
        "F_cmd_S": p.force_scale * e.C_SN @ e.now.C_LN.T @ a_L,
        "M_cmd_S": ZERO3 if p.use_wheels else M,
        "wheel_accel_cmd": -np.linalg.solve(A_w, M) if p.use_wheels else ZERO3,
        "a_cmd_L": a_L,
        "error": e.x1,
        "derror": e.x2,
        "domega_S": e.w,
    }


# ---- prescribed performance (C.4) ----


@dataclass(frozen=True)
class Channel:
    k: float
    eta: float
    lambda_: float
    alpha_0: float
    alpha_inf: float
    beta: float
    delta: float = 1.0


@dataclass(frozen=True)
class Ppc(Common):
    wheel_scale: float = 10.0
    law: float = 2.0
    law_att: float = 2.0
    range: Channel = Channel(15.0, 0.1, 4.3, 600.0, 0.5, 0.2)
    elevation: Channel = Channel(300.0, 0.1, 4.0, 0.8, 0.03, 0.2)
    azimuth: Channel = Channel(300.0, 0.1, 4.0, 0.8, 0.03, 0.2)
    attitude: Channel = Channel(800.0, 0.1, 1.5, 1.5, 0.01, 0.25)


class Funnel(NamedTuple):
    """Decided at activation: time, and per channel whether the generalised state started at or
    above zero.
    """

    t_0: float
    rising: tuple[bool, ...]


def bound(c: Channel, age: float) -> float:
    return (c.alpha_0 - c.alpha_inf) * exp(-c.beta * age) + c.alpha_inf


def barrier(
    cs: Sequence[Channel], law: float, z: Array, funnel: Funnel, t: float
) -> tuple[Array, dict[str, Any]]:
    u, theta, s, alpha = (np.empty(3) for _ in range(4))
    inside = True
    for i, c in enumerate(cs):
        low, high = (-c.delta, 1.0) if funnel.rising[i] else (-1.0, c.delta)
        alpha[i] = bound(c, t - funnel.t_0)
        theta[i] = z[i] / alpha[i]
        inside = inside and low < theta[i] < high
        x = min(max(theta[i], low + 1e-3 * (high - low)), high - 1e-3 * (high - low))
        s[i] = log((x - low) / (high - x))
        r = (1 / (x - low) + 1 / (high - x)) / alpha[i]  # dP/dtheta / alpha
        shape = {0: r, 1: 1 / r, 2: (alpha[i] * (high - low) / 4) ** 2 * r}[int(law)]
        u[i] = -c.k * c.eta * shape * s[i]
    kappa = float(sum(c.eta * x**2 for c, x in zip(cs, s, strict=True)))
    telemetry = {"z": z, "theta": theta, "s": s, "alpha": alpha, "kappa": kappa}
    telemetry["violation"] = float(not inside or kappa >= 1)
    return u / (1 - min(kappa, 0.98)), telemetry


def generalised(e: Error, p: Ppc) -> tuple[Array, Array]:
    """z of position and attitude."""
    position = np.array([c.lambda_ for c in (p.range, p.elevation, p.azimuth)])
    return e.x1 + position * e.x2, e.q_SD[1:] + p.attitude.lambda_ * 0.5 * T_matrix(e.q_SD) @ e.w


PpcState = tuple[Funnel | None, Funnel | None]


def ppc(
    t: float, T: Body, S: Body, ref: Mapping[str, Any], x: PpcState, p: Ppc
) -> tuple[dict[str, Any], PpcState]:
    e = errors(T, S, ref, p.up_axis)
    z, z_att = generalised(e, p)
    active = t >= p.t_att - 1e-9
    position = x[0] or Funnel(t, tuple(z >= 0))
    turning = x[1] or Funnel(t, tuple(z_att >= 0))
    u, telemetry = barrier((p.range, p.elevation, p.azimuth), p.law, z, position, t)
    u_att, telemetry_att = barrier((p.attitude,) * 3, p.law_att, z_att, turning, t)
    M = T_matrix(e.q_SD).T @ u_att
    outputs = command(t, e, u, M, p.wheel_scale * np.eye(3), p) | telemetry
    outputs |= {f"{name}_att": value for name, value in telemetry_att.items()}
    return outputs, (position, turning if active else None)


# ---- PID (C.5) ----


@dataclass(frozen=True)
class Gains:
    Kp: float
    Ki: float
    Kd: float
    T_aw: float
    """1/(Ki k_aw) of the specification"""


@dataclass(frozen=True)
class Pid(Common):
    wheel_scale: float = 10.0
    range: Gains = Gains(0.4, 0.024, 2.0, 1 / (0.024 * 10.0))
    elevation: Gains = Gains(20.0, 4.0, 48.0, 1 / (4.0 * 10.0))
    azimuth: Gains = Gains(20.0, 4.0, 48.0, 1 / (4.0 * 10.0))
    attitude: Gains = Gains(40.0, 2.0, 60.0, 1 / (2.0 * 0.05))


def pid_law(gs: Sequence[Gains], e: Array, integral: Array, de: Array) -> Array:
    return -np.array(
        [g.Kp * a + g.Ki * b + g.Kd * c for g, a, b, c in zip(gs, e, integral, de, strict=True)]
    )


def integrated(
    gs: Sequence[Gains], integral: Array, e: Array, excess: Array, period: float
) -> Array:
    """Euler; the back-calculation of one sample moves Ki times the integral by no more than the
    excess.
    """
    k_aw = np.array([1 / (g.Ki * g.T_aw) for g in gs])
    back = np.minimum(k_aw * period, [1 / g.Ki for g in gs])
    return integral + period * e + back * excess


PidState = tuple[Array, Array]


def pid(
    t: float, T: Body, S: Body, ref: Mapping[str, Any], x: PidState, p: Pid, period: float
) -> tuple[dict[str, Any], PidState]:
    e = errors(T, S, ref, p.up_axis)
    gs, gs_att = (p.range, p.elevation, p.azimuth), (p.attitude,) * 3
    u, M = pid_law(gs, e.x1, x[0], e.x2), pid_law(gs_att, e.q_SD[1:], x[1], e.w)
    outputs = command(t, e, u, M, p.wheel_scale * np.eye(3), p)
    position = integrated(gs, x[0], e.x1, u - limited(u, p.a_max), period)
    active = t >= p.t_att - 1e-9
    turning = (
        integrated(gs_att, x[1], e.q_SD[1:], M - limited(M, p.M_max), period) if active else x[1]
    )
    return outputs | {"integral": position, "integral_att": turning}, (position, turning)
