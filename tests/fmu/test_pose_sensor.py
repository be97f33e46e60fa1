# SPDX-License-Identifier: BSD-2-Clause
"""pose_sensor.fmu: lever arms in their own axes, noise by range, status, latency to the step."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.close import close
from tests.reference.attitude import conjugate, dcm, multiply
from tests.reference.cases import quaternion
from tests.reference.kalman import rot
from tests.reference.random_numbers import normals, uniforms

from .driver import bits
from .rejections import rejection
from .sensor_cases import same_bits_for_any_steps, turn_between

P = 0.5
PROMPT = {"latency": 0}
AHEAD = {"r_TN_N": [20, 0, 0]}


def scene(rng, R=20.0, off=0.1):
    """Camera, servicer and target anywhere, the tracked point at range R and `off` rad from the
    boresight; everything computed from the line of sight outward.
    """
    q_SN, q_TN, q_KS = (quaternion(rng) for _ in range(3))
    p_KS_S, p_GT_T, r_SN_N = rng.normal(size=3), rng.normal(size=3), 7e6 * rng.normal(size=3)
    C_KN = dcm(multiply(q_SN, q_KS))
    r_K = R * np.array((np.cos(off), np.sin(off) * 0.6, -np.sin(off) * 0.8))
    camera = dcm(q_SN).T @ p_KS_S
    r_TN_N = r_SN_N + camera + C_KN.T @ r_K - dcm(q_TN).T @ p_GT_T
    parameters = {"p_KS_S": p_KS_S, "q_KS": q_KS, "p_GT_T": p_GT_T}
    inputs = {"r_TN_N": r_TN_N, "q_TN": q_TN, "r_SN_N": r_SN_N, "q_SN": q_SN}
    return parameters, inputs, r_K, multiply(conjugate(multiply(q_SN, q_KS)), q_TN)


def rows(unit, inputs, count, h=P):
    found = []
    for _ in range(count):
        unit.step(h, inputs)
        found.append(unit.outputs())
    return found


def test_pose_matches_the_tracked_point_in_camera_axes(fmu, rng):
    """1e-8 m: rounding of positions of 1e7 m."""
    p, u, r_K, q_TK = scene(rng)
    silent = {f"sigma_{name}": 0 for name in ("range_0", "range_2", "bearing_0", "bearing_1")}
    silent |= {"sigma_theta_0": 0, "sigma_theta_1": 0}
    row = rows(fmu("pose_sensor", PROMPT | silent | p), u, 1)[0]
    assert row["r_GK_K"] == pytest.approx(r_K, abs=1e-8)
    assert turn_between(row["q_TK"], q_TK) < 1e-15
    assert (row["pose_valid"], row["pose_status"]) == (1, 0)


@pytest.mark.parametrize("R", [4.0, 20.0, 90.0])
def test_noise_grows_with_the_true_range(fmu, rng, R):
    """Along the boresight with the square, across and in attitude with the range; within 1e-8 m."""
    p, u, r_K, q_TK = scene(rng, R)
    for n, row in enumerate(rows(fmu("pose_sensor", PROMPT | p | {"seed": 9}), u, 3)):
        z = normals(9, 3, n, 6)
        across = 0.002 + 5e-4 * R
        sigma = np.array((0.01 + 1e-4 * R**2, across, across))
        assert row["r_GK_K"] == pytest.approx(r_K + sigma * z[:3], abs=1e-8)
        noisy = multiply(q_TK, rot((0.0087 + 4.4e-4 * R) * z[3:]))
        assert turn_between(row["q_TK"], noisy) < 1e-11


def test_outliers_and_flips_come_on_top_and_stay_valid(fmu, rng):
    """u_7 and u_14 decide, u_8..13 say how far; half a turn about flip_axis in target axes."""
    p, u, _r_K, _q_TK = scene(rng)
    axis = np.array((0.6, 0, 0.8))
    p |= {"p_outlier": 0.5, "p_flip": 0.5, "flip_axis": axis, "sigma_range_0": 0}
    clean = rows(fmu("pose_sensor", PROMPT | p | {"p_outlier": 0, "p_flip": 0}), u, 40)
    seen = set()
    for n, row in enumerate(rows(fmu("pose_sensor", PROMPT | p), u, 40)):
        draw = uniforms(0, 3, n, 15)
        outlier, flip = bool(draw[7] < 0.5), bool(draw[14] < 0.5)
        seen.add((outlier, flip))
        dr = 2 * (2 * draw[8:11] - 1) if outlier else 0
        q = clean[n]["q_TK"]
        q = multiply(q, rot(2 * draw[11:14] - 1)) if outlier else q
        q = multiply(q, (0, *axis)) if flip else q
        close(row["r_GK_K"], clean[n]["r_GK_K"] + dr, rel=1e-15)
        assert turn_between(row["q_TK"], q) < 1e-14
        assert row["pose_status"] == 32 * outlier + 64 * flip
        assert row["pose_valid"] == 1
    assert len(seen) == 4


def test_a_fault_misleads_from_its_start_for_its_duration_and_looks_well(fmu, rng):
    """Position drifts from the start on, attitude is turned about target axes; samples 3 to 6."""
    p, u, _r_K, _q_TK = scene(rng)
    drift, theta = np.array((0.6, -0.2, 0.1)), np.array((0.1, -0.3, 0.2))
    fault = {"fault_start": 1.5, "fault_duration": 2.0}
    fault |= {"fault_drift_K": drift, "fault_theta_T": theta}
    clean = rows(fmu("pose_sensor", PROMPT | p), u, 10)
    for n, row in enumerate(rows(fmu("pose_sensor", PROMPT | p | fault), u, 10)):
        wrong = 3 <= n < 7
        dr = wrong * (n * P - 1.5) * drift
        q = multiply(clean[n]["q_TK"], rot(wrong * theta))
        close(row["r_GK_K"], clean[n]["r_GK_K"] + dr, rel=1e-15)
        assert turn_between(row["q_TK"], q) < 1e-14
        assert (row["pose_valid"], row["pose_status"]) == (1, 0)


FOV = 0.5236


@pytest.mark.parametrize(
    ("R", "off", "parameters", "status"),
    [
        (20, FOV - 1e-6, {}, 0),
        (20, FOV + 1e-6, {}, 1),
        (0.5 - 1e-6, 0, {}, 2),
        (0.5 + 1e-6, 0, {}, 0),
        (100 + 1e-6, 0, {}, 2),
        (100 - 1e-6, 0, {}, 0),
        (150, 1.0, {}, 3),
        (20, 0, {"outage_duration": 1}, 8),
        (20, 0, {"p_drop": 1}, 16),
        (20, 0, {"p_drop": 1, "p_outlier": 1, "p_flip": 1, "outage_duration": 1}, 120),
    ],
)
def test_status_names_every_reason(fmu, rng, R, off, parameters, status):
    p, u, _, _ = scene(rng, R, off)
    row = rows(fmu("pose_sensor", PROMPT | p | parameters), u, 1)[0]
    assert row["pose_status"] == status
    assert row["pose_valid"] == (status % 32 == 0)
    if status % 32:
        assert row["pose_time"] == 0
        assert not row["r_GK_K"].any()
        assert row["q_TK"].tolist() == [1, 0, 0, 0]


@pytest.mark.parametrize(("offset", "status"), [(-1e-6, 4), (1e-6, 0)])
def test_sun_near_the_boresight_blinds(fmu, rng, offset, status):
    p, u, _, _ = scene(rng)
    boresight, across = dcm(multiply(u["q_SN"], p["q_KS"]))[:2]
    cone = 0.4
    sun = np.cos(cone + offset) * boresight + np.sin(cone + offset) * across
    unit = fmu("pose_sensor", PROMPT | p | {"sun_N": sun, "sun_cone": cone})
    assert rows(unit, u, 1)[0]["pose_status"] == status


@pytest.mark.parametrize("latency", [0, 0.05, 0.1, 0.3, 0.5, 0.55, 1.2, 3.5])
def test_sample_is_released_after_its_latency_not_a_step_sooner_or_later(fmu, latency):
    """Outputs at the end of the step to t: the newest sample with n P + latency < t, so that at a
    filter that samples at t - h it is the newest with n P + latency <= t - h.
    """
    unit, h = fmu("pose_sensor", {"latency": latency}), 0.05
    for k in range(1, 200):
        unit.step(h, AHEAD)
        n = int(np.ceil(np.round((k * h - latency) / P, 9))) - 1
        assert unit.get("pose_time") == (n * P if n >= 0 else -1), k * h


def test_latency_changes_the_arrival_of_a_pose_and_nothing_else(fmu, rng):
    p, u, _, _ = scene(rng)
    prompt = rows(fmu("pose_sensor", PROMPT | p), u, 20)
    late = rows(fmu("pose_sensor", p | {"latency": 3.5}), u, 27)
    for a, b in zip(prompt, late[7:], strict=True):
        assert all((a[name] == b[name]).all() for name in a)


def test_moving_bodies_are_seen_as_they_were_at_the_sample(fmu):
    """The target goes 1 m per step of 0.1 s: a pose 0.3 s old is of where it was then."""
    unit = fmu("pose_sensor", {"sigma_range_0": 0, "sigma_range_2": 0, "p_GT_T": [0, 0, 0]})
    for k in range(60):
        unit.step(0.1, {"r_TN_N": [20 + 0.5 * k, 0, 0.3]})
        if (time := unit.get("pose_time")) >= 0:
            assert unit.get("r_GK_K")[0] == pytest.approx(20 + 5 * time - 0.5, abs=1e-9)


def test_nothing_before_the_first_pose(fmu):
    unit = fmu("pose_sensor", {"latency": 0.7})
    for _ in range(2):
        assert (unit.get("pose_time"), unit.get("pose_valid")) == (-1, 0)
        assert unit.get("q_TK").tolist() == [1, 0, 0, 0]
        assert not unit.get("r_GK_K").any()
        unit.step(0.6)


def test_same_bits_for_any_steps(fmu, rng):
    p, u, _, _ = scene(rng)
    p |= {"p_outlier": 0.3, "p_flip": 0.3, "latency": 0.7}
    assert same_bits_for_any_steps(fmu, "pose_sensor", p, u)


def test_state_carries_the_poses_under_way(fmu):
    unit = fmu("pose_sensor", {"latency": 2.0})
    rows(unit, AHEAD, 5)
    saved, time = unit.slave.getFMUState(), unit.time
    first = [bits_after(unit, k) for k in range(6)]
    unit.slave.setFMUState(saved)
    unit.slave.freeFMUState(saved)
    unit.time = time
    assert [bits_after(unit, k) for k in range(6)] == first


def bits_after(unit, k):
    unit.step(P, {"r_TN_N": [20 + k, 0, 0]})
    return bits(unit)


def test_mounting_is_a_quaternion_of_a_rotation(fmu):
    """A camera that looks back (half a turn about z) sees what is behind."""
    back = np.roll(Rotation.from_euler("z", 180, degrees=True).as_quat(), 1)
    unit = fmu("pose_sensor", PROMPT | {"q_KS": back, "p_KS_S": [0, 0, 0]})
    assert rows(unit, {"r_TN_N": [-20, 0, 0]}, 1)[0]["pose_status"] == 0
    assert rows(unit, AHEAD, 1)[0]["pose_status"] == 1


@pytest.mark.parametrize(
    ("parameters", "rule"),
    [
        ({"latency": 3.6}, "latency = 3.6: must be at most 7 sample periods"),
        ({"range_max": 0.5}, "range_max = 0.5: must be above range_min"),
        ({"q_KS": [0, 0, 0, 0]}, "must be a unit quaternion"),
        ({"flip_axis": [0, 0, 0]}, "must be a unit vector"),
        ({"sun_N": [0, 0, 2]}, "must be a unit vector"),
        ({"p_flip": 2}, "p_flip = 2: must be in [0, 1]"),
        ({"p_outlier": -1}, "p_outlier = -1: must be >= 0"),
        ({"sigma_theta_1": -1}, "sigma_theta_1 = -1: must be >= 0"),
    ],
)
def test_rejected_with_the_rule(parameters, rule, tmp_path):
    assert rule in rejection("pose_sensor", parameters, tmp_path)
