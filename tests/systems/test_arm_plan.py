# SPDX-License-Identifier: BSD-2-Clause
"""Kinematics and plan of the arm: against the plant, against shapes that are known by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from harness import run
from servicing.ssp.arm_capture.kinematics import arm_of, jacobian, pose

TOOL = {"servicer.p_EA_A": [0.3, 0.1, -0.2], "servicer.q_EA": [0.6, 0, 0, 0.8]}


@pytest.fixture(scope="module")
def flown():
    """Deployment with a tool that is off the axis; seven joints move."""
    return run("arm_capture", stop=60.0, every=20, set=TOOL)


def attitude(result, name):
    return Rotation.from_quat(result[name][:, [1, 2, 3, 0]])


def test_end_effector_is_where_the_plant_has_it(flown):
    at = pose(arm_of(flown), flown["servicer.joint_angle"])
    S, E = attitude(flown, "servicer.q_SN"), attitude(flown, "servicer.q_EN")
    place = S.inv().apply(flown["servicer.r_EN_N"] - flown["servicer.r_SN_N"])
    np.testing.assert_allclose(at.tip, place, atol=1e-8)  # positions in orbit: 7e6 m
    np.testing.assert_allclose(at.frame, (S.inv() * E).as_matrix(), atol=1e-12)


def test_jacobian_gives_the_velocities_of_the_plant(flown):
    """v_E - v_S - w x p_E and w_E - w in base axes are J_m dq."""
    at = pose(arm_of(flown), flown["servicer.joint_angle"])
    found = np.einsum("kij,kj->ki", jacobian(at), flown["servicer.joint_rate"])
    S, E = attitude(flown, "servicer.q_SN"), attitude(flown, "servicer.q_EN")
    w = flown["servicer.omega_SN_S"]
    v = S.inv().apply(flown["servicer.v_EN_N"] - flown["servicer.v_SN_N"]) - np.cross(w, at.tip)
    turning = (S.inv() * E).apply(flown["servicer.omega_EN_E"].copy()) - w
    assert np.abs(found).max() > 0.01
    np.testing.assert_allclose(found, np.hstack([v, turning]), atol=1e-11)
