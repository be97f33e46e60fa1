# SPDX-License-Identifier: BSD-2-Clause
"""Figures of the transposition: which are drawn, and that they show the numbers of the result."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from matplotlib.image import imread

from harness import run
from harness.figures.plots import overlay, paint, plot
from ssp.transposition.metrics import attitude_error as tracking_error
from tests.missions import FIGURES

from ..reference.assembly import turned
from ..reference.attitude import conjugate, dcm, multiply

NAMES = {"plan", "momentum", "assembly_attitude", "assembly_tracking", "gimbals", "bodies"}
NAMES |= {"assembly_torques"}
Q_OH = np.array((1.0, -1, -1, 1)) / 2


@cache
def recording(params="cluster"):
    return run("transposition", params=params)


def figure(name):
    (found,) = (f for f in FIGURES if f.name == name and f.fits(recording()))
    return paint(found, recording())


def test_every_figure_is_drawn(tmp_path, sketches):
    assert {path.stem for path in plot(recording(), tmp_path)} == NAMES


@pytest.mark.long
def test_the_files_are_pictures(tmp_path):
    for path in plot(recording(), tmp_path):
        ink = imread(path)[..., :3].min(axis=2) < 0.9
        assert 0.003 < ink.mean() < 0.6, path.name


def test_runs_are_drawn_into_one_figure(tmp_path, sketches):
    runs = {params: recording(params) for params in ("cluster", "earth_pointing")}
    assert {path.stem for path in overlay(runs, tmp_path)} == {
        "planned_momentum",
        "compared_momentum",
    }


def test_tracking_error_matches_the_controller():
    """Values of the controller at a sample are in the next row."""
    result = recording()
    expected = result["controller.attitude_error"][1:]
    assert tracking_error(result)[:-1] == pytest.approx(expected, abs=1e-12)


def test_bars_of_the_plan_are_its_peaks():
    bars = [bar.get_height() for bar in figure("plan").axes[0].patches]
    count = int(recording()["guidance.iterations"][0]) + 1
    assert bars == list(recording()["guidance.peak"][0, :count])


def test_bodies_are_where_attitude_and_arm_put_them():
    """Mean of the edges of either box: its centre in the axes of flight attitude, which the base
    turns about.
    """
    result = recording()
    rows = np.linspace(0, 5400, 6).round().astype(int)
    for axes, row in zip(figure("bodies").axes, rows, strict=True):
        q_SO = multiply(conjugate(Q_OH), result["assembly.q_SH"][row])
        arm = turned(np.array((8.5, 0, 0.05)), result["assembly.arm_angle"][row])
        expected = dcm(q_SO).T @ (np.array((9.5, 0, 0.1)) + arm)
        base, module = (np.array(c._segments3d)[:12].mean(axis=(0, 1)) for c in axes.collections)
        assert base == pytest.approx(np.zeros(3), abs=1e-12)
        assert module == pytest.approx(expected, abs=1e-9)
