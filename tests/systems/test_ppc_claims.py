# SPDX-License-Identifier: BSD-2-Clause
"""Claims of Yin, Luo, Wei & Yuan, J. Astronautics 38(8), 2017, one by one: quotation, our value,
band, verdict.

The paper prints neither the initial states nor the gains of any controller. The values of
ssp/ppc_tracking/system.toml are used, so a reproduced value shows that the claim can be met, not
that these were the authors' numbers. One claim is about computing time and so none for a test:
"theta-D takes much time and cannot be used on line"; `harness compare` shows it to cost some
microseconds per sample more than the others.
"""

from __future__ import annotations

import numpy as np
import pytest

from harness import run

from .ppc_recordings import (
    BAND,
    after,
    attitude_error,
    effort,
    los,
    range_error,
    recording,
    settled,
    start,
)

PPC, PID, THETA_D = "ppc_controller", "pid_controller", "theta_d_controller"
ALL = (PPC, THETA_D, PID)


def convergence(controller, params="nominal"):
    result = recording(controller, params)
    return settled(result, range_error(result), BAND)


def angle_error(result):
    return np.max(np.abs(los(result, "controller.error")[:, 1:]), axis=1)


# ---- 4.2: the target spins and does not manoeuvre ----


@pytest.mark.parametrize(("controller", "claimed"), [(PPC, 18.0), (THETA_D, 23.0), (PID, 40.0)])
def test_convergence_times(controller, claimed):
    """ "about 18 s", "23 s", "40 s". Ours to 2 % of the initial error: 18.1, 22.8, 42.2 s.
    Reproduced (10 %).
    """
    assert abs(convergence(controller) / claimed - 1) < 0.1


def test_ppc_is_the_fastest_and_pid_the_slowest():
    """ "LCPPC approaches fastest". Reproduced."""
    assert convergence(PPC) < convergence(THETA_D) < convergence(PID)


def test_the_servicer_hovers_twenty_metres_above_the_feature():
    """Figure 2. Ours after 60 s: range within 5 mm, 0.1 deg off the axis of the feature.
    Reproduced.
    """
    result = recording(PPC)
    assert after(result, 60, range_error(result)) < 0.01
    assert after(result, 60, result["guidance.beta_t"]) < np.radians(0.1)


def test_line_of_sight_angles_of_ppc_settle_first_and_of_pid_oscillate():
    """Figure 4: "LCPPC fast, theta-D smooth but slightly slower, PID great oscillation". To 0.5 deg
    13.8, 24.2, 26.0 s, overshoot of the elevation 1.3, 0.4, 17 deg. Reproduced."""
    times = {c: settled(recording(c), angle_error(recording(c)), np.radians(0.5)) for c in ALL}
    overshoot = {c: np.degrees(recording(c)["controller.error.elevation"].max()) for c in ALL}
    assert times[PPC] < times[THETA_D] < times[PID]
    assert max(overshoot[PPC], overshoot[THETA_D]) < 2
    assert overshoot[PID] > 10


def test_pid_undershoots_the_range_and_comes_near_the_target():
    """Conclusion: PID "cannot guarantee the safety". Ours: PID passes the target at 7.4 m, the
    others stay at 20 m. Reproduced."""
    assert recording(PID)["guidance.range"].min() < 10
    assert min(recording(c)["guidance.range"].min() for c in (PPC, THETA_D)) > 19.99


def test_ppc_spends_less_than_pid_and_theta_d_least():
    """Figure 5. Integral of the LOS acceleration: 100, 74, 134 m/s. Reproduced."""
    assert effort(recording(THETA_D)) < effort(recording(PPC)) < effort(recording(PID))


def test_attitudes_are_accurate_in_the_steady_state_and_ppc_acquires_first():
    """Figure 6: all three accurate; theta-D and PID slower. After 60 s 0.006, 0.0001, 0.41 deg; to
    1 deg in 8.7, 13.3, 45 s. Reproduced, PID with the reservation of its slow integral."""
    late = {c: np.degrees(after(recording(c), 60, attitude_error(recording(c)))) for c in ALL}
    times = {c: settled(recording(c), attitude_error(recording(c)), np.radians(1)) for c in ALL}
    assert max(late[PPC], late[THETA_D]) < 0.05
    assert late[PID] < 0.5
    assert times[PPC] < times[THETA_D] < times[PID]


# ---- 4.3: unknown manoeuvre, mass and inertia mismatch, disturbances ----


def test_ppc_converges_under_manoeuvre():
    """ "25 s". Ours 18.2 s: as fast as without manoeuvre. Reproduced, better than claimed."""
    assert convergence(PPC, "manoeuvre") < 25


def test_ppc_retains_half_a_metre_under_manoeuvre():
    """ "within +-0.5 m". Ours 0.30 m after 40 s, 0.18 m after 60 s. Reproduced."""
    result = recording(PPC, "manoeuvre")
    assert after(result, 40, range_error(result)) < 0.5


def test_theta_d_retains_three_metres_under_manoeuvre():
    """ "only within +-3 m". Ours 2.6 m of range after 40 s. Reproduced; across the line of sight it
    is 5 m.
    """
    result = recording(THETA_D, "manoeuvre")
    assert 0.5 < after(result, 40, range_error(result)) < 3
    across = 20 * los(result, "controller.error")[:, 1:]
    assert after(result, 60, across) > 3


def test_pid_is_slow_and_oscillates_under_manoeuvre():
    """ "still slow, with larger oscillation". Ours 39.6 s, range down to 11 m, elevation overshoot
    25 deg. Reproduced."""
    result = recording(PID, "manoeuvre")
    assert convergence(PID, "manoeuvre") > 2 * convergence(PPC, "manoeuvre")
    assert result["guidance.range"].min() < 15
    assert np.degrees(result["controller.error.elevation"].max()) > 20


def test_steady_accuracy_of_pid_suffers_from_the_manoeuvre():
    """ "steady accuracy is not affected by manoeuvre, uncertainty, disturbance". Ours: 4 mm in the
    last 20 s without, 0.69 m with the manoeuvre: an integral takes out its mean, not its sinusoids.
    Not reproduced."""
    nominal, manoeuvre = (recording(PID, params) for params in ("nominal", "manoeuvre"))
    assert after(nominal, 100, range_error(nominal)) < 0.01
    assert after(manoeuvre, 100, range_error(manoeuvre)) > 0.5


def test_theta_d_does_not_chatter_under_manoeuvre():
    """ "severe oscillation of the control acceleration, wasting fuel". Ours: total variation after
    60 s 3.2 m/s2 against 2.9 (ppc) and 3.1 (PID); all three just follow the manoeuvre. Not
    reproduced."""

    def variation(controller):
        result = recording(controller, "manoeuvre")
        return np.sum(np.abs(np.diff(result["controller.a_cmd_L"][result.time > 60], axis=0)))

    assert variation(THETA_D) < 1.2 * variation(PPC)


def test_ppc_still_spends_less_than_pid_under_manoeuvre():
    """Figure 8: "force of LCPPC remains low". 184 against 220 m/s (theta-D: 150). Reproduced
    against PID only.
    """
    assert (
        effort(recording(THETA_D, "manoeuvre"))
        < effort(recording(PPC, "manoeuvre"))
        < effort(recording(PID, "manoeuvre"))
    )


# ---- what the method guarantees ----

MANOEUVRE = {
    "target.a_manoeuvre_N.bias": [0.25, 0.15, -0.20],
    "target.a_manoeuvre_N.amplitude": [0.10, 0.08, 0.10],
    "target.a_manoeuvre_N.frequency": [0.2, 0.15, 0.25],
    "target.a_manoeuvre_N.phase": [0, np.pi / 2, 0],
    "servicer.mass_0": 130,
}


def late_error(params, **settings):
    changes = {f"controller.{name}": value for name, value in settings.items()}
    result = run("ppc_tracking", params=params, set=MANOEUVRE | changes, stop=90.0)
    return after(result, 60, range_error(result)), result["controller.violation"].max()


def test_accuracy_is_adjustable_by_the_performance_function_with_the_law_as_printed():
    """ "higher accuracy by adjusting the performance function". Law 0: its gain grows as
    alpha_inf^-2, so a quarter of alpha_inf divides the error by more than ten. Reproduced."""
    (coarse, _), (fine, flag) = (
        late_error("literal_law", **{"range.alpha_inf": a}) for a in (8.0, 2.0)
    )
    assert fine < coarse / 10
    assert flag == 0


def test_with_the_normalised_law_accuracy_is_adjusted_by_the_gain():
    """Law 2: its gain does not depend on alpha, an error far inside the funnel does not see the
    bound; k does it. What the default law gives up for working at low software rates."""
    wide, narrow = (late_error("manoeuvre", **{"range.alpha_inf": a})[0] for a in (2.0, 0.5))
    stiff, _ = late_error("manoeuvre", **{"range.k": 30.0})
    assert narrow > 0.7 * wide
    assert stiff < 0.7 * narrow


def test_the_guarantee_holds_while_the_actuator_saturates_gently():
    """ "theta remains in (L, U) for ever". In both scenarios, saturated for 11 to 13 s, kappa stays
    below 0.13; with the literal law the barrier acts at 0.90. Reproduced."""
    for params, kappa in (("nominal", 0.15), ("manoeuvre", 0.15), ("literal_law", 0.95)):
        result = recording(PPC, params)
        assert np.any(result["controller.a_saturated"])
        assert result["controller.kappa"].max() < kappa
        assert not np.any(result["controller.violation"] + result["controller.violation_att"])


def test_a_large_initial_speed_breaks_the_guarantee_under_the_acceleration_limit_of_the_paper():
    """ "x2 in z keeps the system stable even if the initial speed is very large". At 45 m/s, with
    kappa(0) = 0.2 and 4.9 m/s2, the funnel is left for seconds and the servicer passes within a
    metre of the target, flagged: the proof does not consider saturation. Not reproduced under the
    limit of section 4.1; without a limit it holds."""
    fast = start((300, np.radians(2), np.radians(32)), (-45.0, 0, 0))
    limited = run("ppc_tracking", set=fast)
    assert limited["controller.start_margin"][1] > 0.7
    assert np.sum(limited["controller.violation"]) * 0.05 > 1
    assert limited["guidance.range"].min() < 1
    free = run("ppc_tracking", set=fast | {"controller.a_max": 0})
    assert not np.any(free["controller.violation"])
    assert free["guidance.range"].min() > 19


def test_the_error_itself_may_leave_the_funnel_that_holds_its_generalised_state():
    """Equation (44) drops the initial value: "x1 converges into the region as z does". Closing at
    45 m/s from 300 m with alpha_0 = 150 m, z starts at 86 m, x1 at 280 m. Not as printed; the bound
    of docs/models.md C.4 with x1(0) holds."""
    fast = start((300, np.radians(2), np.radians(32)), (-45.0, 0, 0))
    result = run(
        "ppc_tracking",
        set=fast | {"controller.a_max": 0, "controller.range.alpha_0": 150},
        stop=10.0,
    )
    assert result["controller.violation"].max() == 0
    assert result["controller.error.range"][1] > result["controller.alpha.range"][1]
