# SPDX-License-Identifier: BSD-2-Clause
"""optimal_controller.fmu against an implementation with dense matrices, sample by sample along the
motion that it commands, and its life: goals, spreading over samples, modes, limits.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException

from tests.close import close

from ..reference.optimal import BRAKE, FIRST, LAST, PLAN, OptimalLaw, matrix_of, tumble
from .driver import bits

J_T = np.diag([100.0, 150, 90])
RANGE = {1: 28.0, 2: 20.0, 3: 18.0}
NAMES = ("residual_p", "residual_u", "change_p", "change_u", "miss", "dv_left", "t_arrival")
COUNTS = ("mode", "feasible", "braking", "count_box", "count_cone", "count_slab")
ACCELERATIONS = ("residual_u", "change_u", "d_hat_N")
"""As small as the largest of 0.02 m/s2; other numbers are metres, seconds, m/s."""
RARE = ("plan_time", "plan_step", "plan_rho_N", "d_hat_N")


@dataclass
class Scene:
    """Target that tumbles and moves, servicer that follows a force, without orbit dynamics of
    either: the law reads states and does not know where they come from.
    """

    seed: int
    goal: int
    mass: float = 97.0
    u: dict = field(default_factory=dict)

    def __post_init__(self):
        rng = np.random.default_rng(self.seed)
        self.q_T, q_S, rho = rng.normal(size=4), rng.normal(size=4), rng.normal(size=3)
        self.q_T /= np.linalg.norm(self.q_T)
        self.rho = rho * RANGE[self.goal] / np.linalg.norm(rho)
        if self.goal == 3:  # inside the corridor
            self.rho = matrix_of(self.q_T).T @ (RANGE[3] * np.array((1.0, 0.05, -0.03)))
        self.v, self.w_T = 0.05 * rng.normal(size=3), np.array((0.004, 0.01, -0.003))
        self.q_S, self.w_S = q_S / np.linalg.norm(q_S), 1e-3 * rng.normal(size=3)
        self.r_T, self.v_T = np.array((4e6, 5e6, 3e6)), np.array((-5e3, 3e3, 4.5e3))

    def inputs(self):
        return {
            "r_TN_N": self.r_T, "v_TN_N": self.v_T, "q_TN": self.q_T, "omega_TN_T": self.w_T,
            "r_SN_N": self.r_T + self.rho, "v_SN_N": self.v_T + self.v, "q_SN": self.q_S,
            "omega_SN_S": self.w_S, "mass": self.mass, "goal": self.goal,
        }  # fmt: skip

    def move(self, F_S):
        """Over a tenth of a second, with an acceleration that the law does not know."""
        a = matrix_of(self.q_S).T @ F_S / 99.0 + (2e-5, -1e-5, 1e-5)
        self.rho = self.rho + 0.1 * self.v + 0.005 * a
        self.v = self.v + 0.1 * a
        self.q_T, self.w_T = tumble(J_T, self.q_T, self.w_T, 0.1)


def run(unit, law, scene, seconds, disturb=None, rel=1e-9):
    """Both on the same inputs; the modes, and the outputs of the last sample."""
    modes, begin = [], round(unit.time / 0.1)
    for k in range(begin, begin + 10 * seconds):
        if disturb:
            disturb(k, scene)
        u = scene.inputs()
        unit.step(0.1, u)
        out, expected = unit.outputs(), law(0.1 * k, u, scene.goal)
        compare(out, expected, rel)
        modes.append(out["mode"])
        scene.move(expected["F_cmd_S"])
    return modes, out


def compare(out, expected, rel):
    for name in COUNTS:
        assert out[name] == expected.get(name, out[name]), name
    for name in NAMES + RARE:
        if name in expected:
            of = 0.02 if name in ACCELERATIONS else 1 + np.max(np.abs(expected[name]))
            close(out[name], expected[name], rel=rel, of=of)
    close(out["F_cmd_S"], expected["F_cmd_S"], rel=rel, of=1.9)


CASES = {
    "point": (1, {}),
    "axis": (2, {}),
    "corridor": (3, {}),
    "speed": (1, {"speed_limit": 1, "v_0": 0.02, "v_slope": 0.002}),
    "arriving": (
        3,
        {"duration": (60, 60, 6), "T_min": 20, "hold_lead": 2, "slab": (0.01, 0.03)},
    ),
    "ball": (2, {"duration": (60, 5, 60), "T_min": 20, "iterations_first": 150}),
    "no turning": (3, {"turn": (0, 0, 0), "iterations": 20, "iterations_first": 40}),
    "deep space": (1, {"mu": 0, "k_d": 0.2}),
}


@pytest.mark.verifies("N.4-6")
@pytest.mark.parametrize("case", CASES)
def test_samples_match_dense_matrices_along_the_commanded_motion(fmu, case):
    """Every output of every sample to 1e-9: sweeps, projections, set-up, carried state, start from
    the last solve, evaluation, estimate of the disturbance.
    """
    goal, p = CASES[case]
    scene = Scene(list(CASES).index(case), goal)
    unit = fmu("optimal_controller", p, scene.inputs())
    modes, out = run(unit, OptimalLaw(**p), scene, 4)
    assert FIRST in modes
    assert len(out["plan_rho_N"]) == 18


@pytest.mark.verifies("N.4-1")
def test_plans_that_are_not_feasible_lead_to_braking_and_back(fmu):
    """Jumps of metres for 4 s after a good plan: last plan, then brake and hold at the place where
    braking began, fixed in the target; the first feasible plan ends it.
    """
    p = {"tol": (0.3, 0.02), "bad_max": 3, "age_max": 2}
    scene = Scene(3, 3)
    unit, law = fmu("optimal_controller", p, scene.inputs()), OptimalLaw(**p)

    def jump(k, scene):
        """A navigation that is wrong by metres every second, for a while."""
        if 30 <= k < 70 and k % 10 == 0:
            scene.rho = scene.rho + 9.0 * (-1) ** (k // 10) * np.array((0.5, 0.5, 0.5))

    modes, _ = run(unit, law, scene, 16, jump, rel=1e-8)  # rounding of 750 iterations
    assert {PLAN, LAST, BRAKE, FIRST} == set(modes)
    assert modes[-1] == PLAN


@pytest.mark.verifies("N.4-3")
def test_braking_holds_a_place_in_hill_axes_for_the_goals_before_the_corridor(fmu):
    p = {"tol": (1e-9, 1e-9), "bad_max": 2}
    scene = Scene(4, 1)
    unit = fmu("optimal_controller", p, scene.inputs())
    modes, out = run(unit, OptimalLaw(**p), scene, 5)
    assert modes[-1] == BRAKE and out["braking"] == 1


@pytest.mark.verifies("N.4-2")
def test_the_old_plan_stays_in_force_until_the_new_goal_has_one(fmu):
    scene = Scene(5, 2)
    unit, law = fmu("optimal_controller", {}, scene.inputs()), OptimalLaw()
    run(unit, law, scene, 3)
    scene.goal = 3
    modes, _out = run(unit, law, scene, 3)
    assert set(modes) <= {PLAN, LAST}


REPLACED = [(1, 30.0, 30.0, 300.0), (1, 5.0, 12.0, 300.0), (2, 25.0, 25.0, 300.0),
            (3, 5.0, 5.0, 300.0), (1, 30.0, 30.0, 9000.0)]  # fmt: skip


@pytest.mark.parametrize(("goal", "given", "L", "T"), REPLACED)
def test_inputs_replace_range_and_duration_of_a_goal(fmu, goal, given, L, T):
    """Not below the zone, where the goal has one; a node has 20 s at most."""
    scene, duration = Scene(5, goal), min(T, 1200.0)
    ends = {"L_end": [20.0, 19.5, 4.02], "duration": [475.0, 203.0, 600.0]}
    ends["L_end"][goal - 1], ends["duration"][goal - 1] = L, duration
    by_input = fmu("optimal_controller", {}, scene.inputs())
    by_parameter = fmu("optimal_controller", ends, scene.inputs())
    for _ in range(35):
        by_input.step(0.1, scene.inputs() | {"L_goal": given, "T_goal": T})
        by_parameter.step(0.1, scene.inputs())
    assert by_input.get("plan_step") == pytest.approx((duration - 3) / 60)
    assert bits(by_input) == bits(by_parameter)


def test_another_range_begins_the_goal_anew(fmu):
    """Its time starts again, and the plan of the range before stays in force for a second."""
    scene = Scene(5, 1)
    unit = fmu("optimal_controller", {}, scene.inputs())
    ranges, steps = [30.0] * 25 + [40.0] * 22, []
    for L in ranges:
        unit.step(0.1, scene.inputs() | {"L_goal": L, "T_goal": 300.0})
        steps.append(unit.get("plan_step"))
    assert steps[24] == steps[34] == pytest.approx(298 / 60)
    assert steps[35] == pytest.approx(299 / 60)
    assert steps[46] == pytest.approx(298 / 60)
    assert unit.get("plan_time") == pytest.approx(4.5)


@pytest.mark.verifies("N.4-4")
def test_an_inactive_time_leaves_nothing_behind(fmu):
    """Goal 0 for any time, then a goal: the bits of a fresh instance started there."""
    used, scene = fmu("optimal_controller", {}, Scene(6, 2).inputs()), Scene(6, 2)
    for _ in range(25):
        used.step(0.1, scene.inputs())
    used.step(0.1, {"goal": 0})
    assert np.all(used.get("F_cmd_S") == 0) and used.get("feasible") == 0
    used.step(0.4)
    fresh = fmu("optimal_controller", {}, scene.inputs(), 3.0)
    for _ in range(25):
        for unit in (used, fresh):
            unit.step(0.1, scene.inputs())
        assert bits(used) == bits(fresh)


def test_a_state_saved_within_a_second_continues_with_equal_bits(fmu):
    scene = Scene(7, 3)
    unit = fmu("optimal_controller", {}, scene.inputs())
    unit.step(1.4)
    saved, time = unit.slave.getFMUState(), unit.time
    unit.step(3.0)
    expected = bits(unit)
    unit.slave.setFMUState(saved)
    unit.time = time
    unit.step(3.0)
    assert bits(unit) == expected
    unit.slave.freeFMUState(saved)


@pytest.mark.verifies("N.4-5")
def test_the_force_stays_in_the_box_and_is_held_in_inertial_axes(fmu):
    """Between two plans the servicer turns, the force does not; limits hold per servicer axis."""
    scene = Scene(8, 3)
    unit, forces = fmu("optimal_controller", {}, scene.inputs()), []
    for k in range(30):
        scene.q_S = np.array((np.cos(0.01 * k), 0, np.sin(0.01 * k), 0))
        unit.step(0.1, scene.inputs())
        F = unit.get("F_cmd_S")
        assert np.all(np.abs(F) <= (1.9, 0.95, 0.95))
        forces.append(matrix_of(scene.q_S).T @ F)
    assert unit.get("mode") == PLAN
    inside = np.all(np.abs(forces[21:29]) < 0.9, axis=1).all()
    if inside:
        close(forces[22], forces[21], rel=1e-12)


def test_the_attitude_law_equals_the_adaptive_controller_with_its_start_values(fmu, rng):
    """At its first sample, at which the estimates are the start values."""
    q, w = rng.normal(size=4), 0.01 * rng.normal(size=3)
    reference = {"q_DN": q / np.linalg.norm(q), "omega_DN_D": w, "alpha_DN_D": 1e-3 * w}
    wheels = {"wheel_speed": 0.1 * rng.normal(size=3)}
    for use_wheels in (0, 1):
        p = {"use_wheels": use_wheels}
        inputs = Scene(9, 3).inputs() | reference | wheels
        ours = fmu("optimal_controller", p, inputs)
        inputs.pop("mass"), inputs.pop("goal")
        adaptive = fmu("adaptive_controller", p, inputs)
        for unit in (ours, adaptive):
            unit.step(0.1)
        for name in ("M_cmd_S", "wheel_accel_cmd"):
            assert np.array_equal(ours.get(name), adaptive.get(name))


@pytest.mark.verifies("N.4-7")
@pytest.mark.parametrize("goal", [3.6, 4])
def test_a_goal_that_does_not_exist_is_rejected(fmu, goal):
    unit = fmu("optimal_controller", {}, Scene(1, 1).inputs())
    with pytest.raises(FMICallException):
        unit.step(0.1, {"goal": goal})


REJECTED = {
    "p_T": (1, 1, 0), "line": (0, -2, 0), "cone": 1.6, "cone_hold": 0.2, "iterations": 8.5,
    "iterations_first": 75, "bad_max": 1.5, "T_min": 19, "duration": (475, 203, 1300),
    "L_end": (11, 19.5, 4), "tumble_step": 2, "J_T": np.diag([1.0, 1, 3]).ravel(),
    "F_max": (1, 0, 1), "tol": (0, 0.04),
}  # fmt: skip


@pytest.mark.verifies("N.4-8")
@pytest.mark.parametrize("name", REJECTED)
def test_parameters_outside_their_rules_are_rejected(fmu, name):
    with pytest.raises(FMICallException):
        fmu("optimal_controller", {name: REJECTED[name]}, Scene(1, 1).inputs())
