# SPDX-License-Identifier: BSD-2-Clause
"""servicing_mission: the table of events of a whole mission, every parameter set to the end that
its name states. One mission takes some seconds of processor time, so whole runs are marked long.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from harness import Simulation, load, run
from harness.files.paths import systems
from harness.mission.claim import Verdict
from harness.results.requirements import finding, findings
from harness.results.result import Result
from ssp.servicing_mission.claims import CLAIMS
from ssp.servicing_mission.events import increments, stays

MU = 3.986004415e14
NOMINAL = [
    "far", "hold 1", "closing", "hold 2", "fly-around", "final", "hold 3", "mating", "rigidise",
    "detumble", "stack",
]  # fmt: skip
TRY_AGAIN = ["back-off", "hold 3", "mating"]
ENDS = {
    "no_go": (NOMINAL[:4], "time-out"),
    "dropout": (NOMINAL[:8], "navigation"),
    "bounce": (NOMINAL[:8] + TRY_AGAIN, "attempts"),
    "thruster_stuck": (NOMINAL[:6], "axis or pointing error"),
    "manoeuvre": (NOMINAL[:6], "axis or pointing error"),
    "ground_retreat": (NOMINAL[:7], "ground"),
}
"""Phases before the retreat, and its reason."""


def test_the_first_second_is_the_same_in_both_executors_and_with_any_thinning():
    """Equal bits; rows every 0.1 s unless stated otherwise."""
    one, other = (run("servicing_mission", stop=1.0, executor=e) for e in ("c", "python"))
    every = run("servicing_mission", stop=1.0, every=1)
    assert len(one.time) == 11
    assert len(every.time) == 101
    for name in one.vectors:
        assert np.array_equal(one[name], other[name]), name
        assert np.array_equal(one[name], every[name][::10]), name
    assert one["manager.phase"].tolist() == [0] * 11
    assert one["manager.active_far"].all()
    assert not one["selector.M_cmd_S"].any()  # the wheels turn it
    assert one["selector.wheel_accel_cmd"].any()


def test_every_mission_that_captures_requires_the_capture():
    found = []
    for name in systems():
        if not name.startswith(("arm_", "servicing_")):
            continue
        with load(name) as system:
            if any(c.fmu.stem == "docking_mechanism" for c in system.components):
                found.append(name)
                assert any("mechanism.hard" in text for text in system.requirements.values()), name
    assert len(found) >= 5


@pytest.mark.parametrize(
    ("hard", "stop", "verdict"),
    [
        ((0, 1), 3600, Verdict.MET),
        ((0, 0), 3600, Verdict.NOT_MET),
        ((1, 0), 3600, Verdict.NOT_MET),
        ((0, 0), 2300, Verdict.NOT_EXERCISED),
    ],
)
def test_a_mission_that_does_not_hold_the_target_at_its_end_has_not_captured(hard, stop, verdict):
    with load("servicing_mission") as system:
        text = system.requirements["captured"]
    values = np.array(hard, dtype=float)[:, None]
    result = Result("", np.array([0.0, stop]), ("mechanism.hard",), ("1",), values)
    assert finding(result, "captured", text).verdict is verdict


def test_the_approach_can_be_commanded_by_the_optimal_law():
    """Far, first hold and closing, quickly left: after a second a plan, its force and no
    other.
    """
    quick = {"manager.dwell": [1.0] * 15, "servicer.rho_0_H": [0, -100, 0]}
    result = run("servicing_mission", params="optimal", set=quick, stop=15)
    assert set(result["manager.phase"]) == {0, 1, 2}
    assert (result["selector.force_law"] == 6).all()
    planned = result["optimal.mode"] == 0
    assert np.flatnonzero(~planned).tolist() == list(range(11))
    used = result["selector.F_cmd_S"]
    assert np.array_equal(used, result["optimal.F_cmd_S"])
    far, closing = (np.abs(used[result["manager.phase"] == k]).max() for k in (0, 2))
    assert far < 0.1 and closing > 0.5
    assert not result["close_controller.violation"].any()
    assert not result["close_controller.F_cmd_S"].any()


@pytest.fixture(scope="module")
def nominal():
    return run("servicing_mission")


@pytest.mark.long
def test_the_mission_goes_through_all_its_phases_to_a_stack_at_rest(nominal):
    assert [s.phase for s in stays(nominal)] == NOMINAL
    assert not nominal["monitor.abort"].any()


@pytest.mark.long
def test_the_whole_run_has_the_same_bits_in_both_executors(nominal):
    other = run("servicing_mission", executor="python")
    assert nominal.values.tobytes() == other.values.tobytes()


@pytest.mark.long
def test_saved_and_restored_in_every_phase_it_has_the_same_future(nominal):
    """In the middle of every phase: saved, advanced by ten seconds, restored, advanced to the
    next.
    """
    with load("servicing_mission") as system, Simulation(system) as simulation:
        for stay in stays(nominal):
            there = 10 * round(5 * (stay.begin + stay.end))
            simulation.advance(to=there)
            snapshot = simulation.save()
            simulation.advance(to=min(there + 1000, 360000))
            simulation.restore(snapshot)
            simulation.recorder.table[there // 10 + 1 :] = np.nan
            simulation.free(snapshot)
        simulation.advance()
        assert simulation.result().values.tobytes() == nominal.values.tobytes()


@pytest.mark.long
@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim.name)
def test_events_lie_in_their_bands(nominal, claim):
    judgement = claim.evaluate(nominal)
    assert judgement.verdict is Verdict.REPRODUCED, judgement.value


@pytest.mark.long
def test_increments_match_the_thrusters(nominal):
    """Impulse over mass, summed over the rows: the mass falls by 0.3 kg, so to 1e-3."""
    impulse = nominal["propulsion.impulse"].sum(axis=1)
    mass = nominal["servicer.mass"]
    summed = np.sum(np.diff(impulse) / mass[:-1])
    assert summed == pytest.approx(increments(nominal)[-1], rel=1e-3)


@pytest.mark.long
def test_wheels_and_stack_stay_within_their_limits(nominal):
    assert np.abs(nominal["servicer.wheel_speed"]).max() <= 0.3
    done = nominal["manager.phase"] == 10
    rate = np.linalg.norm(nominal["servicer.omega_SN_S"][done], axis=1)
    assert rate.max() <= 2e-4 * 1.01
    assert rate[-1] < rate[0]


def drift_of_a_day(result):
    """Least range of free drift from the last row on [m]."""

    def field(_, x):
        a = [-MU * x[k : k + 3] / np.linalg.norm(x[k : k + 3]) ** 3 for k in (0, 6)]
        return np.concatenate((x[3:6], a[0], x[9:], a[1]))

    names = ("servicer.r_SN_N", "servicer.v_SN_N", "target.r_TN_N", "target.v_TN_N")
    start = np.concatenate([result[name][-1] for name in names])
    t = np.linspace(0, 86400, 721)
    y = solve_ivp(field, (0, 86400), start, "DOP853", t, rtol=1e-11, atol=1e-6).y
    return np.linalg.norm(y[:3] - y[6:9], axis=0).min()


@pytest.mark.long
@pytest.mark.parametrize("name", ENDS)
def test_every_set_ends_in_a_safe_drift_for_the_reason_in_its_name(name):
    """A day of drift beyond 150 m, no rule of the monitor violated."""
    before, reason = ENDS[name]
    result = run("servicing_mission", params=name)
    simulated = stays(result)
    assert [s.phase for s in simulated] == [*before, "retreat", "safe"]
    assert simulated[-2].reason == reason
    assert (result["monitor.least_margin"][-1, :3] > 0).all()
    assert drift_of_a_day(result) > 150
    assert {f.name: f.verdict for f in findings(result)}["captured"] is Verdict.NOT_MET


@pytest.mark.long
@pytest.mark.parametrize(
    ("system", "params", "most"),
    [
        ("servicing_mission", "optimal", 3.0),
        ("servicing_mission_navigated", "optimal", 3.6),
        ("servicing_mission", "limited", 5.0),
        ("servicing_mission_navigated", "limited", 5.2),
    ],
)
def test_the_optimal_law_needs_two_thirds_of_the_increments_within_every_rule(system, params, most):
    result = run(system, params=params)
    assert [s.phase for s in stays(result)] == NOMINAL
    assert increments(result)[-1] <= most
    assert all(f.verdict is Verdict.MET for f in findings(result))
    assert not result["monitor.abort"].any()
    assert not result["optimal.braking"].any()


@pytest.mark.long
def test_a_safe_drift_is_resumed_when_ground_states_so():
    """A retreat at the first hold, then resume: the far approach begins anew."""
    times = [1350.0, 1360.0, 3000.0] + [1e30] * 13
    go = (1, 1, 1, 0, 0, 1)
    rows = [(1, 1, 1, 1, 0, 1), go, (1, 1, 1, 0, 1, 1)] + [go] * 13
    changes = {"timeline.times": times, "timeline.rows": rows}
    result = run("servicing_mission", set=changes, stop=6000)
    phases = [s.phase for s in stays(result)]
    assert phases[:5] == ["far", "hold 1", "retreat", "safe", "far"]


@pytest.mark.parametrize("phase", ["contact", "soft", "hard", "free"])
def test_the_load_counts_from_the_first_touch_to_the_stack(phase):
    names = tuple(f"mechanism.{name}" for name in ("contact", "soft", "hard", "load_force"))
    row = [float(name == f"mechanism.{phase}") for name in names[:3]] + [70.0]
    result = Result("made", np.arange(2.0), names, ("1", "1", "1", "N"), np.array([row, row]))
    with load("servicing_mission") as system:
        found = finding(result, "load", system.requirements["load"])
    assert found.word == ("not exercised" if phase == "free" else "NOT MET")
