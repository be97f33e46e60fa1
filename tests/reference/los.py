# SPDX-License-Identifier: BSD-2-Clause
"""Line-of-sight (LOS) coordinates, guidance that hovers in front of a feature (docs/models.md C.1
to C.3).

Angles are differentiated through sin(elevation) and tan(azimuth), attitude rates come from jets of
direction cosines.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, pi, sin, sqrt
from typing import Any, NamedTuple

import numpy as np

from . import attitude, guidance, jet
from .attitude import Array
from .body import Body
from .jet import Jet
from .orbit import central_gravity

ZERO3 = np.zeros(3)


# ---- line of sight (C.1) ----


class Los(NamedTuple):
    """(range, elevation, azimuth) with two derivatives, and the triad as rows of C_LN."""

    q: Jet
    C_LN: Array

    @property
    def ce(self) -> float:
        return cos(self.q.x[1])

    @property
    def se(self) -> float:
        return sin(self.q.x[1])


def triad(elevation: float, azimuth: float, up_axis: float = 2) -> Array:
    """Rows x_l, y_l, z_l: derivatives of the unit vector, made with up = second axis and rolled
    into place.
    """
    ce, se, cb, sb = cos(elevation), sin(elevation), cos(azimuth), sin(azimuth)
    x_l, y_l = (ce * cb, se, -ce * sb), (-se * cb, ce, se * sb)
    return np.array(
        [np.roll(row, int(up_axis) - 2) for row in (x_l, y_l, attitude.cross(x_l, y_l))]
    )


def line_of_sight(r: Jet, up_axis: float = 2) -> Los:
    a = Jet(*(np.roll(part, 2 - int(up_axis)) for part in r))
    rho = jet.power(jet.dot(a, a), 0.5)
    unit = jet.unit(a)
    x, y, z = (Jet(*(part[i] for part in unit)) for i in range(3))
    elevation = np.arctan2(y.x, sqrt(x.x**2 + z.x**2))
    ce = sqrt(x.x**2 + z.x**2)
    d_el = y.d / ce  # d sin(el) = cos(el) d el
    dd_el = (y.dd + y.x * d_el**2) / ce
    n, h = x.d * z.x - z.d * x.x, ce**2  # d az = n/h
    dn, dh = x.dd * z.x - z.dd * x.x, 2 * (x.x * x.d + z.x * z.d)
    azimuth = np.arctan2(-z.x, x.x)
    q = Jet(
        np.array((rho.x, elevation, azimuth)),
        np.array((rho.d, d_el, n / h)),
        np.array((rho.dd, dd_el, (dn - n / h * dh) / h)),
    )
    return Los(q, triad(elevation, azimuth, up_axis))


def inertial(q: Array, dq: Array, up_axis: float = 2) -> tuple[Array, Array]:
    """r and v of LOS coordinates and rates (C.1, the way back)."""
    x_l, y_l, z_l = triad(q[1], q[2], up_axis)
    v = dq[0] * x_l + q[0] * dq[1] * y_l - q[0] * cos(q[1]) * dq[2] * z_l
    return q[0] * x_l, v


def wrapped(angle: float) -> float:
    """In (-pi, pi]."""
    return -((-angle + pi) % (2 * pi) - pi)


def kinematic_acceleration(q: Array, dq: Array) -> Array:
    """Second derivatives of (range, elevation, azimuth) in free motion without gravity (section
    1.2).
    """
    rho, e = q[0], q[1]
    return np.array(
        (
            rho * (dq[1] ** 2 + (dq[2] * cos(e)) ** 2),
            -2 * dq[0] * dq[1] / rho - dq[2] ** 2 * sin(e) * cos(e),
            -2 * dq[0] * dq[2] / rho + 2 * dq[1] * dq[2] * sin(e) / cos(e),
        )
    )


# ---- guidance (C.2, C.3) ----


@dataclass(frozen=True)
class Guidance:
    mu: float = 3.986004418e14
    J_T: Any = ((100.0, 0.0, 0.0), (0.0, 150.0, 0.0), (0.0, 0.0, 90.0))
    use_gravity_gradient: float = 0.0
    p_T: Sequence[float] = (1.0, 0.0, 0.0)
    sun_N: Sequence[float] = (0.3, 0.9, 0.3)
    rho_f: float = 20.0
    force_scale: float = 100.0
    up_axis: float = 2.0
    guard_angle: float = 1e-3


class Held(NamedTuple):
    """Panel axis of the last sample outside the guard, quaternion of the last sample."""

    y_N: Array | None = None
    q_DN: Array | None = None


def feature(T: Body, p: Guidance) -> Jet:
    """rho_ref as seen in N; the target's attitude model equals the other guidance's."""
    model = guidance.Parameters(mu=p.mu, J_T=p.J_T, use_gravity_gradient=p.use_gravity_gradient)
    return guidance.target_frame(0.0, T, model) @ jet.constant(
        p.rho_f * np.array(p.p_T, dtype=float)
    )


def relative_motion(T: Body, S: Body, F_cmd_S: Array, p: Guidance) -> Jet:
    """r_TN - r_SN with the acceleration that the software expects."""
    free = central_gravity(T.r, p.mu) - central_gravity(S.r, p.mu) if p.mu else ZERO3
    return Jet(T.r - S.r, T.v - S.v, free - attitude.dcm(S.q).T @ F_cmd_S / p.force_scale)


def camera_frame(r: Jet, held: Held, p: Guidance) -> tuple[Jet, bool]:
    chi = jet.constant(np.array(p.sun_N) / np.linalg.norm(p.sun_N))
    x = jet.unit(r)
    across = jet.cross(chi, x)
    guarded = bool(np.linalg.norm(across.x) < sin(p.guard_angle))
    if guarded:
        y_held = jet.constant(held.y_N)
        across = y_held - jet.dot(y_held, x) * x
    y = jet.unit(across)
    return jet.rows(x, y, jet.cross(x, y)), guarded


NOTHING = Held()


def guide(
    T: Body, S: Body, F_cmd_S: Array, p: Guidance, held: Held = NOTHING
) -> tuple[dict[str, Any], Held]:
    ref, r = feature(T, p), relative_motion(T, S, F_cmd_S, p)
    C_DN, guarded = camera_frame(r, held, p)
    q_DN = attitude.quaternion_of_dcm(C_DN.x)
    if held.q_DN is not None and q_DN @ held.q_DN < 0:
        q_DN = -q_DN
    omega, alpha = attitude.angular_rates(*C_DN)
    los, los_ref = line_of_sight(r, p.up_axis), line_of_sight(-ref, p.up_axis)
    outputs = {
        "rho_ref_N": ref.x,
        "drho_ref_N": ref.d,
        "ddrho_ref_N": ref.dd,
        "q_DN": q_DN,
        "omega_DN_D": omega,
        "alpha_DN_D": alpha,
        "range": los.q.x[0],
        "los": los.q.x,
        "dlos": los.q.d,
        "los_ref": los_ref.q.x,
        "dlos_ref": los_ref.q.d,
        "ddlos_ref": los_ref.q.dd,
        "beta_t": attitude.angle_between(-r.x, ref.x),
        "beta_p": attitude.angle_between(attitude.dcm(S.q)[0], r.x),
        "attitude_guard": float(guarded),
    }
    return outputs, Held(held.y_N if guarded else C_DN.x[1], q_DN)
