# SPDX-License-Identifier: BSD-2-Clause
"""switched_controller.fmu against its law written out here: force by phase in Hill axes, switching
distances, abort, attitude.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from .cases import random_direction
from .driver import bits
from .motion import deviation
from .rejections import rejection

MU, A = 3.986004415e14, 7.0e6
N = np.sqrt(MU / A**3)


def states(rng, rho_H, drho_H, ref=(0,) * 6, D=None):
    """Inputs on a circular orbit in any plane; ref: rho_ref and its rate as seen in H."""
    C_NH = Rotation.random(random_state=rng).as_matrix()
    S, spin = Rotation.random(random_state=rng), np.array((0, 0, N))
    D = D or (S, np.zeros(3), np.zeros(3))
    r, v = A * C_NH[:, 0], A * N * C_NH[:, 1]

    def inertial(x, dx):
        return C_NH @ x, C_NH @ (np.asarray(dx) + np.cross(spin, x))

    (rho, drho), (rho_ref, drho_ref) = inertial(rho_H, drho_H), inertial(ref[:3], ref[3:])
    inputs = {"r_TN_N": r, "v_TN_N": v, "r_SN_N": r + rho, "v_SN_N": v + drho}
    inputs |= {"rho_ref_N": rho_ref, "drho_ref_N": drho_ref, "q_TN": (1, 0, 0, 0)}
    inputs |= {"q_SN": np.roll(S.as_quat(), 1), "q_DN": np.roll(D[0].as_quat(), 1)}
    inputs |= {"omega_SN_S": D[2], "omega_DN_D": D[1]}
    return inputs, C_NH, S


def gains(rng):
    return {f"K_{x}_{k}": rng.normal(size=(3, 3)) for x in ("rho", "drho") for k in (1, 2, 3)}


@pytest.mark.parametrize("phase", [1, 2, 3])
def test_force_is_linear_feedback_of_the_phase_in_hill_axes(fmu, rng, phase):
    """Switching distances 100 m and 10 m along a random axis; one phase per sample."""
    K, axis = gains(rng), random_direction(rng)
    e, de, ref = rng.normal(size=3), rng.normal(size=3), rng.normal(size=6)
    distance = (150.0, 50.0, 5.0)[phase - 1]
    aside = np.cross(axis, rng.normal(size=3))
    rho = distance * axis + aside
    ref = np.concatenate([rho - e, ref[3:]])
    inputs, C_NH, S = states(rng, rho, ref[3:] + de, ref)
    unit = fmu("switched_controller", K | {"axis_H": axis, "switch_distance": (100, 10)})
    for _ in range(3):
        unit.step(1, inputs)
    F_H = K[f"K_rho_{phase}"] @ e + K[f"K_drho_{phase}"] @ de
    assert unit.get("phase") == phase
    assert deviation(unit.get("F_cmd_S"), S.as_matrix().T @ C_NH @ F_H) < 1e-7
    assert deviation(unit.get("rho_H"), rho) < 1e-7
    assert deviation(unit.get("e_H"), e) < 1e-7
    assert deviation(unit.get("de_H"), de) < 1e-8


@pytest.mark.verifies("H.1-1")
def test_phases_follow_the_distance_and_never_go_back(fmu, rng):
    p = {"axis_H": (-1, 0, 0), "switch_distance": (100, 10), "t_abort": 8}
    unit, seen = fmu("switched_controller", p), []
    for k, x in enumerate((-150, -99, -200, -101, -9, -5, -300, -300, -300, -1)):
        unit.step(1, states(rng, np.array((x, 7.0, 0)), np.zeros(3))[0])
        seen.append((k, unit.get("phase"), unit.get("approaching")))
    assert [phase for _, phase, _ in seen] == [1, 2, 2, 2, 3, 3, 3, 3, 4, 4]
    assert [flag for _, _, flag in seen] == [0, 0, 0, 0, 1, 1, 1, 1, 0, 0]


@pytest.mark.verifies("H.1-1")
def test_a_distance_of_zero_does_not_end_a_phase(fmu, rng):
    near = states(rng, np.array((0, -50.0, 0)), np.zeros(3))[0]
    unit = fmu("switched_controller", {"switch_distance": (0, 10)})
    for _ in range(3):
        unit.step(1, near)
        assert (unit.get("phase"), unit.get("approaching")) == (1, 1)
    two = fmu("switched_controller", {"switch_distance": (10, 0)})
    for _ in range(3):
        two.step(1, near)
        assert (two.get("phase"), two.get("approaching")) == (2, 1)


@pytest.mark.verifies("H.1-2")
def test_no_force_from_the_abort_on_the_attitude_stays_controlled(fmu, rng):
    D = (Rotation.random(random_state=rng), np.zeros(3), np.array((0.01, 0, 0)))
    inputs = states(rng, np.array((0, 30.0, 0)), np.zeros(3), D=D)[0]
    unit = fmu("switched_controller", {"t_abort": 2})
    for k in range(4):
        unit.step(1, inputs)
        assert np.any(unit.get("F_cmd_S")) == (k < 2)
        assert np.any(unit.get("M_cmd_S"))


@pytest.mark.verifies("H.1-5")
def test_phase_begins_with_the_first_step_not_with_the_start_values(fmu, rng):
    near, far = (states(rng, np.array((0, y, 0)), np.zeros(3))[0] for y in (5.0, 500.0))
    unit = fmu("switched_controller", {"switch_distance": (100, 10)}, near)
    unit.step(1, far)
    assert unit.get("phase") == 1


@pytest.mark.verifies("H.1-3")
def test_force_and_torque_are_limited_per_axis(fmu, rng):
    p = {"F_max": (0.1, 0, 0.2), "M_max": (0.3, 0.1, 0), "K_att": (500, 500, 500)}
    D = (Rotation.random(random_state=rng), np.zeros(3), np.zeros(3))
    inputs = states(rng, np.array((30.0, -70.0, 50.0)), np.zeros(3), D=D)[0]
    cut, free = fmu("switched_controller", p), fmu("switched_controller", {"M_max": (0, 0, 0)})
    for unit in (cut, free):
        unit.step(1, inputs)
    F = free.get("F_cmd_S")
    bounds = np.array((0.1, np.inf, 0.2))
    assert deviation(cut.get("F_cmd_S"), np.clip(F, -bounds, bounds)) == 0
    assert cut.get("F_saturated").tolist() == (np.abs(F) > bounds).astype(float).tolist()
    assert np.all(np.abs(cut.get("M_cmd_S"))[:2] <= (0.3, 0.1))


@pytest.mark.parametrize("wheels", [0, 1])
def test_torque_turns_the_servicer_to_its_reference(fmu, rng, wheels):
    """M = -K q_vec - P (omega_SN - C_SD omega_DN), q_SD by rotations of scipy."""
    D = (Rotation.random(random_state=rng), rng.normal(size=3), rng.normal(size=3))
    inputs, _, S = states(rng, np.array((0, 30.0, 0)), np.zeros(3), D=D)
    K, P = rng.uniform(1, 9, 3), rng.uniform(1, 9, 3)
    p = {"K_att": K, "P_att": P, "M_max": (0, 0, 0), "use_wheels": wheels, "wheel_scale": 4}
    unit = fmu("switched_controller", p)
    unit.step(1, inputs)
    turn = D[0].inv() * S
    q = turn.as_quat() * np.sign(turn.as_quat()[3])
    M = -K * q[:3] - P * (D[2] - turn.as_matrix().T @ D[1])
    assert deviation(unit.get("M_cmd_S"), 0 * M if wheels else M) < 1e-12
    assert deviation(unit.get("wheel_accel_cmd"), -M / 4 if wheels else 0 * M) < 1e-12


@pytest.mark.verifies("H.1-4")
def test_attitude_rests_before_its_time(fmu, rng):
    D = (Rotation.random(random_state=rng), np.zeros(3), np.zeros(3))
    inputs = states(rng, np.array((0, 30.0, 0)), np.zeros(3), D=D)[0]
    unit = fmu("switched_controller", {"t_att": 2})
    for k in range(4):
        unit.step(1, inputs)
        assert np.any(unit.get("M_cmd_S")) == (k >= 2)


def test_at_rest_on_the_reference_nothing_is_commanded(fmu, rng):
    ref = rng.normal(size=6) * 30
    unit = fmu("switched_controller")
    unit.step(1, states(rng, ref[:3], ref[3:], ref)[0])
    assert deviation(unit.get("F_cmd_S"), 0) < 1e-7
    assert deviation(unit.get("M_cmd_S"), 0) < 1e-12


def test_result_does_not_depend_on_how_the_step_is_cut(fmu, rng):
    p = {"sample_period": 0.4, "switch_distance": (60, 0), "t_abort": 3.1}
    whole, cut = fmu("switched_controller", p), fmu("switched_controller", p)
    for _ in range(10):
        u = states(rng, rng.normal(size=3) * 100, rng.normal(size=3))[0]
        whole.step(0.4, u)
        for _ in range(4):
            cut.step(0.1, u)
        assert bits(cut) == bits(whole)


@pytest.mark.verifies("H.1-6")
def test_an_axis_that_is_no_unit_vector_is_rejected(tmp_path):
    assert "axis_H" in rejection("switched_controller", {"axis_H": (1, 1, 0)}, tmp_path)
