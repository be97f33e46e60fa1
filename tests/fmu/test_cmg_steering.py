# SPDX-License-Identifier: BSD-2-Clause
"""cmg_steering.fmu: the law against numpy, null motion, limits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from .rejections import rejection

START = np.radians((54, -108, 144, 0, -144, 108))
H_W = 350.0


def jacobian(angles):
    """Columns A_i: spin axes a quarter turn ahead about their gimbals."""
    columns = []
    for k, d in enumerate(angles):
        turn = Rotation.identity()
        spin = np.array([1.0, 0, 0])
        if k:
            turn = Rotation.from_euler("ZY", (2 * np.pi / 5 * (k - 1), np.arctan(2)))
            spin = np.array([0, 1.0, 0])
        quarter = Rotation.from_rotvec((0, 0, d + np.pi / 2))
        columns.append((turn * quarter).apply(spin))
    return np.transpose(columns)


def singularity(angles):
    A = jacobian(angles)
    return np.sqrt(max(0, np.linalg.det(A @ A.T)))


def law(angles, hdot, t, k_null=0.02, lambda_0=0.01):
    A, m = jacobian(angles), singularity(angles)
    e = 0.01 * np.sin(np.pi / 2 * t + np.array((0, np.pi / 2, np.pi)))
    E = np.array([[1, e[2], e[1]], [e[2], 1, e[0]], [e[1], e[0], 1]])
    d = 1e-5
    gradient = [
        (singularity(angles + d * x) - singularity(angles - d * x)) / (2 * d) for x in np.eye(6)
    ]
    null = np.eye(6) - np.linalg.pinv(A, rcond=1e-3) @ A
    damped = A.T @ np.linalg.solve(A @ A.T + lambda_0 * np.exp(-m) * E, hdot) / H_W
    return damped + k_null * null @ gradient


def test_rates_match_the_law(fmu, rng):
    angles, hdot = rng.uniform(-3, 3, 6), rng.normal(size=3) * 5
    for t in (0.0, 0.7, 3.0):
        unit = fmu(
            "cmg_steering",
            {"gimbal_rate_max": 1e3},
            {"gimbal_angle": angles, "hdot_cmd_S": hdot},
            start=t,
        )
        assert unit.get("gimbal_rate_cmd") == pytest.approx(law(angles, hdot, t), abs=1e-8)
        assert unit.get("singularity") == pytest.approx(singularity(angles), rel=1e-9)


def test_without_damping_the_cluster_gives_what_is_required(fmu, rng):
    angles, hdot = START + rng.uniform(-0.3, 0.3, 6), rng.normal(size=3) * 5
    unit = fmu("cmg_steering", {"lambda_0": 0}, {"gimbal_angle": angles, "hdot_cmd_S": hdot})
    given = H_W * jacobian(angles) @ unit.get("gimbal_rate_cmd")
    assert given == pytest.approx(hdot, abs=1e-10)
    assert unit.get("hdot_missing_S") == pytest.approx([0, 0, 0], abs=1e-10)


@pytest.mark.verifies("E.6-2")
def test_null_motion_leaves_the_momentum_and_leads_away_from_singularities(fmu, rng):
    angles = rng.uniform(-3, 3, 6)
    before = singularity(angles)
    rates = fmu("cmg_steering", {}, {"gimbal_angle": angles}).get("gimbal_rate_cmd")
    assert jacobian(angles) @ rates == pytest.approx([0, 0, 0], abs=1e-12)
    assert singularity(angles + rates) > before
    unit = fmu("cmg_steering", {"k_null": 0}, {"gimbal_angle": angles})
    assert not unit.get("gimbal_rate_cmd").any()


@pytest.mark.verifies("E.6-3")
def test_at_a_singularity_the_rates_are_finite_and_the_dither_moves_out(fmu):
    """All wheels as far along Z as they go: A has rank 2, nothing is left along Z."""
    angles = np.array([0, *[-np.pi / 2] * 5])
    unit = fmu("cmg_steering", {}, {"gimbal_angle": angles, "hdot_cmd_S": (0, 0, 5)}, start=0.3)
    assert unit.get("singularity") < 1e-6
    rates = unit.get("gimbal_rate_cmd")
    assert np.abs(rates).max() <= 0.1
    assert unit.get("damping") == pytest.approx(0.01, rel=1e-5)
    assert unit.get("hdot_missing_S")[2] == pytest.approx(5, rel=1e-3)


@pytest.mark.verifies("E.6-1")
def test_rates_beyond_the_limit_are_scaled_together(fmu, rng):
    hdot = rng.normal(size=3)
    small, large = (fmu("cmg_steering", {"k_null": 0}, {"hdot_cmd_S": k * hdot}) for k in (1, 1000))
    rates = large.get("gimbal_rate_cmd")
    assert np.abs(rates).max() == pytest.approx(0.1, rel=1e-14)
    assert rates / 0.1 == pytest.approx(
        small.get("gimbal_rate_cmd") / np.abs(small.get("gimbal_rate_cmd")).max(), rel=1e-9
    )
    assert (small.get("rate_limited"), large.get("rate_limited")) == (0, 1)
    assert np.linalg.norm(large.get("hdot_missing_S")) > 100


@pytest.mark.verifies("E.6-4")
def test_gimbals_rest_without_the_cluster(fmu):
    unit = fmu("cmg_steering", {"use_cluster": 0}, {"hdot_cmd_S": (1, 2, 3)})
    assert not unit.get("gimbal_rate_cmd").any()


@pytest.mark.verifies("E.6-5")
def test_between_samples_the_rates_are_held(fmu):
    unit = fmu("cmg_steering", {"sample_period": 1.0}, {"hdot_cmd_S": (1, 2, 3)})
    unit.step(0.5)
    held = unit.get("gimbal_rate_cmd")
    unit.step(0.5, {"hdot_cmd_S": (-1, 2, 3)})
    assert np.array_equal(unit.get("gimbal_rate_cmd"), held)


@pytest.mark.parametrize("name", ["h_w", "gimbal_rate_max"])
def test_rejected(tmp_path, name):
    assert f"{name} = 0: must be > 0" in rejection("cmg_steering", {name: 0}, tmp_path)
