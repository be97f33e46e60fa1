# SPDX-License-Identifier: BSD-2-Clause
"""theta_d_controller.fmu: a linear quadratic regulator where nothing depends on the state, and what
it adds.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from scipy.linalg import solve_continuous_are

from ..reference import los, theta_d
from ..reference import ppc as shared
from ..reference.jet import Jet
from .cases import random_direction, random_inertia
from .los_cases import Scene, bodies, random_scene, reference_of, sample
from .motion import deviation

SPACE = {"a_max": 0, "M_max": (0, 0, 0), "mu": 0}
LINEAR = {"k_1": 1, "l_1": 0, "k_2": 1, "l_2": 0, "k_att": 1, "l_att": 0}
"""Both corrections suppressed for ever."""
SIGMA = np.array((-1, -1, 1))


def random_weights(rng):
    channels = {
        c: theta_d.Weights(*np.exp(rng.uniform(-2, 2, 3)))
        for c in ("range", "elevation", "azimuth")
    }
    turning = theta_d.Weights(*rng.uniform((100, 500, 0.5), (2000, 4000, 2.0)))
    p = theta_d.ThetaD(
        **channels, attitude=turning, J_hat=random_inertia(rng), A_hat=random_inertia(rng, 2, 12)
    )
    return replace(
        p,
        **dict(
            zip(("k_1", "k_2", "l_1", "l_2", "k_att", "l_att"), rng.uniform(0, 1, 6), strict=True)
        ),
    )


@pytest.mark.parametrize("up_axis", [1, 2, 3])
def test_outputs_match_the_reference_over_three_samples(fmu, rng, up_axis):
    """Riccati by scipy, Lyapunov by Kronecker products; 1e-7 relative: 1e-9 m of cancellation by
    gains.
    """
    p = replace(
        random_weights(rng),
        up_axis=up_axis,
        t_att=2.1,
        use_wheels=rng.integers(2),
        force_scale=80.0,
    )
    unit, law = fmu("theta_d_controller", shared.settings(p), None, 2.0), theta_d.ThetaDLaw(p, 2.0)
    for k in range(3):
        wheels = rng.normal(size=3)
        u = random_scene(rng, up_axis).inputs() | {"wheel_speed": wheels}
        expected = law(2.0 + 0.1 * k, *bodies(u), wheels, reference_of(u))
        out = sample(unit, u)
        for name, value in expected.items():
            assert deviation(out[name], value, 1 + np.max(np.abs(value))) < 1e-7, (k, name)


# ---- the regulator ----


def test_position_gains_match_the_double_integrator(fmu, rng):
    """kp = sqrt(qp/r), kd = sqrt(qv/r + 2 kp); control per channel divided by g = (1, 1/rho, 1/(rho
    ce)).
    """
    p = random_weights(rng)
    scene = replace(random_scene(rng), r_TN_N=np.zeros(3), v_TN_N=np.zeros(3))
    at_rest = replace(scene, dref=np.zeros(3), ddrho_ref_N=np.zeros(3))
    out = sample(fmu("theta_d_controller", shared.settings(p) | SPACE | LINEAR), at_rest.inputs())
    weights = (p.range, p.elevation, p.azimuth)
    kp = np.sqrt([w.Q_error / w.R for w in weights])
    kd = np.sqrt([w.Q_rate / w.R for w in weights] + 2 * kp)
    rho, elevation, _ = scene.ref + scene.x1
    u = -np.array((1, rho, rho * np.cos(elevation))) * (kp * scene.x1 + kd * scene.x2)
    assert deviation(SIGMA * out["a_cmd_L"], u, np.max(np.abs(u))) < 1e-10


def test_attitude_gains_match_scipy_for_a_full_inertia(fmu, rng):
    p = random_weights(rng)
    scene = Scene(turn=0.8 * random_direction(rng), omega=0.1 * rng.normal(size=3))
    out = sample(fmu("theta_d_controller", shared.settings(p) | SPACE | LINEAR), scene.inputs())
    A = np.block([[np.zeros((3, 3)), 0.5 * np.eye(3)], [np.zeros((3, 6))]])
    B = np.vstack((np.zeros((3, 3)), np.linalg.inv(p.J_hat)))
    Q = np.diag([p.attitude.Q_error] * 3 + [p.attitude.Q_rate] * 3)
    X = solve_continuous_are(A, B, Q, p.attitude.R * np.eye(3))
    feedback = -B.T @ X @ np.concatenate((out["q_SD"][1:], scene.omega)) / p.attitude.R
    gyroscopic = np.cross(scene.omega, p.J_hat @ scene.omega)
    assert deviation(out["M_cmd_S"], feedback + gyroscopic, np.max(np.abs(feedback))) < 1e-10


def test_attitude_gains_of_the_spec(fmu):
    """kp = sqrt(qp/r) = 30 and kd = sqrt(qv/r + J kp) per axis, from the weights alone."""
    turn = 1e-6 * np.array((1.0, 2.0, 3.0))
    out = sample(fmu("theta_d_controller", SPACE), Scene(turn=turn).inputs())
    assert deviation(out["M_cmd_S"] / (turn / 2), -30.0, 30.0) < 1e-9
    w = 1e-8 * np.array((1.0, 2.0, 3.0))  # gyroscopic torque of second order
    out = sample(fmu("theta_d_controller", SPACE), Scene(omega=w).inputs())
    assert deviation(out["M_cmd_S"] / w, -np.sqrt(2100 + 30 * np.array((50, 45, 60))), 60.0) < 1e-7


@pytest.mark.verifies("C.5-7")
def test_without_rates_the_full_law_is_the_regulator(fmu, rng):
    """All of A is proportional to rates: at rest the corrections vanish although they are not
    suppressed.
    """
    scene = Scene(x1=rng.normal(size=3) * (5, 0.1, 0.1))
    full, linear = (
        sample(fmu("theta_d_controller", SPACE | p), scene.inputs()) for p in ({}, LINEAR)
    )
    assert deviation(full["a_cmd_L"], linear["a_cmd_L"]) < 1e-12


@pytest.mark.parametrize("stiffness", [1e-8, 1e-4, 1.0, 1e4, 1e8])
def test_the_riccati_solution_holds_over_many_orders_of_bandwidth(fmu, stiffness):
    """From hours to milliseconds."""
    weights = {"range.Q_error": stiffness**2, "range.Q_rate": stiffness, "range.R": 1}
    x1 = np.array((1.0, 0, 0))
    out = sample(fmu("theta_d_controller", SPACE | LINEAR | weights), Scene(x1=x1).inputs())
    assert abs(out["a_cmd_L"][0] / stiffness - 1) < 1e-9


# ---- the factorisation and the expansion ----


def random_pair(rng):
    """LOS coordinates of two motions, neither near a pole."""

    def motion():
        q = np.array((rng.uniform(10, 200), rng.uniform(-1.2, 1.2), rng.uniform(-3, 3)))
        return los.Los(Jet(q, rng.normal(size=3) * (2, 0.1, 0.1), np.zeros(3)), np.eye(3))

    return motion(), motion()


def test_factorisation_is_exact(rng):
    """A x = f(x) - f(0), with a reference whose range moves."""
    now, ref = random_pair(rng)
    x = np.concatenate((now.q.x - ref.q.x, now.q.d - ref.q.d))
    difference = los.kinematic_acceleration(now.q.x, now.q.d) - los.kinematic_acceleration(
        ref.q.x, ref.q.d
    )
    assert (
        deviation(
            theta_d.kinematic_matrix(now, ref) @ x, difference, 1 + np.max(np.abs(difference))
        )
        < 1e-12
    )


@pytest.mark.parametrize("regulator", [theta_d.position_regulator, theta_d.attitude_regulator])
def test_expansion_approaches_the_state_dependent_riccati_equation_with_the_third_power(
    rng, regulator
):
    """|T0 + T1 + T2 - T(A)| = O(|A|^3): halving A divides it by 8."""
    w = theta_d.Weights(0.5, 1.0, 1.0)
    p = theta_d.ThetaD(range=w, elevation=w, azimuth=w, J_hat=np.diag((1.0, 1.5, 2.0)), attitude=w)
    reg, lower = regulator(p), np.zeros((6, 6))
    lower[3:] = 0.02 * rng.normal(size=(3, 6))

    def error(A):
        return np.linalg.norm(
            reg.cost_matrix(A, 1, 1) - solve_continuous_are(reg.A0 + A, reg.B, reg.Q, reg.R)
        )

    assert abs(error(lower) / error(lower / 2) - 8) < 1


@pytest.mark.verifies("C.5-8")
def test_corrections_are_released_with_time(fmu, rng):
    """eps = 1 - k exp(-l t): for k = 1 the regulator at first, the full expansion in the end;
    attitude from t_att. The two differ by a thousand times what equal values may differ by.
    """
    scene = replace(random_scene(rng), r_TN_N=np.zeros(3), v_TN_N=np.zeros(3)).inputs()
    late = {"k_1": 1, "k_2": 1, "k_att": 1, "l_1": 1, "l_2": 1, "l_att": 1}
    linear, full = (
        sample(fmu("theta_d_controller", SPACE | LINEAR), scene),
        sample(fmu("theta_d_controller", SPACE | LINEAR | {"k_1": 0, "k_2": 0, "k_att": 0}), scene),
    )
    unit = fmu("theta_d_controller", SPACE | late | {"t_att": 40.0, "sample_period": 40.0})
    first = sample(unit, scene, 40.0)
    assert deviation(first["a_cmd_L"], linear["a_cmd_L"]) < 1e-10
    second = sample(unit, scene, 40.0)
    assert deviation(second["a_cmd_L"], full["a_cmd_L"]) < 1e-9
    assert deviation(second["M_cmd_S"], linear["M_cmd_S"]) < 1e-9
    third = sample(unit, scene, 40.0)
    assert deviation(third["M_cmd_S"], full["M_cmd_S"]) < 1e-9
    assert deviation(full["M_cmd_S"], linear["M_cmd_S"]) > 1e-6
    assert deviation(full["a_cmd_L"], linear["a_cmd_L"]) > 1e-6


@pytest.mark.verifies("C.5-9")
def test_spinning_wheels_are_taken_into_account(fmu, rng):
    """Their momentum turned by the body adds omega x A Omega."""
    scene, wheels, A = (
        Scene(omega=0.1 * rng.normal(size=3)),
        rng.normal(size=3),
        random_inertia(rng, 2, 12),
    )
    p = SPACE | {"A_hat": A}
    still = sample(fmu("theta_d_controller", p), scene.inputs())
    running = sample(fmu("theta_d_controller", p), scene.inputs() | {"wheel_speed": wheels})
    assert (
        deviation(running["M_cmd_S"] - still["M_cmd_S"], np.cross(scene.omega, A @ wheels)) < 1e-11
    )


@pytest.mark.verifies("C.5-11")
@pytest.mark.parametrize(
    "p",
    [
        {"range.Q_error": 0},
        {"elevation.Q_rate": -1},
        {"azimuth.R": 0},
        {"attitude.R": -1},
        {"k_1": 1.1},
        {"l_2": -1},
        {"J_hat": np.diag((1, 1, 3))},
        {"A_hat": np.diag((1, 1, 0))},
    ],
    ids=lambda p: next(iter(p)),
)
def test_weights_and_inertias_that_are_not_positive_are_rejected(fmu, p):
    with pytest.raises(FMICallException):
        fmu("theta_d_controller", p)
