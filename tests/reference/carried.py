# SPDX-License-Identifier: BSD-2-Clause
"""Reference of the carried frame: attitude as a matrix C_DN, derivatives by complex steps.

    W = w_H + s (w_T - w_H) + steer(n x a) + b,   n = -X_D,  a = grasp axis;   rho_ref = L n

b, the integral of the steering, is fixed in D but for its growth.

A complex number x + i h dx carries a derivative through every formula, so none is derived by hand.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from .attitude import Array, cross

H = 1e-30


@dataclass
class Steering:
    spin_time: float = 60.0
    k_steer: float = 0.02
    w_steer: float = 0.005
    k_integral: float = 0.0
    spin_accel: float = 0.0

    def spin(self, w_H: Array, w_T: Array) -> float:
        """How long D takes to turn with T: the peak of the acceleration of a fifth-order step is
        15/8 of its mean.
        """
        if not self.spin_accel:
            return self.spin_time
        return max(self.spin_time, 15 / 8 * np.linalg.norm(w_T - w_H) / self.spin_accel)


def length(x: Array) -> Array:
    """Norm that is analytic in its argument."""
    return np.sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2])


def along(x: Array, dx: Array) -> Array:
    return x + 1j * H * dx


def slope(x: Array) -> Array:
    return np.imag(x) / H


def start(rho_N: Array, C_SN: Array) -> Array:
    """C_DN: X towards the target, Z next to the Z axis of S, or to its Y axis."""
    X = -rho_N / np.linalg.norm(rho_N)
    z = C_SN[2] if np.linalg.norm(cross(C_SN[2], X)) >= 0.1 else C_SN[1]
    Z = (np.eye(3) - np.outer(X, X)) @ z
    Z = Z / np.linalg.norm(Z)
    return np.array((X, cross(Z, X), Z))


def steer(p: Steering, c: Array) -> Array:
    size = length(c)
    return p.k_steer * c if p.k_steer * np.real(size) <= p.w_steer else p.w_steer * c / size


def spin(x: Array) -> Array:
    """Fifth-order step, clipped; of a complex argument too."""
    if not 0 <= np.real(x) <= 1:
        return 0.0 * x + float(np.real(x) > 1)
    return x**3 * (10 + x * (6 * x - 15))


def turning(
    p: Steering, C_DN: Array, since: float, H_turn: Array, T_turn: Array, a: Array,
    b: Array | None = None, spin_time: float | None = None,
) -> tuple[Array, Array]:  # fmt: skip
    """W and dW; H_turn, T_turn: rows w and dw in N axes; b: integral of the steering, D axes."""
    (w_H, dw_H), (w_T, dw_T) = H_turn, T_turn
    n = -C_DN[0]
    c = cross(n, a)
    if np.linalg.norm(c) < 1e-6 and n @ a < 0:
        c = 1e-6 * C_DN[2]
    spin_time = spin_time or p.spin_time
    s = spin(since / spin_time)
    b_N = np.zeros(3) if b is None else C_DN.T @ b
    W = w_H + s * (w_T - w_H) + steer(p, c) + b_N
    # everything moves a complex step on: n with D, a with T
    dc = slope(cross(along(n, cross(W, n)), along(a, cross(w_T, a))))
    s1 = spin(along(since, 1.0) / spin_time)
    w_H1, w_T1 = along(w_H, dw_H), along(w_T, dw_T)
    b1 = along(b_N, cross(W, b_N) + C_DN.T @ growth(p, C_DN, since, spin_time, a))
    return W, slope(w_H1 + s1 * (w_T1 - w_H1) + steer(p, along(c, dc)) + b1)


def growth(p: Steering, C_DN: Array, since: float, spin_time: float, a: Array) -> Array:
    """Rate of the integral, D axes: none while D spins up or the steering is at its limit."""
    c = C_DN @ cross(-C_DN[0], a)
    rests = since < spin_time or p.k_steer * np.linalg.norm(c) > p.w_steer
    return 0 * c if rests else p.k_integral * c


def integrated(p: Steering, b: Array, rate: Array, period: float) -> Array:
    b = b + period * rate
    return b * min(1.0, p.w_steer / max(np.linalg.norm(b), 1e-300))


def reference(C_DN: Array, W: Array, dW: Array, L: Array) -> dict[str, Array]:
    """L: distance with its two derivatives."""
    n = -C_DN[0]
    dn = cross(W, n)
    ddn = slope(cross(along(W, dW), along(n, dn)))
    return {
        "rho_ref_N": L[0] * n,
        "drho_ref_N": L[1] * n + L[0] * dn,
        "ddrho_ref_N": L[2] * n + 2 * L[1] * dn + L[0] * ddn,
        "omega_DN_D": C_DN @ W,
        "alpha_DN_D": C_DN @ dW,
    }


def carried_on(C_DN: Array, W: Array, dW: Array, period: float) -> Array:
    """rot(phi): Rodrigues parameters phi/4."""
    phi = C_DN @ (W + dW * period / 2) * period
    return Rotation.from_mrp(phi / 4).as_matrix().T @ C_DN
