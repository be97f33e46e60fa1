# SPDX-License-Identifier: BSD-2-Clause
"""mission_manager.fmu: every row of the table of phases, every reason to retreat, every clock, by
made-up inputs; the range profile; the retreat. A reference runs beside every run and agrees to 1e-9
in all outputs (mission_cases.Recording).
"""

from __future__ import annotations

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from tests.each import each, some
from tests.reference import mission

from .mission_cases import (
    AXIS,
    GEO,
    GOOD,
    GROUND,
    HOLDING,
    QUICK,
    RATE,
    P,
    Recording,
    T,
    in_hill,
    line,
    on_axis,
)
from .rejections import rejection
from .theory import MU, dcm_of_quaternion, quaternion_of_dcm

NEAR, BEFORE = (5, 6, 7, 11), (0, 1, 2, 3, 4, 5, 6, 7, 11)
TURNING = (4, *NEAR)
TINY = 1e-7
"""Positions of 4e7 m have a rounding of 1e-8 m."""
FOLLOWS = {0: 1, 1: 2, 2: 3, 3: 4, 4: 5, 5: 6, 6: 7, 7: 8, 8: 9, 9: 10, 11: 6, 13: 0}


# phase, scene that is just good enough, scene that is not: each condition of the table alone
LIMITS = [
    (0, in_hill(line(105 - TINY)), in_hill(line(105 + TINY))),
    (0, in_hill(line(95 + TINY)), in_hill(line(95 - TINY))),
    (0, in_hill(line(100), (0.03 - TINY, 0, 0)), in_hill(line(100), (0.03 + TINY, 0, 0))),
    (0, GOOD[0], GOOD[0] | {"relative_valid": 0}),
    (1, in_hill(line(110 - TINY)), in_hill(line(110 + TINY))),
    (1, in_hill(line(90 + TINY), (0.1, 0, 0)), in_hill(line(90 - TINY))),
    (1, GOOD[1], GOOD[1] | {"go_1": 0}),
    (1, GOOD[1] | {"go_2": 0, "go_3": 0}, GOOD[1] | {"relative_valid": 0}),
    *(
        (k, good, bad)
        for k in (2, 3)
        for good, bad in (
            (in_hill((1 - TINY, -20, 0)), in_hill((1 + TINY, -20, 0))),
            (in_hill((0, -20, 1 - TINY)), in_hill((0, -20, 1 + TINY))),
            (in_hill((0, -21 + TINY, 0)), in_hill((0, 20, 0))),
            (in_hill(line(20), (0, 0, 0.03 - TINY)), in_hill(line(20), (0, 0, 0.03 + TINY))),
            (GOOD[k], GOOD[k] | {"relative_valid": 0}),
        )
    ),
    (2, GOOD[2] | {"go_2": 0}, in_hill(line(22))),
    (3, GOOD[3] | {"go_1": 0, "go_3": 0}, GOOD[3] | {"go_2": 0}),
    (4, on_axis(20, off=20 * np.tan(0.06 - TINY)), on_axis(20, off=20 * np.tan(0.06 + TINY))),
    (4, on_axis(21 - TINY), on_axis(21 + TINY)),
    (4, on_axis(19 + TINY), on_axis(19 - TINY)),
    (4, on_axis(20, v_rel=0.03 - TINY), on_axis(20, v_rel=0.03 + TINY)),
    (4, on_axis(20, pointing=0.2618 - TINY), on_axis(20, pointing=0.2618 + TINY)),
    (4, on_axis(20, w_rel=0.1, go_1=0, go_2=0, go_3=0), on_axis(-20, pointing=np.pi)),
    (4, GOOD[4], GOOD[4] | {"relative_valid": 0}),
    *(
        (k, good, bad)
        for k in (5, 6, 11)
        for good, bad in (
            (on_axis(3, off=0.05 - TINY), on_axis(3, off=0.05 + TINY)),
            (on_axis(3.05 - TINY), on_axis(3.05 + TINY)),
            (on_axis(2.95 + TINY), on_axis(2.95 - TINY)),
            (on_axis(3, v_rel=-0.01 + TINY), on_axis(3, v_rel=-0.01 - TINY)),
            (on_axis(3, pointing=0.0524 - TINY), on_axis(3, pointing=0.0524 + TINY)),
            (on_axis(3, w_rel=0.005 - TINY), on_axis(3, w_rel=0.005 + TINY)),
            (GOOD[k], GOOD[k] | {"relative_valid": 0}),
        )
    ),
    (5, GOOD[5] | {"go_3": 0}, on_axis(3.1)),
    (6, GOOD[6] | {"go_1": 0, "go_2": 0}, GOOD[6] | {"go_3": 0}),
    (8, GOOD[8] | {"relative_valid": 0, "soft": 1}, GOOD[8] | {"hard": 0}),
    (9, GOOD[9] | {"omega_SN_S": (2e-4 - 1e-12, 0, 0)}, GOOD[9] | {"done": 0}),
    (9, GOOD[9] | {"relative_valid": 0}, GOOD[9] | {"omega_SN_S": (0, 2e-4 + 1e-12, 0)}),
    (13, GOOD[13], GOOD[13] | {"relative_valid": 0}),
    (13, in_hill(line(1000), resume=1), GOOD[13] | {"resume": 0}),
]


@pytest.mark.verifies("J.1-1")
@each(("phase", "good", "bad"), LIMITS)
def test_each_condition_of_each_row_alone_retains_the_phase(fmu, phase, good, bad):
    """Dwell 3 s: three bad samples between good ones start it anew, then it counts from the first
    good one.
    """
    recording = Recording(fmu, {"nav_far": 60, "nav_near": 60}).lead_to(phase)
    assert recording.stay(bad, 5) == [phase] * 5  # also beyond the end of a profile
    assert recording.sample(good) == phase
    assert recording.stay(bad, 3) == [phase] * 3
    assert recording.stay(good, 4) == [phase] * 3 + [FOLLOWS[phase]]
    assert recording["reason"] == 0
    assert recording["t_phase"] == recording.unit.time - P


@pytest.mark.verifies("J.1-2")
def test_one_change_a_sample_with_no_dwell_at_all(fmu):
    recording = Recording(fmu, {"dwell": [0.0] * 15, "tol_1": 80, "R_1": 90, "v_slope": (1, 1)})
    good = in_hill(line(20))
    assert recording.stay(good, 5) == [1, 2, 3, 4, 4]


@pytest.mark.parametrize("phase", [1, 3, 6])
def test_go_is_a_level_that_leaves_no_trace(fmu, phase):
    """On for two of three seconds, off for one, again and again: never a go."""
    recording = Recording(fmu).lead_to(phase)
    for _ in range(5):
        assert recording.stay(GOOD[phase], 2) == [phase] * 2
        assert recording.stay(HOLDING[phase], 1) == [phase]
    assert recording.stay(GOOD[phase], 4)[-1] == FOLLOWS[phase]


@pytest.mark.verifies("J.1-4")
@each("phase", range(15))
@each("order", [{"abort": 1}, {"retreat": 1}, {"abort": 1, "retreat": 1}])
def test_abort_and_ground_end_every_phase_but_the_phases_of_capture(fmu, phase, order):
    recording = Recording(fmu).lead_to(phase)
    found = recording.sample(HOLDING[phase] | order)
    aborted = "abort" in order and phase not in (8, 9, 10)
    assert found == (14 if aborted else 12 if phase in BEFORE else phase)
    if found != phase:
        assert recording["reason"] == (1 if found == 14 else 2)


@pytest.mark.verifies("J.1-5")
@pytest.mark.parametrize("phase", BEFORE)
def test_navigation_may_be_lost_for_so_long(fmu, phase):
    """Lost longer than nav_far, nav_near: equal is not longer."""
    recording = Recording(fmu, {"nav_near": 4, "nav_far": 7}).lead_to(phase)
    recording.sample(HOLDING[phase] | {"relative_valid": 1})
    longest = 4 if phase in NEAR else 7
    hidden = HOLDING[phase] | {"relative_valid": 0}
    assert recording.stay(hidden, longest) == [phase] * longest
    assert recording.sample(hidden) == 12
    assert recording["reason"] == 3


@pytest.mark.parametrize("phase", BEFORE)
def test_propellant_below_the_reserve(fmu, phase):
    recording = Recording(fmu).lead_to(phase)
    assert recording.sample(HOLDING[phase] | {"mass": 86}) == phase
    assert recording.sample(HOLDING[phase] | {"mass": 86 - TINY}) == 12
    assert recording["reason"] == 4


ERRORS = {
    "beside the axis": (
        on_axis(5, off=0.4 - TINY, relative_valid=0),
        on_axis(5, off=0.4 + TINY, relative_valid=0),
    ),
    "beside the axis, close": (
        on_axis(2, off=0.2 - TINY, relative_valid=0),
        on_axis(2, off=0.2 + TINY, relative_valid=0),
    ),
    "pointing": (
        on_axis(3, pointing=0.2618 - TINY, relative_valid=0),
        on_axis(3, pointing=0.2618 + TINY, relative_valid=0),
    ),
}


@each("phase", BEFORE)
@each("error", ERRORS)
def test_errors_count_near_the_target_only_and_in_one_stretch(fmu, phase, error):
    """error_dwell 3 s: from the first bad sample on, forgotten by a good one."""
    good, bad = ERRORS[error]
    recording = Recording(fmu, {"nav_near": 60, "nav_far": 60, "v_0": (9, 9)}).lead_to(phase)
    assert recording.stay(bad, 3) == [phase] * 3
    assert recording.stay(good, 1) == [phase]
    expected = 12 if phase in NEAR else phase
    assert recording.stay(bad, 4) == [phase] * 3 + [expected]
    if phase in NEAR:
        assert recording["reason"] == 5


@each("phase", range(15))
def test_speed_limit_by_range_before_the_capture(fmu, phase):
    """As seen in H: 0.6 + 0.01 R far, 0.06 + 0.0083 R near, and the tumble rate times R where the
    servicer turns with the target; speed_dwell 5 s.
    """
    R = 40.0
    limit = 0.06 + 0.0083 * R if phase in NEAR else 0.6 + 0.01 * R
    limit += np.hypot(0.002, 0.01) * R if phase in TURNING else 0
    slow, fast = (
        in_hill((R, 0, 0), (0, limit + e, 0)) | {"relative_valid": 0} for e in (-TINY, TINY)
    )
    changes = {"nav_near": 60, "nav_far": 60, "error_dwell": 60}
    recording = Recording(fmu, changes).lead_to(phase)
    assert recording.stay(fast, 5) == [phase] * 5
    assert recording.stay(slow, 1) == [phase]
    assert recording.stay(fast, 6) == [phase] * 5 + [12 if phase in BEFORE else phase]
    if phase in BEFORE:
        assert recording["reason"] == 6


@pytest.mark.parametrize(("rate", "counted"), [(0.03, 0.03), (0.05, 0.04)])
def test_speed_limit_allows_for_no_more_than_tumble_max(fmu, rate, counted):
    limit = 0.06 + (0.0083 + counted) * 10
    slow, fast = (
        in_hill((10, 0, 0), (0, limit + e, 0), omega_TN_T=(0, 0, rate), relative_valid=0)
        for e in (-TINY, TINY)
    )
    recording = Recording(fmu, {"nav_near": 60, "error_dwell": 60}).lead_to(5)
    assert recording.stay(slow, 8) == [5] * 8
    assert recording.stay(fast, 6) == [5] * 5 + [12]


@each("phase", range(15))
def test_time_outs(fmu, phase):
    """Of all phases before the capture; of mating it ends the attempt, of detumbling nothing."""
    at = [0.0] * 15
    at[phase] = 8.0
    changes = {"nav_far": 60, "nav_near": 60, "attempts": 1 + (phase == 11)}
    recording = Recording(fmu, {"time_out": at} | changes).lead_to(phase)
    waiting = 7 + (phase == 0)  # FAR begins at the first sample, the others at the last one
    assert recording.stay(HOLDING[phase] | {"contact": 0}, waiting) == [phase] * waiting
    expected = 12 if phase in BEFORE else phase
    assert recording.sample(HOLDING[phase]) == expected
    if phase in BEFORE:
        assert recording["reason"] == (8 if phase == 7 else 7)


@pytest.mark.verifies("J.1-3")
@pytest.mark.parametrize("first", range(1, 8))
def test_of_several_reasons_that_hold_at_once_the_first_counts(fmu, first):
    """All clocks end at the sixth second of FINAL; those before `first` are switched off."""
    at = [0.0] * 15
    at[5] = 6.0
    changes = {"time_out": at, "nav_near": 5.0, "attempts": 1}
    changes |= {"error_dwell": 5.0 if first <= 5 else 99, "speed_dwell": 5 if first <= 6 else 99}
    bad = on_axis(30, off=9, v_rel=5, relative_valid=float(first > 3))
    orders = {1: {"abort": 1}, 2: {"retreat": 1}, 4: {"mass": 80}}
    at_once = {k: v for reason, o in orders.items() if reason >= first for k, v in o.items()}
    recording = Recording(fmu, changes).lead_to(5)
    assert recording.stay(bad, 5) == [5] * 5
    assert recording.sample(bad | at_once) == (14 if first == 1 else 12)
    assert recording["reason"] == first


# ---- mating ----
def test_soft_capture_is_followed_at_once_for_any_dwell(fmu):
    recording = Recording(fmu, {"dwell": [3.0] * 15}).lead_to(7)
    assert recording.sample(HOLDING[7]) == 7
    assert recording.sample(GOOD[7] | {"relative_valid": 0, "contact": 1}) == 8


@pytest.mark.verifies("J.1-6")
def test_attempts_fail_after_their_first_contact_and_are_counted(fmu):
    """capture_time 20 s from the first contact of the phase on, however short; then back-off, hold,
    a second attempt, retreat.
    """
    recording = Recording(fmu, {"capture_time": 20}).lead_to(7)
    mating = HOLDING[7]
    assert recording["attempt"] == 1
    assert recording.stay(mating, 30) == [7] * 30
    assert recording["push"] == 0
    assert recording.sample(mating | {"contact": 1}) == 7
    assert recording["push"] == 1
    assert recording.stay(mating, 20) == [7] * 19 + [11]
    assert recording["push"] == 0
    while recording.sample(GOOD[11]) == 11:
        pass
    while recording.sample(GOOD[6]) == 6:
        pass
    assert recording["attempt"] == 2
    assert recording.stay(mating, 119) == [7] * 119
    assert recording.sample(mating) == 12
    assert recording["reason"] == 8


def test_attempts_begin_anew_after_a_resumption(fmu):
    recording = Recording(fmu).lead_to(7)
    recording.sample(HOLDING[7] | {"retreat": 1})
    while recording.sample(GOOD[12]) == 12:
        pass
    assert recording["attempt"] == 1
    recording.stay(GOOD[13], 4)
    assert recording["phase"] == 0
    assert recording["attempt"] == 0
    assert recording["L_ref"] == 20


# ---- outputs ----
def test_a_run_begins_far_away_with_a_state_that_counts_as_valid(fmu):
    """A retreat at the first sample, nothing valid before it, has that sample's state to go by."""
    recording = Recording(fmu)
    where = in_hill((3, -50, 1), (0.1, 0, 0), relative_valid=0, retreat=1)
    assert recording.sample(where) == 12
    assert recording["clearance"] > 40


@pytest.mark.verifies("J.1-11")
def test_initialization_shows_a_first_sample_and_retains_nothing(fmu):
    unit = fmu("mission_manager", {}, GOOD[0] | {"retreat": 1}, 0.0)
    first = fmu("mission_manager", {}, GOOD[0], 0.0)
    assert unit.get("phase") == 12
    assert unit.get("clearance") > 0
    unit.step(0.1, GOOD[0])
    first.step(0.1, GOOD[0])
    for name in unit.kind.outputs:
        assert np.array_equal(unit.get(name), first.get(name)), name


@pytest.mark.verifies("J.1-8")
def test_commanding_and_active_controllers_of_each_phase(fmu):
    """Columns force and torque of the table; torque of retreat, safe drift, abort as before."""
    table = {
        0: (1, 1), 1: (1, 1), 2: (2, 2), 3: (2, 2), 4: (3, 3), 5: (3, 3), 6: (3, 3), 7: (3, 3),
        8: (0, 0), 9: (4, 4), 10: (4, 4), 11: (3, 3), 12: (5, 1), 13: (0, 1), 14: (0, 1),
    }  # fmt: skip
    for phase, selected in table.items():
        unit = Recording(fmu).lead_to(phase).unit
        assert (unit.get("select_force"), unit.get("select_torque")) == selected
        active = [unit.get(f"active_{name}") for name in ("far", "close", "sync", "stack")]
        assert active == [float(k in selected) for k in (1, 2, 3, 4)]


@each("phase", range(1, 15))
def test_the_optimal_law_has_the_force_of_the_approach_and_its_goals(fmu, phase):
    """Up to hold 3; in the far phases the law of the closing has the torque."""
    plain, optimal = (Recording(fmu, {"use_optimal": s}).lead_to(phase) for s in (0, 1))
    goal = {1: 1, 2: 1, 3: 1, 4: 2, 5: 3, 6: 3}.get(phase, 0)
    assert (plain["goal"], optimal["goal"]) == (0, goal)
    assert optimal["select_force"] == (6 if goal else plain["select_force"])
    assert (optimal["L_goal"], optimal["T_goal"]) == ((100, 1200) if phase == 1 else (0, 0))
    torque = 2 if plain["select_torque"] == 1 else plain["select_torque"]
    assert optimal["select_torque"] == torque
    active = [optimal[f"active_{name}"] for name in ("far", "close", "sync", "stack")]
    assert active == [float(k == torque) for k in (1, 2, 3, 4)]


@pytest.mark.parametrize(("phase", "torque"), [(3, 2), (4, 3), (6, 3)])
@pytest.mark.parametrize("end", [{"retreat": 1}, {"abort": 1}])
def test_attitude_law_continues_through_retreat_safe_drift_and_abort(fmu, phase, torque, end):
    recording = Recording(fmu).lead_to(phase)
    recording.sample(HOLDING[phase] | end)
    for _ in range(150):
        recording.sample(GOOD[12])
        assert recording["select_torque"] == torque
    assert recording["phase"] == (13 if "retreat" in end else 14)


@pytest.mark.verifies("J.1-9")
def test_a_retreat_out_of_the_opened_zone_is_not_evaluated_as_an_entry(fmu):
    recording = Recording(fmu).lead_to(6)
    recording.sample(HOLDING[6] | {"retreat": 1})
    for R, valid in ((3, 0), (20 - TINY, 0), (20 + TINY, 1), (150, 1)):
        recording.sample(in_hill(line(R)))
        assert recording["monitor_valid"] == valid
    recording.sample(in_hill(line(150), relative_valid=0))
    assert recording["monitor_valid"] == 0


@pytest.mark.verifies("J.1-13")
@pytest.mark.parametrize("watched", [0, 1])
def test_the_monitor_uses_the_state_of_the_stack_with_monitor_stack_only(fmu, watched):
    for phase, valid in ((7, 1), (8, watched), (9, watched), (10, watched)):
        recording = Recording(fmu, {"monitor_stack": watched}).lead_to(phase)
        assert recording["monitor_valid"] == valid


def test_attitude_of_the_virtual_target_carries_x_to_the_line_of_the_holds(fmu):
    """A point R on x of V is the hold point: rho_H = R [cos psi, sin psi, 0]."""
    for psi in (-np.pi / 2, 0.4, 2.0):
        unit = fmu("mission_manager", {"line_angle": psi}, in_hill(line(100)))
        C_HN = mission.seen(mission.PARAMETERS, in_hill(line(100))).C_HN
        x_H = C_HN @ dcm_of_quaternion(unit.get("q_VN"))[0]
        assert np.abs(x_H - (np.cos(psi), np.sin(psi), 0)).max() < 1e-14
        assert unit.get("omega_VN_V") == pytest.approx((0, 0, np.sqrt(MU / GEO**3)), abs=1e-17)


# ---- closing beside the zone ----
BESIDE = {
    "aim_radius": 12.6,
    "time_out": [0.0] * 15,
    "nav_far": 1e9,
    "speed_dwell": 1e9,
    "tol_1": 50.0,
}
STARTS = {
    "beside the line": (13.2, -102.0, 1.4),
    "on the line": (0.0, -104.0, 0.0),
    "opposite to the hold": (0.0, 60.0, 0.0),
    "above the plane": (5.0, -30.0, 80.0),
}


def closing_from(fmu, start, ranges):
    """Outputs of a closing from a place on a straight radial path with these ranges, one a sample;
    the reference runs beside it.
    """
    recording = Recording(fmu, BESIDE).lead_to(1)
    start, rows = np.array(start), []
    out = start / np.linalg.norm(start)
    recording.stay(HOLDING[1] | in_hill(start, go_1=0), 1)
    speeds = np.gradient(ranges, P)
    for R, speed in zip(ranges, speeds, strict=True):
        recording.sample(in_hill(R * out, speed * out))
        rows.append({name: recording[name] for name in ("phase", "q_VN", "omega_VN_V")})
    return rows


def line_of_sight(row):
    """X of V in H axes."""
    return AXIS.T @ dcm_of_quaternion(row["q_VN"])[0]


@each("place", STARTS)
def test_closing_beside_the_zone_aims_along_a_tangent_of_its_sphere(fmu, place):
    """The places at which a servicer is that follows: a line that passes at 12.6 m."""
    R = np.linalg.norm(STARTS[place])
    ranges = np.concatenate(([R] * 8, np.linspace(R, 25.0, 40)))
    rows = closing_from(fmu, STARTS[place], ranges)
    ranges, rows = ranges[8:], rows[8:]
    assert {int(row["phase"]) for row in rows} == {2}
    points = np.array([r * line_of_sight(row) for r, row in zip(ranges, rows, strict=True)])
    along = points[-1] - points[0]
    along /= np.linalg.norm(along)
    assert np.linalg.norm(np.cross(points, along), axis=1) == pytest.approx(12.6)
    assert np.linalg.matrix_rank(points, 1e-6) == 2


def test_closing_beside_the_zone_turns_to_the_hold_at_its_end(fmu):
    R = np.linalg.norm(STARTS["beside the line"])
    ranges = np.concatenate(([R] * 8, np.linspace(R, 20.5, 40), [20.5] * 300))
    rows = closing_from(fmu, STARTS["beside the line"], ranges)
    hold = np.array((np.cos(-np.pi / 2), np.sin(-np.pi / 2), 0))
    off = np.array([np.arccos(np.clip(line_of_sight(row) @ hold, -1, 1)) for row in rows[48:]])
    assert off[0] > 0.3 and off[-1] < 1e-6
    assert np.all(np.diff(off) < 1e-7)
    assert 20 * np.abs(np.diff(off)).max() / P == pytest.approx(2 * 0.03, rel=0.01)


def test_without_an_aim_the_closing_goes_to_the_hold_point(fmu):
    recording = Recording(fmu, {"aim_radius": 0}).lead_to(2)
    recording.sample(in_hill((13.2, -102.0, 1.4), (0, 0.1, 0)))
    x_H = AXIS.T @ dcm_of_quaternion(recording["q_VN"])[0]
    assert x_H == pytest.approx((0, -1, 0), abs=1e-14)


# ---- range profile ----
FROM = {5: 20.0, 6: 3.0, 7: 3.0, 11: 1.6}
"""Distance at the start."""


def profile_rows(fmu, phase, seconds, changes):
    """t - t_phase, L, dL, ddL of every sample from the one that begins the phase, and the speed."""
    stand_still = [0.0] * 15
    changes = {"time_out": stand_still, "nav_far": 1e9, "nav_near": 1e9} | changes
    recording = Recording(fmu, changes).lead_to(phase, 4000)
    begun, rows = recording["t_phase"], []
    for _ in range(round(seconds / recording.p["sample_period"])):
        rows.append([recording[name] for name in ("L_ref", "dL_ref", "ddL_ref")])
        assert recording.sample(HOLDING[phase] | {"contact": 0, "relative_valid": 0}) == phase
    assert recording["t_phase"] == begun
    return np.array(rows).T


def derivative(x, h):
    """Of fourth order, at all but two samples at either end."""
    return (8 * (x[3:-1] - x[1:-3]) - (x[4:] - x[:-4])) / (12 * h)


SPEEDS = {"v_final": 2.0, "v_mate": 0.1, "v_back": 0.2, "v_3": 9.0, "L_end": 1.483}
JOINTS = {5: (1.875 * 17 / 2,), 7: (10, 5 + 1.517 / 0.1), 11: (1.875 * 1.4 / 0.2,)}
"""Ends of ramps; of mating also where it stops at L_end, in a step."""


@pytest.mark.verifies("J.2-1")
@pytest.mark.parametrize(("phase", "speed"), [(5, 2.0), (7, 0.1), (11, 0.2)])
def test_profile_rate_and_acceleration_are_derivatives_of_each_other(fmu, phase, speed):
    """1e-8 at 20 Hz, but for the stencils across a joint."""
    h = 0.05
    L, d, dd = profile_rows(fmu, phase, 22, SPEEDS | {"dwell": [0.1] * 15, "sample_period": h})
    t = h * np.arange(len(L))[2:-2]
    smooth = np.all([np.abs(t - joint) > 2 * h for joint in JOINTS[phase]], axis=0)
    assert np.abs(derivative(L, h) - d[2:-2])[smooth].max() < 1e-8
    assert np.abs(derivative(d, h) - dd[2:-2])[smooth].max() < 1e-8
    assert np.abs(d).max() == pytest.approx(speed, rel=1e-4)
    assert (L[0], d[0], dd[0]) == pytest.approx((FROM[phase], 0, 0), abs=1e-7)
    assert (L[-1], d[-1], dd[-1]) == (1.483 if phase == 7 else 3, 0, 0)
    assert (np.abs(np.diff(L)) <= 1.001 * speed * h).all()


def test_profiles_begin_at_their_phase_and_the_last_one_continues_after_it(fmu):
    """The approach of FINAL is not begun anew at each sample, and goes on through a retreat."""
    quick = {"v_final": 1.0, "dwell": [0.0] * 15}
    recording = Recording(fmu, quick).lead_to(5)
    T = 1.875 * 17
    for k in range(1, 45):
        order = {"retreat": 1} if k == 10 else {}
        recording.sample(HOLDING[5] | order | {"relative_valid": 1})
        x = min(k / T, 1.0)
        assert recording["L_ref"] == pytest.approx(20 - 17 * (10 * x**3 - 15 * x**4 + 6 * x**5))
    assert recording["phase"] == 12
    assert recording["L_ref"] == 3


# ---- retreat ----
def two_bodies(S, T, seconds, step):
    """Relative positions every `step` seconds of free drift, N axes."""

    def field(_, x):
        pull = [-MU * x[k : k + 3] / np.linalg.norm(x[k : k + 3]) ** 3 for k in (0, 6)]
        return np.concatenate((x[3:6], pull[0], x[9:], pull[1]))

    t = np.arange(step, seconds * (1 + 1e-12), step)
    found = solve_ivp(field, (0, t[-1]), [*S, *T], "DOP853", t, rtol=1e-12, atol=1e-9)
    return found.y[:3].T - found.y[6:9].T


def retreat_from(fmu, place, changes=None):
    """A run in the first sample of its retreat, and the whole increment in N."""
    recording = Recording(fmu, {"R_1": 1e4, "drift_step": 120} | (changes or {}))
    assert recording.sample(place | {"retreat": 1}) == 12
    C_NS = dcm_of_quaternion(np.array(place["q_SN"], float)).T
    return recording, recording["dv_left_N"] + C_NS @ recording["F_retreat_S"] * P / place["mass"]


PLACES = [
    (line(100), (0, 0, 0)),
    ((100, 0, 0), (0, 0, 0)),
    ((-60, 70, 20), (0.02, 0.05, -0.01)),
    ((40, -90, -10), (0.0, -0.03, 0.02)),
]


@pytest.mark.verifies("J.3-1")
@pytest.mark.parametrize(("rho", "drho"), PLACES)
@pytest.mark.parametrize("a", [7.2e6, GEO])
def test_clearance_matches_the_two_body_motion(fmu, a, rho, drho):
    """1 % at 100 m; and the other sign of the drift would not lead away further."""
    place = in_hill(rho, drho, a=a)
    recording, dv = retreat_from(fmu, place)
    S = np.concatenate((place["r_SN_N"], place["v_SN_N"] + dv))
    T = np.concatenate((place["r_TN_N"], place["v_TN_N"]))
    assert np.linalg.norm(two_bodies(S, T, 86400, 120), axis=1).min() == pytest.approx(
        recording["clearance"], rel=1e-2
    )
    # speeds as seen in H: outwards 0.1, along the track 0.05 one way or the other
    C_HN = mission.seen(recording.model.p, place).C_HN
    v, out = C_HN @ dv + drho, np.array(rho) / np.linalg.norm(rho)
    along = v - 0.1 * out
    assert np.abs(along) == pytest.approx((0, 0.05, 0), abs=1e-9)
    other = S.copy()
    other[3:] -= 2 * C_HN.T @ along
    assert (
        np.linalg.norm(two_bodies(other, T, 86400, 120), axis=1).min()
        < 1.001 * recording["clearance"]
    )


@pytest.mark.verifies("J.3-1")
@pytest.mark.parametrize("phase", [2, 6])
def test_without_abort_relative_the_retreat_leaves_outwards_from_the_last_valid_state(fmu, phase):
    """Also near the target, where the grasp axis would be another direction; no drift until now."""
    recording = Recording(fmu, {"abort_relative": 0}).lead_to(phase)
    recording.sample(seen := on_axis(3, 0.04, 0.001))
    assert recording.sample(in_hill((50, 60, 70), relative_valid=0, retreat=1)) == 12
    F_N = recording["F_retreat_S"]  # the servicer is aligned with N there
    dv_H = AXIS.T @ (recording["dv_left_N"] + F_N * P / GROUND["mass"])
    rho = AXIS.T @ (seen["r_SN_N"] - seen["r_TN_N"])
    drho = AXIS.T @ (seen["v_SN_N"] - seen["v_TN_N"]) - np.cross((0, 0, RATE), rho)
    along = dv_H + drho - 0.1 * rho / np.linalg.norm(rho)
    assert np.abs(along) == pytest.approx((0, 0.05, 0), abs=1e-9)


def test_a_step_of_a_servicer_without_mass_is_rejected(fmu):
    unit = fmu("mission_manager", QUICK, GOOD[0] | {"mass": 0.0}, 0.0)
    with pytest.raises(FMICallException):
        unit.step(P)


@pytest.mark.verifies("J.3-1")
def test_the_burn_leaves_the_servicer_on_the_drift_that_was_planned(fmu):
    """0.9 N on 100 kg take 13 s; the true drift of a day retains 80 % of the clearance."""
    place = in_hill((3, -18, 2), (0.01, 0.02, 0), mass=90.0)
    recording, dv = retreat_from(fmu, place)
    r, v, moved, impulse = place["r_SN_N"], place["v_SN_N"].copy(), np.zeros(3), np.zeros(3)
    C_NS = dcm_of_quaternion(np.array(place["q_SN"], float)).T
    while recording["F_retreat_S"].any():
        a = C_NS @ recording["F_retreat_S"] / 90
        assert np.linalg.norm(recording["F_retreat_S"]) <= 0.9 + 1e-12
        moved, v, impulse = (
            moved + P * (v - place["v_SN_N"]) + a / 2 * P**2,
            v + a * P,
            impulse + a * P,
        )
        recording.sample(place)
    assert np.abs(impulse - dv).max() < 1e-12
    T = np.concatenate((place["r_TN_N"], place["v_TN_N"]))
    ranges = np.linalg.norm(two_bodies(np.concatenate((r + moved, v)), T, 86400, 120), axis=1)
    assert ranges.min() > 0.8 * recording["clearance"]
    assert recording["dv_left_N"] == pytest.approx((0, 0, 0), abs=0)


@pytest.mark.verifies("J.3-2")
def test_the_burn_follows_the_increment_while_the_servicer_turns(fmu):
    """The force is constant in N, for any attitude; the mass is the one of each sample."""
    place, rng = in_hill(line(30)), np.random.default_rng(0)
    recording, dv = retreat_from(fmu, place)
    left = recording["dv_left_N"].copy()
    for mass in (100.0, 95.0, 90.0):
        q = rng.normal(size=4)
        now = place | {"q_SN": q / np.linalg.norm(q), "mass": mass}
        recording.sample(now)
        F_N = dcm_of_quaternion(now["q_SN"]).T @ recording["F_retreat_S"]
        assert pytest.approx(0.9 * dv / np.linalg.norm(dv), abs=1e-12) == F_N
        left = left - F_N * P / mass
        assert recording["dv_left_N"] == pytest.approx(left, abs=1e-13)


# ---- by the arm ----
STOW, DEPLOY, GRASP, REST = range(4)


def test_arm_is_commanded_as_the_phase_requires_and_only_where_it_mates(fmu):
    stated = {6: DEPLOY, 7: GRASP, 8: REST, 9: REST, 10: REST, 11: DEPLOY, 12: STOW, 13: STOW}
    for by_arm in (0, 1):
        for phase in filter(None, GOOD):
            recording = Recording(fmu, {"by_arm": by_arm}).lead_to(phase)
            assert recording["arm_mode_cmd"] == by_arm * stated.get(phase, STOW)


def test_retreat_with_the_arm_out_folds_it(fmu):
    recording = Recording(fmu, {"by_arm": 1}).lead_to(7)
    assert recording["arm_mode_cmd"] == GRASP
    assert recording.sample(HOLDING[7] | {"retreat": 1}) == 12
    assert recording["arm_mode_cmd"] == STOW


def test_servicer_is_at_rest_without_thrust_while_the_arm_mates(fmu):
    recording = Recording(fmu, {"by_arm": 1, "capture_time": 50.0}).lead_to(7)
    for contact in (0, 1, 1):
        assert recording.sample(HOLDING[7] | {"contact": contact}) == 7
        assert [recording[name] for name in ("L_ref", "dL_ref", "ddL_ref")] == [3, 0, 0]
        assert recording["push"] == 0


@pytest.mark.verifies("J.1-10")
@pytest.mark.parametrize(("share", "phase"), [(0, 7), (1 + 1e-9, 7), (1 - 1e-9, 6)])
def test_pair_with_more_momentum_than_allowed_is_not_mated(fmu, share, phase):
    """share 0: no limit."""
    recording = Recording(fmu).lead_to(6)
    momentum = recording["momentum"]
    assert momentum > 1
    recording = Recording(fmu, {"momentum_max": share * momentum}).lead_to(6)
    assert recording.stay(GOOD[6], 10)[-1] == phase


# ---- what turning with the target needs ----
PLANNED = {"budget": 0.8, "rate_2": 0.005, "nav_far": 1e9, "nav_near": 1e9}
AT_HOLD = in_hill(line(20))
W = np.hypot(0.002, 0.01)
J_S, WHEELS = np.diag((200.0, 250, 150)), np.array((12.0, 15, 10))
MEAN = mission.mean(mission.seen(mission.PARAMETERS, AT_HOLD))
BIAS = mission.bias_for(mission.PARAMETERS, MEAN)
"""Of the nominal tumble for a servicer without rotation."""


def tumbling(rate, **other):
    """The second hold before a target that turns about its z axis."""
    return in_hill(line(20), omega_TN_T=(0, 0, rate), **other)


def at_hold(fmu, changes, place):
    """A run in the second hold, the wheels at rest."""
    recording = Recording(fmu, PLANNED | changes).lead_to(3)
    recording.stay(place, 1)
    return recording


@pytest.mark.parametrize(("rate", "R", "steer"), [
    (0.0102, 20, 0.005),                                 # force for more
    (0.0255, 1.6 / (100 * 0.0305**2), 0.005),
    (0.0306, 14, np.sqrt(1.6 / 1400) - 0.0306),
])  # fmt: skip
def test_range_and_steering_of_turning_leave_a_fifth_of_the_force(fmu, rate, R, steer):
    """Centripetal force 100 kg (w + steer)^2 R of 2 N; the range is reached with v_back."""
    place = tumbling(rate)
    bias = mission.plan(
        mission.PARAMETERS | PLANNED, place, mission.seen(mission.PARAMETERS, place)
    ).bias
    recording = at_hold(fmu, {"v_back": 0.05}, place | {"wheel_speed": bias})
    while recording["phase"] == 3:
        recording.sample(place | {"wheel_speed": bias})
    assert recording["phase"] == 4
    assert recording["L_ref"] == 20
    recording.stay(place, round(1.875 * (20 - R) / 0.05) + 2)
    assert recording["L_ref"] == pytest.approx(R, abs=1e-9)
    C_NT = dcm_of_quaternion(place["q_TN"]).T
    rho = R * C_NT[:, 0]
    recording.sample(place | {"r_SN_N": place["r_TN_N"] + rho})
    assert recording["steer_max"] == pytest.approx(steer, abs=1e-9)
    used = 100 * (rate + recording["steer_max"]) ** 2 * R
    assert used <= 1.6 * (1 + 1e-9)


@pytest.mark.parametrize(("rate", "goal"), [(0.0102, 2), (0.0306, 0)])
def test_turning_closer_than_the_hold_is_not_for_the_optimal_law(fmu, rate, goal):
    place = tumbling(rate)
    recording = at_hold(fmu, {"use_optimal": 1, "bias_tol": 9.0}, place)
    assert recording["goal"] == 1
    while recording["phase"] == 3:
        recording.sample(place)
    assert (recording["phase"], recording["goal"]) == (4, goal)
    assert recording["select_force"] == (6 if goal else 3)


@pytest.mark.parametrize(("force", "goals"), [(2.0, [2, 3, 3]), (0.575, [0, 0, 0])])
def test_after_turning_closer_than_the_hold_the_laws_before_bring_it_to_the_third_hold(
    fmu, force, goals
):
    """The force of an axis that 20 m need is 0.58 N."""
    given = PLANNED | {"use_optimal": 1, "F_axis": force, "steer_least": 0, "bias_tol": 9.0}
    found = [Recording(fmu, given).lead_to(phase)["goal"] for phase in (4, 5, 6)]
    assert found == goals


def test_wheels_are_brought_to_half_of_what_the_rotation_takes(fmu):
    """Parallel to the mean rate: beta w, w J w/2 in beta; from the closing to the fly-around."""
    for phase in (1, 2, 3, 4):
        recording = Recording(fmu, PLANNED | {"dwell": [0.0] * 15})
        place = AT_HOLD | {"wheel_speed": BIAS}
        while (
            recording.sample(GOOD[max(recording.model.phase, 0)] | {"wheel_speed": BIAS}) != phase
        ):
            pass
        assert recording["prepare"] == (phase in (2, 3, 4))
        expected = BIAS if phase in (2, 3, 4) else np.zeros(3)
        assert recording["wheel_bias"] == pytest.approx(expected, abs=1e-15), place
    h, w_S = WHEELS * BIAS, MEAN
    h_T = np.diag((100.0, 150, 90)) @ T["omega_TN_T"]  # in axes of T; twice the energy over it
    assert np.linalg.norm(w_S) == pytest.approx(h_T @ T["omega_TN_T"] / np.linalg.norm(h_T))
    assert np.linalg.norm(np.cross(h, w_S)) < 1e-12
    assert h @ w_S == pytest.approx(w_S @ J_S @ w_S / 2)
    assert np.abs(h).max() > 0.5


@pytest.mark.parametrize("w_S", [(1e-3, 2e-3, -1e-3), (0, 0.01, 0), (0, -0.03, 0.03)])
def test_wheels_hold_what_the_body_lacks_of_the_momentum(fmu, w_S):
    """Body and wheels have the momentum of the bias together, wheels up to 0.65 of 0.3 rad/s."""
    recording = at_hold(fmu, {}, AT_HOLD | {"wheel_speed": BIAS})
    recording.sample(AT_HOLD | {"wheel_speed": BIAS, "omega_SN_S": w_S})
    free = BIAS - J_S @ w_S / WHEELS
    assert recording["wheel_bias"] == pytest.approx(np.clip(free, -0.195, 0.195), abs=1e-12)
    assert (np.abs(free).max() > 0.195) == (np.abs(w_S).max() > 0.02)


def test_bias_has_a_limit_and_its_direction(fmu):
    """65 % of the wheel that is filled first, for a rate that needs 85 %."""
    place = tumbling(0.06)
    recording = at_hold(fmu, {"steer_least": 0}, place)
    bias, w_S = recording["wheel_bias"], mission.seen(mission.PARAMETERS, place).w_T
    assert np.abs(bias).max() == pytest.approx(0.65 * 0.3)
    assert np.linalg.norm(np.cross(WHEELS * bias, w_S)) < 1e-12
    assert bias @ w_S > 0


@pytest.mark.parametrize("off", [-1, 1])
def test_turning_begins_with_prepared_wheels(fmu, off):
    tolerance = 0.1 * 0.3
    recording = at_hold(fmu, {}, AT_HOLD)
    near = AT_HOLD | {"wheel_speed": BIAS + off * np.array((0, 0, tolerance - 1e-9))}
    beside = AT_HOLD | {"wheel_speed": BIAS + off * np.array((0, 0, tolerance + 1e-9))}
    assert recording.stay(beside, 5) == [3] * 5
    assert recording.stay(near, 4) == [3] * 3 + [4]


def verdicts(rate, **changes):
    """Parameters and place of one reason against a capture."""
    return {"speed_dwell": 1e9} | changes, tumbling(rate)


AGAINST = {
    # sqrt(1.6/1400) = 33.806e-3 at R_around
    "too little force": (9, verdicts(0.0318), verdicts(0.0319)),
    "too much momentum": (10, verdicts(0.02, momentum_max=0.02 * (90 + 250 + 60 * 9) + 1e-6),
                          verdicts(0.02, momentum_max=0.02 * (90 + 250 + 60 * 9) - 1e-6)),
    "too little propellant": (11, verdicts(0.02, Isp=3.8), verdicts(0.02, Isp=3.6)),
    "tumble too fast for probe": (12, verdicts(0.02, rate_probe=0.02 + 1e-9),
                                  verdicts(0.02, rate_probe=0.02 - 1e-9)),
}  # fmt: skip


@each("reason", AGAINST)
def test_a_target_that_cannot_be_captured_is_left_at_the_second_hold(fmu, reason):
    """With its reason, after the dwell; without budget there is no verdict."""
    number, (may, place), (may_not, other) = AGAINST[reason]
    recording = at_hold(fmu, may, place)
    assert recording["verdict"] == 0
    assert recording.stay(place, 5) == [3] * 5  # the wheels are not prepared
    recording = at_hold(fmu, may_not, other)
    assert recording["verdict"] == number - 8
    assert recording.stay(other, 3) == [3] * 2 + [12]
    assert recording["reason"] == number
    recording = at_hold(fmu, may_not | {"budget": 0}, other)
    assert recording["verdict"] == 0
    assert recording.stay(other, 3) == [3] * 2 + [4]


def turned_target(angle, rate=0.02, **other):
    """A servicer 20 m behind a target that turns about the orbit normal, its grasp axis `angle`
    ahead of the line to the servicer.
    """
    place = in_hill(line(20), omega_TN_T=(0, 0, rate))
    x = Rotation.from_rotvec(angle * AXIS[:, 2]).apply(place["r_SN_N"] - place["r_TN_N"]) / 20
    C_TN = np.array((x, np.cross(AXIS[:, 2], x), AXIS[:, 2]))
    return place | {"q_TN": quaternion_of_dcm(C_TN)} | other


@pytest.mark.parametrize(("spin_accel", "lead"), [(0, 0.02 * 30), (4e-4, 1.875 * 0.02**2 / 8e-4)])
@pytest.mark.parametrize("off", [-0.1, 0.1])
def test_the_servicer_joins_where_the_grasp_axis_will_pass(fmu, spin_accel, lead, off):
    """An axis in the plane of the motion passes in front of the servicer; while the servicer spins
    up it turns by w T_s/2.
    """
    changes = {"await_axis": 0.1, "spin_accel": spin_accel}
    inside, outside = (turned_target(-lead + off * s) for s in (1 - 1e-6, 1 + 1e-6))
    recording = waiting(fmu, changes)
    assert spins(recording, outside, 8) == [0] * 8
    assert spins(recording, inside, 1) == [1]
    assert spins(recording, outside, 2) == [1] * 2  # it has begun


def waiting(fmu, changes):
    """A run that has just come to the fly-around."""
    recording = Recording(fmu, changes).lead_to(3)
    while recording["phase"] == 3:
        recording.sample(GOOD[3] | turned_target(2.0, go_2=1))
    assert (recording["phase"], recording["spin"]) == (4, 0)
    return recording


def spins(recording, place, seconds):
    return [(recording.sample(place), recording["spin"])[1] for _ in range(seconds)]


def test_the_optimal_law_holds_until_the_servicer_turns_with_the_target(fmu):
    recording = waiting(fmu, {"await_axis": 0.1, "use_optimal": 1})
    assert (recording["spin"], recording["goal"]) == (0, 1)


def test_the_axis_is_awaited_for_a_turn_at_most(fmu):
    """2 pi/0.02 s = 314.2 s; a target at rest has no axis to wait for."""
    recording = waiting(fmu, {"await_axis": 0.1})
    found = spins(recording, turned_target(2.0), 316)
    assert found.index(1) + 1 == 315
    recording = waiting(fmu, {"await_axis": 0.1})
    assert spins(recording, turned_target(2.0, 0.0), 1) == [1]


def test_the_servicer_joins_at_the_range_of_turning_only(fmu):
    """14 m at 3 times the nominal rate, 1 m/s: 11.25 s; and with a valid state."""
    changes = PLANNED | {"await_axis": 4.0, "v_back": 1.0, "bias_tol": 9.0}
    recording = Recording(fmu, changes).lead_to(3)
    place = turned_target(0.0, 0.0306)
    while recording.sample(place) == 3:
        pass
    assert (recording["spin"], recording["prepare"]) == (0, 1)
    assert spins(recording, place, 11) == [0] * 11
    assert spins(recording, place | {"relative_valid": 0}, 2) == [0] * 2
    assert spins(recording, place, 1) == [1]
    assert recording["prepare"] == 1


def test_an_axis_out_of_the_plane_is_awaited_where_it_comes_nearest(fmu):
    """Rate across the line of sight, axis 0.5 rad from the rate: never nearer than pi/2 - 0.5."""
    inclined = np.array((np.sin(0.5), 0, np.cos(0.5)))
    recording = waiting(fmu, {"await_axis": 0.2, "p_T": inclined})
    assert spins(recording, turned_target(0.6), 8) == [0] * 8
    assert spins(recording, turned_target(-0.6), 1) == [1]


def test_a_verdict_of_one_sample_ends_nothing(fmu):
    may_not = verdicts(0.0319)[1]
    recording = at_hold(fmu, {}, AT_HOLD)
    for _ in range(3):
        assert recording.stay(may_not, 2) == [3] * 2
        assert recording.stay(AT_HOLD, 1) == [3]


def test_increment_ahead_is_the_centripetal_acceleration_over_its_time(fmu):
    """Nominal tumble, R_f = 20 m: half a turn at 5e-3 rad/s, 17 m at 0.1 m/s, 3 m for 80.67 s."""
    recording = at_hold(fmu, {"v_final": 0.1, "dwell": [10.0] * 15}, AT_HOLD)
    inwards, there = 1.875 * 17 / 0.1, 20 + 1.52 / 0.03
    expected = W**2 * (20 * np.pi / 0.005 + 11.5 * inwards + 3 * there)
    assert recording["dv_ahead"] == pytest.approx(expected)


@each(("phase", "following"), [(4, 5), (6, 7)])
@each("wheel", range(3))
def test_with_a_full_wheel_no_mating_begins(fmu, phase, following, wheel):
    """80 % of 0.3 rad/s, either way round; and a rate error after the fly-around."""
    full = np.eye(3)[wheel] * 0.24
    recording = Recording(fmu, PLANNED)
    recording.unit = fmu("mission_manager", recording.p, GOOD[0] | {"wheel_speed": BIAS}, 0.0)
    while recording.sample(GOOD[max(recording.model.phase, 0)] | {"wheel_speed": BIAS}) != phase:
        pass
    bad = GOOD[phase] | {"wheel_speed": -full * (1 + 1e-9)}
    assert recording.stay(bad, 6) == [phase] * 6
    good = GOOD[phase] | {"wheel_speed": full * (1 - 1e-9)}
    assert recording.stay(good, 4) == [phase] * 3 + [following]


@pytest.mark.parametrize("error", [-1, 1])
def test_turning_ends_when_the_servicer_turns_with_the_target(fmu, error):
    recording = Recording(fmu, {"rate_2": 0.005}).lead_to(4)
    inside, outside = (on_axis(20, w_rel=error * (0.005 + e)) for e in (-TINY, TINY))
    assert recording.stay(outside, 6) == [4] * 6
    assert recording.stay(inside, 4) == [4] * 3 + [5]


@pytest.mark.verifies("J.1-7")
@pytest.mark.parametrize("phase", [5, 6])
def test_a_final_approach_that_does_not_end_begins_anew(fmu, phase):
    """Attempts 2: one time-out backs off to 20 m with v_final, the arm stowed; the next one
    retreats.
    """
    at = [0.0] * 15
    at[5] = at[6] = 12.0
    changes = {"time_out": at, "by_arm": 1, "nav_far": 1e9, "nav_near": 1e9, "v_final": 5.0}
    recording = Recording(fmu, changes).lead_to(phase)
    waiting = on_axis(3, off=0.06)  # beside the axis
    seen = recording.stay(waiting, 12)
    assert seen == [phase] * 11 + [11]
    assert (recording["reason"], recording["attempt"], recording["arm_mode_cmd"]) == (7, 1, 0)
    assert recording["approaching"] == 1
    assert recording.stay(on_axis(3), 9) == [11] * 9  # on the axis, but not far back
    assert recording["L_ref"] == 20
    assert recording.stay(GOOD[4], 4) == [11] * 3 + [5]
    while recording.sample(waiting) == 5:
        pass
    assert (recording["phase"], recording["reason"]) == (12, 7)


@pytest.mark.verifies("J.1-7")
@pytest.mark.parametrize("wait", [{"go_3": 0}, {"r_SN_N": None}])
def test_a_third_hold_that_waits_for_ground_or_momentum_does_not_begin_anew(fmu, wait):
    at = [0.0] * 15
    at[6] = 12.0
    limit = 1e-3 if "r_SN_N" in wait else 0
    changes = {"time_out": at, "momentum_max": limit}
    recording = Recording(fmu, changes).lead_to(6)
    place = GOOD[6] | ({"go_3": 0} if "go_3" in wait else {})
    assert recording.stay(place, 12) == [6] * 11 + [12]
    assert (recording["reason"], recording["attempt"]) == (7, 0)


# ---- everything at random ----
@pytest.mark.parametrize("seed", some(range(3), 3, 1))
def test_random_runs_follow_the_reference(fmu, seed):
    """Inputs that now and then fit the phase; every phase and every reason come up in the seeds
    together.
    """
    rng = np.random.default_rng(seed)
    changes = {"sample_period": 0.5, "dwell": [0.5] * 15, "drift_step": 7200, "by_arm": seed % 2}
    recording = Recording(fmu, changes)
    seen = set()
    for _ in range(1500):
        k = max(recording.model.phase, 0)
        scene = GOOD[k] if rng.random() < 0.9 else GOOD[int(rng.integers(15))]
        scene = scene | {"relative_valid": float(rng.random() < 0.95)}
        for name, share in (("abort", 2e-4), ("retreat", 0.01), ("contact", 0.3), ("go_2", 0.8)):
            scene[name] = float(rng.random() < share)
        scene["mass"] = 85.9 if rng.random() < 2e-3 else 95.0
        seen.add(recording.sample(scene))
        if seen >= {14} or recording["phase"] == 10:
            recording.model = mission.Manager(recording.model.p)
            recording.unit = fmu("mission_manager", recording.p, GOOD[0], recording.unit.time)
            seen.discard(14)
    assert seen >= {0, 1, 2, 3, 4, 5, 6, 12, 13}


# ---- parameters ----
@pytest.mark.verifies("J.1-12")
@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"R_2": 100}, "R_2 = 100: must be below R_1"),
        ({"L_3": 20}, "L_3 = 20: must be below R_2"),
        ({"L_end": 3}, "L_end = 3: must be below L_3"),
        ({"L_end": 0}, "L_end = 0: must be > 0"),
        ({"p_T": (1, 1e-4, 0)}, "must be a unit vector"),
        *(({name: 0}, f"{name} = 0: must be > 0") for name in (
            "sample_period", "v_final", "v_mate", "v_back", "v_retreat", "v_drift", "drift_step",
            "F_retreat")),
        *(({name: -1}, f"{name} = -1: must be >= 0") for name in (
            "tol_1", "angle_2", "nav_far", "attempts", "mass_dry", "reserve", "ramp_mate")),
        ({"dwell": [0] * 14 + [-1]}, "dwell[15] = -1: must be >= 0"),
        ({"drift_step": 0.1}, "must not be below drift_time / 1e5"),
        ({"aim_radius": 20}, "aim_radius = 20: must be below R_2"),
        ({"budget": 1.1}, "budget = 1.1: must not be above 1"),
        ({"budget": 0.8, "R_around": 21}, "R_around = 21: must be above L_3 and not above R_2"),
        ({"budget": 0.8, "R_around": 3}, "R_around = 3: must be above L_3 and not above R_2"),
    ],
)  # fmt: skip
def test_rejected(change, words, tmp_path):
    assert words in rejection("mission_manager", change, tmp_path)
