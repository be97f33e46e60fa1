# SPDX-License-Identifier: BSD-2-Clause
"""Parameter values of the paper's case (ssp/sync_approach/system.toml)."""

from __future__ import annotations

from math import radians
from typing import Any

from . import adaptive, guidance, servicer, target
from .sinusoid import Sinusoid

STEP = 0.1
STOP = 1800.0
T_ATT = 1200.0

ORBIT: dict[str, Any] = {
    "mu": 3.986004415e14,
    "R_E": 6378136.3,
    "J2": 1.0826360229829945e-3,
    "a": 7158.14e3,
    "e": 0.01,
    "inc": radians(30.0),
    "argp": radians(60.0),
    "raan": radians(120.0),
    "nu": radians(30.0),
    "use_J2": 1.0,
    "max_step": STEP,
}
J_T = ((100.0, 0.0, 0.0), (0.0, 150.0, 0.0), (0.0, 0.0, 90.0))
J_S = ((200.0, 0.0, 0.0), (0.0, 250.0, 0.0), (0.0, 0.0, 150.0))
A_W = ((12.0, 0.0, 0.0), (0.0, 15.0, 0.0), (0.0, 0.0, 10.0))

TARGET = target.Parameters(
    **ORBIT,
    mass=500.0,  # no force acts on the target: the value is free
    J_T=J_T,
    sigma_TN_0=(-0.02, 0.015, -0.25),
    omega_TN_T_0=(0.002, 0.01, 0.0),
    use_gravity_gradient=1.0,
    M_dist_T=Sinusoid(amplitude=(3.2e-4, -4.5e-4, 5.6e-4), frequency=(0.04, 0.04, 0.04)),
)
SERVICER = servicer.Parameters(
    **ORBIT,
    rho_0_H=(0.0, 20.0, 0.0),
    mass_0=100.0,
    J_S=J_S,
    A_w=A_W,
    sigma_SN_0=(0.2, -0.2, 0.15),
    t_att=T_ATT,
    M_dist_S=Sinusoid(
        amplitude=(1.2e-4, 2.4e-4, 1.6e-4), frequency=(0.05, 0.05, 0.05), start=T_ATT
    ),
    a_dist=Sinusoid(bias=(1.8e-5, -2.0e-5, -1.5e-5)),
    a_dist_axes=1.0,
)
GUIDANCE = guidance.Parameters(
    mu=ORBIT["mu"],
    J_T=J_T,
    p_T=(1.0, 0.0, 0.0),
    rho_M=4.0,
    rho_0=20.0,
    beta=1.0 / 120.0,
    use_gravity_gradient=1.0,
    guard_angle=radians(5.0),
)
CONTROLLER = adaptive.Parameters(
    mu=ORBIT["mu"],
    K_rho=(2e-3,) * 3,
    P_rho=(5e-2,) * 3,
    Gamma_m=10.0,
    m_hat_0=95.0,
    K_att=(2.0,) * 3,
    P_att=(10.0,) * 3,
    Gamma_eta=tuple(400.0 * g for g in (200, 10, 10, 200, 10, 200, 10, 5, 5, 10, 4, 4)),
    eta_hat_0=(180, 0, 0, 240, 0, 160, 14, 0, 0, 16, 0, 12),
    t_att=T_ATT,
)
