# SPDX-License-Identifier: BSD-2-Clause
"""Attitude: unit quaternions (scalar first, v_N = q v_X q*), direction cosine matrices and
Rodrigues parameters.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Array = Any
"""numpy array (or sequence) of floats; complex values pass for complex-step derivatives."""


def cross(a: Array, b: Array) -> Array:
    """a x b of vectors, or of arrays of them along the last axis: what np.cross returns, which
    takes ten times as long for two vectors.
    """
    a, b = np.asarray(a), np.asarray(b)
    if a.ndim == b.ndim == 1:
        (a1, a2, a3), (b1, b2, b3) = a.tolist(), b.tolist()
        return np.array((a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1))
    a1, a2, a3, b1, b2, b3 = (x[..., k] for x in (a, b) for k in range(3))
    return np.stack((a2 * b3 - a3 * b2, a3 * b1 - a1 * b3, a1 * b2 - a2 * b1), axis=-1)


def tilde(a: Array) -> Array:
    """Matrix of the cross product, tilde(a) b = a x b."""
    a1, a2, a3 = a
    return np.array(((0.0, -a3, a2), (a3, 0.0, -a1), (-a2, a1, 0.0)))


def vee(M: Array) -> Array:
    """Vector of the antisymmetric part of M, the inverse of tilde."""
    return 0.5 * np.array((M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]))


def multiply(p: Array, q: Array) -> Array:
    """Hamilton product."""
    p0, p1, p2, p3 = p
    q0, q1, q2, q3 = q
    r0 = p0 * q0 - p1 * q1 - p2 * q2 - p3 * q3
    r1 = p0 * q1 + p1 * q0 + p2 * q3 - p3 * q2
    r2 = p0 * q2 + p2 * q0 + p3 * q1 - p1 * q3
    r3 = p0 * q3 + p3 * q0 + p1 * q2 - p2 * q1
    return np.array((r0, r1, r2, r3))


def conjugate(q: Array) -> Array:
    return np.array((q[0], -q[1], -q[2], -q[3]))


def positive(q: Array) -> Array:
    """The one of q and -q whose scalar part is not negative: the rotation by at most 180
    degrees.
    """
    return q if q[0] >= 0.0 else -q


def rate(q: Array, omega_X: Array) -> Array:
    """dq/dt = 1/2 q (x) [0, omega] of a frame X that turns at omega (X components)."""
    w1, w2, w3 = omega_X
    return 0.5 * multiply(q, (0.0, w1, w2, w3))


def dcm(q: Array) -> Array:
    """C_XN of q_XN. Homogeneous of degree 0: a rotation also for a quaternion that an integrator
    left off norm 1.
    """
    a, b, c, d = q
    aa, bb, cc, dd = a * a, b * b, c * c, d * d
    n = 1.0 / (aa + bb + cc + dd)
    m = 2.0 * n
    rows = (
        (n * (aa + bb - cc - dd), m * (b * c + a * d), m * (b * d - a * c)),
        (m * (b * c - a * d), n * (aa - bb + cc - dd), m * (c * d + a * b)),
        (m * (b * d + a * c), m * (c * d - a * b), n * (aa - bb - cc + dd)),
    )
    return np.array(rows)


def quaternion_of_dcm(C_XN: Array) -> Array:
    """q_XN (scalar part >= 0) as the eigenvector of Bar-Itzhack's matrix that belongs to its
    largest eigenvalue.
    """
    c = C_XN
    z = np.array((c[1, 2] - c[2, 1], c[2, 0] - c[0, 2], c[0, 1] - c[1, 0]))
    K = np.empty((4, 4))
    K[0, 0] = np.trace(c)
    K[0, 1:] = K[1:, 0] = z
    K[1:, 1:] = c + c.T - np.trace(c) * np.eye(3)
    return positive(np.linalg.eigh(K)[1][:, -1])


def mrp_of_quaternion(q: Array) -> Array:
    """sigma = q_vec / (1 + q_0) with |sigma| <= 1."""
    q = positive(q)
    return q[1:] / (1.0 + q[0])


def quaternion_of_mrp(sigma: Array) -> Array:
    """From tan(angle/4): half the angle turned twice, q = [1, sigma] (x) [1, sigma] / (1 +
    sigma.sigma).
    """
    half = np.array((1.0, *sigma))
    return multiply(half, half) / (half @ half)


def mrp_rate_matrix(q: Array) -> Array:
    """d(dsigma/dt)/d(omega), that is G(sigma)/4, by the chain rule through sigma = q_vec/(1 + q_0)
    and dq/dt.
    """
    q0, v = q[0], q[1:]
    return 0.5 * ((q0 * np.eye(3) + tilde(v)) / (1.0 + q0) + np.outer(v, v) / (1.0 + q0) ** 2)


def angle(q: Array) -> float:
    """Rotation angle in [0, pi]."""
    return float(2.0 * np.arctan2(np.linalg.norm(q[1:]), abs(q[0])))


def angle_between(a: Array, b: Array) -> float:
    return float(np.arctan2(np.linalg.norm(cross(a, b)), a @ b))


def angular_rates(C: Array, C_dot: Array, C_ddot: Array) -> tuple[Array, Array]:
    """omega and its derivative (X components) of a frame X from C_XN(t): dC/dt = -tilde(omega)
    C.
    """
    return vee(-C_dot @ C.T), vee(-C_ddot @ C.T - C_dot @ C_dot.T)
