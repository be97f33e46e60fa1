# SPDX-License-Identifier: BSD-2-Clause
"""Servicer, target and the mechanism between them, alone in deep space: systems built as a user
would, and what must hold of the pair.
"""

from __future__ import annotations

import tomllib
from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from harness import run
from harness.files import paths
from harness.ssp.build import system_of

M_S, M_T, M_RED = 100.0, 150.0, 60.0
J_S, J_T, A_W = np.diag((200.0, 250, 150)), np.diag((100.0, 150, 90)), np.diag((12.0, 15, 10))
P_S, P_Q = np.array((1.1, 0, 0)), np.array((0.6, 0, 0))
FACING = (0, 0, 1)  # MRP of half a turn about z: +X of S looks at the mouth on +X of T

TOML = """
name = "docking"
[experiment]
stop = 1.0
step = 0.01
algorithm = "gauss-seidel"
[components]
mechanism = "docking_mechanism"
servicer = "servicer"
target = "target"
[open]
"mechanism.latch_enable" = 1
"mechanism.release" = 0
"servicer.F_S" = [0, 0, 0]
"servicer.M_S" = [0, 0, 0]
"servicer.mdot" = 0
"servicer.wheel_accel_cmd" = [0, 0, 0]
[parameters.shared]
a = 0
mu = 0
use_J2 = 0
use_gravity_gradient = 0
J_S = [[200, 0, 0], [0, 250, 0], [0, 0, 150]]
J_T = [[100, 0, 0], [0, 150, 0], [0, 0, 90]]
[parameters.servicer]
mass_0 = 100
A_w = [[12, 0, 0], [0, 15, 0], [0, 0, 10]]
max_step = 0.001
[parameters.target]
mass = 150
omega_TN_T_0 = [0, 0, 0]
sigma_TN_0 = [0, 0, 0]
max_step = 0.001
"""


@cache
def system():
    return system_of(tomllib.loads(TOML), paths.fmus())


def simulate(*, tip=-0.11, offset=(0, 0), speed=0.03, step=0.01, stop=3.0, algorithm=None, **more):
    """Probe straight ahead of the mouth by `tip`, off its axis, closing at `speed` along it."""
    place = np.array((0.6 + tip + 1.1, *offset))
    start = {
        "servicer.r_0_N": place,
        "servicer.v_0_N": (-speed, 0, 0),
        "servicer.sigma_SN_0": FACING,
        "servicer.max_step": min(step, 0.001),
        "target.max_step": min(step, 0.001),
    }
    values = {n: np.asarray(v, dtype=float).tolist() for n, v in (start | more).items()}
    return run(system(), set=values, step=step, stop=stop, algorithm=algorithm)


# ---- what the pair has, from the plants alone


def matrices(q):
    """C_NB of quaternions, scalar first."""
    return Rotation.from_quat(np.roll(q, -1, axis=-1)).as_matrix()


def momenta(result, masses=(M_S, M_T), wheels=0.0):
    """P (rows, 3) [N.s] and H about the common centre of mass [N.m.s], N axes."""
    m_S, m_T = masses
    r, v = (result[f"servicer.{x}_SN_N"] - result[f"target.{x}_TN_N"] for x in "rv")
    P = m_S * result["servicer.v_SN_N"] + m_T * result["target.v_TN_N"]
    spin_S = result["servicer.omega_SN_S"] @ J_S + wheels
    spin_T = result["target.omega_TN_T"] @ J_T
    H = np.einsum("kij,kj->ki", matrices(result["servicer.q_SN"]), spin_S)
    H += np.einsum("kij,kj->ki", matrices(result["target.q_TN"]), spin_T)
    return P, H + m_S * m_T / (m_S + m_T) * np.cross(r, v)


def kinetic(result):
    """About the common centre of mass [J]."""
    v = result["servicer.v_SN_N"] - result["target.v_TN_N"]
    w_S, w_T = result["servicer.omega_SN_S"], result["target.omega_TN_T"]
    parts = M_RED * (v**2).sum(1), (w_S @ J_S * w_S).sum(1), (w_T @ J_T * w_T).sum(1)
    return sum(parts) / 2


def energy(result):
    """Return the conserved energy: of the bodies, stored, lost, less what was put in; the
    mechanism's own belong to the end of the step before.
    """
    stored, lost, driven = (
        result[f"mechanism.energy_{kind}"] for kind in ("elastic", "dissipated", "drive")
    )
    return kinetic(result) + stored + lost - driven


CLOSING = """[parameters.servicer]
r_0_N = [1.71, 0.006, -0.004]
v_0_N = [-0.04, -0.0085, -0.0068]
sigma_SN_0 = [0.02, 0.01, 1]
omega_SN_S_0 = [0.004, -0.004, -0.005]
"""


def capture_a_step_late():
    """System of a capture within 10 s, for a master that passes every output on one step late."""
    text = TOML.replace("[parameters.servicer]\n", CLOSING)
    return system_of(tomllib.loads(text + "[parameters.mechanism]\nlatency = 1\n"), paths.fmus())
