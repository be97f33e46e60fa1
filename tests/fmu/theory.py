# SPDX-License-Identifier: BSD-2-Clause
"""Theory of attitude, gravity and orbits, written without the formulas of the models under test.

Attitude is a rotation matrix instead of Rodrigues parameters, gravity the gradient of its
potential, gravity gradient a sum over point masses. C_XY maps components in frame Y to components
in frame X. SI units, radians.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from tests.reference.attitude import cross

MU, R_E, J2 = 3.986004415e14, 6378136.3, 1.0826360229829945e-3
EARTH = {"mu": MU, "R_E": R_E, "J2": J2}

# ---- attitude ----


def dcm_of_mrp(sigma):
    """C_BN of sigma_BN: scipy's matrix turns body components into N components."""
    return Rotation.from_mrp(sigma).as_matrix().T


def dcm_of_quaternion(q):
    """C_BN of q_BN, scalar first."""
    return Rotation.from_quat(np.roll(q, -1)).as_matrix().T


def quaternion_of_dcm(C_BN):
    """q_BN, scalar first."""
    return np.roll(Rotation.from_matrix(C_BN.T).as_quat(), 1)


def angle_between_attitudes(C_1, C_2):
    """Rotation angle from one attitude to the other, rad; precise also when it is tiny."""
    return Rotation.from_matrix(C_1 @ C_2.T).magnitude()


def tilde(w):
    return np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])


def vee(M):
    """Vector of an antisymmetric matrix: vee(tilde(w)) = w."""
    return np.array([M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]]) / 2


# ---- gravity ----


def potential(r, mu=MU, oblateness=J2):
    """Potential energy per mass of a planet with second zonal harmonic; analytic, so that complex
    steps pass.
    """
    distance = np.sqrt(r @ r)
    P2 = (3 * (r[2] / distance) ** 2 - 1) / 2
    return -mu / distance * (1 - oblateness * (R_E / distance) ** 2 * P2)


def minus_gradient(U, r):
    """-grad U by complex steps: no cancellation, exact to rounding."""
    h = 1e-20 * np.linalg.norm(r)
    return -np.array([np.imag(U(r + 1j * h * axis)) for axis in np.eye(3)]) / h


def torque_on_point_masses(r_B, J, mu=MU, size=100.0):
    """Torque of a point-mass planet on six masses that have the inertia J [N.m], r_B: centre of
    mass in body axes.

    Pairs at +-size on the principal axes: error (size/r)^2 relative, 2e-10 in a low orbit.
    """
    moments, axes = np.linalg.eigh(J)
    masses = (moments.sum() / 2 - moments) / (2 * size**2)
    torque = np.zeros(3)
    for m, axis in zip(
        np.repeat(masses, 2), np.vstack([axes.T, -axes.T])[[0, 3, 1, 4, 2, 5]], strict=True
    ):
        x = size * axis
        force = -mu * m * (r_B + x) / np.linalg.norm(r_B + x) ** 3
        torque += cross(x, force)
    return torque


# ---- orbit ----


def hill_axes(r, v):
    """C_HN: x radial outward, y along track, z orbit normal. Analytic in r and v."""
    z = np.array(
        [r[1] * v[2] - r[2] * v[1], r[2] * v[0] - r[0] * v[2], r[0] * v[1] - r[1] * v[0]],
    )
    x, z = r / np.sqrt(r @ r), z / np.sqrt(z @ z)
    y = np.array([z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]])
    return np.array([x, y, z])


def elements_of_state(r, v, mu=MU):
    """a, e, inc, argp, raan, nu from the integrals of motion."""
    h, distance = cross(r, v), np.linalg.norm(r)
    e, node = cross(v, h) / mu - r / distance, cross([0, 0, 1], h)
    normal = h / np.linalg.norm(h)

    def angle(a, b):
        """From a to b about the orbit normal."""
        return np.arctan2(cross(a, b) @ normal, a @ b)

    return {
        "a": 1 / (2 / distance - v @ v / mu),
        "e": np.linalg.norm(e),
        "inc": np.arccos(normal[2]),
        "argp": angle(node, e),
        "raan": np.arctan2(node[1], node[0]),
        "nu": angle(e, r),
    }
