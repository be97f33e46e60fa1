# SPDX-License-Identifier: BSD-2-Clause
"""adaptive_controller.fmu, the law: feed-forward, regressors, options, symmetries, sampling.
Stability: next file.
"""

from __future__ import annotations

import numpy as np
import pytest

from ..reference import adaptive as reference
from ..reference.body import Body
from .adaptive_cases import (
    attitude_error,
    desired_rates,
    feedback,
    following_torque,
    gravity,
    parameters,
    position_error,
    situation,
    symmetric,
    without_errors,
)
from .cases import random_rotation, turned
from .driver import bits
from .motion import deviation
from .theory import dcm_of_quaternion, hill_axes

PERIOD = 1.0  # s; long, so that the increments of the estimates retain their digits


def one_step(fmu, p, u, h=PERIOD, start=0.0):
    """Outputs after the first sample: the command uses the start values of the estimates."""
    unit = fmu("adaptive_controller", p, u, start)
    unit.step(h)
    return unit.outputs()


def force_N(out, u):
    return dcm_of_quaternion(u["q_SN"]).T @ out["F_cmd_S"]


# ---- translation ----


def test_errors_match_the_true_motion_in_the_turning_hill_frame(fmu, rng):
    p, u = parameters(rng), situation(rng)
    out = one_step(fmu, p, u)
    e1, e2, _ = position_error(u, np.zeros(3), 1)
    assert deviation(out["e1_H"], e1) < 1e-13
    assert deviation(out["e2_H"], e2) < 1e-14


def test_force_is_published_in_hill_and_in_servicer_axes(fmu, rng):
    u = situation(rng)
    out = one_step(fmu, parameters(rng), u)
    C_SH = dcm_of_quaternion(u["q_SN"]) @ hill_axes(u["r_TN_N"], u["v_TN_N"]).T
    assert deviation(out["F_cmd_S"], C_SH @ out["F_cmd_H"], np.linalg.norm(out["F_cmd_H"])) < 1e-14


def test_without_error_the_force_is_pure_feed_forward_of_the_true_dynamics(fmu, rng):
    """m_hat (ddrho_ref - differential gravity); rounding of 8 m/s2 in the difference. The estimate
    rests.
    """
    p, u = parameters(rng), without_errors(situation(rng))
    out = one_step(fmu, p, u)
    expected = p["m_hat_0"] * (u["ddrho_ref_N"] - gravity(u["r_SN_N"]) + gravity(u["r_TN_N"]))
    assert deviation(force_N(out, u), expected, p["m_hat_0"]) < 1e-14
    assert deviation(out["m_hat"], p["m_hat_0"]) == 0


def test_with_the_true_mass_the_position_error_obeys_its_linear_equation(fmu, rng):
    """de2/dt = -K e1 - P e2 along the true motion: every term of the model cancels."""
    p, u = parameters(rng), situation(rng)
    out = one_step(fmu, p, u)
    e1, e2, de2 = position_error(u, force_N(out, u), p["m_hat_0"])
    assert deviation(de2, -p["K_rho"] * e1 - p["P_rho"] * e2) < 1e-14


@pytest.mark.parametrize("damping", [0, 1])
def test_mass_estimate_moves_along_the_regressor_of_the_force(fmu, rng, damping):
    """The acceleration without control, Psi, from the true motion; regressor Psi + K e1 (+ P
    e2).
    """
    p, u = parameters(rng) | {"damping_in_regressor": damping}, situation(rng)
    e1, e2, Psi = position_error(u, np.zeros(3), 1)
    rate = p["Gamma_m"] * e2 @ (Psi + p["K_rho"] * e1 + damping * p["P_rho"] * e2)
    assert (
        deviation(one_step(fmu, p, u)["m_hat"] - p["m_hat_0"], PERIOD * rate) < 1e-12 * p["m_hat_0"]
    )


# ---- attitude ----


def test_attitude_error_is_the_rotation_from_the_desired_to_the_actual_body(fmu, rng):
    u = situation(rng)
    out = one_step(fmu, parameters(rng), u)
    epsilon, wd = attitude_error(u)
    assert deviation(out["epsilon"], epsilon) < 1e-14
    assert deviation(out["domega_S"], u["omega_SN_S"] - wd) < 1e-15
    assert np.linalg.norm(out["epsilon"]) <= 1


def test_without_error_the_wheels_give_the_true_dynamics_the_desired_acceleration(fmu, rng):
    """J domega = -omega x (J omega + A Omega) - A dOmega with the estimated inertias is the desired
    acceleration.
    """
    p, u = parameters(rng), without_errors(situation(rng))
    out = one_step(fmu, p, u)
    J, A, w = symmetric(p["eta_hat_0"][:6]), symmetric(p["eta_hat_0"][6:]), u["omega_SN_S"]
    domega = np.linalg.solve(
        J, -np.cross(w, J @ w + A @ u["wheel_speed"]) - A @ out["wheel_accel_cmd"]
    )
    assert deviation(domega, u["alpha_DN_D"]) < 1e-15
    assert deviation(out["eta_hat"], p["eta_hat_0"], np.abs(p["eta_hat_0"]).max()) < 1e-14


def test_wheel_command_feeds_back_the_errors_and_forward_the_desired_motion(fmu, rng):
    """(19) with different gains per axis; Jacobian of the kinematics by stencil."""
    p, u = parameters(rng), situation(rng)
    accel = one_step(fmu, p, u)["wheel_accel_cmd"]
    assert deviation(following_torque(u, p["eta_hat_0"], accel), feedback(u, p)) < 1e-9


def test_inertia_estimates_move_along_the_jacobian_of_the_following_torque(fmu, rng):
    """The torque is linear in eta: its Jacobian is what each of the twelve unit inertias needs, and
    W = -Jacobian.
    """
    p, u = parameters(rng), situation(rng)
    out = one_step(fmu, p, u)
    jacobian = np.array(
        [following_torque(u, unit, out["wheel_accel_cmd"]) for unit in np.eye(12)]
    ).T
    dw = u["omega_SN_S"] - desired_rates(u)[0]
    expected = -PERIOD * p["Gamma_eta"] * (jacobian.T @ dw)
    assert (
        deviation(out["eta_hat"] - p["eta_hat_0"], expected, np.abs(p["eta_hat_0"]).max()) < 1e-14
    )


@pytest.mark.verifies("A.5-3")
def test_without_wheels_the_torque_is_what_the_wheels_would_have_given(fmu, rng):
    p, u = parameters(rng), situation(rng)
    wheels, thrusters = one_step(fmu, p, u), one_step(fmu, p | {"use_wheels": 0}, u)
    expected = -symmetric(p["eta_hat_0"][6:]) @ wheels["wheel_accel_cmd"]
    assert deviation(thrusters["M_cmd_S"], expected, np.abs(expected).max()) < 1e-13
    assert not thrusters["wheel_accel_cmd"].any()
    assert not wheels["M_cmd_S"].any()
    assert deviation(thrusters["eta_hat"][:6], wheels["eta_hat"][:6]) == 0
    jacobian = np.array([following_torque(u, unit, np.zeros(3)) for unit in np.eye(12)]).T
    step = -PERIOD * p["Gamma_eta"] * (jacobian.T @ (u["omega_SN_S"] - desired_rates(u)[0]))
    assert (
        deviation(thrusters["eta_hat"] - p["eta_hat_0"], step, np.abs(p["eta_hat_0"]).max()) < 1e-14
    )


@pytest.mark.verifies("A.5-2")
def test_attitude_control_rests_before_its_time_and_its_errors_are_shown(fmu, rng):
    p, u = parameters(rng) | {"t_att": 10.0}, situation(rng)
    unit, free = fmu("adaptive_controller", p, u), one_step(fmu, p | {"t_att": 0.0}, u)
    for _ in range(10):
        unit.step(1.0)
        out = unit.outputs()
        assert not out["wheel_accel_cmd"].any()
        assert not out["M_cmd_S"].any()
        assert deviation(out["eta_hat"], p["eta_hat_0"]) == 0
        for name in ("epsilon", "domega_S", "e1_H", "e2_H"):
            assert deviation(out[name], free[name]) == 0
    unit.step(1.0)
    assert deviation(unit.get("wheel_accel_cmd"), free["wheel_accel_cmd"]) == 0
    assert deviation(unit.get("eta_hat"), free["eta_hat"]) == 0


# ---- estimates ----


@pytest.mark.verifies("A.5-1")
def test_command_uses_the_estimate_before_its_update_and_the_published_estimate_is_the_one_after(
    fmu, rng
):
    """Same inputs twice: the force follows the mass estimate with one sample delay."""
    p, u = parameters(rng), situation(rng)
    unit = fmu("adaptive_controller", p, u)
    assert unit.get("m_hat") == p["m_hat_0"]
    assert deviation(unit.get("eta_hat"), p["eta_hat_0"]) == 0
    F, m, accel = [unit.get("F_cmd_H")], [p["m_hat_0"]], [unit.get("wheel_accel_cmd")]
    for _ in range(3):
        unit.step(PERIOD)
        F.append(unit.get("F_cmd_H"))
        m.append(unit.get("m_hat"))
        accel.append(unit.get("wheel_accel_cmd"))
    assert deviation(F[1], F[0]) == 0
    assert deviation(accel[1], accel[0]) == 0
    assert abs(m[1] - m[0]) > 1e-3
    assert deviation(F[2], F[1] * m[1] / m[0], np.abs(F[1]).max()) < 1e-14
    assert deviation(np.diff(m), m[1] - m[0]) < 1e-12


def test_gain_scale_multiplies_the_steps_of_the_inertia_estimates_only(fmu, rng):
    p, u = parameters(rng), situation(rng)
    full, tenth = one_step(fmu, p, u), one_step(fmu, p | {"Gamma_scale": 0.1}, u)
    steps = full["eta_hat"] - p["eta_hat_0"]
    assert deviation(tenth["eta_hat"] - p["eta_hat_0"], 0.1 * steps) < 1e-12
    assert full["m_hat"] == tenth["m_hat"]


@pytest.mark.verifies("A.5-4")
@pytest.mark.parametrize("share", [1 - 1e-9, 1 + 1e-9])
def test_inertia_estimates_rest_while_a_wheel_is_at_its_limit(fmu, rng, share):
    """The command and the mass estimate are as without the rule."""
    p, u = parameters(rng), situation(rng)
    fastest = np.abs(u["wheel_speed"]).max()
    free, limited = one_step(fmu, p, u), one_step(fmu, p | {"wheel_rest": share * fastest}, u)
    expected = p["eta_hat_0"] if share < 1 else free["eta_hat"]
    assert deviation(limited["eta_hat"], expected) == 0
    assert deviation(free["eta_hat"], p["eta_hat_0"]) > 0
    assert limited["m_hat"] == free["m_hat"]
    assert deviation(limited["wheel_accel_cmd"], free["wheel_accel_cmd"]) == 0


@pytest.mark.verifies("A.5-5")
def test_projection_retains_every_estimate_within_its_range_of_the_start_value(fmu, rng):
    """Gains so large that one sample leaves every range; without projection they do leave them."""
    p = parameters(rng) | {"Gamma_m": 1e5, "Gamma_eta": np.full(12, 1e7)}
    ranges = {"m_hat_range": 0.2, "eta_hat_range": 0.15, "J_offdiag_max": 7.0, "A_offdiag_max": 0.5}
    space = np.where(
        np.tile([1, 0, 0, 1, 0, 1], 2), 0.15 * p["eta_hat_0"], np.repeat([7.0, 0.5], 6)
    )
    inside, outside = (fmu("adaptive_controller", p | ranges | {"projection": k}) for k in (1, 0))
    reached = np.zeros(12, dtype=bool)
    for _ in range(10):
        u = situation(rng)
        inside.step(PERIOD, u)
        away = np.abs(inside.get("eta_hat") - p["eta_hat_0"])
        assert (away <= space * (1 + 1e-12)).all()
        assert abs(inside.get("m_hat") / p["m_hat_0"] - 1) <= 0.2 * (1 + 1e-12)
        reached |= away > space * (1 - 1e-9)
    outside.step(PERIOD, u)
    assert reached.all()
    assert (np.abs(outside.get("eta_hat") - p["eta_hat_0"]) > space).all()


@pytest.mark.verifies("A.5-5")
def test_projection_changes_nothing_within_the_ranges(fmu, rng):
    p, u = parameters(rng) | {"Gamma_m": 1, "Gamma_scale": 1e-3}, situation(rng)
    free, projected = one_step(fmu, p, u), one_step(fmu, p | {"projection": 1}, u)
    assert deviation(projected["eta_hat"], free["eta_hat"]) == 0
    assert projected["m_hat"] == free["m_hat"]


# ---- symmetries ----


def test_turning_everything_given_in_inertial_axes_leaves_the_commands_as_they_are(fmu, rng):
    """1e-12 of the largest term: m_hat x 8 m/s2 of gravity in the force, whose rounding equals the
    rounding of turned positions.
    """
    p, u = parameters(rng), situation(rng)
    one, other = (one_step(fmu, p, x) for x in (u, turned(u, random_rotation(rng))))
    scale = {
        "F_cmd_S": 8 * p["m_hat_0"],
        "F_cmd_H": 8 * p["m_hat_0"],
        "e1_H": 7e6,
        "e2_H": 7e3,
        "m_hat": 8e2,
    }
    for name, value in one.items():
        assert deviation(other[name], value, scale.get(name, np.abs(value).max() or 1)) < 1e-12, (
            name
        )


@pytest.mark.parametrize("name", ["q_TN", "q_SN", "q_DN"])
def test_quaternions_of_either_sign_are_the_same_attitude(fmu, rng, name):
    p, u = parameters(rng), situation(rng)
    one, other = (
        fmu("adaptive_controller", p, u),
        fmu("adaptive_controller", p, u | {name: -u[name]}),
    )
    for unit in (one, other):
        unit.step(PERIOD)
    assert bits(other) == bits(one)


def test_in_deep_space_the_hill_frame_is_inertial_and_there_is_no_gravity(fmu, rng):
    p, u = parameters(rng) | {"mu": 0}, situation(rng)
    out = one_step(fmu, p, u)
    e1 = u["r_SN_N"] - u["r_TN_N"] - u["rho_ref_N"]
    e2 = u["v_SN_N"] - u["v_TN_N"] - u["drho_ref_N"]
    assert deviation(out["e1_H"], e1) < 1e-15
    assert deviation(out["e2_H"], e2) < 1e-15
    expected = -p["m_hat_0"] * (p["K_rho"] * e1 + p["P_rho"] * e2 - u["ddrho_ref_N"])
    assert deviation(out["F_cmd_H"], expected, np.abs(expected).max()) < 1e-14


# ---- sampling ----


@pytest.mark.parametrize("h", [0.1, 0.25, 0.5])
def test_samples_are_taken_at_multiples_of_the_period_and_held(fmu, rng, h):
    """Inputs change at every call; only those at 0, 0.5, 1.0, ... s count, for any step of the
    master.
    """
    period, p = 0.5, parameters(rng) | {"sample_period": 0.5, "t_att": 1.0}
    inputs = [situation(np.random.default_rng(k)) for k in range(4)]
    slow, sampled = (fmu("adaptive_controller", p, inputs[0]) for _ in range(2))
    for k in range(4):
        slow.step(period, inputs[k])
        for i in range(round(period / h)):
            sampled.step(h, inputs[k] if i == 0 else situation(rng))
            assert bits(sampled) == bits(slow)


@pytest.mark.parametrize("h", [0.1, 0.2, 2.5])
def test_steps_across_sample_times_or_over_several_change_nothing(fmu, rng, h):
    p, u = parameters(rng) | {"sample_period": 0.5, "t_att": 1.0}, situation(rng)
    sampled, cut = (fmu("adaptive_controller", p, u) for _ in range(2))
    for _ in range(5):
        sampled.step(0.5)
    for _ in range(round(2.5 / h)):
        cut.step(h)
    assert bits(cut) == bits(sampled)


# ---- reference implementation ----


@pytest.mark.parametrize(
    "options", [{}, {"use_wheels": 0, "damping_in_regressor": 1}, {"projection": 1, "t_att": 2.0}]
)
def test_outputs_match_the_reference_implementation(fmu, rng, options):
    """Over several samples; projection about diagonal start values, where all readings of its range
    agree.
    """
    p = parameters(rng) | {"Gamma_scale": 0.05} | options
    if "projection" in options:
        p["eta_hat_0"] = p["eta_hat_0"] * np.tile([1, 0, 0, 1, 0, 1], 2)
    q = reference.Parameters(**p)
    x, unit = reference.initial_estimate(q), fmu("adaptive_controller", p)
    for k in range(6):
        u = situation(rng)
        T, S = (
            Body(u[f"r_{b}N_N"], u[f"v_{b}N_N"], u[f"q_{b}N"], u[f"omega_{b}N_{b}"]) for b in "TS"
        )
        expected, x = reference.sample(float(k), T, S, u["wheel_speed"], u, x, q, PERIOD)
        unit.step(PERIOD, u)
        for name, value in expected.items():
            assert deviation(unit.get(name), value, np.abs(value).max() or 1) < 1e-9, name
