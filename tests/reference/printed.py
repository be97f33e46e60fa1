# SPDX-License-Identifier: BSD-2-Clause
"""The formulas of docs/models.md A as printed there: on trial in the tests of the identities,
unused elsewhere.
"""

from __future__ import annotations

from types import SimpleNamespace as Case

import numpy as np

from .attitude import Array, cross, tilde

ORBIT_NORMAL_H = np.array((0.0, 0.0, 1.0))


def C(s: Array) -> Array:
    """(1)"""
    ss = s @ s
    return (
        np.eye(3)
        - 4 * (1 - ss) / (1 + ss) ** 2 * tilde(s)
        + 8 / (1 + ss) ** 2 * tilde(s) @ tilde(s)
    )


def G(s: Array) -> Array:
    """(3)"""
    return (1 - s @ s) * np.eye(3) + 2 * tilde(s) + 2 * np.outer(s, s)


def G_written_out(s: Array) -> Array:
    s1, s2, s3 = s
    n = 1 - s @ s
    rows = (
        (n + 2 * s1 * s1, 2 * (s1 * s2 - s3), 2 * (s1 * s3 + s2)),
        (2 * (s2 * s1 + s3), n + 2 * s2 * s2, 2 * (s2 * s3 - s1)),
        (2 * (s3 * s1 - s2), 2 * (s3 * s2 + s1), n + 2 * s3 * s3),
    )
    return np.array(rows)


def j2_acceleration(r: Array, mu: float, R_E: float, J2: float) -> Array:
    """A.2."""
    x, y, z = r
    n = np.linalg.norm(r)
    zz = z * z / n**2
    brackets = np.array((x * (1 - 5 * zz), y * (1 - 5 * zz), z * (3 - 5 * zz)))
    return -mu / n**3 * 1.5 * J2 * (R_E / n) ** 2 * brackets


def gravity_gradient_torque(r_X: Array, J: Array, mu: float) -> Array:
    """A.2."""
    r = np.linalg.norm(r_X)
    return 3 * mu / r**3 * cross(r_X / r, J @ (r_X / r))


def f_rel(rho: Array, drho: Array, r_t: float, th: float, thd: float, mu: float) -> Array:
    """A.4.4."""
    (x, y, z), (xd, yd, _) = rho, drho
    rc3 = ((r_t + x) ** 2 + y * y + z * z) ** 1.5
    f_x = th**2 * x + thd * y + 2 * th * yd + mu / r_t**2 - mu * (r_t + x) / rc3
    f_y = -thd * x + th**2 * y - 2 * th * xd - mu * y / rc3
    return np.array((f_x, f_y, -mu * z / rc3))


def f_rel_split(rho: Array, drho: Array, r_t: float, th: float, thd: float, mu: float) -> Array:
    """A.4.4: A1 rho + A2 rhoDot + g(rho)."""
    x, y, z = rho
    k, rc3 = mu / r_t**3, ((r_t + x) ** 2 + y * y + z * z) ** 1.5
    A1 = np.array(((th**2 + 2 * k, thd, 0), (-thd, th**2 - k, 0), (0, 0, -k)))
    A2 = np.array(((0, 2 * th, 0), (-2 * th, 0, 0), (0, 0, 0)))
    g_x = -mu * (r_t + x) / rc3 + mu / r_t**2 - 2 * mu * x / r_t**3
    g = np.array((g_x, -mu * y / rc3 + mu * y / r_t**3, -mu * z / rc3 + mu * z / r_t**3))
    return A1 @ rho + A2 @ drho + g


def grasp_axis(T: Case) -> Case:
    """A.4.3; T: omega, J, r_B, C_BH, p_t, w_H, w_H_dot, mu."""
    M_gt = gravity_gradient_torque(T.r_B, T.J, T.mu)
    omega_dot = np.linalg.solve(T.J, -cross(T.omega, T.J @ T.omega) + M_gt)
    carried = T.C_BH.T @ T.w_H
    w = T.omega - carried
    w_dot = omega_dot - T.C_BH.T @ T.w_H_dot + cross(w, carried)
    p1 = T.C_BH @ cross(w, T.p_t)
    p2 = T.C_BH @ (cross(w_dot, T.p_t) + cross(w, cross(w, T.p_t)))
    return Case(w=w, w_dot=w_dot, p0=T.C_BH @ T.p_t, p1=p1, p2=p2)


def reference(
    t: float, axis: Case, rho_M: float, rho_0: float, beta: float
) -> tuple[Array, Array, Array]:
    """A.4.3: rho*, rho*Dot, rho*DDot in H."""
    decay = (rho_M - rho_0) * np.exp(-beta * t)
    L, L1, L2 = rho_M - decay, beta * decay, -(beta**2) * decay
    return L * axis.p0, L1 * axis.p0 + L * axis.p1, L2 * axis.p0 + 2 * L1 * axis.p1 + L * axis.p2


def desired_attitude(axis: Case, C_HN: Array, w_H: Array, w_H_dot: Array) -> Case:
    """A.4.5."""
    i, i1, i2 = -axis.p0, -axis.p1, -axis.p2
    u, u1, u2 = (cross(a, ORBIT_NORMAL_H) for a in (i, i1, i2))
    n = np.linalg.norm(u)
    k = u / n
    n1 = k @ u1
    k1 = (u1 - n1 * k) / n
    n2 = k1 @ u1 + k @ u2
    k2 = (u2 - 2 * n1 * k1 - n2 * k) / n
    j = cross(k, i)
    j1 = cross(k1, i) + cross(k, i1)
    j2 = cross(k2, i) + 2 * cross(k1, i1) + cross(k, i2)
    w = np.array((j1 @ k, k1 @ i, i1 @ j))
    w_dot = np.array((j2 @ k + j1 @ k1, k2 @ i + k1 @ i1, i2 @ j + i1 @ j1))
    C_DH = np.array((i, j, k))
    carried = C_DH @ w_H
    alpha = w_dot + C_DH @ w_H_dot - cross(w, carried)
    return Case(C_DN=C_DH @ C_HN, w=w, w_dot=w_dot, omega=w + carried, alpha=alpha, n=n)


def Y(b: Array) -> Array:
    """A.5.2: Y(b) s = S b."""
    b1, b2, b3 = b
    return np.array(((b1, b2, b3, 0, 0, 0), (0, b1, 0, b2, b3, 0), (0, 0, b1, 0, b2, b3)))


def X(a: Array, b: Array) -> Array:
    """A.5.2: X(a, b) s = a x (S b)."""
    (a1, a2, a3), (b1, b2, b3) = a, b
    rows = (
        (0, -b1 * a3, b1 * a2, -b2 * a3, b2 * a2 - b3 * a3, b3 * a2),
        (b1 * a3, b2 * a3, b3 * a3 - b1 * a1, 0, -b2 * a1, -b3 * a1),
        (-b1 * a2, b1 * a1 - b2 * a2, -b3 * a2, b2 * a1, b3 * a1, 0),
    )
    return np.array(rows)
