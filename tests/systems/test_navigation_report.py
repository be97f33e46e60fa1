# SPDX-License-Identifier: BSD-2-Clause
"""Figures and claims of navigation, on runs of sync_approach_navigated and on made-up histories."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib import pyplot as plt
from scipy.stats import chi2

from harness import run
from harness.mission import Verdict
from harness.results.result import Result
from ssp.shared import estimates
from ssp.shared import navigation_figures as figures
from ssp.shared.navigation_claims import CLAIMS, PAPER
from tests.missions import FIGURES, PAPERS

from ..reference.attitude import conjugate, multiply
from ..reference.cases import quaternion
from ..reference.kalman import err
from .navigated_case import Errors, recording, rms

NAMES = {"estimate_errors", "innovations", "normalised_errors", "availability"}


def verdicts_of(result: Result) -> dict[str, Verdict]:
    return {claim.name: claim.evaluate(result).verdict for claim in CLAIMS}


def changed(result: Result, name: str, factor: float) -> Result:
    """The result with one variable multiplied by a factor."""
    values = result.values.copy()
    for k, column in enumerate(result.columns):
        if column.partition("[")[0] == name:
            values[:, k] *= factor
    return replace(result, values=values)


def test_all_claims_hold_in_the_nominal_run():
    assert set(verdicts_of(recording()).values()) == {Verdict.REPRODUCED}


def test_a_blind_camera_shows_in_the_availability():
    verdicts = verdicts_of(recording("sun_blinding"))
    assert verdicts.pop("availability") is Verdict.PARTLY
    assert verdicts["errors within their bands"] is Verdict.REPRODUCED


@pytest.mark.parametrize(
    ("claim", "name", "factor"),
    [
        ("errors within their bands", "relative_filter.sigma_theta_T", 0.3),
        ("errors within their bands", "relative_filter.sigma_rho_N", 0.3),
        ("mean innovations", "orbit_filter.fix_nis", 2.0),
        ("innovations of poses", "relative_filter.pose_nis", 3.0),
        ("availability", "gyro.gyro_valid", 0.0),
    ],
)
def test_claims_can_fail(claim, name, factor):
    assert verdicts_of(changed(recording(), name, factor))[claim] is Verdict.NOT_REPRODUCED


def test_claims_belong_to_navigated_runs_only():
    assert PAPER in PAPERS
    assert PAPER.belongs_to(recording())
    assert not PAPER.belongs_to(run("sync_approach", stop=10.0))


def test_figures_are_drawn_for_navigated_runs_only():
    fitting = {figure.name for figure in FIGURES if figure.fits(recording())}
    assert NAMES | {"tracking_on_estimates"} <= fitting
    on_truth = run("sync_approach", stop=10.0)
    assert not NAMES & {figure.name for figure in FIGURES if figure.fits(on_truth)}


@pytest.mark.parametrize("figure", figures.FIGURES, ids=lambda figure: figure.name)
def test_every_figure_can_be_drawn(figure):
    canvas = plt.figure(figsize=figure.size)
    figure.draw(canvas, recording())
    assert canvas.axes
    assert all(axes.lines or axes.collections for axes in canvas.axes)
    plt.close(canvas)


def test_drawn_errors_match_the_tests():
    """Two ways from the same run."""
    rho, drho, theta, w = (part.error for part in estimates.errors(recording()))
    e = Errors(recording(), 0.0, 1800.0)
    assert rms(rho) == pytest.approx(rms(e.rho()), rel=1e-12)
    assert rms(drho) == pytest.approx(rms(e.drho()), rel=1e-12)
    assert rms(w) == pytest.approx(rms(e.target_rate()), rel=1e-12)
    assert np.degrees(rms(theta)) == pytest.approx(rms(e.target_attitude()), rel=1e-3)


def test_attitude_error_matches_the_filter():
    rng = np.random.default_rng(1)
    a, b = (np.array([quaternion(rng) for _ in range(20)]) for _ in range(2))
    expected = [err(multiply(conjugate(p), q)) for p, q in zip(a, b, strict=True)]
    assert estimates.attitude_error(a, b) == pytest.approx(np.array(expected), abs=1e-13)
    assert estimates.attitude_error(-a, b) == pytest.approx(np.array(expected), abs=1e-13)


def test_innovations_are_counted_once_each():
    """3600 poses and stars less the first of each, which is set; 1800 fixes less one."""
    counts = [
        len(estimates.innovations(recording(), f, n, s)[0]) for _, f, n, s, _ in estimates.KINDS
    ]
    assert counts == [pytest.approx(n, abs=2) for n in (3599, 3599, 1799)]


def test_bounds_match_chi_square():
    assert estimates.bounds(6) == pytest.approx(chi2.ppf((0.025, 0.975), 6))
    low, high = estimates.bounds(3, 50)
    assert (low, high) == pytest.approx(chi2.ppf((0.025, 0.975), 150) / 50)
    assert estimates.moving_mean(np.arange(6.0), 3).tolist() == [1, 2, 3, 4]
