# SPDX-License-Identifier: BSD-2-Clause
"""An approach on an estimate that is wrong and looks well, with the independent range and without.

The navigated approach on thrusters, its force through the monitor, all rules on the estimate.
"""

from __future__ import annotations

import numpy as np
import pytest

from harness import run

RADIUS = 2.0
SYSTEM = """\
extends = "sync_approach_thrusters_navigated"
name = "ranged"

[components]
range_sensor = "range_sensor"

[connections]
"range_sensor.r_TN_N" = "target.r_TN_N"
"range_sensor.r_SN_N" = "servicer.r_SN_N"
"allocation.F_cmd_S" = "monitor.F_safe_S"

[parameters.monitor]
keep_out_half = [2, 2, 2]
t_armed = 60                            # the filters have settled
lost_time = 5
range_at_zero = 0.5
range_patience = 3
act = 1
abort_on = [1, 0, 0, 1, 0, 1, 0]
mass = 95
abort_force = 1
abort_speed = 0.3                       # more than the leak gives back until the end
"""
WRONG_POINT = ("pose_sensor.p_GT_T=[-2.4,0,0]",)
"""The camera tracks a point 3 m nearer to the back than the filter assumes."""
LEAK = (
    "pose_sensor.outage_start=300",
    "pose_sensor.outage_duration=1e6",
    "relative_filter.age_max=1e6",
    "servicer.a_dist.start=300",
    "servicer.a_dist.bias=[0,4e-4,-4e-4]",
)
"""Poses end; the filter goes on by dead reckoning and knows nothing of a valve that leaks."""


@pytest.fixture(scope="module")
def ranged(tmp_path_factory):
    path = tmp_path_factory.mktemp("ranged") / "ranged.toml"
    path.write_text(SYSTEM)
    return path


def simulate(path, changes, use_range):
    return run(path, set=[*changes, f"monitor.use_range={use_range}"], stop=700.0, every=10)


def distance(result, who_S, who_T):
    rho = result[f"{who_S}.r_SN_N"] - result[f"{who_T}.r_TN_N"]
    return np.linalg.norm(rho, axis=1)


@pytest.mark.parametrize("changes", [WRONG_POINT, LEAK], ids=["wrong_point", "leak"])
def test_a_wrong_estimate_enters_the_zone_without_the_range_and_aborts_with_it(ranged, changes):
    blind, watched = (simulate(ranged, changes, use_range) for use_range in (0, 1))
    assert distance(blind, "servicer", "target").min() < RADIUS
    assert distance(blind, "relative_filter", "relative_filter").min() > 3.8
    assert not blind["monitor.abort"].any()
    assert not blind["monitor.violated"].any(axis=0)[[0, 3, 5]].any()

    assert distance(watched, "servicer", "target").min() > RADIUS
    assert watched["monitor.abort"][-1] == 1
    assert watched["monitor.rule_violated"][-1] == 6
    assert watched["monitor.violated"][-1].tolist() == [0, 0, 0, 0, 0, 1, 0]


def test_a_right_estimate_runs_the_same_bits_with_the_range(ranged):
    plain, watched = (simulate(ranged, (), use_range) for use_range in (0, 1))
    for column in plain.columns:
        assert plain[column].tobytes() == watched[column].tobytes(), column
    assert watched["range_sensor.range_valid"].any()
