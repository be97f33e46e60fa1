# SPDX-License-Identifier: BSD-2-Clause
"""Headers of flight software at the edges of their rules, where no test of an FMU leads."""

import numpy as np
import pytest

X, Y, Z = np.eye(3)


# ---- limited_roll.h


@pytest.mark.parametrize("side", [1, -1])
def test_a_roll_nearly_half_a_turn_away_goes_on_in_its_sense(core, side):
    """3.1 rad ahead while D turns backwards: the shorter way would reverse the rotation."""
    psi = side * 3.1
    rule = np.cos(psi) * Y + np.sin(psi) * Z
    assert core.missing_roll(X, Y, side * 0.1, rule, 0) == pytest.approx(psi, abs=1e-15)
    assert core.missing_roll(X, Y, -side * 0.1, rule, 0) == pytest.approx(
        psi - side * 2 * np.pi, abs=1e-15
    )
    near = np.cos(side * 2.9) * Y + np.sin(side * 2.9) * Z
    assert core.missing_roll(X, Y, -side * 0.1, near, 0) == pytest.approx(side * 2.9, abs=1e-15)


def test_the_closing_rate_is_odd_and_stops_at_the_rule(core):
    a, tau = 2e-3, 5.0
    for psi in (0.01, 0.05, 0.3, 2.0):
        rate = core.closing_rate(psi, a, tau)
        assert core.closing_rate(-psi, a, tau) == -rate
        rest = psi - a * tau**2 / 2  # of a constant deceleration, if it is not proportional
        expected = psi / tau if psi <= a * tau**2 else np.sqrt(2 * a * rest)
        assert rate == pytest.approx(expected, rel=1e-15)


def test_a_rule_satisfies_the_limits_of_rate_and_acceleration(core):
    assert core.satisfies(0.05, 1e-3, 0.049, 1e-3, 1.0)
    assert not core.satisfies(0.05, 1e-3, 0.0495, 1e-3, 1.0)
    assert not core.satisfies(0.05, 1e-3, -0.0495, -1e-3, 1.0)
    assert not core.satisfies(0.05, 1e-3, 0.0, 1.1e-3, 1.0)


def test_a_sample_without_length_has_no_roll_acceleration(core):
    assert core.roll_acceleration(0.05, 1e-3, 0.01, 0.0) == 0
    assert core.roll_acceleration(0.05, 1e-3, 0.01, 0.5) == 0  # held: towards rate 0, at rate 0


# ---- carried_frame.h


def test_the_integral_part_of_the_steering_is_limited(core):
    b, db = np.array((0.003, -0.004, 0.0)), np.array((0.0, -0.002, 0.001))
    total = b + 0.5 * db
    assert core.integrated_steering(0.1, b, db, 0.5) == pytest.approx(total, abs=1e-17)
    expected = 0.002 * total / np.linalg.norm(total)
    assert core.integrated_steering(0.002, b, db, 0.5) == pytest.approx(expected, abs=1e-17)


# ---- mission_aim.h, mission_budget.h, mission_retreat.h


def test_the_aim_is_at_the_hold_without_a_sphere_and_near_the_hold(core):
    at_hold, on_tangent = 0, 1
    assert core.mode_of_aim(0, 20, 300 * X, 300) == at_hold
    assert core.mode_of_aim(12, 20, 20 * X, 20) == at_hold
    assert core.mode_of_aim(12, 20, 300 * X, 300) == on_tangent


def test_a_target_at_rest_needs_no_closer_range(core):
    """Range of the fly-around: budget F/(m W^2) within R_2, W: tumble and steering."""
    assert core.range_around(0.5, 0, 20, 2.0, 0) == 20
    assert core.range_around(0, 0.01, 20, 2.0, 0.3) == 20
    assert core.range_around(0.5, 0.1, 20, 2.0, 0.3) == pytest.approx(0.5 * 2 / 0.4**2, rel=1e-15)


def test_a_target_at_rest_needs_no_bias_of_the_wheels(core):
    J, A, w = np.diag((180.0, 240, 160)), np.diag((14.0, 16, 12)), np.array((0.01, -0.02, 0.03))
    assert np.array_equal(core.wheel_bias(0.5, J, A, 100, 0 * w), np.zeros(3))
    assert np.array_equal(core.wheel_bias(0, J, A, 100, w), np.zeros(3))
    expected = np.linalg.solve(A, (w @ J @ w) / (2 * w @ w) * w)
    assert core.wheel_bias(0.5, J, A, 100, w) == pytest.approx(expected, rel=1e-14)


def test_only_a_probe_is_limited_by_the_rate_of_the_target(core):
    can, only_by_arm = 0, 4
    assert core.verdict_on(0.05, 0, 0.04) == can
    assert core.verdict_on(0.05, 0, 0.06) == only_by_arm
    assert core.verdict_on(0.05, 1, 0.06) == can
    assert core.verdict_on(0, 0, 0.06) == can


def test_a_drift_without_instants_has_its_present_distance(core):
    rho, v = np.array((3.0, -4, 12)), np.array((-0.1, 0, 0))
    assert core.least_distance(1.0, 2.0, rho, v) == 13
    ends = (rho + k * v for k in (2.0, 4.0))
    least = min(map(np.linalg.norm, ends))
    assert core.least_distance(5.0, 2.0, rho, v) == pytest.approx(least, rel=1e-14)


# ---- optimal_motion.h


@pytest.mark.parametrize("part", [0.0, 0.25, 1.0])
def test_the_first_path_is_straight_where_no_arc_is_defined(core, part):
    a, aside = 30 * X, 20 * Y
    for b in (20 * X, -20 * X, 20 * X + 1e-6 * Y):
        straight = a + part * (b - a)
        assert core.first_way(a, b, 1, part) == pytest.approx(straight, abs=1e-13)
        assert core.first_way(a, b, 0, part) == pytest.approx(straight, abs=1e-13)
    turn = part * np.pi / 2
    arc = (30 - 10 * part) * (np.cos(turn) * X + np.sin(turn) * Y)
    assert core.first_way(a, aside, 1, part) == pytest.approx(arc, abs=1e-13)


@pytest.mark.parametrize(
    ("ratio", "steps"), [(0.5, 1), (1.0, 1), (1.01, 2), (2.01, 3), (3.0, 3), (3.01, 4), (9.0, 4)]
)
def test_a_node_of_the_tumble_has_as_many_steps_as_it_needs_but_at_most_four(core, ratio, steps):
    """Steps of Runge and Kutta of Euler's equations, long enough that their number shows."""
    J, w, dt = np.diag((100.0, 150, 90)), np.array((0.02, 0.5, 0.1)), 5.0

    def rate(w):
        return np.linalg.solve(J, np.cross(J @ w, w))

    expected, h = w, dt / steps
    for _ in range(steps):
        a = rate(expected)
        b = rate(expected + h / 2 * a)
        c = rate(expected + h / 2 * b)
        d = rate(expected + h * c)
        expected = expected + h / 6 * (a + 2 * b + 2 * c + d)
    found = core.rate_after_node(J, np.linalg.inv(J), w, dt, dt / ratio)
    assert found == pytest.approx(expected, abs=1e-13)


# ---- optimal_problem.h


@pytest.mark.parametrize("axis", range(3))
def test_a_point_is_moved_if_one_component_differs(core, axis):
    a = np.array((1.0, 2, 3))
    assert not core.differ(a, a)
    assert core.differ(a, a + 1e-9 * np.eye(3)[axis])
