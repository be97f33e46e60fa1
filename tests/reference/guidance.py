# SPDX-License-Identifier: BSD-2-Clause
"""Reference of the synchronised approach: a shrinking radius along the grasp axis, and the attitude
that faces it.

    rho_ref = L(t) p,  L = rho_M - (rho_M - rho_0) exp(-beta t),  p = grasp axis of the target
    D: x = -p,  z = x cross (orbit normal) made a unit vector,  y = z cross x

All derivatives are jets of these lines: the target's attitude moves by its known torques, its orbit
is Keplerian.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import exp, radians, sin
from typing import Any

import numpy as np

from . import attitude, jet
from .attitude import Array
from .body import IDENTITY, Body
from .jet import Jet
from .orbit import gravity_gradient_torque, hill_frame
from .sinusoid import Sinusoid

RADIAL_H = np.array((1.0, 0.0, 0.0))
"""z axis of D before projection when the very first sample already lies inside the guard"""


@dataclass(frozen=True)
class Parameters:
    mu: float = 3.986004415e14
    J_T: Any = IDENTITY
    p_T: Sequence[float] = (1.0, 0.0, 0.0)
    rho_M: float = 4.0
    rho_0: float = 20.0
    beta: float = 1.0 / 120.0
    know_M_dist: float = 0.0
    M_dist_T: Sinusoid = field(default_factory=Sinusoid)
    use_gravity_gradient: float = 1.0
    guard_angle: float = radians(5.0)


def target_frame(t: float, T: Body, p: Parameters) -> Jet:
    """C_NT with the derivatives that the known torques give: (C_NT)' = C_NT tilde(omega)."""
    J = np.array(p.J_T, dtype=float)
    C_TN = attitude.dcm(T.q)
    M = gravity_gradient_torque(C_TN @ T.r, J, p.mu) if p.use_gravity_gradient else np.zeros(3)
    if p.know_M_dist:
        M = M + p.M_dist_T(t)
    alpha = np.linalg.solve(J, M + attitude.cross(J @ T.omega, T.omega))
    w = attitude.tilde(T.omega)
    return Jet(C_TN.T, C_TN.T @ w, C_TN.T @ (w @ w + attitude.tilde(alpha)))


def radius(t: float, p: Parameters) -> Jet:
    decay = (p.rho_0 - p.rho_M) * exp(-p.beta * t)
    return Jet(p.rho_M + decay, -p.beta * decay, p.beta**2 * decay)


def facing_frame(grasp_N: Jet, C_HN: Jet, held_H: Array | None, p: Parameters) -> tuple[Jet, float]:
    """C_DN and |x cross orbit normal|.

    Inside the guard the z axis of the last sample outside, held constant in H, takes the place of
    the cross product and is made normal to x again.
    """
    x = -grasp_N
    normal = Jet(C_HN.x[2], C_HN.d[2], C_HN.dd[2])
    across = jet.cross(x, normal)
    size = float(np.sqrt(across.x @ across.x))
    if size < sin(p.guard_angle):
        held_N = C_HN.T @ jet.constant(RADIAL_H if held_H is None else held_H)
        across = held_N - jet.dot(held_N, x) * x
    z = jet.unit(across)
    return jet.rows(x, jet.cross(z, x), z), size


def sample(
    t: float, T: Body, S: Body, p: Parameters, held_H: Array | None = None
) -> tuple[dict[str, Any], Array | None]:
    """All outputs at t, and the z axis of D in H components that the guard of a later sample may
    hold.
    """
    C_HN = hill_frame(T.r, T.v, p.mu)
    grasp_N = target_frame(t, T, p) @ jet.constant(np.array(p.p_T, dtype=float))
    rho_ref_N = radius(t, p) * grasp_N
    C_DN, size = facing_frame(grasp_N, C_HN, held_H, p)
    omega, alpha = attitude.angular_rates(*C_DN)
    rho_N = S.r - T.r
    outputs = {
        "rho_ref_N": rho_ref_N.x,
        "drho_ref_N": rho_ref_N.d,
        "ddrho_ref_N": rho_ref_N.dd,
        "q_DN": attitude.quaternion_of_dcm(C_DN.x),
        "omega_DN_D": omega,
        "alpha_DN_D": alpha,
        "rho_H": C_HN.x @ rho_N,
        "drho_H": C_HN.x @ (S.v - T.v) + C_HN.d @ rho_N,
        "rho_ref_H": C_HN.x @ rho_ref_N.x,
        "range": float(np.sqrt(rho_N @ rho_N)),
        "beta_t": attitude.angle_between(rho_N, grasp_N.x),
        "beta_p": attitude.angle_between(attitude.dcm(S.q)[0], -rho_N),
        "attitude_guard": float(size < sin(p.guard_angle)),
        "normal_distance": size,
        "normal_angle": float(np.arctan2(size, abs(grasp_N.x @ C_HN.x[2]))),
        "roll_limited": 0.0,
    }
    return outputs, held_H if outputs["attitude_guard"] else C_HN.x @ C_DN.x[2]
