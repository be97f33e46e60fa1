# SPDX-License-Identifier: BSD-2-Clause
"""servicing_mission_navigated: the mission on estimates, and four failures of real missions with
and without the protection against them. Whole runs are marked long.
"""

from __future__ import annotations

import numpy as np
import pytest

from harness import load, run
from harness.mission.claim import Verdict
from harness.results.requirements import margin
from ssp.servicing_mission.claims import CLAIMS
from ssp.servicing_mission.events import collided, increments, outcome, stays
from ssp.shared.relative_motion import range_

from .test_servicing_mission import ENDS, NOMINAL, drift_of_a_day

SYSTEM = "servicing_mission_navigated"
SEES_THE_TRUTH = {
    "star_tracker", "gyro", "pose_sensor", "orbit_sensor", "range_sensor", "mechanism",
}  # fmt: skip
PLANTS = {"servicer", "target"}
STATES = {"r_TN_N", "v_TN_N", "q_TN", "omega_TN_T", "r_SN_N", "v_SN_N", "q_SN", "omega_SN_S"}


def test_no_software_sees_the_truth():
    """States of the bodies reach sensors and mechanism only; the software has them from filters."""
    with load(SYSTEM) as system:
        wires = {(*c.target, c.source.component) for c in system.connections}
    seen = {(to, name.split("[")[0], of) for to, name, of in wires if of in PLANTS}
    assert {to for to, name, _ in seen if name in STATES} <= SEES_THE_TRUTH
    stated = {to for to, name, of in wires if of == "relative_filter"}
    assert {"manager", "monitor", "guidance", "controller", "stack_guidance"} <= stated


def test_first_seconds_have_the_same_bits_in_both_executors():
    """Filters start at the wrong place and are corrected by the first pose."""
    one, other = (run(SYSTEM, stop=0.6, executor=e) for e in ("c", "python"))
    for name in one.vectors:
        assert np.array_equal(one[name], other[name]), name
    off = one["servicer.r_SN_N"] - one["target.r_TN_N"]
    off -= one["relative_filter.r_SN_N"] - one["relative_filter.r_TN_N"]
    assert np.linalg.norm(off[0]) == pytest.approx(
        np.linalg.norm((5, 10, 2)), abs=0.4
    )  # axes of H at S, not T


@pytest.fixture(scope="module")
def nominal():
    return run(SYSTEM)


@pytest.mark.long
def test_the_mission_on_estimates_comes_to_a_stack_at_rest(nominal):
    assert [s.phase for s in stays(nominal)] == NOMINAL
    assert outcome(nominal) == "captured"
    assert not nominal["monitor.abort"].any()
    assert (nominal["monitor.least_margin"][-1, [0, 1, 2, 5]] > 0).all()


@pytest.mark.long
@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim.name)
def test_events_lie_in_the_bands_of_the_truth(nominal, claim):
    judgement = claim.evaluate(nominal)
    assert judgement.verdict is Verdict.REPRODUCED, judgement.value


def simulate(name):
    return run(SYSTEM, params=name, every=50)


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(set(ENDS) - {"bounce"}))
def test_sets_of_the_truth_end_for_the_same_reasons(name):
    before, reason = ENDS[name]
    result = simulate(name)
    simulated = stays(result)
    assert [s.phase for s in simulated] == [*before, "retreat", "safe"]
    assert simulated[-2].reason == reason
    assert drift_of_a_day(result) > 150


@pytest.mark.long
def test_bounce_captures_at_the_second_attempt():
    """Errors of the estimate push the slow probe over the catch."""
    result = simulate("bounce")
    assert [s.phase for s in stays(result)][8:11] == ["back-off", "hold 3", "mating"]
    assert outcome(result) == "captured"
    assert np.abs(result["servicer.wheel_speed"]).max() < 0.29


@pytest.mark.long
def test_dart_collides_on_its_own_estimate_and_aborts_on_the_independent_range():
    blind, watched = simulate("dart_blind"), simulate("dart")
    met = int(range_(blind).argmin())
    assert collided(blind)
    v = blind["servicer.v_SN_N"][met] - blind["target.v_TN_N"][met]
    assert np.linalg.norm(v) > 0.6
    assert not blind["monitor.violated"][:met, [0, 1, 2, 5]].any()  # all looked well
    assert outcome(watched) == "aborted"
    assert watched["monitor.t_first"][-1][5] < 1430  # of a fault at 1394 s
    assert range_(watched).min() > 50
    assert drift_of_a_day(watched) > 150


@pytest.mark.long
def test_elsa_d_without_half_of_its_thrusters_drifts_safely_away():
    known, unseen = simulate("elsa_d"), simulate("elsa_d_blind")
    stated = (known.time > 2119.5) & (known.time < 2177)
    assert known["allocation.infeasible"][stated].mean() > 0.9
    assert not unseen["allocation.infeasible"][(unseen.time > 2119) & (unseen.time < 2130)].any()
    assert [s.phase for s in stays(known)] == [*NOMINAL[:4], "retreat", "safe"]
    assert drift_of_a_day(known) > 150
    assert [s.phase for s in stays(unseen)] == [*NOMINAL[:5], "retreat", "safe"]
    lost = [np.ptp(increments(r)[r.time > 2119]) for r in (known, unseen)]
    assert lost[0] < 0.3
    assert lost[1] > 10
    assert range_(unseen).min() > 19


@pytest.mark.long
def test_adras_j_aborts_when_the_attitude_jumps_and_misses_the_drogue_without_the_guard():
    guarded, blind = simulate("adras_j"), simulate("adras_j_blind")
    simulated = stays(guarded)
    assert [s.phase for s in simulated] == [*NOMINAL[:6], "retreat", "safe"]
    assert simulated[-2].reason == "axis or pointing error"
    assert 13 < range_(guarded)[simulated[-2].row] < 15
    assert range_(guarded).min() > 13
    assert drift_of_a_day(guarded) > 150
    touching = blind["mechanism.phase"] == 1
    assert touching.any()
    assert blind["mechanism.misalignment"][touching].min() > np.radians(10)  # 5 deg latches
    assert not (blind["mechanism.phase"] >= 2).any()


@pytest.mark.long
def test_orbital_express_retreats_at_its_reset_and_comes_back_to_the_outer_hold():
    guarded, blind = simulate("orbital_express"), simulate("orbital_express_blind")
    simulated = stays(guarded)
    assert [s.phase for s in simulated] == [*NOMINAL[:6], "retreat", "safe", "far", "hold 1"]
    assert simulated[6].reason == "navigation"
    assert 9 < range_(guarded)[simulated[6].row] < 10
    assert range_(guarded)[simulated[6].row :].min() > 8
    assert 95 < range_(guarded)[-1] < 110
    assert (guarded["monitor.least_margin"][-1, :3] > 0).all()
    unseen = (blind.time > 2800) & (blind.time < 3600)
    assert (blind["manager.phase"][unseen] == 5).all()
    assert not blind["monitor.violated"][unseen][:, :3].any()  # the estimate is at 3 m
    assert np.ptp(range_(blind)[unseen]) > 0.8
    assert outcome(blind) == "aborted"  # when the sensors are back
    assert blind.time[blind["monitor.abort"] == 1][0] > 3605


@pytest.mark.long
def test_a_second_approach_after_reset_and_retreat_captures():
    """The wheels turn the thrust axis of the far approach and are prepared again."""
    again = simulate("orbital_express_again")
    first = [*NOMINAL[:6], "retreat", "safe"]
    assert [s.phase for s in stays(again)] == [*first, *NOMINAL]
    assert outcome(again) == "captured"
    assert margin(again, "abs(servicer.wheel_speed) <= 0.29 rad/s") > 0


@pytest.mark.long
@pytest.mark.parametrize("rate", [0.5, 2.0, 3.0])
def test_slow_and_fast_targets_are_captured_without_a_full_wheel(rate):
    result = run(SYSTEM, set={"target.omega_TN_T_0": [0.002 * rate, 0.01 * rate, 0]}, every=50)
    assert outcome(result) == "captured"
    assert margin(result, "abs(servicer.wheel_speed) <= 0.29 rad/s") > 0
    mating = result["manager.phase"] == 7
    assert np.abs(result["servicer.wheel_speed"][mating][0]).max() <= 0.24 * 1.01
    turning = (result["manager.phase"] == 4) & (result["manager.spin"] == 1)
    assert turning.sum() * 50 * 0.01 < 2 * np.pi / 0.0102


@pytest.mark.long
def test_a_target_that_turns_too_fast_is_left_for_a_reason_known_at_the_second_hold():
    """3.5 times: 2 N do not turn 100 kg at 14 m with 0.0357 rad/s and a fifth to spare."""
    result = run(SYSTEM, set={"target.omega_TN_T_0": [0.007, 0.035, 0]}, every=50)
    simulated = stays(result)
    assert [s.phase for s in simulated] == [*NOMINAL[:4], "retreat", "safe"]
    assert simulated[-2].reason == "too little force"
    assert range_(result).min() > 19
    assert drift_of_a_day(result) > 150
