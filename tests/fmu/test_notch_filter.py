# SPDX-License-Identifier: BSD-2-Clause
"""notch_filter.fmu against the bilinear transform of scipy and what a notch must do."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter

from .driver import bits
from .motion import deviation
from .rejections import rejection

T, W = 0.1, (2.5, 9.0)
NOTCHES = {
    "frequency": W,
    "force_frequency": W[::-1],
    "depth": (0.05, 0.1),
    "width": (0.7, 0.4),
    "sample_period": T,
}


INPUTS = ("M_cmd_S", "wheel_accel_cmd", "F_cmd_S")
OUTPUTS = ("M_notched_S", "wheel_accel_notched", "F_notched_S")


def response(fmu, commands, **changes):
    """The three outputs of a filter for a sequence of commands, (n, 9)."""
    unit, rows = fmu("notch_filter", NOTCHES | changes), []
    for u in commands:
        unit.step(T, dict(zip(INPUTS, u.reshape(3, 3), strict=True)))
        rows.append(np.concatenate([unit.get(name) for name in OUTPUTS]))
    return np.array(rows)


def expected(commands, frequency=W):
    """scipy's bilinear transform at the rate that puts the analogue notch at its frequency."""
    for w, z, Z in zip(frequency, NOTCHES["depth"], NOTCHES["width"], strict=True):
        k = w / np.tan(w * T / 2)
        b, a = bilinear([1, 2 * z * w, w**2], [1, 2 * Z * w, w**2], fs=k / 2)
        commands = lfilter(b, a, commands, axis=0)
    return commands


def test_notches_are_the_prewarped_bilinear_transform_on_every_axis_and_channel(fmu, rng):
    commands = rng.normal(size=(60, 9))
    torque, force = commands[:, :6], commands[:, 6:]
    both = np.hstack((expected(torque), expected(force, W[::-1])))
    assert deviation(response(fmu, commands), both) < 1e-12


@pytest.mark.verifies("L.7-3")
def test_nothing_is_commanded_before_the_first_sample(fmu):
    unit = fmu("notch_filter", NOTCHES, dict.fromkeys(INPUTS, np.ones(3)))
    assert [unit.get(name).tolist() for name in OUTPUTS] == [[0.0] * 3] * 3


@pytest.mark.verifies("L.7-2")
@pytest.mark.parametrize(("i", "gain"), [(0, 0.05 / 0.7), (1, 0.1 / 0.4)])
def test_gain_at_the_frequency_of_a_notch_is_depth_over_width(fmu, i, gain):
    """The other notch is off; after the transient of 1/(width frequency)."""
    only = np.where(np.arange(2) == i, W, 0.0)
    wave = np.sin(W[i] * T * np.arange(400))
    out = response(fmu, np.outer(wave, np.ones(9)), frequency=only, force_frequency=only)[-150:]
    basis = np.column_stack([f(W[i] * T * np.arange(250, 400)) for f in (np.sin, np.cos)])
    size = np.linalg.norm(np.linalg.lstsq(basis, out)[0], axis=0)
    assert deviation(size, gain) < 1e-9


@pytest.mark.verifies("L.7-1")
def test_a_steady_command_passes_and_without_notches_everything_does(fmu, rng):
    steady = np.tile(rng.normal(size=9), (400, 1))
    assert deviation(response(fmu, steady)[-1], steady[-1]) < 1e-12
    commands = rng.normal(size=(5, 9))
    passed = response(fmu, commands, frequency=(0, 0), force_frequency=(0, 0))
    assert np.array_equal(passed, commands)


@pytest.mark.verifies("L.7-4")
def test_result_does_not_depend_on_how_the_step_is_cut(fmu, rng):
    """Between samples the output is held, for any input."""
    u = {name: rng.normal(size=3) for name in INPUTS}
    whole, cut = (fmu("notch_filter", NOTCHES, u) for _ in range(2))
    whole.step(3)
    for _ in range(60):
        cut.step(0.05)
    assert bits(cut) == bits(whole)


@pytest.mark.verifies("L.7-5")
@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frequency": (31.5, 0)}, "frequency[1] = 31.5: must be below pi/sample_period"),
        ({"force_frequency": (9, 31.5)}, "force_frequency[2] = 31.5: must be below pi/sample"),
        ({"frequency": (0, 9), "width": (0, 0.4)}, "width[1] = 0: must be > 0"),
        ({"width": (0, 0.4)}, "width[1] = 0: must be > 0"),
        ({"frequency": (-1, 0)}, "frequency[1] = -1: must be >= 0"),
        ({"sample_period": 0}, "sample_period = 0: must be > 0"),
    ],
)
def test_notches_that_cannot_be_are_rejected(change, message, tmp_path):
    reported = rejection("notch_filter", NOTCHES | change, tmp_path)
    assert message in reported
    assert "; " not in reported
