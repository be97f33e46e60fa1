# SPDX-License-Identifier: BSD-2-Clause
"""Gravity of an oblate planet, orbital elements, and the orbit (Hill) frame H with its
derivatives.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from .attitude import Array
from .attitude import cross as cross_product
from .jet import Jet, constant, cross, rows, unit


def central_gravity(r: Array, mu: float) -> Array:
    return -mu / (r @ r) ** 1.5 * r


def j2_potential(r: Array, mu: float, R_E: float, J2: float) -> Array:
    """Oblateness part of the potential U (acceleration = +grad U): -mu J2 R_E^2 P2(z/r) / r^3,
    [m2/s2].
    """
    rr = r @ r
    return -0.5 * mu * J2 * R_E**2 * (3.0 * r[2] ** 2 / rr - 1.0) / rr**1.5


def j2_acceleration(r: Array, mu: float, R_E: float, J2: float) -> Array:
    """Gradient of U = -k/2 (3 z^2 r^-5 - r^-3), k = mu J2 R_E^2, term by term with grad r^n = n
    r^(n-2) r.
    """
    rr = r @ r
    z = r[2]
    k = mu * J2 * R_E**2 / rr**2.5
    a = -0.5 * k * (3.0 - 15.0 * z * z / rr) * r
    a[2] -= 3.0 * k * z
    return a


def gravity_gradient_torque(r_X: Array, J: Array, mu: float) -> Array:
    """Torque of the tidal tensor T on the mass distribution, X axes.

    M_i = integral of eps_ijk x_j (T x)_k dm = eps_ijk (E T)_jk with the second moments E = tr(J)/2
    I - J and T = mu (3 r r' / r^5 - I / r^3).
    """
    rr = r_X @ r_X
    T = mu / rr**1.5 * (3.0 / rr * np.outer(r_X, r_X) - np.eye(3))
    ET = (0.5 * np.trace(J) * np.eye(3) - J) @ T
    return np.array((ET[1, 2] - ET[2, 1], ET[2, 0] - ET[0, 2], ET[0, 1] - ET[1, 0]))


def state_of_elements(
    mu: float, a: float, e: float, inc: float, argp: float, raan: float, nu: float
) -> tuple[Array, Array]:
    """Position and velocity by the conic, vis-viva and the flight path angle; angles in rad."""
    r = a * (1.0 - e**2) / (1.0 + e * np.cos(nu))
    speed = np.sqrt(mu * (2.0 / r - 1.0 / a))
    flight_path = np.arctan2(e * np.sin(nu), 1.0 + e * np.cos(nu))
    R_NH = Rotation.from_euler("ZXZ", (raan, inc, argp + nu)).as_matrix()
    return R_NH[:, 0] * r, R_NH @ (
        speed * np.array((np.sin(flight_path), np.cos(flight_path), 0.0))
    )


def elements_of_state(r: Array, v: Array, mu: float) -> tuple[float, float]:
    """Semi-major axis and eccentricity (vis-viva, eccentricity vector)."""
    a = 1.0 / (2.0 / np.linalg.norm(r) - v @ v / mu)
    return float(a), float(np.linalg.norm(np.cross(v, np.cross(r, v)) / mu - r / np.linalg.norm(r)))


def hill_axes(r: Array, v: Array) -> Array:
    """C_HN: x radial outward, z along r x v."""
    z = cross_product(r, v)
    z /= np.linalg.norm(z)
    x = r / np.linalg.norm(r)
    return np.array((x, cross_product(z, x), z))


def hill_frame(r: Array, v: Array, mu: float) -> Jet:
    """C_HN with the derivatives it has in unperturbed motion, so that H turns at |h|/r^2 about its
    z axis.
    """
    h = cross_product(r, v)
    normal = constant(h / np.linalg.norm(h))
    radial = unit(Jet(r, v, central_gravity(r, mu)))
    return rows(radial, cross(normal, radial), normal)
