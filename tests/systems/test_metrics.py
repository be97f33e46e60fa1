# SPDX-License-Identifier: BSD-2-Clause
"""Metrics of a run against values known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from harness.claims.report import safety
from harness.mission import Limits
from harness.mission.library import everything
from harness.mission.mission import measured
from harness.results.expressions import settling_time, steady_error
from harness.results.result import Result
from ssp.shared.metrics import bands, definitions
from ssp.shared.relative_motion import (
    attitude_error,
    position_error,
    range_,
    range_error,
    rotation_angle,
)
from tests.missions import METRICS

METRIC = {metric.name: metric for metric in METRICS}
TIME = np.linspace(0.0, 100.0, 1001)
LIMITS = Limits(position=0.06)


def table(time, **variables):
    """A result of vectors; `servicer__r_SN_N` represents servicer.r_SN_N."""
    names, columns = [], []
    for name, values in variables.items():
        block = np.atleast_2d(np.asarray(values, dtype=float).T)
        names += (
            [f"{name.replace('__', '.')}[{i}]" for i in range(1, len(block) + 1)]
            if len(block) > 1
            else [name.replace("__", ".")]
        )
        columns += list(block)
    return Result(
        "test", np.asarray(time), tuple(names), ("",) * len(names), np.stack(columns, axis=1)
    )


def parameters(**values):
    names, row = [], []
    for name, value in values.items():
        for index, number in np.ndenumerate(np.asarray(value, dtype=float)):
            suffix = f"[{','.join(str(i + 1) for i in index)}]" if index else ""
            names.append(name.replace("__", ".") + suffix)
            row.append(number)
    return Result("test", np.zeros(1), tuple(names), ("",) * len(names), np.array([row]))


def decaying():
    """The reference moves at 0.5 m/s along x and is in the next row; 3 m off along y at first,
    decaying in 10 s.
    """
    error = 3 * np.exp(-TIME / 10)
    actual = np.stack([10 + 0.5 * TIME, error, 0 * TIME], axis=1)
    reference = np.stack([10 + 0.5 * TIME, 0 * TIME, 0 * TIME], axis=1)
    published = np.concatenate((reference[:1], reference[:-1]))
    return table(
        TIME,
        servicer__r_SN_N=actual + 7e6,
        target__r_TN_N=0 * actual + 7e6,
        guidance__rho_ref_N=published,
    ), error


# ---- errors


def test_the_reference_of_a_state_is_in_the_next_row():
    result, error = decaying()
    assert position_error(result)[:-1] == pytest.approx(error[:-1], abs=1e-8)
    assert position_error(result)[-1] == position_error(result)[-2]


def test_with_rows_further_apart_than_samples_the_reference_of_the_same_row_is_taken():
    result, error = decaying()
    seldom = replace(result, time=result.time[::10], values=result.values[::10])
    moved = np.hypot(error[::10], 0.5 * 0.1)
    moved[0] = error[0]
    assert position_error(seldom) == pytest.approx(moved, abs=1e-8)


def test_range_error_is_the_difference_of_two_distances():
    result, error = decaying()
    reference = 10 + 0.5 * TIME
    assert range_error(result)[:-1] == pytest.approx(
        (np.hypot(reference, error) - reference)[:-1], abs=1e-8
    )
    assert range_(result) == pytest.approx(np.hypot(reference, error), abs=1e-8)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.3, 3.0, np.pi])
@pytest.mark.parametrize("sign", [1, -1])
def test_rotation_angle_is_exact_for_small_and_large_angles_and_either_sign(angle, sign):
    axis = np.array([1, 2, -2]) / 3
    a = np.array([[0.5, -0.5, 0.5, 0.5]])
    s, v = np.cos(angle / 2), np.sin(angle / 2) * axis
    b = np.concatenate(
        ([a[0, 0] * s - a[0, 1:] @ v], a[0, 0] * v + s * a[0, 1:] + np.cross(a[0, 1:], v))
    )[None]
    assert rotation_angle(a, sign * b)[0] == pytest.approx(angle, rel=1e-6, abs=1e-15)


def test_attitude_error_uses_the_next_row_too():
    turn = 0.01 * TIME
    actual = np.stack([np.cos(turn / 2), np.sin(turn / 2), 0 * turn, 0 * turn], axis=1)
    published = np.concatenate((actual[:1], actual[:-1]))
    assert attitude_error(
        table(TIME, servicer__q_SN=actual, guidance__q_DN=published)
    ) == pytest.approx(0, abs=1e-12)


# ---- settling and steady errors


def test_an_exponential_settles_after_a_logarithm_of_time_constants():
    error = 3 * np.exp(-TIME / 10)
    assert settling_time(TIME, error, 0.06) == pytest.approx(10 * np.log(50), abs=0.1)


def test_an_error_that_swings_back_has_not_settled_before():
    error = np.where((TIME > 60) & (TIME < 61), 0.1, np.exp(-TIME))
    assert settling_time(TIME, error, 0.02) == pytest.approx(61.0, abs=0.11)


def test_an_error_that_ends_outside_the_band_never_settles():
    assert np.isnan(settling_time(TIME, 1 + TIME, 100.0))


def test_an_error_that_is_zero_settles_at_once():
    assert settling_time(TIME, 0 * TIME, 0.0) == 0


def test_one_band_is_common_to_all_runs_of_a_comparison():
    """A run is not punished for small errors: 1e-3 of the largest range at the start of any."""
    near, _ = decaying()
    values = near.values.copy()
    values[:, near.vectors["servicer.r_SN_N"][0]] += 990
    far = replace(near, values=values)
    limits = bands(Limits(), {"near": near, "far": far})
    assert limits.position == pytest.approx(1e-3 * np.hypot(1000, 3))
    assert bands(Limits(position=0.2), {"far": far}).position == 0.2
    assert METRIC["position settles"](near, limits) == pytest.approx(10 * np.log(3), abs=0.1)


def test_the_definition_of_the_columns_names_the_bands():
    limits = Limits(position=0.02, attitude=0.5)
    about = {m.name: m.about(limits, {}) for m in METRICS if m.about}
    assert about["range settles"] == about["position settles"] == "within 0.02 m"
    assert about["attitude settles"] == "0.5 deg once free to turn"
    assert "settles: time after which the error stays" in " ".join(definitions(limits))


def test_the_steady_error_is_the_largest_of_the_last_fifth():
    assert steady_error(TIME, np.abs(TIME - 90)) == pytest.approx(10)
    assert steady_error(TIME, np.where(TIME < 79.9, 5.0, 0.1)) == pytest.approx(0.1)


def test_settling_and_steady_errors_of_a_result():
    result, _ = decaying()
    assert METRIC["position settles"](result, LIMITS) == pytest.approx(10 * np.log(50), abs=0.1)
    assert METRIC["position error"](result, LIMITS) == pytest.approx(3 * np.exp(-8), rel=1e-3)
    assert METRIC["minimum range"](result, LIMITS) == pytest.approx(
        np.hypot(10 + 0.5 * TIME, 3 * np.exp(-TIME / 10)).min()
    )


def test_the_attitude_counts_from_the_beginning_of_its_control():
    angle = np.where(TIME < 40, 2.0, np.exp(-(TIME - 40) / 5))
    q = np.stack([np.cos(angle / 2), np.sin(angle / 2), 0 * angle, 0 * angle], axis=1)
    still = table(TIME, servicer__q_SN=q, guidance__q_DN=np.tile([1.0, 0, 0, 0], (len(TIME), 1)))
    late = replace(still, parameters=parameters(servicer__t_att=40.0))
    assert METRIC["attitude settles"](late, LIMITS) == pytest.approx(
        5 * np.log(np.degrees(1)), abs=0.2
    )
    assert METRIC["attitude error"](late, LIMITS) == pytest.approx(
        np.degrees(np.exp(-48 / 5)), rel=0.05
    )
    never = replace(still, parameters=parameters(servicer__t_att=200.0))
    assert np.isnan(METRIC["attitude settles"](never, LIMITS))


# ---- safety


def test_how_far_a_run_comes_inside_its_reference():
    result, error = decaying()
    values = result.values.copy()
    values[500, result.vectors["servicer.r_SN_N"][0]] -= 30  # at 35 m: now at 5 m
    below = replace(result, values=values)
    assert METRIC["inside reference"](below, LIMITS) == pytest.approx(35 - np.hypot(5, error[500]))
    assert METRIC["inside reference"](result, LIMITS) < 1e-8


# ---- cost


def test_delta_v_divides_the_impulse_of_all_axes_by_the_mass_of_the_moment():
    impulse = np.outer(TIME, [1.0, 2.0, 3.0])
    result = table(TIME, propulsion__impulse=impulse, servicer__mass=200 - TIME)
    assert METRIC["delta-v"](result, LIMITS) == pytest.approx(6 * np.log(2), rel=1e-3)


def test_torque_impulse_adds_thrusters_and_wheels():
    M = np.tile([0.1, -0.2, 0.0], (len(TIME), 1))
    speed = np.stack([np.sin(TIME), 0 * TIME, 0 * TIME], axis=1)
    result = replace(
        table(TIME, propulsion__M_S=M, servicer__wheel_speed=speed),
        parameters=parameters(servicer__A_w=np.diag([2.0, 1, 1])),
    )
    turns = np.abs(np.diff(np.sin(TIME))).sum()
    assert METRIC["torque impulse"](result, LIMITS) == pytest.approx(
        0.3 * 100 + 2 * turns, rel=1e-9
    )


def test_torque_impulse_is_taken_from_the_propulsion_if_that_counts_it():
    """Then rows may be far apart: here the torque is zero at all of them."""
    counted = np.stack([3 * TIME, 0 * TIME, TIME], axis=1)
    still = np.zeros((len(TIME), 3))
    result = replace(
        table(
            TIME,
            propulsion__M_S=still,
            propulsion__torque_impulse=counted,
            servicer__wheel_speed=still,
        ),
        parameters=parameters(servicer__A_w=np.eye(3)),
    )
    assert METRIC["torque impulse"](result, LIMITS) == pytest.approx(400)


def turning(release):
    """Torque of 3 N m about x all the time, wheels that take 2 N m about y away."""
    M = np.tile([3.0, 0, 0], (len(TIME), 1))
    speed = np.stack([0 * TIME, -2 * TIME, 0 * TIME], axis=1)
    counted = np.stack([3 * TIME, 0 * TIME, 0 * TIME], axis=1)
    return replace(
        table(
            TIME,
            propulsion__M_S=M,
            propulsion__torque_impulse=counted,
            servicer__wheel_speed=speed,
        ),
        parameters=parameters(servicer__A_w=np.eye(3), servicer__t_att=release),
    )


def test_torque_before_the_attitude_is_released_does_not_count():
    assert METRIC["torque impulse"](turning(0.0), LIMITS) == pytest.approx(500)
    assert METRIC["torque impulse"](turning(75.0), LIMITS) == pytest.approx(125)
    assert METRIC["torque impulse"](turning(200.0), LIMITS) == 0
    assert np.isnan(METRIC["peak torque"](turning(200.0), LIMITS))


def test_peak_torque_matches_thrusters_and_wheels_together():
    assert METRIC["peak torque"](turning(0.0), LIMITS) == pytest.approx(np.hypot(3, 2))


def test_peak_force_is_the_largest_size():
    F = np.stack([np.sin(TIME / 10), 0 * TIME, 2 + 0 * TIME], axis=1)
    result = table(TIME, propulsion__F_S=F)
    assert METRIC["peak force"](result, LIMITS) == pytest.approx(np.sqrt(5), rel=1e-4)


def test_saturated_is_the_share_of_rows_with_any_limit_reached():
    flag = (TIME < 25).astype(float)
    result = table(
        TIME,
        propulsion__F_saturated=np.stack([flag, 0 * flag, flag], axis=1),
        allocation__infeasible=(TIME > 90).astype(float),
    )
    assert METRIC["saturated"](result, LIMITS) == pytest.approx(35, abs=0.2)


def test_metrics_of_missing_variables_are_nan():
    result, _ = decaying()
    values = {name: metric(result, LIMITS) for name, metric in METRIC.items()}
    assert np.isnan(
        [values[name] for name in ("delta-v", "torque impulse", "attitude error")]
    ).all()


# ---- estimates


def test_nees_is_the_sum_of_squares_over_variances_of_the_last_fifth():
    """Truth at rest at the origin, estimates off by 2, 1, 3 and 1 standard deviations per axis in
    position, velocity, attitude and rate, ten times as much before.
    """
    one, zero = np.ones((len(TIME), 3)), np.zeros((len(TIME), 3))
    factor = np.where(TIME < 80.0, 10.0, 1.0)[:, None]
    q_0 = np.tile([1.0, 0.0, 0.0, 0.0], (len(TIME), 1))
    half = factor * 3e-4 * one / 2
    q = np.column_stack([np.sqrt(1 - np.sum(half**2, axis=1)), half])
    run = table(
        TIME,
        servicer__r_SN_N=zero,
        servicer__v_SN_N=zero,
        servicer__q_SN=q_0,
        target__r_TN_N=zero,
        target__v_TN_N=zero,
        target__q_TN=q_0,
        target__omega_TN_T=zero,
        relative_filter__r_SN_N=factor * 0.2 * one,
        relative_filter__v_SN_N=factor * 0.01 * one,
        relative_filter__q_SN=q_0,
        relative_filter__r_TN_N=zero,
        relative_filter__v_TN_N=zero,
        relative_filter__q_TN=q,
        relative_filter__omega_TN_T=factor * 0.5 * one,
        relative_filter__sigma_rho_N=0.1 * one,
        relative_filter__sigma_drho_N=0.01 * one,
        relative_filter__sigma_theta_T=1e-4 * one,
        relative_filter__sigma_omega_T=0.5 * one,
    )
    assert METRIC["estimate NEES"](run, LIMITS) == pytest.approx(3 * (4 + 1 + 9 + 1), rel=1e-3)


# ---- safety monitor


def watched(least, first):
    """The last row of a monitor with these least margins and first violations."""
    names = [f"monitor.{name}[{k}]" for name in ("least_margin", "t_first") for k in range(1, 7)]
    columns = (*names, "monitor.rule_violated", "monitor.t_violation")
    row = [*least, *first, 2.0, 8.15]
    return Result("x", np.zeros(1), columns, ("",) * len(columns), np.array([row]))


def test_margins_of_the_monitor_are_columns_and_rules_at_rest_are_none():
    result = watched((-9.5, -5.8, 2.0, 1e9, 1e9, 20), (18.8, 8.15, -1, -1, -1, -1))
    found = {key: column["a"] for key, column in measured(METRICS, {"a": result}, Limits()).items()}
    assert found["keep-out margin", "m"] == -9.5
    assert found["corridor margin", "m"] == -5.8
    assert found["speed margin", "m/s"] == 2.0
    assert found["navigation margin", "s"] == 20
    assert np.isnan([found[f"{rule} margin", "m"] for rule in ("passive", "plume")]).all()
    assert found["first violated", "1"] == 2
    assert found["first violation", "s"] == 8.15


def test_a_run_without_violation_has_no_time_of_one():
    quiet = watched((1,) * 6, (-1,) * 6)
    assert np.isnan(measured(METRICS, {"a": quiet}, Limits())["first violation", "s"]["a"])


def test_the_report_ends_with_what_the_monitor_has_found():
    result = watched((-9.5, -5.8, 2.0, 1e9, 1e9, 20), (18.8, 8.15, -1, -1, -1, -1))
    lines = safety(everything(), result).splitlines()
    assert [line.split()[0] for line in lines[3:]] == [
        "keep-out",
        "corridor",
        "speed",
        "navigation",
    ]
    assert "-9.5 m" in lines[3]
    assert lines[3].endswith("violated, first at 18.80 s")
    assert lines[5].endswith("holds")
    assert not safety(everything(), watched((1e9,) * 6, (-1,) * 6))
