# SPDX-License-Identifier: BSD-2-Clause
"""Situations of the adaptive controller, and its errors from the true motion of both bodies."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from .cases import random_bodies, random_inertia, random_rotation
from .motion import stencil
from .theory import MU, dcm_of_quaternion, hill_axes, quaternion_of_dcm

SIX = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def six(S):
    """S11 S12 S13 S22 S23 S33 of a symmetric matrix."""
    return np.array([S[i, j] for i, j in SIX])


def symmetric(elements):
    S = np.zeros((3, 3))
    for (i, j), value in zip(SIX, elements, strict=True):
        S[i, j] = S[j, i] = value
    return S


def parameters(rng):
    """Every gain different, both inertia estimates full."""
    translation = {
        "mu": MU,
        "K_rho": rng.uniform(1e-3, 3e-3, 3),
        "P_rho": rng.uniform(0.03, 0.07, 3),
    }
    mass = {"Gamma_m": rng.uniform(5, 15), "m_hat_0": rng.uniform(80, 120)}
    attitude = {
        "K_att": rng.uniform(1, 3, 3),
        "P_att": rng.uniform(5, 15, 3),
        "Gamma_eta": rng.uniform(10, 1000, 12),
    }
    eta = np.concatenate([six(random_inertia(rng)), six(random_inertia(rng, 8, 20))])
    return translation | mass | attitude | {"eta_hat_0": eta}


def situation(rng):
    """Inputs: bodies 20 m apart, references off by metres and by any rotation, running wheels."""
    u = random_bodies(rng)
    u["rho_ref_N"] = u["r_SN_N"] - u["r_TN_N"] + rng.normal(size=3)
    u["drho_ref_N"] = u["v_SN_N"] - u["v_TN_N"] + 0.1 * rng.normal(size=3)
    u["ddrho_ref_N"] = 0.05 * rng.normal(size=3)
    u["q_DN"] = quaternion_of_dcm(random_rotation(rng))
    u["omega_DN_D"], u["alpha_DN_D"] = 0.03 * rng.normal(size=3), 0.003 * rng.normal(size=3)
    return u | {"wheel_speed": rng.normal(size=3)}


def without_errors(u):
    """The same references, with the servicer on them."""
    on_reference = {"r_SN_N": u["r_TN_N"] + u["rho_ref_N"], "v_SN_N": u["v_TN_N"] + u["drho_ref_N"]}
    exact = {
        "rho_ref_N": on_reference["r_SN_N"] - u["r_TN_N"],
        "drho_ref_N": on_reference["v_SN_N"] - u["v_TN_N"],
    }
    return u | on_reference | exact | {"q_SN": u["q_DN"], "omega_SN_S": u["omega_DN_D"]}


# ---- translation: the error and its derivatives along the true motion ----


def gravity(r):
    return -MU * r / (r @ r) ** 1.5


def position_error(u, F_N, mass):
    """e1, e2 and de2/dt in H components, of a servicer of that mass pushed by F_N, on Kepler
    orbits.

    e1 = C_HN (rho - rho_ref). A complex step along the motion differentiates it; e2 is C_HN de - w
    x e1 with the rate |h|/r^2 of the frame about its z axis, differentiated likewise.
    """
    h = 1e-20
    r_T, v_T = u["r_TN_N"] + 1j * h * u["v_TN_N"], u["v_TN_N"] + 1j * h * gravity(u["r_TN_N"])
    e = u["r_SN_N"] - u["r_TN_N"] - u["rho_ref_N"]
    de = u["v_SN_N"] - u["v_TN_N"] - u["drho_ref_N"]
    dde = gravity(u["r_SN_N"]) - gravity(u["r_TN_N"]) + F_N / mass - u["ddrho_ref_N"]
    C_HN = hill_axes(r_T, v_T)
    e1 = C_HN @ (e + 1j * h * de)
    rate = np.sqrt(np.sum(cross(r_T, v_T) ** 2)) / (r_T @ r_T)
    e2 = C_HN @ (de + 1j * h * dde) - rate * np.array([-e1[1], e1[0], 0])
    return e1.real, e1.imag / h, e2.imag / h


def cross(a, b):
    """numpy's cross product, for complex vectors too."""
    return np.array(
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    )


# ---- attitude: the error and its derivatives along the true motion ----


def attitude_error(u, t=0.0, omega=None):
    """epsilon and desired rate in S components, t after u when S turns at omega and D at omega_D +
    alpha t.
    """
    omega = u["omega_SN_S"] if omega is None else omega
    turn_D = u["omega_DN_D"] * t + u["alpha_DN_D"] * t**2 / 2
    turn_D = (
        turn_D + np.cross(u["omega_DN_D"], u["alpha_DN_D"]) * t**3 / 12
    )  # Magnus expansion, next term t^5
    C_SN = Rotation.from_rotvec(-omega * t).as_matrix() @ dcm_of_quaternion(u["q_SN"])
    C_DN = Rotation.from_rotvec(-turn_D).as_matrix() @ dcm_of_quaternion(u["q_DN"])
    C_SD = C_SN @ C_DN.T
    return Rotation.from_matrix(C_SD.T).as_mrp(), C_SD @ (u["omega_DN_D"] + u["alpha_DN_D"] * t)


def derivatives_of_attitude_error(u, omega=None, h=0.02):
    """d epsilon/dt and the derivative of the desired rate as S sees it; stencil error (w h)^4 =
    1e-12.
    """
    samples = [attitude_error(u, k * h, omega) for k in range(-2, 3)]
    return tuple(stencil(column, h) for column in zip(*samples, strict=True))


def desired_rates(u):
    """wd, wdd: rate and acceleration of D relative to N, in S components."""
    C_SD = dcm_of_quaternion(u["q_SN"]) @ dcm_of_quaternion(u["q_DN"]).T
    return C_SD @ u["omega_DN_D"], C_SD @ u["alpha_DN_D"]


def following_torque(u, eta, wheel_accel):
    """J wdd + wd x (J wd + A Omega) + A dOmega: momentum rate of a servicer of inertias eta that
    moves as D.
    """
    J, A = symmetric(eta[:6]), symmetric(eta[6:])
    wd, wdd = desired_rates(u)
    return J @ wdd + np.cross(wd, J @ wd + A @ u["wheel_speed"]) + A @ wheel_accel


def feedback(u, p):
    """(d epsilon_dot/d omega)' K epsilon + P dw, the Jacobian column by column from the
    kinematics.
    """
    epsilon, wd = attitude_error(u)
    dw = u["omega_SN_S"] - wd
    still, _ = derivatives_of_attitude_error(u)
    step = 0.01
    columns = [
        (derivatives_of_attitude_error(u, u["omega_SN_S"] + step * e)[0] - still) / step
        for e in np.eye(3)
    ]
    return np.array(columns) @ (p["K_att"] * epsilon) + p["P_att"] * dw
