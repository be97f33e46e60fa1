# SPDX-License-Identifier: BSD-2-Clause
"""Soft capture against MuJoCo: two rigid bodies in free space, joined at one point by a spring
without damping (a spatial tendon of length 0 between a site on each body).
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.systems.docking_case import J_S, J_T, M_S, M_T, P_Q, P_S, matrices, simulate

K = 100.0
TIP = np.array((-0.112, 0.006, -0.004))
SPEED = np.array((-0.03, 0.004, -0.002))
RATE = np.array((0.004, -0.006, 0.005))
STOP, STEP = 20.0, 1e-3
CAUGHT = {  # at the first sample, rest point where it was caught; free to turn
    "mechanism.trip_force": 0,
    "mechanism.latch_dwell": 0,
    "mechanism.latch_rate": 1,
    "mechanism.draw_delay": 1e9,
    "mechanism.k_soft": K,
    "mechanism.c_soft": 0,
    "mechanism.k_rot_soft": 1e-12,
    "mechanism.c_rot_soft": 0,
}


def body(name, mass, J, place, site):
    diagonal = " ".join(map(str, np.diag(J)))
    return (
        f'<body name="{name}" pos="{place[0]} {place[1]} {place[2]}"><freejoint/>'
        f'<inertial pos="0 0 0" mass="{mass}" diaginertia="{diagonal}"/>'
        f'<site name="{name}" pos="{site[0]} {site[1]} {site[2]}"/></body>'
    )


def motion_by_mujoco(place):
    """Positions (rows, 6) and quaternions (rows, 8) of S and T, every 10 ms."""
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed")
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option gravity="0 0 0" timestep="{STEP}" integrator="RK4"/><worldbody>'
        + body("S", M_S, J_S, place, P_S)
        + body("T", M_T, J_T, (0, 0, 0), P_Q + TIP)
        + f'</worldbody><tendon><spatial stiffness="{K}" springlength="0 0">'
        '<site site="S"/><site site="T"/></spatial></tendon></mujoco>'
    )
    data = mujoco.MjData(model)
    data.qpos[3:7] = (0, 0, 0, 1)  # half a turn about z
    data.qvel[:3], data.qvel[3:6] = SPEED, RATE
    rows = [data.qpos.copy()]
    for k in range(round(STOP / STEP)):
        mujoco.mj_step(model, data)
        if (k + 1) % 10 == 0:
            rows.append(data.qpos.copy())
    found = np.array(rows)
    return found[:, [0, 1, 2, 7, 8, 9]], found[:, [3, 4, 5, 6, 10, 11, 12, 13]]


@pytest.mark.interop
@pytest.mark.tool("MuJoCo", "mujoco")
def test_soft_capture_matches_mujoco():
    """Over four periods of the spring, in which the pair moves by 0.2 m: 5e-6 m and 5e-6 of the
    attitude at 100 Hz, less than a third at 200 Hz.
    """
    place = P_Q + TIP - np.diag((-1, -1, 1)) @ P_S
    bodies, attitudes = motion_by_mujoco(place)
    start = {"servicer.r_0_N": place, "servicer.v_0_N": SPEED, "servicer.omega_SN_S_0": RATE}
    errors = []
    for h in (0.01, 0.005):
        result = simulate(stop=STOP, step=h, **start, **CAUGHT)
        assert (result["mechanism.phase"][1:] == 2).all()
        assert np.ptp(result["mechanism.tip_Q"], axis=0).max() > 0.02
        rows = slice(None, None, round(0.01 / h))
        r = np.hstack((result["servicer.r_SN_N"], result["target.r_TN_N"]))[rows]
        C = [matrices(result[name][rows]) for name in ("servicer.q_SN", "target.q_TN")]
        turned = [
            np.abs(each - matrices(attitudes[:, 4 * k : 4 * k + 4])).max()
            for k, each in enumerate(C)
        ]
        errors.append((np.abs(r - bodies).max(), *turned))
    assert max(errors[0]) < 5e-6
    assert (np.array(errors[1]) < np.array(errors[0]) / 3).all()
