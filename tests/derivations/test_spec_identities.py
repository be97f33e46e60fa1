# SPDX-License-Identifier: BSD-2-Clause
"""Identities of frames, plants and guidance (docs/models.md A.1 to A.4.4) and the start of the
paper's case, each against a derivation of its own.

Exact derivatives come from second-order jets or complex steps, so that tolerances cover rounding
only: EXACT is about a hundred roundings of the largest term. Finite differences are used nowhere.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.each import Each
from tests.reference import attitude, guidance, orbit, paper_case, printed, servicer, target
from tests.reference.attitude import cross, tilde
from tests.reference.cases import (
    EXACT,
    MU,
    close,
    complex_step,
    direction,
    orbits,
    positive_definite,
    quaternion,
)
from tests.reference.printed import C, G


@pytest.fixture
def rng():
    return Each(range(20)).map(np.random.default_rng)


def test_matrix_of_rodrigues_parameters_is_the_passive_rotation_matrix(rng):
    R = Rotation.random(random_state=rng)
    assert close(C(R.as_mrp()), R.as_matrix().T)


def test_reference_quaternion_algebra_agrees_with_scipy(rng):
    A, B = Rotation.random(random_state=rng), Rotation.random(random_state=rng)
    a, b = A.as_quat(scalar_first=True), B.as_quat(scalar_first=True)
    assert close(attitude.dcm(a), A.as_matrix().T)
    assert close(attitude.dcm(attitude.multiply(a, b)), (A * B).as_matrix().T)
    assert close(attitude.dcm(attitude.quaternion_of_dcm(A.as_matrix().T)), A.as_matrix().T)
    assert close(attitude.dcm(attitude.quaternion_of_mrp(A.as_mrp())), A.as_matrix().T)
    assert close(attitude.mrp_of_quaternion(a), A.as_mrp())


def test_shepperd_signs_of_a_passive_matrix(rng):
    c = Rotation.random(random_state=rng).as_matrix().T
    q = attitude.quaternion_of_dcm(c)
    printed = np.array((c[1, 2] - c[2, 1], c[2, 0] - c[0, 2], c[0, 1] - c[1, 0])) / (4 * q[0])
    assert close(q[1:], printed, EXACT / q[0])


def test_shadow_set_is_the_same_attitude(rng):
    s = rng.normal(size=3)
    assert close(C(-s / (s @ s)), C(s))


def test_rate_matrix_times_its_transpose_is_isotropic(rng):
    s = rng.normal(size=3)
    assert close(G(s) @ G(s).T, (1 + s @ s) ** 2 * np.eye(3))


def test_rodrigues_parameters_are_an_eigenvector_of_the_rate_matrix_and_its_transpose(rng):
    s = rng.normal(size=3)
    assert close(G(s).T @ s, (1 + s @ s) * s)
    assert close(G(s) @ s, (1 + s @ s) * s)


def test_rate_matrix_written_out_has_the_full_norm_on_its_diagonal(rng):
    s = rng.normal(size=3)
    assert close(G(s), printed.G_written_out(s))


def test_rate_matrix_is_the_kinematics_of_quaternions(rng):
    R = Rotation.random(random_state=rng)
    q = attitude.positive(R.as_quat(scalar_first=True))
    assert close(G(attitude.mrp_of_quaternion(q)) / 4, attitude.mrp_rate_matrix(q))


def test_matrix_turns_against_the_angular_velocity(rng):
    """dC/dt = -tilde(w) C along s_dot = G w / 4."""
    s, w = rng.normal(size=3), rng.normal(size=3)
    assert close(complex_step(C, s, G(s) @ w / 4), -tilde(w) @ C(s))


def test_oblateness_acceleration_is_the_gradient_of_the_potential(rng):
    r = 7.2e6 * direction(rng)
    R_E, J2 = paper_case.ORBIT["R_E"], paper_case.ORBIT["J2"]
    gradient = [
        complex_step(lambda p: orbit.j2_potential(p, MU, R_E, J2), r, axis) for axis in np.eye(3)
    ]
    assert close(printed.j2_acceleration(r, MU, R_E, J2), gradient)
    assert close(orbit.j2_acceleration(r, MU, R_E, J2), gradient)


def test_gravity_gradient_torque_matches_point_masses(rng):
    """Three pairs of unit masses on the principal axes, exact gravity of each. With arms of 500 m
    the next term is (500 m/r)^2 = 5e-9 smaller, and rounding (a force of 8 N) gives 1e-12:
    tolerance 1e-7."""
    inertia = rng.uniform(80, 160, 3)
    arms = np.sqrt((inertia.sum() / 2 - inertia) / 2) * 100.0
    R = Rotation.random(random_state=rng).as_matrix()
    J = 1e4 * R @ np.diag(inertia) @ R.T
    r = 7.2e6 * direction(rng)
    points = [
        side * arm * axis for arm, axis in zip(arms, R.T, strict=True) for side in (-1.0, 1.0)
    ]
    total = sum(cross(p, -MU * (r + p) / np.linalg.norm(r + p) ** 3) for p in points)
    scale = 3 * MU / np.linalg.norm(r) ** 3 * np.max(J)
    torque = printed.gravity_gradient_torque(r, J, MU)
    assert close(orbit.gravity_gradient_torque(r, J, MU), torque, scale=scale)
    assert close(total, torque, 1e-7, scale)


def test_momentum_of_body_and_wheels_obeys_the_printed_equation(rng):
    """d/dt [C_SN' (J w + A Omega)] = C_SN' M, with the printed acceleration of the body."""
    J, A = positive_definite(rng, (200, 250, 150)), positive_definite(rng, (12, 15, 10))
    w, Omega, Omega_dot, M = rng.normal(size=(4, 3))
    q = quaternion(rng)
    H = J @ w + A @ Omega
    w_dot = np.linalg.solve(J, -cross(w, H) - A @ Omega_dot + M)
    C_NS, C_NS_dot = (
        attitude.dcm(q).T,
        complex_step(lambda x: attitude.dcm(x).T, q, attitude.rate(q, w)),
    )
    assert close(C_NS_dot @ H + C_NS @ (J @ w_dot + A @ Omega_dot), C_NS @ M, scale=250.0)


def test_reference_target_is_the_printed_right_hand_side(rng):
    p, t = paper_case.TARGET, 1300.0
    y = target.initial_state(p)
    w = y[10:13] = rng.normal(size=3)
    M = p.M_dist_T(t) + printed.gravity_gradient_torque(
        attitude.dcm(y[6:10]) @ y[:3], p.inertia, MU
    )
    dy = target.rhs(t, y, p, target.Input())
    assert close(dy[10:], np.linalg.solve(p.inertia, -cross(w, p.inertia @ w) + M))
    assert close(
        dy[3:6],
        -MU * y[:3] / np.linalg.norm(y[:3]) ** 3 + printed.j2_acceleration(y[:3], MU, p.R_E, p.J2),
    )


def test_reference_servicer_is_the_printed_right_hand_side(rng):
    p, t = paper_case.SERVICER, 1300.0
    y = servicer.initial_state(p)
    y[10:16] = rng.normal(size=6)
    r, v, q, w, Omega = y[:3], y[3:6], y[6:10], y[10:13], y[13:16]
    u = servicer.Input(F_S=rng.normal(size=3), wheel_accel_cmd=rng.normal(size=3))
    dy = servicer.rhs(t, y, p, u, active=True)
    H = p.inertia @ w + p.wheel_inertia @ Omega
    assert close(
        p.inertia @ dy[10:13], -cross(w, H) - p.wheel_inertia @ u.wheel_accel_cmd + p.M_dist_S(t)
    )
    gravity = -MU * r / np.linalg.norm(r) ** 3 + printed.j2_acceleration(r, MU, p.R_E, p.J2)
    force = attitude.dcm(q).T @ u.F_S / p.mass_0
    assert close(dy[3:6], gravity + force + orbit.hill_axes(r, v).T @ p.a_dist(t))


def test_orbit_frame_turns_with_the_printed_keplerian_rates(rng):
    c = orbits(rng)
    w, alpha = attitude.angular_rates(*c.C_HN)
    assert close(w, (0, 0, c.th))
    assert close(alpha, (0, 0, c.thd), scale=c.th**2)


def test_relative_velocity_in_the_orbit_frame(rng):
    c = orbits(rng)
    rho = c.C_HN @ (c.S - c.T)
    assert close(rho.d, c.C_HN.x @ (c.S.d - c.T.d) - cross((0, 0, c.th), rho.x))


def test_model_term_is_the_difference_of_inertial_accelerations_seen_in_the_orbit_frame(rng):
    """Rounding: 1e-16 of g = 8 m/s2 in each of a few terms, hence an absolute 1e-14 m/s2."""
    c = orbits(rng)
    rho = c.C_HN @ (c.S - c.T)
    free = printed.f_rel(rho.x, rho.d, c.r_t, c.th, c.thd, MU)
    assert close(rho.dd, free + c.C_HN.x @ c.a_F, 1e-14, scale=1.0)


def test_model_term_splits_into_the_printed_matrices_and_remainder(rng):
    c = orbits(rng)
    rho = c.C_HN @ (c.S - c.T)
    terms = (rho.x, rho.d, c.r_t, c.th, c.thd, MU)
    assert close(printed.f_rel_split(*terms), printed.f_rel(*terms), 1e-14, scale=1.0)


def test_printed_sign_of_the_gravity_bias_is_wrong_by_sixteen_metres_per_second_squared():
    """Erratum E6, at the paper's radius."""
    r, _ = paper_case.TARGET.start()
    bias = 2 * np.linalg.norm(orbit.central_gravity(r, MU))
    assert bias == pytest.approx(16, rel=0.02)


def test_oblateness_turns_the_orbit_frame_out_of_plane_by_the_stated_bound():
    """Section 4.1: r (a . ih)/|h| <= 1.2e-6 rad/s on the paper's orbit."""
    o = paper_case.ORBIT
    worst = 0.0
    for nu in np.linspace(0, 2 * np.pi, 721):
        r, v = orbit.state_of_elements(MU, o["a"], o["e"], o["inc"], o["argp"], o["raan"], nu)
        h = np.cross(r, v)
        a = orbit.j2_acceleration(r, MU, o["R_E"], o["J2"])
        worst = max(worst, abs(a @ h) / (h @ h) * np.linalg.norm(r))
    assert 0.9e-6 < worst < 1.25e-6


def test_grasp_axis_starts_close_to_the_along_track_axis():
    """3.9 degrees from [0, 1, 0] in H."""
    T = target.body(target.initial_state(paper_case.TARGET))
    S = servicer.body(servicer.initial_state(paper_case.SERVICER))
    out, _ = guidance.sample(0.0, T, S, paper_case.GUIDANCE)
    assert np.degrees(out["beta_t"]) == pytest.approx(3.9, abs=0.05)
    assert close(out["rho_H"], (0, 20, 0), 1e-8, 1.0)  # 1e-9 m resolution of 7e6 m
    assert close(out["drho_H"], np.zeros(3), 1e-11, 1.0)  # 1e-12 m/s resolution of 7e3 m/s


def test_elements_of_the_start_state_are_the_given_ones():
    r, v = paper_case.TARGET.start()
    a, e = orbit.elements_of_state(r, v, MU)
    h = np.cross(r, v)
    assert a == pytest.approx(7158.14e3, rel=EXACT)
    assert e == pytest.approx(0.01, rel=1e-11)  # difference of two terms near 1
    assert np.degrees(np.arccos(h[2] / np.linalg.norm(h))) == pytest.approx(30.0, rel=EXACT)
    assert np.degrees(np.arctan2(h[0], -h[1])) == pytest.approx(120.0, rel=EXACT)


def test_fixed_step_plants_agree_with_the_tight_tolerance_truth():
    """70 s around t_att under constant inputs: RK4 at 0.1 s is exact to the rounding of 7e6 m and
    7e3 m/s.
    """
    T, S = paper_case.TARGET, paper_case.SERVICER
    u = servicer.Input(F_S=(0.1, -0.2, 0.05), wheel_accel_cmd=(1e-3, -2e-3, 1.5e-3))
    yT, yS = target.initial_state(T), servicer.initial_state(S)
    T_truth, S_truth = target.truth(T, yT, 1190.0, 1260.0), servicer.truth(S, yS, 1190.0, 1260.0, u)
    T_steps, S_steps = target.step(T, yT, 1190.0, 1260.0), servicer.step(S, yS, 1190.0, 1260.0, u)
    for steps, exact in ((T_steps, T_truth), (S_steps, S_truth)):
        assert close(steps[:3], exact[:3], 1e-6, 1.0)
        assert close(steps[3:6], exact[3:6], 1e-9, 1.0)
        assert close(attitude.dcm(steps[6:10]), attitude.dcm(exact[6:10]), 1e-11, 1.0)
        assert close(steps[10:], exact[10:], 1e-11, 1.0)
