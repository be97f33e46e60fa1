# SPDX-License-Identifier: BSD-2-Clause
"""Edges of conditions that no other test reaches (make evidence): one behaviour each."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from tests.close import close
from tests.each import Each

from .driver import bits
from .filter_cases import SMALL, answers
from .rejections import rejection
from .test_attitude_filter import T, World
from .test_los_guidance import SUN, seen_at
from .test_optimal_controller import Scene
from .test_safety_escape import ON
from .test_safety_filter import at
from .test_safety_monitor import DEEP, OFF, states
from .test_safety_range import ALONE, H
from .test_thruster_allocation import T0, box_of_thrusters, command

EYE = np.eye(3)
FLAT = EYE * 100 + 60 * (np.outer(EYE[1], EYE[2]) + np.outer(EYE[2], EYE[1]))
"""Positive definite, but no inertia of a body: E of rigid_body.h has one negative minor."""
NO_WHEELS = np.zeros(12)
RULES = (
    ("target", {"a": 7e6, "mu": 0}, "mu"),
    ("target", {"a": 0, "mu": 0, "r_0_N": (0, 0, 0)}, ""),
    ("target", {"a": 0, "r_0_N": (0, 0, 0)}, "r_0_N"),
    ("target", {"J_T": FLAT.ravel()}, "J_T"),
    ("arm_guidance", {"joints": -1}, "joints"),
    ("adaptive_controller", {"eta_hat_0": NO_WHEELS}, "eta_hat_0"),
    ("adaptive_controller", {"eta_hat_0": NO_WHEELS, "use_wheels": 0}, ""),
    ("optimal_controller", {"eta_hat_0": NO_WHEELS}, "eta_hat_0"),
    ("optimal_controller", {"eta_hat_0": NO_WHEELS, "use_wheels": 0}, ""),
    ("optimal_controller", {"iterations": 8}, "iterations"),
    ("optimal_controller", {"iterations": 61, "iterations_first": 61}, "iterations"),
)


@pytest.fixture
def rule():
    return Each(RULES)


@pytest.mark.verifies("A.5-7")
def test_parameters_are_rejected_with_their_name(tmp_path_factory, rule):
    name, parameters, word = rule
    message = rejection(name, parameters, tmp_path_factory.mktemp("fmu"))
    assert word in message if word else message == ""


# ---- safety filter ----
def test_a_drift_through_the_centre_has_no_normal_and_gets_no_row(fmu):
    p = replace(SMALL, mu=0, use_corridor=0, use_speed_limit=0, sample_period=1)
    p = replace(p, passive_time=256, passive_points=2)
    (found,) = answers(fmu, p, [at((8, 0, 0), (-0.0625, 0, 0), (0, 0, 0))])
    assert found["F_safe_S"].tolist() == [0, 0, 0] and found["mode"] == 0
    close(found["barrier"][3], -4.15, rel=1e-12)  # its point at the centre, less sphere and margin


@pytest.mark.verifies("M.5-4")
def test_a_force_of_any_length_leaves_as_the_nearest_one(fmu):
    """Beyond 1e5 |F_max| a command is shortened; the sphere removes its inward part."""
    p = replace(SMALL, mu=0, use_corridor=0, use_speed_limit=0)
    way = np.array((-1, 0.3, 0.1))
    each = [at((4.01, 0, 0), (0, 0, 0), size * way) for size in (1e3, 1e9)]
    short, long = (answers(fmu, p, [case])[0]["F_safe_S"] for case in each)
    close(long, short, rel=1e-6)
    assert np.all(np.abs(long) <= np.array(p.F_max) * (1 + 1e-8))


def test_the_corridor_may_point_anywhere(fmu):
    """The least barrier turns with the axis: the construction of the faces has no direction."""
    found = []
    for k in range(3):
        p = replace(SMALL, mu=0, corridor_axis=tuple(EYE[k]), corridor_half_angle=0.3)
        state = at(5 * EYE[k] + 0.1 * EYE[(k + 1) % 3], (0, 0, 0), (0, 0, 0))
        found.append(answers(fmu, p, [state])[0]["barrier"][1])
    close(found, [found[0]] * 3, rel=0.05)
    assert min(found) > 0.5


# ---- safety monitor ----
def test_a_range_seen_before_is_not_compared_again(fmu):
    first = states(0, (0, 50, 0), (0, 0, 0), 0)
    seen = {"range_meas": 50.0, "range_time": 0.0, "range_valid": 1}
    again = {"range_meas": 90.0, "range_time": 0.0, "range_valid": 1}
    found = []
    for later in (again, {"range_valid": 0}):
        unit = fmu("safety_monitor", ALONE | {"range_patience": 0.0}, first | seen)
        for k in range(5):
            unit.step(H, states(k * H, (0, 50, 0), (0, 0, 0), 0) | (seen if k == 0 else later))
        found.append(bits(unit))
    assert found[0] == found[1]


def test_a_fixed_abort_without_any_valid_state_drifts(fmu):
    p = OFF | {"abort_relative": 0, "abort_time": 0, "act": 1}
    unit = fmu("safety_monitor", p, {"relative_valid": 0})
    unit.step(1, states(0, (0, -20, 0), (0, 0.1, 0)) | {"relative_valid": 0})
    assert unit.get("abort") == 1 and unit.get("dv_left_N").tolist() == [0, 0, 0]


def test_no_escape_is_foreseen_from_zero_range(fmu):
    unit = fmu("safety_monitor", ON, states(0, (0, 0, 0), (0, 0, 0)))
    unit.step(1, states(0, (0, 0, 0), (0, 0, 0)))
    assert unit.get("escape_margin") == 1e9 and unit.get("escape_dv") == 0


@pytest.mark.parametrize("y", [-20.0, -10.0])
def test_a_drift_through_the_target_has_no_escape(fmu, y):
    """Instants of 20 s: one in the centre itself, or two beside the centre."""
    p = ON | DEEP | {"abort_force": 0, "e_r": 0, "e_v": 0, "e_model": 0}
    unit = fmu("safety_monitor", p)
    unit.step(1, states(0, (0, y, 0), (0, 1, 0), 0))
    close(unit.get("escape_margin"), -1.75, rel=1e-12)
    close(unit.get("escape_time_least"), -y, rel=1e-12)


# ---- filters ----
@pytest.mark.verifies("F.4-2")
def test_a_star_older_than_the_history_is_ignored(fmu):
    """16 samples old and never used before: not the order of the stars, but their age."""
    found = []
    for age in (15, 16, None):
        world = World(np.random.default_rng(3))
        unit = world.filter(fmu)
        for k in range(20):
            unit.step(T, world.gyro(k))
        quiet = world.gyro(20)
        unit.step(T, quiet if age is None else quiet | world.star(20 - age))
        found.append(unit.get("q_SN").tolist())
    assert found[0] != found[2] and found[1] == found[2]


def test_without_a_reset_a_filter_never_begins_anew(fmu):
    """Fixes that are 10 km off are rejected for ever with reset_after 0."""
    found = []
    for after, valid in ((0, 0), (0, 1), (3, 1)):
        unit = fmu("orbit_filter", {"reset_after": after, "acquire": 0})
        fix = {"r_fix_N": unit.get("r_SN_N") + 1e4, "v_fix_N": (0, 0, 0), "fix_valid": valid}
        for k in range(8):
            unit.step(0.1, fix | {"fix_time": 0.1 * k})
        found.append(unit.get("r_SN_N"))
    assert found[1].tolist() == found[0].tolist()
    assert np.linalg.norm(found[2] - found[0]) > 5e3


def test_in_deep_space_the_relative_filter_has_no_tide(fmu):
    found = []
    for tide in (0, 1):
        p = {"mu": 0, "use_gravity_gradient": tide, "omega_TN_T_0": (0.1, 0.02, -0.03)}
        here = {"r_SN_N_hat": (0, 0, 0), "v_SN_N_hat": (0, 0, 0)}
        unit = fmu("relative_filter", p | {"rho_0_H": (0, 0, 0)}, here)
        for _ in range(20):
            unit.step(0.1, here)
        found.append(bits(unit))
    assert found[0] == found[1]


# ---- guidance and control ----
def test_inactive_line_of_sight_guidance_reports_no_guard_from_the_start(fmu):
    p, seen = {"guard_angle": np.radians(5)}, seen_at(100 * SUN)
    units = [fmu("los_guidance", p, seen | {"active": active}) for active in (1, 0)]
    assert [unit.get("attitude_guard") for unit in units] == [1, 0]


@pytest.mark.verifies("N.4-7")
@pytest.mark.parametrize("change", [{"goal": -3}, {"mass": 0}])
def test_optimal_controller_rejects_no_goal_and_no_mass(fmu, change):
    unit = fmu("optimal_controller", {}, Scene(1, 1).inputs())
    with pytest.raises(FMICallException):
        unit.step(0.1, change)


def test_optimal_controller_rejects_no_goal_from_the_start(fmu):
    with pytest.raises(FMICallException):
        fmu("optimal_controller", {}, Scene(1, 1).inputs() | {"goal": -3})


def test_optimal_controller_leaves_the_attitude_alone_or_waits(fmu):
    u = Scene(1, 1).inputs()
    for p in ({"use_attitude": 0}, {"t_att": 5}, {}):
        unit = fmu("optimal_controller", p, u)
        unit.step(0.1, u)
        assert bool(np.any(unit.get("wheel_accel_cmd"))) == (not p)


def test_optimal_controller_with_an_inactive_goal_starts_silent(fmu):
    unit = fmu("optimal_controller", {}, Scene(1, 1).inputs() | {"goal": 0})
    assert not np.any(unit.get("wheel_accel_cmd")) and unit.get("mode") == 3


def test_optimal_controller_at_rest_does_not_turn_the_box(fmu):
    """Below omega_rest the axes of the box stay in S."""
    u, active = Scene(1, 3).inputs(), []
    for rest in (0, 1):
        p = {"omega_rest": rest, "F_max": (0.5, 0.03, 0.03)}
        unit = fmu("optimal_controller", p, u)
        for _ in range(21):
            unit.step(0.1, u)
        active.append(unit.get("count_box"))
    assert active[0] != active[1] and min(active) > 0


def test_allocation_at_every_call_allocates_at_the_start(fmu):
    p, u = box_of_thrusters(), command(np.array([2.0, 0, 0, 0, 0, 0]))
    first, every = (fmu("thruster_allocation", p | {"sample_period": P}, u) for P in (T0, 0))
    assert every.get("throttle").tolist() == first.get("throttle").tolist()
    assert every.get("throttle")[0] == pytest.approx(0.5)
