# SPDX-License-Identifier: BSD-2-Clause
"""The system transposition: what its parameter sets do, and how exactly the law conserves the
predicted momentum.
"""

from __future__ import annotations

import numpy as np
import pytest

from harness import run

H_SAT = 1500.0


def sampled_every(T):
    software = ("guidance", "controller", "steering")
    return {f"{name}.sample_period": T for name in software} | {"assembly.max_step": T}


def momentum_error(result):
    """Largest difference between momentum and prediction, as a part of saturation."""
    return np.linalg.norm(result["controller.dh_S"], axis=1).max() / H_SAT


def error_deg(result):
    return np.degrees(result["controller.attitude_error"].max())


def test_planned_swing_stays_below_saturation_and_tracks():
    result = run("transposition")
    assert result["assembly.h_cmg"].max() < 0.9 * H_SAT
    assert np.degrees(result["assembly.rotation"].max()) < 35
    assert error_deg(result) < 1e-4
    assert result["assembly.arm_angle"][-1] == pytest.approx(np.pi / 2)
    assert np.degrees(result["assembly.rotation"][-1]) < 1e-3
    assert not result["assembly.saturated"].any()


def test_momentum_is_the_predicted_one_up_to_the_hold_of_the_command():
    """The attitude follows the mean of a held rate of momentum, so that h differs from the smooth
    plan by T^2/12 d2h/dt2 at the samples: a quarter for half the sample period, below 1e-6 of
    saturation at 0.25 s.
    """
    errors = [
        momentum_error(run("transposition", step=T, set=sampled_every(T))) for T in (1, 0.5, 0.25)
    ]
    assert errors[0] < 1e-5
    assert errors[2] < 1e-6
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.05)


def test_feed_forward_at_the_sample_instant_is_late_by_half_a_sample():
    late = run("transposition", set={"controller.use_plan_rate": 0})
    assert momentum_error(late) > 1e-3
    assert error_deg(late) < 0.01


@pytest.mark.parametrize("inertia", [0.97, 1.03])
@pytest.mark.parametrize("density", [0.5, 1.5])
def test_wrong_inertia_and_density_cost_less_than_a_tenth_of_a_degree(inertia, density):
    J0, J1 = (
        (inertia * run("transposition", stop=1.0).parameter(f"assembly.{name}")).tolist()
        for name in ("J0", "J1")
    )
    real = {
        "assembly.J0": J0,
        "assembly.J1": J1,
        "assembly.m0": 24000 * inertia,
        "assembly.m1": 20000 * inertia,
        "assembly.rho": 3e-12 * density,
    }
    result = run("transposition", set=real)
    assert 1e-3 < error_deg(result) < 0.1
    assert result["assembly.h_cmg"].max() < 0.9 * H_SAT


def test_cluster_runs_the_plan_far_from_singularities():
    result = run("transposition", params="cluster")
    assert error_deg(result) < 0.05
    assert result["assembly.singularity"].min() > 1
    assert not result["assembly.saturated"].any()


@pytest.mark.filterwarnings("ignore")
def test_run_attitude_saturates_well_before_the_end_and_is_lost():
    result = run("transposition", params="earth_pointing")
    first = result.time[result["assembly.saturated"] > 0][0]
    assert first < 2000
    assert np.degrees(result["assembly.rotation"].max()) > 90
    assert result["assembly.h_cmg"].max() <= H_SAT * (1 + 1e-12)


def test_law_as_printed_is_four_orders_worse():
    printed, corrected = run("transposition", params="printed_law"), run("transposition")
    assert error_deg(printed) > 1e4 * error_deg(corrected)
    assert error_deg(printed) > 1
