# SPDX-License-Identifier: BSD-2-Clause
"""orbit_sensor.fmu: fixes with noise, outages, drop-outs."""

from __future__ import annotations

import numpy as np

from tests.close import close
from tests.reference.random_numbers import normals, uniforms

from .rejections import rejection
from .sensor_cases import same_bits_for_any_steps

STATE = {"r_SN_N": [7e6, -1e5, 2e4], "v_SN_N": [10, 7500, -20]}


def rows(unit, count):
    found = []
    for _ in range(count):
        unit.step(1.0, STATE)
        found.append(unit.outputs())
    return found


def test_fix_is_truth_and_noise(fmu):
    for n, row in enumerate(rows(fmu("orbit_sensor", {"seed": 2}), 20)):
        z = normals(2, 4, n, 6)
        close(row["r_fix_N"], STATE["r_SN_N"] + 5 * z[:3], rel=1e-15)
        close(row["v_fix_N"], STATE["v_SN_N"] + 0.05 * z[3:], rel=1e-15)
        assert (row["fix_time"], row["fix_valid"]) == (n, 1)


def test_nothing_before_the_first_sample(fmu):
    unit = fmu("orbit_sensor")
    assert (unit.get("fix_time"), unit.get("fix_valid")) == (-1, 0)


def test_outage_and_drop_outs_leave_time_and_zeros(fmu):
    p = {"outage_start": 3, "outage_duration": 2, "p_drop": 0.3}
    found, valid = rows(fmu("orbit_sensor", p), 40), []
    for n, row in enumerate(found):
        gone = 3 <= n < 5 or uniforms(0, 4, n, 7)[6] < 0.3
        valid.append(not gone)
        assert row["fix_valid"] == (not gone)
        assert row["fix_time"] == n
        assert np.any(row["r_fix_N"]) == np.any(row["v_fix_N"]) == (not gone)
    assert 10 < sum(valid) < 36


def test_same_bits_for_any_steps(fmu):
    assert same_bits_for_any_steps(fmu, "orbit_sensor", {}, STATE)


def test_rejected_with_the_rule(tmp_path):
    text = rejection("orbit_sensor", {"p_drop": 1.5, "sigma_fix_r": -1}, tmp_path)
    assert "p_drop = 1.5: must be in [0, 1]" in text
    assert "sigma_fix_r = -1: must be >= 0" in text
