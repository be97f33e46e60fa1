# SPDX-License-Identifier: BSD-2-Clause
"""adaptive_controller.fmu with ideal actuation: the Lyapunov functions of docs/models.md A.5 fall
as predicted.

Translation  V = m/2 (e1.K e1 + e2.e2) + (m - m_hat)^2/(2 Gamma),              dV/dt = -m_hat e2.P
e2 Attitude     V = k/2 epsilon^2 + dw.J dw/2 + (eta - eta_hat).Gamma^-1 (eta - eta_hat)/2,   dV/dt
= -dw.P dw
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from .adaptive_cases import (
    attitude_error,
    derivatives_of_attitude_error,
    parameters,
    position_error,
    situation,
    six,
)
from .cases import ELEMENTS, random_inertia
from .motion import deviation
from .theory import EARTH, dcm_of_quaternion, quaternion_of_dcm

PERIOD = 1.0  # s; long, so that the increments of the estimates retain their digits


def one_step(fmu, p, u):
    unit = fmu("adaptive_controller", p, u)
    unit.step(PERIOD)
    return unit.outputs()


# ---- the rate at one instant, true motion and true increments of the estimates ----


@pytest.mark.parametrize("damping", [0, 1])
def test_translation_function_falls_with_the_damping_of_the_estimated_or_the_true_mass(
    fmu, rng, damping
):
    """With P e2 in the regressor the damping belongs to the true mass: no sign condition on m_hat
    is left.
    """
    p, u, mass = (
        parameters(rng) | {"damping_in_regressor": damping},
        situation(rng),
        rng.uniform(60, 160),
    )
    out = one_step(fmu, p, u)
    F_N = dcm_of_quaternion(u["q_SN"]).T @ out["F_cmd_S"]
    e1, e2, de2 = position_error(u, F_N, mass)
    dm_hat = (out["m_hat"] - p["m_hat_0"]) / PERIOD
    terms = (
        mass * e1 @ (p["K_rho"] * e2),
        mass * e2 @ de2,
        -(mass - p["m_hat_0"]) * dm_hat / p["Gamma_m"],
    )
    damped = mass if damping else p["m_hat_0"]
    assert deviation(sum(terms), -damped * e2 @ (p["P_rho"] * e2), np.abs(terms).max()) < 1e-11


@pytest.mark.parametrize("use_wheels", [1, 0])
def test_attitude_function_falls_with_the_rate_damping(fmu, rng, use_wheels):
    """True inertias far from their estimates; equal K on all axes, as the function needs. Stencil
    error 1e-12.
    """
    k = rng.uniform(1, 3)
    p, u = parameters(rng) | {"K_att": np.full(3, k), "use_wheels": use_wheels}, situation(rng)
    out, J, A = one_step(fmu, p, u), random_inertia(rng), random_inertia(rng, 8, 20)
    epsilon, wd = attitude_error(u)
    depsilon, dwd = derivatives_of_attitude_error(u)
    w, dw = u["omega_SN_S"], u["omega_SN_S"] - wd
    momentum = J @ w + A @ u["wheel_speed"]
    domega = np.linalg.solve(J, out["M_cmd_S"] - np.cross(w, momentum) - A @ out["wheel_accel_cmd"])
    error = np.concatenate([six(J), six(A)]) - p["eta_hat_0"]
    deta_hat = (out["eta_hat"] - p["eta_hat_0"]) / PERIOD
    terms = k * epsilon @ depsilon, dw @ J @ (domega - dwd), -error @ (deta_hat / p["Gamma_eta"])
    assert deviation(sum(terms), -dw @ (p["P_att"] * dw), np.abs(terms).max()) < 1e-9


# ---- closed loop of FMUs ----

MASS, J, A = (
    100.0,
    np.array([[200, 8, -5], [8, 250, 6], [-5, 6, 150.0]]),
    np.diag([12.0, 15.0, 10.0]),
)
GAMMA_ETA = np.repeat([2e3, 4e2], 6)


def reference_motion(t):
    """A station 10 m from the target and a body that turns faster and faster about a fixed axis."""
    w, axis = 0.02, np.array([0.6, 0, 0.8])
    c, s = np.cos(w * t), np.sin(w * t)
    x, y = np.array([c, s, 0.3]), np.array([-s, c, 0])
    angle = 0.02 * t + 2e-4 * t**2
    C_DN = Rotation.from_rotvec(-angle * axis).as_matrix()
    station = {
        "rho_ref_N": 10 * x,
        "drho_ref_N": 10 * w * y,
        "ddrho_ref_N": -10 * w**2 * np.array([c, s, 0]),
    }
    turning = {
        "q_DN": quaternion_of_dcm(C_DN),
        "omega_DN_D": (0.02 + 4e-4 * t) * axis,
        "alpha_DN_D": 4e-4 * axis,
    }
    return station | turning


def closed_loop(fmu, h, duration=40.0):
    """Controller, servicer and target in Gauss-Seidel order, sampled every h: V and its dissipation
    at each sample.
    """
    orbit = EARTH | ELEMENTS | {"use_J2": 0, "max_step": h}
    body = {
        "mass_0": MASS,
        "J_S": J,
        "A_w": A,
        "rho_0_H": (9, 1, 4),
        "sigma_SN_0": (0.1, -0.05, 0.15),
    }
    eta_0 = np.concatenate([six(np.diag([180, 240, 160])), six(np.diag([14, 16, 12]))])
    gains = {"K_rho": (2e-3,) * 3, "P_rho": (5e-2,) * 3, "Gamma_m": 10, "m_hat_0": 95}
    gains |= {"K_att": (2,) * 3, "P_att": (10,) * 3, "Gamma_eta": GAMMA_ETA, "eta_hat_0": eta_0}
    T, S = fmu("target", orbit), fmu("servicer", orbit | body)
    unit, rows = fmu("adaptive_controller", gains), []
    m_hat, eta_hat = 95.0, eta_0
    for _ in range(round(duration / h)):
        states = {f"{x}_TN_N": T.get(f"{x}_TN_N") for x in "rv"} | {"q_TN": T.get("q_TN")}
        states |= {
            name: S.get(name) for name in ("r_SN_N", "v_SN_N", "q_SN", "omega_SN_S", "wheel_speed")
        }
        unit.step(h, states | reference_motion(unit.time))
        out = unit.outputs()
        rows.append(lyapunov(out, m_hat, eta_hat))
        m_hat, eta_hat = out["m_hat"], out["eta_hat"]
        S.step(h, {"F_S": out["F_cmd_S"], "wheel_accel_cmd": out["wheel_accel_cmd"]})
        T.step(h)
    return np.array(rows)


def lyapunov(out, m_hat, eta_hat):
    """V and -dV/dt of translation, the same of attitude, with the estimates that the command
    used.
    """
    e1, e2, dw, eta = out["e1_H"], out["e2_H"], out["domega_S"], np.concatenate([six(J), six(A)])
    V_rho = MASS / 2 * (2e-3 * e1 @ e1 + e2 @ e2) + (MASS - m_hat) ** 2 / 20
    V_att = (
        out["epsilon"] @ out["epsilon"]
        + dw @ J @ dw / 2
        + (eta - eta_hat) @ ((eta - eta_hat) / GAMMA_ETA) / 2
    )
    return V_rho, m_hat * 5e-2 * e2 @ e2, V_att, 10 * dw @ dw


def test_lyapunov_functions_fall_at_every_sample_of_a_closed_loop_and_by_what_is_dissipated(fmu):
    """V(t) - V(0) + sum of dissipation is an error of the hold and of explicit Euler: first order
    in the period.
    """
    errors = []
    for h in (0.1, 0.05):
        history = closed_loop(fmu, h)
        V, dissipation = history[:, ::2], history[:, 1::2]
        assert (np.diff(V, axis=0) < 0).all()
        errors.append(V[-1] - V[0] + h * dissipation[:-1].sum(axis=0))
    assert np.max(np.abs(errors[0] / (V[0] - V[-1]))) < 0.01
    assert deviation(errors[0] / errors[1], 2) < 0.02
