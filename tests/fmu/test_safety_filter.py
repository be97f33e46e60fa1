# SPDX-License-Identifier: BSD-2-Clause
"""safety_filter.fmu against the independent implementation of its equations
(tests/reference/safety_filter.py), against worked values, and its behaviour between samples.
"""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest

from tests.close import close
from tests.each import each
from tests.reference import safety_filter as reference
from tests.reference.safety_filter import Inputs, Settings

from .driver import bits
from .filter_cases import SMALL, A, N, answers, inputs, settings
from .rejections import rejection

REST = (1.0, 0.0, 0.0, 0.0)
DEEP = replace(SMALL, mu=0)
RESTING = 1e9


def at(rho, v, command, **changes):
    """Target at rest in the origin of deep space, attitudes of N."""
    zero = np.zeros(3)
    state = {
        "r_TN_N": zero, "v_TN_N": zero, "q_TN": REST, "omega_TN_T": zero,
        "r_SN_N": np.array(rho, float), "v_SN_N": np.array(v, float), "q_SN": REST,
        "omega_SN_S": zero, "F_cmd_S": np.array(command, float),
    }  # fmt: skip
    return Inputs(**(state | changes))


def one(fmu, p, u):
    return answers(fmu, p, [u])[0]


# ---- the independent implementation ----
def compare(found, expected, p):
    """Compare one sample: force to 1e-8 |F_max|, barriers to 1e-9, flags exactly."""
    most = np.linalg.norm(p.F_max)
    close(found["F_safe_S"], expected.F_safe_S, rel=1e-8, of=max(most, 1))
    close(found["barrier"], expected.barrier, rel=1e-9, of=1)
    flags = ("mode", "active", "feasible", "relaxed")
    assert [found[n] for n in flags] == [getattr(expected, n) for n in flags]


SAMPLES = 12


def agreement(fmu, seed, law):
    """Compare consecutive samples of random parameters; return how many of each mode there were."""
    rng = np.random.default_rng([law, seed])
    p = settings(rng, filter=law)
    cases, memory, modes = [inputs(rng, p) for _ in range(SAMPLES)], reference.Memory(), []
    for found, case in zip(answers(fmu, p, cases), cases, strict=True):
        P = p.sample_period
        expected = (
            reference.filtered(p, case, P)
            if law == reference.ASIF
            else reference.switched(p, case, P, memory)
        )
        compare(found, expected, p)
        changed = np.linalg.norm(expected.F_safe_S - case.F_cmd_S)
        close(found["intervention"], changed, rel=1e-8, of=max(changed, 3))
        modes.append((expected.mode, expected.active, expected.relaxed))
    return modes


@pytest.mark.parametrize(
    "seeds", [range(9), pytest.param(range(9, 900), marks=pytest.mark.long)], ids=len
)
@pytest.mark.parametrize("law", [1, 2, 3])
def test_every_output_agrees_with_the_independent_implementation(fmu, law, seeds):
    seen = [mode for seed in seeds for mode in agreement(fmu, seed, law)]
    modes, active, relaxed = (set(column) for column in zip(*seen, strict=True))
    if law == reference.ASIF:
        assert modes == {0, 1, 3} and active >= {1, 2, 3, 5, 6} and relaxed >= {1, 2, 3}
    else:
        assert modes == {0, 1, 2} and active >= {0, 1, 2, 3, 6}


# ---- worked values ----
@pytest.mark.verifies("M.5-2")
def test_a_row_takes_the_nearest_point_of_its_plane_inside_the_box(fmu):
    """A row (-0.6, -0.8, 0).u >= -0.5 by the plume: the force away from the target is limited."""
    p = replace(Settings(), keep_out_radius=0, plume_range=9, plume_force=0.5, mu=0)
    found = one(fmu, p, at((3, 4, 0), (0, 0, 0), (2, 1, 0.3)))
    close(found["F_safe_S"], (1.1, -0.2, 0.3), rel=1e-14)
    assert (found["mode"], found["active"], found["feasible"]) == (1, 5, 1)
    assert found["intervention"] == pytest.approx(1.5, rel=1e-14)
    close(found["barrier"], (RESTING, RESTING, RESTING, RESTING, 5 - 9), rel=1e-15)


@pytest.mark.verifies("M.5-3")
def test_a_rule_that_the_box_cannot_satisfy_gets_all_of_the_box(fmu):
    """At (0.6, 0.8, 0) from the edge with 1 m/s inwards, only the full force along n brakes."""
    p = replace(Settings(), mu=0, mass_error=0)
    found = one(fmu, p, at((3, 4, 0), (-0.6, -0.8, 0), (0, 0, 0.3)))
    close(found["F_safe_S"], (2, 1, 0.3), rel=1e-8)
    assert (found["mode"], found["active"], found["feasible"], found["relaxed"]) == (3, 1, 0, 1)


WORKED = replace(
    Settings(),
    mu=0,
    use_corridor=1,
    corridor_half_angle=0.349,
    corridor_length=10,
    brake_keep_out=2.5e-3,
    brake_corridor=2.5e-3,
    sample_period=0.5,
)


def test_the_barriers_of_the_worked_sample(fmu):
    state = at((4.05, 1, 0), (-0.02, 0.06, 0), (-2, 1, 0.1), omega_TN_T=np.array((0, 0, 0.01)))
    found = one(fmu, WORKED, state)
    close(found["barrier"][:2], (0.166562139, 0.248823151), rel=4e-9)
    assert found["F_safe_S"].tolist() == [-2, 1, 0.1] and found["mode"] == 0


def test_the_worked_drift(fmu):
    rho = np.array((0, 12, 0))
    v = np.array((0, A * N, 0))
    state = at(rho, (0, 0, 0), (0, 0, 0), r_TN_N=np.array((A, 0, 0)), v_TN_N=v)
    seen = np.array((0, -0.02, 0)) + np.cross((0, 0, N), rho)
    state = replace(state, r_SN_N=state.r_TN_N + rho, v_SN_N=v + seen)
    found = one(fmu, replace(Settings(), passive_time=600, sample_period=1), state)
    assert found["barrier"][3] == pytest.approx(1.87512917, rel=1e-8)


# ---- what passes unchanged ----
def far(command):
    return at((40, 1, 2), (0.01, 0, 0.002), command)


@pytest.mark.verifies("M.5-1")
@each("law", (0, 1, 2, 3))
def test_a_command_inside_all_rules_leaves_to_the_last_bit(fmu, law):
    command = (0.1, -1 / 3, 0.7)
    found = one(fmu, replace(DEEP, filter=law, use_corridor=0), far(command))
    assert found["F_safe_S"].tolist() == list(command)
    assert [found[n] for n in ("mode", "active", "intervention", "feasible")] == [0, 0, 0, 1]


@pytest.mark.verifies("M.3-1")
@each("case", ({"filter": 0}, {"relative_valid": 0}))
def test_without_filter_or_state_the_command_passes_between_samples_too(fmu, case):
    p = asdict(DEEP) | {k: v for k, v in case.items() if k == "filter"}
    state = vars(at((4.1, 0, 0), (-0.1, 0, 0), (-2, 0, 0))) | {
        k: v for k, v in case.items() if k != "filter"
    }
    unit = fmu("safety_filter", p, state)
    for k in range(10):
        command = np.array((-9.0, k, 0.1))
        unit.step(0.1, {"F_cmd_S": command})
        assert unit.get("F_safe_S").tolist() == command.tolist()
        assert unit.get("intervention") == 0
    assert unit.get("mode") == (0 if "filter" in case else 4)


@pytest.mark.verifies("M.3-2")
def test_a_filter_that_is_off_still_computes_its_barriers(fmu):
    state = inputs(np.random.default_rng(5), SMALL)
    p = replace(SMALL, passive_time=600)
    on, off = (one(fmu, replace(p, filter=law), state) for law in (3, 0))
    assert on["barrier"].tolist() == off["barrier"].tolist() and max(off["barrier"][:4]) < RESTING


@pytest.mark.verifies("M.3-3")
def test_a_force_is_held_between_samples(fmu):
    unit = fmu("safety_filter", asdict(DEEP), vars(at((4.1, 0, 0), (0, 0, 0), (-2, 0, 0))))
    unit.step(0.1)
    held = bits(unit)
    for _ in range(4):
        unit.step(0.1, {"F_cmd_S": np.array((1, 1, 1))})
        assert bits(unit) == held
    unit.step(0.1)
    assert bits(unit) != held


def test_sample_period_0_holds_for_the_length_of_the_call(fmu):
    u = vars(inputs(np.random.default_rng(11), SMALL))
    units = [fmu("safety_filter", asdict(replace(SMALL, sample_period=P)), u) for P in (0, 0.5)]
    for unit in units:
        unit.step(0.5)
    assert bits(units[0]) == bits(units[1])
    assert units[0].get("mode") != 0


def test_the_least_barrier_is_the_least_of_all_samples(fmu):
    rng = np.random.default_rng(3)
    rows = answers(fmu, SMALL, [inputs(rng, SMALL) for _ in range(20)])
    seen = np.minimum.accumulate([row["barrier"] for row in rows])
    assert [row["least_barrier"].tolist() for row in rows] == seen.tolist()


def test_a_rule_that_rests_has_no_barrier(fmu):
    p = replace(DEEP, keep_out_opens=1, passive_time=600)
    state = at((4.1, 0, 0), (0, 0, 0), (0, 0, 0))
    approaching, not_so = (one(fmu, p, replace(state, approaching=a))["barrier"] for a in (1, 0))
    assert approaching[0] == approaching[3] == RESTING and max(approaching[1:3]) < RESTING
    assert not_so[1] == not_so[2] == RESTING and max(not_so[0], not_so[3]) < RESTING


def test_a_servicer_in_the_centre_is_pushed_along_its_x_axis(fmu):
    found = one(fmu, replace(Settings(), mu=0), at((0, 0, 0), (0, 0, 0), (0, 0.5, 0)))
    assert found["F_safe_S"][0] > 0 and found["active"] == 1


# ---- simplex ----
@pytest.mark.verifies("M.7-1")
def test_backup_ends_with_the_sample_that_completes_the_dwell(fmu):
    """The command is safe at every second sample at first, then always: only this counts."""
    p = replace(DEEP, filter=1, use_corridor=0, use_speed_limit=0, dwell=1.5)
    calm = at((5, 0, 0), (0, 0, 0), (0.1, 0, 0))
    approach = at((4.02, 0, 0), (-0.02, 0, 0), (-1, 0, 0))
    turns = [calm, approach, calm, approach, calm, calm, calm, calm]
    modes = [row["mode"] for row in answers(fmu, p, turns)]
    assert modes == [0, 2, 2, 2, 2, 2, 0, 0]


@pytest.mark.verifies("M.7-2")
def test_the_implicit_filter_lets_pass_by_what_the_explicit_one_stops(fmu):
    """A course beside the sphere: the radial rate would not stop in time, the way is clear."""
    passing = at((5, 4.6, 0), (-0.2, 0, 0), (0, 0, 0))
    p = replace(Settings(), mu=0, keep_out_radius=4)
    explicit, implicit = (one(fmu, replace(p, filter=law), passing)["mode"] for law in (1, 2))
    assert (explicit, implicit) == (2, 0)


# ---- rejected parameters ----
REJECTED = (
    ({"filter": 4}, "filter", "must be 0, 1, 2 or 3"),
    ({"filter": 1.5}, "filter", "must be 0, 1, 2 or 3"),
    ({"mass": 0}, "mass", "must be > 0"),
    ({"mass_error": 1}, "mass_error", "must be below 1"),
    ({"F_max": (1, 0, 1)}, "F_max[2]", "must be > 0"),
    ({"brake_keep_out": 0}, "brake_keep_out", "must be > 0"),
    ({"brake_corridor": 0}, "brake_corridor", "must be > 0"),
    ({"speed_at_zero": 0}, "speed_at_zero", "must be > 0"),
    ({"recover_speed": 0}, "recover_speed", "must be > 0"),
    ({"corridor_axis": (1, 1, 0)}, "corridor_axis", "must be a unit vector"),
    ({"corridor_half_angle": np.pi / 2}, "corridor_half_angle", "must be below pi/2"),
    ({"passive_points": 1}, "passive_points", "must be a whole number from 2 to 32"),
    ({"passive_points": 7.5}, "passive_points", "must be a whole number from 2 to 32"),
    ({"passive_points": 33}, "passive_points", "must be a whole number from 2 to 32"),
    ({"passive_time": 600, "keep_out_radius": 0}, "passive_time", "needs keep_out_radius > 0"),
    (
        {"use_speed_limit": 1, "sample_period": 1, "F_max": (2, 1, 1), "speed_at_zero": 0.02},
        "speed_at_zero",
        "must be above sample_period |F_max| / (mass (1 - mass_error))",
    ),
)


@pytest.mark.verifies("M.3-4")
@each("case", REJECTED)
def test_parameters_without_a_meaning_are_rejected(tmp_path_factory, case):
    parameters, name, rule = case
    message = rejection("safety_filter", parameters, tmp_path_factory.mktemp("fmu"))
    assert name in message and rule in message, message
